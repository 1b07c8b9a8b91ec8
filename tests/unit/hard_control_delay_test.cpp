/// How much gain a delay allows: the loop on the plant against the roots of the linear loop, and against the
/// bound of docs/theory.md,  (K/layer + lambda) h |H^-1 H_hat| < 2 sin(pi / (4 d + 2)).

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "firmware/mechanism/matrices.hpp"
#include "tests/support/control_loop.hpp"

namespace esmc::test {
namespace {

using M = FiveBar<double>;

constexpr double h = 1e-3, lambda = 40.0;  // s, 1/s
constexpr std::array all_laws{LawKind::esmc, LawKind::esmc_projected, LawKind::smc, LawKind::ctc};
constexpr std::array delays{0.0, 0.5, 1.0, 1.5, 2.0, 3.0};  // ticks
constexpr std::array beliefs{0.8, 1.0, 1.2};                // times m, J, lg
constexpr host::V2 place{0.02, 0.17};

/// The largest and the smallest eigenvalue of H^-1 H_hat at `place`: by these the believed masses change the
/// gain of the loop. The rule's norm is not smaller than the largest.
std::array<double, 2> mass_ratio(double belief) {
  const auto inertia = [](const FiveBarParams<double>& p) {
    const M m(p);
    const auto pose = m.inverse({place.x, place.y}, {{{1, 1}}, -1});
    return Mat<double, 2, 2>(mass_matrix(m, matrix_C(m, *pose)));
  };
  const Eigen::Matrix2d H = inertia(b7_mechanism()), hat = inertia(scaled_bars(b7_mechanism(), belief));
  const Eigen::GeneralizedSelfAdjointEigenSolver<Eigen::Matrix2d> solver(hat, H);
  return {solver.eigenvalues()[0], solver.eigenvalues()[1]};
}

/// Largest growth per tick of e'' = -ratio u(t - d h), u = (slow + kappa) e' + slow kappa e held over ticks:
/// a companion matrix of (e, h e', the last h^2 u), exact for a delay that is no whole number of ticks as
/// well.
double growth(double slow, double kappa, double delay, double ratio) {
  constexpr int past = 4;
  using State = Eigen::Matrix<double, 2 + past, 1>;
  const int whole = static_cast<int>(std::floor(delay));
  const double late = delay - whole;  // of a tick, during which the torque of one tick earlier still acts
  Eigen::Matrix<double, 2 + past, 2 + past> step;
  for (int k = 0; k < 2 + past; ++k) {
    const State z = State::Unit(k);
    const double u = (slow + kappa) * h * z[1] + slow * kappa * h * h * z[0];
    const auto earlier = [&](int ticks) { return ticks == 0 ? u : z[1 + ticks]; };
    State next;
    double e = z[0], v = z[1];
    for (const auto& [span, torque] :
         {std::pair(late, earlier(whole + 1)), std::pair(1.0 - late, earlier(whole))}) {
      e += v * span - 0.5 * ratio * torque * span * span;
      v -= ratio * torque * span;
    }
    next << e, v, u, z[2], z[3], z[4];
    step.col(k) = next;
  }
  return step.eigenvalues().cwiseAbs().maxCoeff();
}

/// Growth of a disturbance of a micrometre on the plant, per tick. Without gravity the reference is an
/// equilibrium whatever is believed; so small a motion sees the linear zone and the linear mechanism only.
double growth_on_the_plant(LoopSetup s, double delay, double belief) {
  s.truth = b7_mechanism(0.0);
  s.believed = scaled_bars(s.truth, belief);
  s.hold = place;
  s.start = host::V2{place.x + 1e-6, place.y + 5e-7};
  if (delay > 0.0) s.effects = {host::ComputeDelay{delay * h}};
  ControlLoop loop(s);
  std::array<double, 2> size{};  // of the motion in two windows
  constexpr int window = 60, first = 140, second = 400;
  for (int n = 0; n < second + window; ++n) {
    loop.tick();
    const auto o = loop.truth();
    const double now = std::hypot(o.effector_rate.x, o.effector_rate.y);
    if (n >= first && n < first + window) size[0] = std::max(size[0], now);
    if (n >= second) size[1] = std::max(size[1], now);
    if (now > 1e-2)
      return 2.0;  // grown a hundredfold and more; soon out of the linear zone, where growth ends
  }
  if (size[1] < 1e-11) return 0.0;  // rounding is all that is left
  return std::pow(size[1] / size[0], 1.0 / (second - first));
}

/// Laws with a linear zone of slope kappa = K / layer; ctc with the gains that are the same loop [F28].
LoopSetup linear_zone(LawKind law, double slow, double kappa) {
  LoopSetup s{.law = law, .reaching = Reaching::saturation, .lambda = slow, .torque_limit = 1e6};
  s.layer = 1e3;  // never left
  s.gain = kappa * s.layer;
  s.kd = slow + kappa;
  s.kp = slow * kappa;
  return s;
}

/// Largest kappa for which `rho(kappa)` stays below 1; to 0.2 %.
template <class Rho>
double threshold(const Rho& rho) {
  double low = 50.0, high = 4000.0;
  while (high > 1.002 * low) {
    const double middle = std::sqrt(low * high);
    (rho(middle) < 1.0 ? low : high) = middle;
  }
  return low;
}

double rule(double delay) { return 2.0 * std::sin(std::numbers::pi / (4.0 * delay + 2.0)); }

/// All laws, delays and beliefs. The threshold found on the plant is the one of the linear loop; half of the
/// rule is always stable; 1.3 times the rule rings, and 1.4 times where the delay is half a tick, for which
/// the rule is no fit.
TEST(Delay, RingsWhereTheLinearLoopDoesAndTheRuleHolds) {
  for (const double belief : beliefs) {
    const double ratio = mass_ratio(belief)[1];
    for (const double delay : delays) {
      const double linear = threshold([&](double kappa) { return growth(lambda, kappa, delay, ratio); });
      const double above = delay == 0.5 ? 1.4 : 1.3;
      for (const LawKind law : all_laws) {
        SCOPED_TRACE("law " + std::to_string(int(law)) + ", delay " + std::to_string(delay) + ", belief " +
                     std::to_string(belief));
        const auto on_plant = [&](double kappa) {
          return growth_on_the_plant(linear_zone(law, lambda, kappa), delay, belief);
        };
        EXPECT_NEAR(threshold(on_plant) / linear, 1.0, 0.02);
        EXPECT_LT(on_plant(0.5 * rule(delay) / (h * ratio) - lambda), 1.0);
        EXPECT_GT(on_plant(above * rule(delay) / (h * ratio) - lambda), 1.0);
      }
    }
  }
}

/// The rule counts kappa + lambda, however they share it. At half of it that must not matter.
TEST(Delay, HalfOfTheRuleIsStableHoweverLambdaAndTheLayerShareIt) {
  for (const double share : {0.02, 0.1, 0.25, 0.5, 0.75}) {
    for (const double delay : delays) {
      const double sum = 0.5 * rule(delay) / h, own = share * sum;
      EXPECT_LT(growth(own, sum - own, delay, 1.0), 1.0) << share << ' ' << delay;
      for (const LawKind law : all_laws) {
        EXPECT_LT(growth_on_the_plant(linear_zone(law, own, sum - own), delay, 1.0), 1.0)
            << "law " << int(law) << ", share of lambda " << share << ", delay " << delay;
      }
    }
  }
}

/// The implicit law chooses kappa = 1 / ((1 + told) h) by itself. Whether that rings is what the linear loop
/// says, for every true delay and belief; told the truth about mass and delay it never does.
TEST(Delay, TheImplicitLawRingsWhereItsToldDelaySaysSo) {
  int ringing = 0, calm = 0;
  for (const double told : {0.0, 1.0, 2.0, 3.0}) {
    const double kappa = 1.0 / ((1.0 + told) * h);
    for (const double belief : beliefs) {
      for (const double delay : delays) {
        const double linear = growth(lambda, kappa, delay, mass_ratio(belief)[1]);
        if (std::abs(linear - 1.0) < 0.01) continue;  // too close to call in half a second
        for (const LawKind law : {LawKind::esmc, LawKind::esmc_projected, LawKind::smc}) {
          LoopSetup s{.law = law, .lambda = lambda, .gain = 150.0, .told_delay = told, .torque_limit = 1e6};
          const double found = growth_on_the_plant(s, delay, belief);
          EXPECT_EQ(found > 1.0, linear > 1.0)
              << "law " << int(law) << ", told " << told << ", true " << delay << ", belief " << belief
              << ": " << found << ' ' << linear;
          if (belief == 1.0 && told >= delay) {
            EXPECT_LT(found, 1.0) << "told the truth";
          }
          ++(linear > 1.0 ? ringing : calm);
        }
      }
    }
  }
  EXPECT_GT(ringing, 20);  // both kinds were seen
  EXPECT_GT(calm, 20);
}

struct Tracked {
  double error = 0.0, chatter = 0.0;  ///< largest of base joints, rad; mean |change| per tick and motor, N m
};
Tracked track(LoopSetup s) {
  s.believed = scaled_bars(s.truth, 1.2);
  s.effects = {host::ComputeDelay{2e-3}};
  ControlLoop loop(s);
  Tracked out;
  Vec<double, 4> last;
  last.setZero();
  for (int n = 0; n < 2000; ++n) {
    const auto& r = loop.tick();
    if (n >= 1000) {
      for (int i = 0; i < 2; ++i) {
        const double off = loop.sample().angle[2 * i] - r.desired_base()[i];
        out.error = std::max(out.error, std::abs(std::remainder(off, 2.0 * std::numbers::pi)));
      }
      out.chatter += 0.5 * (r.torque - last).cwiseAbs().sum() / 1000.0;
    }
    last = r.torque;
  }
  return out;
}

/// B7 with +20 % believed and 2 ms of true delay, as model.md section 10 reports it of a program that shares
/// nothing with this one: ESMC told one tick rings at 3.3e-3 rad and 0.57 N m per tick, computed torque with
/// lambda = 200 stays at 1.0e-3 rad and 0.002 N m. (The second second: what the start leaves rings down
/// slowly in the latter.)
TEST(Delay, B7WithTwoMillisecondsIsAsThePrototypeFoundIt) {
  const Tracked esmc = track({.told_delay = 1.0});
  EXPECT_LT(std::abs(std::log(esmc.error / 3.3e-3)), std::log(2.0)) << esmc.error;
  EXPECT_LT(std::abs(std::log(esmc.chatter / 0.57)), std::log(2.0)) << esmc.chatter;
  const Tracked ctc = track({.law = LawKind::ctc, .kp = 4e4, .kd = 400.0});
  EXPECT_LT(std::abs(std::log(ctc.error / 1.0e-3)), std::log(2.0)) << ctc.error;
  EXPECT_LT(std::abs(std::log(ctc.chatter / 0.002)), std::log(2.0)) << ctc.chatter;
}

}  // namespace
}  // namespace esmc::test
