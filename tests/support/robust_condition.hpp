#pragma once
/// What a robust design promises, judged from outside: a true plant out of the intervals, as Lagrange's
/// equations of its positions (tests/support/lagrange.hpp), is driven by the firmware's law with the designed
/// gains, and the decrease of V = 1/2 sigma^T H sigma, H the true inertia, is compared with -sum M eta |s|.
/// Nothing of host_sim/design is used but its gains and the size of its tube.

#include <algorithm>

#include "host_sim/design/efforts.hpp"
#include "host_sim/design/result.hpp"
#include "tests/support/random_mechanism.hpp"

namespace esmc::test {

/// A plant and a place in the tube: numbers in [0, 1] (parameters between their ends), angles and shares.
struct Trial {
  static constexpr int parameters = 24;
  std::array<double, parameters>
      at{};  ///< per leg m1 m2 J1 J2 lg1 lg2, then gravity, payload, viscous, dry friction
  std::size_t point = 0;
  double angle_e = 0, share_e = 0, angle_s = 0, share_s = 0;
};

/// Of one trial. `slack`: (V' + sum M eta |s|) / sum M K |s|, promised to be <= 0; the gains could be scaled
/// by 1 + slack.
struct Verdict {
  bool valid = false;
  Real slack = 0;
};

inline Trial random_trial(Random& r, std::size_t points) {
  Trial t;
  const bool corner = r.chance(0.5);
  for (double& v : t.at) v = corner ? (r.chance(0.5) ? 1.0 : 0.0) : r.in<double>(0, 1);
  t.point = std::min(points - 1, static_cast<std::size_t>(r.in<double>(0, static_cast<double>(points))));
  t.angle_e = r.in<double>(0, 6.2831853);
  t.angle_s = r.in<double>(0, 6.2831853);
  t.share_e = r.chance(0.3) ? 1.0 : r.in<double>(0, 1);
  t.share_s = r.chance(0.3) ? 1.0 : r.in<double>(0.001, 1);
  return t;
}

/// A point mass at the end of a bar becomes part of it.
inline void load(Bar& b, Real mass) {
  const Real whole = b.mass + mass;
  if (!(mass != 0) || !(whole > 0)) return;
  const Real centre = (b.mass * b.centre + mass * b.length) / whole;
  b.inertia +=
      b.mass * (b.centre - centre) * (b.centre - centre) + mass * (b.length - centre) * (b.length - centre);
  b.mass = whole;
  b.centre = centre;
}

/// The true parameters of a trial.
inline FiveBarParams<double> truth_of(const FiveBarParams<double>& believed, const host::UncertaintyScene& u,
                                      const Trial& t, double& payload) {
  std::size_t next = 0;
  const auto in = [&](const host::Interval& i) { return i.lower + t.at[next++] * (i.upper - i.lower); };
  FiveBarParams<double> p = believed;
  for (auto& leg : p.legs) {
    leg.m1 *= in(u.m1);
    leg.m2 *= in(u.m2);
    leg.J1 *= in(u.J1);
    leg.J2 *= in(u.J2);
    leg.lg1 += in(u.lg1);
    leg.lg2 += in(u.lg2);
  }
  p.g *= in(u.gravity);
  payload = in(u.payload);
  for (std::size_t j = 0; j < 4; ++j) {
    auto& leg = p.legs[j / 2];
    if (u.viscous) (j % 2 == 0 ? leg.d1 : leg.d2) = in((*u.viscous)[j]);
    if (u.coulomb) (j % 2 == 0 ? leg.gamma1 : leg.gamma2) = in((*u.coulomb)[j]);
  }
  return p;
}

// The same questions to either mechanism: state from independent coordinates, true energy and acceleration,
// believed channels.
struct FiveBarOracle {
  using M = FiveBar<double>;
  using Q = FiveBarModel::Q;
  FiveBarModel truth, belief;
  Q q{}, qd{};
  FiveBarOracle(const FiveBarParams<double>& t, const FiveBarParams<double>& b, double payload)
      : truth(oracle_of(t)), belief(oracle_of(b)) {
    truth.effector_mass += Real(payload);
  }
  void place(const M::Pose& pose, const Vec2<double>& rate) {
    const Vec<double, 4> a = M::angles(pose);
    q = {Real(pose.effector.x()), Real(pose.effector.y()),  Real(a[0]),
         Real(a[0]) + Real(a[1]), detail::kPi - Real(a[2]), detail::kPi - Real(a[2]) - Real(a[3])};
    q = truth.close(q, FiveBarModel::by_effector);
    qd = truth.rates(q, FiveBarModel::by_effector, Real(rate[0]), Real(rate[1]));
  }
  /// 1/2 v^T H v, where the motion will be in `ahead` seconds.
  [[nodiscard]] Real energy(Real ahead, const Vec<Real, 2>& v) const {
    Q at = q;
    for (std::size_t i = 0; i < 6; ++i) at[i] += ahead * qd[i];
    if (ahead != 0) at = truth.close(at, FiveBarModel::by_effector);
    return kinetic<FiveBarModel, Real>(truth, at, truth.rates(at, FiveBarModel::by_effector, v[0], v[1]));
  }
  [[nodiscard]] Vec<Real, 2> acceleration(const Vec<double, 4>& tau) const {
    const Q a = truth.accelerate(q, qd, {Real(tau[0]), Real(tau[1]), Real(tau[2]), Real(tau[3])});
    return {a[0], a[1]};
  }
  [[nodiscard]] Vec<Real, 18> believed_channels(const Vec<Real, 2>& sigma) const {
    return eigen(channel_rates(belief, q, belief.rates(q, FiveBarModel::by_effector, sigma[0], sigma[1])));
  }
};

struct RrOracle {
  using M = Rr<double>;
  Chain<2> truth{}, belief{};
  Row<2> q{}, qd{};
  RrOracle(const FiveBarParams<double>& t, const FiveBarParams<double>& b, double payload) {
    truth.bar = {proximal(t.legs[0]), distal(t.legs[0])};
    truth.gravity = Real(t.g);
    belief.bar = {proximal(b.legs[0]), distal(b.legs[0])};
    belief.gravity = Real(b.g);
    load(truth.bar[1], Real(payload));
  }
  void place(const M::Pose& pose, const Vec2<double>& rate) {
    const Vec2<double> a = M::angles(pose);
    q = {Real(a[0]), Real(a[1])};
    qd = {Real(rate[0]), Real(rate[1])};
  }
  [[nodiscard]] Real energy(Real ahead, const Vec<Real, 2>& v) const {
    return kinetic<Chain<2>, Real>(truth, {q[0] + ahead * qd[0], q[1] + ahead * qd[1]}, {v[0], v[1]});
  }
  [[nodiscard]] Vec<Real, 2> acceleration(const Vec<double, 2>& tau) const {
    const Row<2> a = truth.accelerate(q, qd, {Real(tau[0]), Real(tau[1])});
    return {a[0], a[1]};
  }
  [[nodiscard]] Vec<Real, 8> believed_channels(const Vec<Real, 2>& sigma) const {
    return eigen(channel_rates(belief, q, {sigma[0], sigma[1]}));
  }
};

template <class M>
using OracleOf = std::conditional_t<M::has_type2, FiveBarOracle, RrOracle>;

/// A design under trial.
template <class M>
class Trials {
 public:
  Trials(const host::design::Problem<M>& p, const host::design::Design<M>& d)
      : p_(p), d_(d), gains_(p.controller.gains) {
    host::design::apply(p, d, gains_);
  }

  [[nodiscard]] Verdict judge(const Trial& t) const {
    const auto& c = p_.controller;
    const double lambda = c.gains.independent.lambda, E = d_.tube;
    Tracking<M> k;
    if (!host::design::desired(p_, p_.points[t.point].now, k)) return {};
    const Vec2<double> e = Vec2<double>(std::cos(t.angle_e), std::sin(t.angle_e)) * (t.share_e * E);
    const Vec2<double> sigma =
        Vec2<double>(std::cos(t.angle_s), std::sin(t.angle_s)) * (t.share_s * lambda * E);
    const Vec2<double> ed = sigma - e * lambda;
    if (!host::design::displaced(c.mechanism, c.mode, e, k)) return {};
    const Vec2<double> rate = M::independent(k.desired_rates) - ed;
    k.rates = c.mechanism.chain_rates(k.pose, rate);
    const auto asked = demand(c.law, c.mechanism, gains_, Reaching::sign, k).acceleration;
    const auto tau = host::design::effort(c, k.pose, c.mechanism.force(asked, k.rates)).torque;

    double payload = 0.0;
    const FiveBarParams<double> truth = truth_of(p_.believed, p_.uncertainty, t, payload);
    OracleOf<M> oracle(truth, p_.believed, payload);
    oracle.place(k.pose, rate);
    const Vec<Real, 2> wanted = M::independent(k.desired_acceleration).template cast<Real>(),
                       slip = sigma.template cast<Real>();
    const Vec<Real, 2> slip_rate =
        wanted - oracle.acceleration(tau) + Real(lambda) * ed.template cast<Real>();
    if (c.law == LawKind::smc) {
      Real slack = -1e9L;
      for (int i = 0; i < 2; ++i) {
        const Real size = std::fabs(slip[i]),
                   falls = slip[i] * slip_rate[i] + Real(d_.eta_independent) * size;
        slack = std::max(slack, falls / (Real(d_.k_independent) * size));
      }
      return {true, slack};
    }
    constexpr Real step = 1e-5L;
    // d/dt of 1/2 sigma^T H sigma: H grows along the motion, sigma changes
    const Real grown = (oracle.energy(step, slip) - oracle.energy(-step, slip)) / (2 * step);
    const Real falls = grown + (oracle.energy(0, slip + slip_rate) - oracle.energy(0, slip - slip_rate)) / 2;
    const auto channel = oracle.believed_channels(slip);
    const typename M::Channels mass = c.mechanism.mass();
    Real promised = 0, spent = 0;
    for (int i = 0; i < M::channels; ++i) {
      const auto& row = d_.row[static_cast<std::size_t>(i)];
      promised += Real(mass[i] * row.eta) * std::fabs(channel[i]);
      spent += Real(mass[i] * row.k) * std::fabs(channel[i]);
    }
    return {true, (falls + promised) / spent};
  }

  /// Climbs from a trial: parameters to their other end, angles and shares and the point by shrinking steps.
  [[nodiscard]] Trial worst_near(Trial best, int rounds) const {
    Real most = judge(best).slack;
    const auto attempt = [&](const Trial& t) {
      const Verdict v = judge(t);
      if (!v.valid || !(v.slack > most)) return;
      most = v.slack;
      best = t;
    };
    double turn = 0.8, share = 0.5;
    auto along = static_cast<std::ptrdiff_t>(p_.points.size() / 16);
    for (int round = 0; round < rounds; ++round) {
      for (std::size_t i = 0; i < best.at.size(); ++i) {
        for (const double end : {0.0, 1.0}) {
          Trial t = best;
          t.at[i] = end;
          attempt(t);
        }
      }
      for (const double sign : {-1.0, 1.0}) {
        Trial t = best;
        t.angle_e += sign * turn;
        attempt(t);
        t = best;
        t.angle_s += sign * turn;
        attempt(t);
        t = best;
        t.share_e = std::clamp(t.share_e + sign * share, 0.0, 1.0);
        attempt(t);
        t = best;
        t.share_s = std::clamp(t.share_s + sign * share, 0.001, 1.0);
        attempt(t);
        t = best;
        const auto moved = static_cast<std::ptrdiff_t>(t.point) + static_cast<std::ptrdiff_t>(sign) * along;
        if (moved >= 0 && moved < static_cast<std::ptrdiff_t>(p_.points.size()))
          t.point = static_cast<std::size_t>(moved);
        attempt(t);
      }
      turn *= 0.6;
      share *= 0.6;
      along = std::max<std::ptrdiff_t>(1, along / 2);
    }
    return best;
  }

 private:
  const host::design::Problem<M>& p_;
  const host::design::Design<M>& d_;
  Gains<M> gains_;
};

}  // namespace esmc::test
