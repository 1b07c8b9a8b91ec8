#pragma once
/// Random legal mechanisms and random closed states in all working and assembly modes, for the firmware's
/// scalar S and, exactly the same mechanism and state, for the long double oracle. One 64-bit seed fixes a
/// case.

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>
#include <optional>
#include <random>
#include <stdexcept>
#include <string>
#include <type_traits>

#include "firmware/mechanism/five_bar.hpp"
#include "firmware/mechanism/rr.hpp"
#include "tests/support/lagrange.hpp"

namespace esmc::test {

/// Bounds may be of any arithmetic type: clang warns about every double that becomes a long double by itself.
class Random {
 public:
  explicit Random(std::uint64_t seed) : engine_(seed) {}
  template <class A, class B>
  Real between(A low, B high) {
    const Real from = static_cast<Real>(low), to = static_cast<Real>(high);
    return from + (to - from) * static_cast<Real>(engine_() >> 11U) * 0x1p-53L;
  }
  /// Same, rounded to S.
  template <class S, class A, class B>
  S in(A low, B high) {
    return static_cast<S>(between(low, high));
  }
  template <class A>
  bool chance(A probability) {
    return between(0, 1) < static_cast<Real>(probability);
  }
  int sign() { return chance(0.5) ? 1 : -1; }
  template <class S, int N, class A>
  Vec<S, N> vector(A size) {
    Vec<S, N> v;
    for (int i = 0; i < N; ++i) v[i] = in<S>(-size, size);
    return v;
  }

 private:
  std::mt19937_64 engine_;
};

/// Largest error of one quantity over many cases, and the seed of its worst case. A NaN counts as infinite.
class Accuracy {
 public:
  explicit Accuracy(std::string name) : name_(std::move(name)) {}
  void take(std::uint64_t seed, Real error) {
    if (!(error <= worst_)) {
      worst_ = std::isnan(error) ? std::numeric_limits<Real>::infinity() : error;
      seed_ = seed;
    }
  }
  /// |got - want| of a vector or matrix, relative to the largest entry of want, or to `scale` if that is
  /// larger.
  template <class A, class B>
  void compare(std::uint64_t seed, const A& got, const B& want, Real scale = 0) {
    take(seed, relative(got, want, scale));
  }
  template <class A, class B>
  static Real relative(const A& got, const B& want, Real scale = 0) {
    const auto g = got.template cast<Real>().eval();
    const auto w = want.template cast<Real>().eval();
    Real error = 0, size = scale;
    for (int i = 0; i < g.size(); ++i) {
      const Real e = std::fabs(g(i) - w(i));
      if (!(e <= error)) error = std::isnan(e) ? std::numeric_limits<Real>::infinity() : e;
      size = std::fmax(size, std::fabs(w(i)));
    }
    return error == 0 ? Real(0) : error / size;
  }
  template <class B>
  void expect_below(B bound) const {
    testing::Test::RecordProperty(name_, std::to_string(static_cast<double>(worst_ * 1e18L)) + "e-18");
    EXPECT_LE(worst_, static_cast<Real>(bound)) << name_ << ": seed " << seed_;
  }
  [[nodiscard]] Real worst() const { return worst_; }

 private:
  std::string name_;
  Real worst_ = 0;
  std::uint64_t seed_ = 0;
};

using Scalars = testing::Types<float, double>;
struct ScalarName {
  template <class S>
  static std::string GetName(int) {
    return std::is_same_v<S, float> ? "float" : "double";
  }
};

template <class S>
inline constexpr Real kEpsilon = static_cast<Real>(std::numeric_limits<S>::epsilon());

template <std::size_t N>
Vec<Real, static_cast<int>(N)> eigen(const std::array<Real, N>& a) {
  Vec<Real, static_cast<int>(N)> v;
  for (std::size_t i = 0; i < N; ++i) v[static_cast<int>(i)] = a[i];
  return v;
}

/// Two bars with lengths, masses, inertias and friction of their own; the mass centre may lie outside the
/// bar.
template <class S>
LegParams<S> random_leg(Random& r) {
  LegParams<S> p;
  p.l1 = r.in<S>(0.1, 0.4);
  p.l2 = r.in<S>(0.1, 0.4);
  p.lg1 = S(r.in<S>(-0.2, 1.1) * p.l1);
  p.lg2 = S(r.in<S>(-0.2, 1.1) * p.l2);
  p.m1 = r.in<S>(0.05, 1.0);
  p.m2 = r.in<S>(0.05, 1.0);
  p.J1 = S(r.in<S>(0.03, 0.2) * p.m1 * p.l1 * p.l1);
  p.J2 = S(r.in<S>(0.03, 0.2) * p.m2 * p.l2 * p.l2);
  if (r.chance(0.8)) {
    p.d1 = r.in<S>(0, 0.03);
    p.d2 = r.in<S>(0, 0.03);
  }
  if (r.chance(0.5)) {
    p.gamma1 = r.in<S>(0, 0.05);
    p.gamma2 = r.in<S>(0, 0.05);
  }
  return p;
}

template <class S>
Bar proximal(const LegParams<S>& p) {
  return {Real(p.l1), Real(p.lg1), 0, Real(p.m1), Real(p.J1), Real(p.d1), Real(p.gamma1)};
}
template <class S>
Bar distal(const LegParams<S>& p) {
  return {Real(p.l2), Real(p.lg2), 0, Real(p.m2), Real(p.J2), Real(p.d2), Real(p.gamma2)};
}

template <class S>
FiveBarParams<S> random_five_bar_params(Random& r) {
  FiveBarParams<S> p;
  p.l0 = r.in<S>(0.03, 0.2);
  p.m0 = r.chance(0.3) ? S(0) : r.in<S>(0.02, 1.0);
  p.g = r.chance(0.3) ? S(0) : r.in<S>(1.0, 10.0);
  p.legs = {random_leg<S>(r), random_leg<S>(r)};
  return p;
}

template <class S>
FiveBarModel oracle_of(const FiveBarParams<S>& p) {
  FiveBarModel m;
  m.bar = {proximal(p.legs[0]), distal(p.legs[0]), proximal(p.legs[1]), distal(p.legs[1])};
  m.half_base = Real(p.l0);
  m.effector_mass = Real(p.m0);
  m.gravity = Real(p.g);
  return m;
}

/// What a random 5R state must be like.
struct Wanted {
  double min_sin1 = 0.2;         ///< least |sin theta_j2|, both legs
  double min_sin2 = 0.2;         ///< least |D2|
  std::optional<double> sin1{};  ///< exactly this |sin theta_j2| in one leg instead
  std::optional<double> sin2{};  ///< exactly this |D2| instead (makes the proximal bar of leg 2 fit)
  bool from_base = false;        ///< the exact inputs are the base angles and rates, not the effector's
};

/// A mechanism in a state. Of (position, velocity) and (base, base_rate) one pair is exact in S
/// (Wanted::from_base), q and qd belong to it in long double; the other pair and theta, theta_rate are q and
/// qd rounded to S.
template <class S>
struct FiveBarCase {
  std::uint64_t seed = 0;
  FiveBarParams<S> params{};
  typename FiveBar<S>::Mode mode{};
  FiveBarModel oracle{};
  FiveBarModel::Q q{}, qd{};
  Vec2<S> position, velocity, base, base_rate;
  Vec<S, 4> theta, theta_rate;

  [[nodiscard]] FiveBar<S> mechanism() const { return FiveBar<S>(params); }
  [[nodiscard]] Vec<Real, 18> rates() const { return eigen(channel_rates(oracle, q, qd)); }
  /// C (or C_a) of the oracle.
  [[nodiscard]] Mat<Real, 18, 2> C(std::array<std::size_t, 2> known = FiveBarModel::by_effector) const {
    Mat<Real, 18, 2> out;
    for (int k = 0; k < 2; ++k) out.col(k) = eigen(channel_rates(oracle, q, column(known, k)));
    return out;
  }
  /// Rates of q for unit rate k of the known pair, counted as the model does (base joint of leg 2 clockwise).
  [[nodiscard]] FiveBarModel::Q column(std::array<std::size_t, 2> known, int k) const {
    const Real second = known == FiveBarModel::by_base ? -1 : 1;
    return oracle.rates(q, known, k == 0 ? 1 : 0, k == 0 ? 0 : second);
  }
  [[nodiscard]] Vec<Real, 18> mass() const {
    const Vec<Real, 4> J(oracle.bar[0].inertia, oracle.bar[1].inertia, oracle.bar[2].inertia,
                         oracle.bar[3].inertia);
    Vec<Real, 18> m;
    m.setZero();
    m.template head<2>().setConstant(oracle.effector_mass);
    for (int leg = 0; leg < 2; ++leg) {
      for (int k = 0; k < 2; ++k) {
        m[4 + 8 * leg + k] = J[2 * leg + k];
        m.template segment<2>(6 + 8 * leg + 2 * k)
            .setConstant(oracle.bar[static_cast<unsigned>(2 * leg + k)].mass);
      }
    }
    return m;
  }
  /// Accelerations of all channels when the six coordinates accelerate by qdd.
  [[nodiscard]] Vec<Real, 18> accelerations(const FiveBarModel::Q& qdd) const {
    return eigen(channel_accelerations(oracle, q, qd, qd, qdd));
  }
  [[nodiscard]] FiveBarModel::Q accelerate(const Vec<S, 4>& tau) const {
    return oracle.accelerate(q, qd, {Real(tau[0]), Real(tau[1]), Real(tau[2]), Real(tau[3])});
  }
};

namespace detail {

inline constexpr Real kPi = std::numbers::pi_v<long double>;

/// Angles of the bars of a leg from `base` to `tip`, bent so that sin(distal - proximal) has the sign `bend`.
inline std::optional<std::array<Real, 2>> reach(Real base, const std::array<Real, 2>& tip, Real l1, Real l2,
                                                Real bend) {
  const Real dx = tip[0] - base, dy = tip[1], r = std::hypot(dx, dy);
  const Real cosine = (l1 * l1 + r * r - l2 * l2) / (2 * l1 * r);
  if (!(std::fabs(cosine) < 1)) return std::nullopt;
  const Real a = std::atan2(dy, dx) - bend * std::acos(cosine);
  return std::array<Real, 2>{a, std::atan2(dy - l1 * std::sin(a), dx - l1 * std::cos(a))};
}

/// One attempt: draws a leg freely, fits the other, and says whether the state is as wanted.
template <class S>
bool draw_state(Random& r, const Wanted& w, FiveBarCase<S>& c) {
  FiveBarModel& m = c.oracle;
  const std::size_t free = r.chance(0.5) ? 0 : 1, fitted = 1 - free;
  // Sign of sin(distal - proximal) in N, where leg 2 is not mirrored.
  const std::array<Real, 2> bend{Real(c.mode.working[0]), -Real(c.mode.working[1])};
  const std::array<Real, 2> base{m.half_base, -m.half_base};
  const Real l1 = m.bar[2 * free].length, l2 = m.bar[2 * free + 1].length;
  Real turn = w.sin1 ? std::asin(Real(*w.sin1)) : std::asin(r.between(w.min_sin1, 1));
  if (r.chance(0.5)) turn = kPi - turn;
  const Real a = r.between(-3.14, 3.14), b = a + bend[free] * turn;
  c.q[2 + 2 * free] = a;
  c.q[3 + 2 * free] = b;
  const std::array<Real, 2> tip{base[free] + l1 * std::cos(a) + l2 * std::cos(b),
                                l1 * std::sin(a) + l2 * std::sin(b)};
  c.q[0] = tip[0];
  c.q[1] = tip[1];
  if (w.sin2) {  // distal bars nearly in line: the fitted leg's proximal bar gets the length that closes the
                 // loop
    const Real sign = fitted == 1 ? Real(1) : Real(-1);  // D2 = sin(distal of leg 2 - distal of leg 1)
    Real angle = sign * Real(c.mode.assembly) * std::asin(Real(*w.sin2));
    if (r.chance(0.5)) angle = kPi - angle;
    const Real other = b + angle, length = m.bar[2 * fitted + 1].length;
    const Real ex = tip[0] - length * std::cos(other) - base[fitted], ey = tip[1] - length * std::sin(other);
    auto& leg = c.params.legs[fitted];
    leg.l1 = static_cast<S>(std::hypot(ex, ey));
    if (leg.l1 < S(0.1) || leg.l1 > S(0.5)) return false;
    m = oracle_of(c.params);
    c.q[2 + 2 * fitted] = std::atan2(ey, ex);
    c.q[3 + 2 * fitted] = other;
  } else {
    const auto angles =
        reach(base[fitted], tip, m.bar[2 * fitted].length, m.bar[2 * fitted + 1].length, bend[fitted]);
    if (!angles) return false;
    c.q[2 + 2 * fitted] = (*angles)[0];
    c.q[3 + 2 * fitted] = (*angles)[1];
  }
  const Real s_fitted = FiveBarModel::sin_type1(c.q, static_cast<int>(fitted)),
             d2 = FiveBarModel::sin_type2(c.q);
  return s_fitted * c.mode.working[static_cast<int>(fitted)] >= Real(w.min_sin1) &&
         (w.sin2 ? d2 * c.mode.assembly > 0 : d2 * c.mode.assembly >= Real(w.min_sin2));
}

inline Real wrap(Real a) { return std::remainder(a, 2 * kPi); }

}  // namespace detail

/// The case of a seed; seed % 8 is its mode, so eight seeds in a row visit all of them.
template <class S>
FiveBarCase<S> random_five_bar(std::uint64_t seed, const Wanted& w = {}) {
  Random r(seed);
  FiveBarCase<S> c;
  c.seed = seed;
  c.mode = {{{(seed & 1U) != 0U ? 1 : -1, (seed & 2U) != 0U ? 1 : -1}}, (seed & 4U) != 0U ? 1 : -1};
  bool found = false;
  for (int attempt = 0; attempt < 20000 && !found; ++attempt) {
    c.params = random_five_bar_params<S>(r);
    c.oracle = oracle_of(c.params);
    found = detail::draw_state(r, w, c);
  }
  if (!found) throw std::runtime_error("no case for seed " + std::to_string(seed));
  const auto& by = w.from_base ? FiveBarModel::by_base : FiveBarModel::by_effector;
  for (const std::size_t k : by) {
    if (k >= 2) c.q[k] = detail::wrap(c.q[k]);
    // Leg 2 turns clockwise in the model: its base angle is pi less the angle in N.
    c.q[k] = k == 4 ? detail::kPi - Real(static_cast<S>(detail::wrap(detail::kPi - c.q[k])))
                    : Real(static_cast<S>(c.q[k]));
  }
  c.q = c.oracle.close(c.q, by);
  const Vec2<S> rate = r.vector<S, 2>(w.from_base ? 4.0 : 1.0);
  c.qd = c.oracle.rates(c.q, by, Real(rate[0]), w.from_base ? -Real(rate[1]) : Real(rate[1]));
  const auto coordinates = c.oracle.channels(c.q);
  const Row<4> joint = FiveBarModel::joint_rates(c.qd);
  const std::array<std::size_t, 4> row{2, 3, 10, 11};
  for (int i = 0; i < 4; ++i) {
    c.theta[i] = static_cast<S>(detail::wrap(coordinates[row[static_cast<unsigned>(i)]]));
    c.theta_rate[i] = static_cast<S>(joint[static_cast<unsigned>(i)]);
  }
  c.position = {static_cast<S>(c.q[0]), static_cast<S>(c.q[1])};
  c.velocity = {static_cast<S>(c.qd[0]), static_cast<S>(c.qd[1])};
  c.base = {c.theta[0], c.theta[2]};
  c.base_rate = {c.theta_rate[0], c.theta_rate[2]};
  return c;
}

/// An RR arm with exact joint angles and rates.
template <class S>
struct RrCase {
  std::uint64_t seed = 0;
  RrParams<S> params{};
  Vec2<S> theta, rate;
  Chain<2> oracle{};
  Row<2> q{}, qd{};

  [[nodiscard]] Rr<S> mechanism() const { return Rr<S>(params); }
};

template <class S>
RrCase<S> random_rr(std::uint64_t seed, double min_sin1 = 0.2) {
  Random r(seed);
  RrCase<S> c;
  c.seed = seed;
  c.params = {random_leg<S>(r), r.chance(0.3) ? S(0) : r.in<S>(1.0, 10.0)};
  c.rate = r.vector<S, 2>(6.0);
  do {
    c.theta = r.vector<S, 2>(3.14);
  } while (std::fabs(std::sin(static_cast<double>(c.theta[1]))) < min_sin1);
  c.oracle.bar = {proximal(c.params.arm), distal(c.params.arm)};
  c.oracle.gravity = Real(c.params.g);
  c.q = {Real(c.theta[0]), Real(c.theta[1])};
  c.qd = {Real(c.rate[0]), Real(c.rate[1])};
  return c;
}

}  // namespace esmc::test
