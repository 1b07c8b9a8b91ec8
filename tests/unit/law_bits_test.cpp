/// The laws to the last bit. Their formulas are held against an oracle elsewhere, within rounding errors;
/// here one ulp in any of them is another number. Only operations that IEEE 754 rounds exactly are used, so
/// it is the same number from every compiler and on every machine. A commit that changes a law on purpose
/// puts the new numbers here and says so in its message.

#include <gtest/gtest.h>

#include <array>
#include <bit>
#include <cstdint>
#include <cstring>

#include "firmware/control/fused_law.hpp"
#include "firmware/cycle/estimate.hpp"
#include "firmware/link/crc.hpp"

namespace esmc {
namespace {

/// Numerical Recipes' quick generator, 24 bits of each.
class Draw {
 public:
  template <class S>
  S between(double a, double b) {
    state_ = 1664525U * state_ + 1013904223U;
    return static_cast<S>(a + (b - a) * (static_cast<double>(state_ >> 8U) * 0x1p-24));
  }

 private:
  std::uint32_t state_ = 2015;
};

class Crc {
 public:
  template <class S, int N>
  void add(const Vec<S, N>& v) {
    for (int i = 0; i < N; ++i) {
      std::array<std::uint8_t, sizeof(S)> bytes{};
      const S value = v[i];
      std::memcpy(bytes.data(), &value, sizeof(S));
      for (const std::uint8_t b : bytes) crc_ = link::crc32_add(crc_, b);
    }
  }
  [[nodiscard]] std::uint32_t value() const { return ~crc_; }

 private:
  std::uint32_t crc_ = link::crc32_start;
};

template <class S>
LegParams<S> leg() {
  return {S(0.12), S(0.16), S(0.06), S(0.068), S(0.1),  S(0.09),
          S(2e-4), S(7e-4), S(1e-3), S(2e-3),  S(0.01), S(0.02)};
}
template <class S>
FiveBar<S> mechanism(const FiveBar<S>*) {
  FiveBarParams<S> p;
  p.l0 = S(0.05);
  p.m0 = S(0.2);
  p.g = S(9.8);
  p.legs = {leg<S>(), leg<S>()};
  p.legs[1].l2 = S(0.17);  // legs need not be equal
  return FiveBar<S>(p);
}
template <class S>
Rr<S> mechanism(const Rr<S>*) {
  return Rr<S>({leg<S>(), S(9.8)});
}
template <class S>
typename FiveBar<S>::Mode mode(const FiveBar<S>*) {
  return {{{1, 1}}, -1};
}
template <class S>
typename Rr<S>::Mode mode(const Rr<S>*) {
  return {1};
}

/// The single pass of a control tick has the bits of the law as it stands in esmc.hpp and law.hpp.
template <class M>
void expect_fused_is_plain(LawKind law, const M& m, const Gains<M>& g, Reaching reaching,
                           const Tracking<M>& t, const Demand<M>& plain) {
  using S = typename M::Scalar;
  typename M::Channels acceleration, sliding;
  fused_acceleration(law, m, g, reaching, t, acceleration, sliding);
  const auto equal = [](S a, S b) { return std::memcmp(&a, &b, sizeof(S)) == 0; };
  for (int i = 0; i < M::channels; ++i) {
    if (!M::has_mass(i)) continue;
    ASSERT_TRUE(equal(acceleration[i], plain.acceleration[i])) << int(law) << int(reaching) << ' ' << i;
    ASSERT_TRUE(equal(sliding[i], plain.sliding[i])) << int(law) << int(reaching) << ' ' << i;
  }
  const Vec2<S> torque = m.base_torque(t.pose, m.force(acceleration, t.rates)),
                same = m.base_torque(t.pose, m.force(plain.acceleration, t.rates));
  ASSERT_TRUE(equal(torque[0], same[0]) && equal(torque[1], same[1])) << int(law) << int(reaching);
}

template <class M>
std::uint32_t bits() {
  using S = typename M::Scalar;
  const M* const type = nullptr;
  const M m = mechanism(type);
  const typename M::Mode way = mode(type);
  Draw draw;
  Crc crc;
  int states = 0;
  while (states < 200) {
    const auto pair = [&](double a, double b, double c,
                          double d) {  // one draw after the other, whatever the compiler prefers
      const S x = draw.between<S>(a, b), y = draw.between<S>(c, d);
      return Vec2<S>(x, y);
    };
    const Vec2<S> here = pair(-0.05, 0.05, 0.12, 0.22), there = here + pair(-0.03, 0.03, -0.03, 0.03);
    const Vec2<S> rate = pair(-1, 1, -1, 1), wanted_rate = pair(-1, 1, -1, 1), wanted = pair(-9, 9, -9, 9);
    Tracking<M> t;
    typename M::Rates unused;
    const bool reached = desired_at_effector(m, way, here, rate, wanted, t.pose, t.rates, unused) &&
                         desired_at_effector(m, way, there, wanted_rate, wanted, t.desired_pose,
                                             t.desired_rates, t.desired_acceleration);
    if (!reached) continue;
    ++states;
    Gains<M> g;
    for (int i = 0; i < M::channels; ++i) {
      g.lambda[i] = draw.between<S>(5, 80);
      g.k[i] = draw.between<S>(0, 300);
      g.layer[i] = draw.between<S>(0.01, 2);
    }
    g.independent = {draw.between<S>(5, 80), draw.between<S>(0, 300), draw.between<S>(0.01, 2),
                     draw.between<S>(1, 900), draw.between<S>(1, 60)};
    for (const LawKind law : {LawKind::esmc, LawKind::esmc_projected, LawKind::smc, LawKind::ctc}) {
      for (const Reaching reaching :
           {Reaching::sign, Reaching::saturation, Reaching::tanh, Reaching::implicit}) {
        const Demand<M> d = demand(law, m, g, reaching, t);
        expect_fused_is_plain(law, m, g, reaching, t, d);
        crc.add(d.acceleration);
        crc.add(d.sliding);
        crc.add(m.base_torque(t.pose, m.force(d.acceleration, t.rates)));
      }
    }
    crc.add(torque_pd(g, t));
    crc.add(M::base_angles(t.pose));
  }
  return crc.value();
}

TEST(LawBits, AreTheSameFromEveryCompilerAndOnEveryMachine) {
  EXPECT_EQ(bits<FiveBar<double>>(), 2838781848U);
  EXPECT_EQ(bits<FiveBar<float>>(), 4237609237U);
  EXPECT_EQ(bits<Rr<double>>(), 1013742404U);
  EXPECT_EQ(bits<Rr<float>>(), 1207178558U);
}

}  // namespace
}  // namespace esmc
