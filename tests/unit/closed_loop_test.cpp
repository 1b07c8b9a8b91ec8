/// The laws of firmware/ on the plant of host_sim/: two derivations that share no equation. The law is
/// evaluated at every stage of the integrator, so that what model.md promises for continuous time must hold
/// to rounding.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "firmware/control/law.hpp"
#include "firmware/cycle/estimate.hpp"
#include "firmware/mechanism/matrices.hpp"
#include "host_sim/plant/kinematics.hpp"
#include "host_sim/plant/plant.hpp"

namespace esmc {
namespace {

using M = FiveBar<double>;
using host::FiveBarPlant;
using Channels = M::Channels;

constexpr FiveBarParams<double> asymmetric{
    0.05,
    0.08,
    9.8,
    {{{0.13, 0.17, 0.06, 0.07, 0.12, 0.09, 2e-4, 6e-4}, {0.11, 0.15, 0.05, 0.06, 0.1, 0.11, 2.5e-4, 8e-4}}}};

Gains<M> some_gains() {
  Gains<M> g;
  for (int i = 0; i < M::channels; ++i) {  // every channel its own: what holds must not hang on equal gains
    g.lambda[i] = 20.0 + i;
    g.k[i] = 5.0 + 0.5 * i;
    g.layer[i] = 0.05 + 0.01 * i;
  }
  g.independent = {20.0, 5.0, 0.05, 400.0, 40.0};
  return g;
}

/// One instant of the closed loop: state and reference, and what the plant does under the law's torque.
struct Instant {
  Tracking<M> t;
  FiveBarPlant::Angles acceleration;
  M::Rates plant_acceleration;  ///< the same, as the model names it
  Demand<M> demand;
};

class ClosedLoop {
 public:
  ClosedLoop(LawKind law, Reaching reaching, int mode1, int mode2) : law_(law), reaching_(reaching) {
    const auto q = host::reach(asymmetric, {0.03, 0.2}, {mode1, mode2});
    state_ = FiveBarPlant::from_joints(*q, {0.0, 0.0, 0.0, 0.0});
    mode_ = {{{mode1, mode2}}, host::type2_sine(*q) > 0.0 ? 1 : -1};
  }

  [[nodiscard]] Instant at(double t, const FiveBarPlant::State& s) const {
    const auto o = plant_.output(s);
    Instant out;
    out.t.pose = model_.pose({o.q[2], o.q[3], o.q[4], o.q[5]});
    out.t.rates.platform = {o.qd[0], o.qd[1]};
    out.t.rates.leg = {{Vec2<double>(o.qd[2], o.qd[3]), Vec2<double>(o.qd[4], o.qd[5])}};
    const double w = 6.0, r = 0.012, c = std::cos(w * t), n = std::sin(w * t);
    const auto d = desired_at_effector<M>(model_, mode_, {0.02 + r * c, 0.2 + r * n}, {-r * w * n, r * w * c},
                                          {-r * w * w * c, -r * w * w * n});
    out.t.desired_pose = d->pose;
    out.t.desired_rates = d->rates;
    out.t.desired_acceleration = d->acceleration;
    out.demand = demand(law_, model_, gains_, reaching_, out.t);
    const Vec2<double> tau =
        model_.base_torque(out.t.pose, model_.force(out.demand.acceleration, out.t.rates));
    out.acceleration = plant_.acceleration(s.angle, s.rate, {tau[0], 0.0, tau[1], 0.0});
    const auto joint = FiveBarPlant::joint_rates(out.acceleration);
    out.plant_acceleration = model_.base_accelerations(out.t.pose, out.t.rates, {joint[0], joint[2]});
    return out;
  }

  /// RK4 over one step; `look` sees every stage.
  template <class Look>
  void step(double t, double h, const Look& look) {
    const auto slope = [&](double at_time, FiveBarPlant::State s) {
      plant_.project(
          s.angle,
          s.rate);  // a stage lies off the closure by O(h^2); the promises are about closed mechanisms
      const Instant i = at(at_time, s);
      look(i);
      return FiveBarPlant::State{s.rate, i.acceleration};
    };
    const auto shifted = [&](const FiveBarPlant::State& k, double by) {
      FiveBarPlant::State s = state_;
      for (std::size_t i = 0; i < 4; ++i) {
        s.angle[i] += by * k.angle[i];
        s.rate[i] += by * k.rate[i];
      }
      return s;
    };
    const auto a = slope(t, state_), b = slope(t + h / 2, shifted(a, h / 2)),
               c = slope(t + h / 2, shifted(b, h / 2)), d = slope(t + h, shifted(c, h));
    for (std::size_t i = 0; i < 4; ++i) {
      state_.angle[i] += h / 6 * (a.angle[i] + 2 * b.angle[i] + 2 * c.angle[i] + d.angle[i]);
      state_.rate[i] += h / 6 * (a.rate[i] + 2 * b.rate[i] + 2 * c.rate[i] + d.rate[i]);
    }
    plant_.project(state_.angle, state_.rate);
  }

  [[nodiscard]] const M& model() const { return model_; }
  [[nodiscard]] const Gains<M>& gains() const { return gains_; }
  [[nodiscard]] Reaching reaching() const { return reaching_; }

 private:
  LawKind law_;
  Reaching reaching_;
  M model_{asymmetric};
  FiveBarPlant plant_{asymmetric};
  Gains<M> gains_ = some_gains();
  M::Mode mode_;
  FiveBarPlant::State state_;
};

Channels switched(const ClosedLoop& loop, const Channels& s) {
  Channels out;
  for (int i = 0; i < M::channels; ++i) {
    out[i] = loop.gains().k[i] * switching(loop.reaching(), s[i], loop.gains().layer[i]);
  }
  return out;
}

/// |sum of terms| relative to the sum of their magnitudes.
double relative(const Vec2<double>& sum, const Vec2<double>& magnitude) {
  return std::max(std::abs(sum[0]) / magnitude[0], std::abs(sum[1]) / magnitude[1]);
}

class EveryModeAndReaching : public testing::TestWithParam<std::tuple<int, int, Reaching>> {};

TEST_P(EveryModeAndReaching, FullLawObeysF31OnThePlant) {
  const auto [mode1, mode2, reaching] = GetParam();
  ClosedLoop loop(LawKind::esmc, reaching, mode1, mode2);
  double worst = 0.0;
  for (int n = 0; n < 200; ++n) {
    loop.step(n * 1e-3, 1e-3, [&](const Instant& i) {
      // C^T M (s' + K sw(s)) = 0 with s' = qdd_d - qdd + Lambda e', qdd from the plant.
      const M& m = loop.model();
      const Channels qdd = m.channel_accelerations(i.t.pose, i.t.rates, i.plant_acceleration);
      const Channels qdd_d =
          m.channel_accelerations(i.t.desired_pose, i.t.desired_rates, i.t.desired_acceleration);
      const Channels ed =
          m.channel_rates(i.t.desired_pose, i.t.desired_rates) - m.channel_rates(i.t.pose, i.t.rates);
      const Channels weighted = m.mass().cwiseProduct(qdd_d - qdd + loop.gains().lambda.cwiseProduct(ed) +
                                                      switched(loop, i.demand.sliding));
      const Mat<double, 18, 2> C = matrix_C(m, i.t.pose);
      const Vec2<double> size =
          C.cwiseAbs().transpose() * m.mass().cwiseProduct(qdd.cwiseAbs() + qdd_d.cwiseAbs());
      worst = std::max(worst, relative(C.transpose() * weighted, size));
    });
  }
  EXPECT_LT(worst, 1e-9);
  EXPECT_GT(worst, 0.0);  // exactly zero would mean that nothing was compared
}

TEST_P(EveryModeAndReaching, ProjectedLawDissipatesAsF33SaysOnThePlant) {
  const auto [mode1, mode2, reaching] = GetParam();
  ClosedLoop loop(LawKind::esmc_projected, reaching, mode1, mode2);
  double worst = 0.0;
  int compared = 0;
  for (int n = 0; n < 200; ++n) {
    loop.step(n * 1e-3, 1e-3, [&](const Instant& i) {
      // V = 1/2 s^T M s with s = C sigma, so V' = s^T M (C sigma' + Cdot sigma), sigma' = e'' + lambda e'
      // from the plant.
      const M& m = loop.model();
      const double lambda = loop.gains().independent.lambda;
      const Vec2<double> e = M::independent_error(i.t.desired_pose, i.t.pose);
      const Vec2<double> ed = i.t.desired_rates.platform - i.t.rates.platform;
      const Vec2<double> sigma = ed + lambda * e;
      const Vec2<double> sigma_rate =
          i.t.desired_acceleration.platform - i.plant_acceleration.platform + lambda * ed;
      const M::Rates sigma_rates = m.chain_rates(i.t.pose, sigma);
      M::Rates turning = m.chain_bias(i.t.pose, i.t.rates, sigma_rates);
      turning += m.chain_rates(i.t.pose, sigma_rate);
      const Channels s = m.channel_rates(i.t.pose, sigma_rates);
      const Channels s_rate = m.channel_accelerations(i.t.pose, i.t.rates, sigma_rates, turning);
      const double v_rate = s.dot(m.mass().cwiseProduct(s_rate));
      const double promised = -s.dot(m.mass().cwiseProduct(switched(loop, s)));
      const double size = s.cwiseAbs().dot(m.mass().cwiseProduct(s_rate.cwiseAbs()));
      if (s.norm() < 1e-2) return;  // what is left to dissipate drowns in the rounding of the accelerations
      worst = std::max(worst, std::abs(v_rate - promised) / std::max(size, std::abs(promised)));
      ++compared;
      EXPECT_LE(promised, 0.0);
    });
  }
  EXPECT_GT(compared, 50);
  EXPECT_LT(worst, 1e-9);
}

INSTANTIATE_TEST_SUITE_P(All, EveryModeAndReaching,
                         testing::Combine(testing::Values(1, -1), testing::Values(1, -1),
                                          testing::Values(Reaching::sign, Reaching::saturation,
                                                          Reaching::tanh)));

TEST(ClosedLoopDemo, ErrorVanishesUnderTheFullLaw) {
  ClosedLoop loop(LawKind::esmc, Reaching::saturation, 1, 1);
  double last = 1.0;
  for (int n = 0; n < 800; ++n) {
    loop.step(n * 1e-3, 1e-3,
              [&](const Instant& i) { last = M::independent_error(i.t.desired_pose, i.t.pose).norm(); });
  }
  EXPECT_LT(last, 1e-7);
}

/// The two derivations against each other at random states, all modes, 4 motors.
TEST(PlantAgainstModel, SameAccelerationEverywhere) {
  std::uint64_t seed = 12345;
  const auto u = [&] {
    seed = seed * 6364136223846793005ULL + 1442695040888963407ULL;
    return static_cast<double>(seed >> 11U) * 0x1p-53;
  };
  const M model(asymmetric);
  const FiveBarPlant plant(asymmetric);
  int compared = 0;
  for (int n = 0; n < 20000; ++n) {
    const std::array<int, 2> mode{u() < 0.5 ? 1 : -1, u() < 0.5 ? 1 : -1};
    const auto q = host::reach(asymmetric, {0.5 * u() - 0.25, 0.5 * u() - 0.25}, mode);
    if (!q) continue;
    const M::Pose p = model.pose({(*q)[0], (*q)[1], (*q)[2], (*q)[3]});
    if (M::min_abs_sin_type1(p) < 0.1) continue;
    const M::Rates r = model.chain_rates(p, {4 * u() - 2, 4 * u() - 2});
    const Vec<double, 4> tau(u() - 0.5, u() - 0.5, u() - 0.5, u() - 0.5);
    const auto s = FiveBarPlant::from_joints(*q, {r.leg[0][0], r.leg[0][1], r.leg[1][0], r.leg[1][1]});
    const auto a =
        FiveBarPlant::joint_rates(plant.acceleration(s.angle, s.rate, {tau[0], tau[1], tau[2], tau[3]}));
    const Mat<double, 18, 2> C = matrix_C(model, p);
    const Vec2<double> h = gather<M>(C, model.force(bias(model, p, r), r));
    const Vec2<double> force = model.gather(p, Vec2<double>::Zero(), {{tau.head<2>(), tau.tail<2>()}});
    const M::Rates acc = model.chain_accelerations(p, r, solve_spd<double>(mass_matrix(model, C), force - h));
    const Vec<double, 4> want(acc.leg[0][0], acc.leg[0][1], acc.leg[1][0], acc.leg[1][1]);
    EXPECT_LT((Vec<double, 4>(a[0], a[1], a[2], a[3]) - want).norm(), 1e-11 * (1.0 + want.norm()))
        << "sample " << n;
    ++compared;
  }
  EXPECT_GT(compared, 3000);
}

}  // namespace
}  // namespace esmc
