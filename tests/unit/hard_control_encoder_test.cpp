/// Encoders and the observer behind them: the delay they leave room for, and what a quantum of angle costs.
/// Criteria come from a linear loop written here, observer and all, with its own exponential.

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "firmware/mechanism/matrices.hpp"
#include "tests/support/control_loop.hpp"
#include "tests/support/random_mechanism.hpp"

namespace esmc::test {
namespace {

using M = FiveBar<double>;

constexpr double h = 1e-3, lambda = 40.0, bandwidth = 1000.0;
constexpr int samples = 8;  // the drive's own loop: 8 kHz

/// One joint of the linear loop: x'' = -u(t - d h), u = (lambda + kappa) w + lambda kappa p, with p and w
/// from a tracking loop of double pole e^{-bT} on y = x, sampled eight times a tick.
class LinearJoint {
 public:
  static constexpr int past = 9;
  using State = Eigen::Matrix<double, 4 + past, 1>;  // x, x', p, w, the last u
  LinearJoint(double kappa, double delay)
      : kappa_(kappa), whole_(int(std::floor(delay))), late_(delay - whole_) {
    // p + T w predicts; a miss r moves p by (1 - q^2) r and w by (1 - q)^2 r / T, both poles at q = e^{-bT}.
    constexpr double T = h / samples;
    const double q = std::exp(-bandwidth * T), stay = q * q, turn = (1.0 - q) * (1.0 - q);
    observer_ << stay, stay * T, -turn / T, 1.0 - turn;
  }
  /// The state a tick later; `noise(k)` is added to what the k-th sample sees.
  template <class Noise>
  [[nodiscard]] State step(const State& z, const Noise& noise) const {
    const double u = (lambda + kappa_) * z[3] + lambda * kappa_ * z[2];
    const auto earlier = [&](int ticks) { return ticks == 0 ? u : z[3 + ticks]; };
    const double first = -earlier(whole_ + 1), then = -earlier(whole_), change = late_ * h;
    Eigen::Vector2d seen{z[2], z[3]};
    const auto rate = [&](double t) {
      return z[1] + first * std::min(t, change) + then * std::max(0.0, t - change);
    };
    const auto place = [&](double t) {
      const double a = std::min(t, change), b = std::max(0.0, t - change);
      return z[0] + z[1] * t + first * a * (0.5 * a + b) + 0.5 * then * b * b;
    };
    for (int k = 1; k <= samples; ++k) {
      const double y = place(h * k / samples) + noise(k);
      seen = observer_ * Eigen::Vector2d(seen[0] - y, seen[1]) + Eigen::Vector2d(y, 0.0);
    }
    State next;
    next << place(h), rate(h), seen, u, z.template segment<past - 1>(4);
    return next;
  }
  [[nodiscard]] double growth() const {
    Eigen::Matrix<double, 4 + past, 4 + past> m;
    for (int k = 0; k < 4 + past; ++k) m.col(k) = step(State::Unit(k), [](int) { return 0.0; });
    return m.eigenvalues().cwiseAbs().maxCoeff();
  }
  /// Response to noise of unit variance in every sample.
  struct Response {
    double place = 0.0, jump = 0.0;  ///< rms of x, and of the change of u per tick
  };
  [[nodiscard]] Response response() const {
    Random r(7);
    State z = State::Zero();
    Response out;
    constexpr int ticks = 40000;
    for (int n = 0; n < ticks; ++n) {
      z = step(z, [&](int) { return std::sqrt(3.0) * r.in<double>(-1, 1); });
      out.place += z[0] * z[0] / ticks;
      out.jump += (z[4] - z[5]) * (z[4] - z[5]) / ticks;
    }
    return {std::sqrt(out.place), std::sqrt(out.jump)};
  }

 private:
  double kappa_;
  int whole_;
  double late_;
  Eigen::Matrix2d observer_ = Eigen::Matrix2d::Zero();
};

/// Largest delay, in ticks, that the linear loop bears.
double margin(double told) {
  double low = 0.0, high = 7.5;
  while (high - low > 1e-3) {
    const double middle = 0.5 * (low + high);
    (LinearJoint(1.0 / ((1.0 + told) * h), middle).growth() < 1.0 ? low : high) = middle;
  }
  return low;
}

LoopSetup with_encoder(int bits, double told, double delay) {
  LoopSetup s{.told_delay = told, .torque_limit = 20.0};
  s.effects = {host::Encoder{bits, bandwidth}};
  if (delay > 0.0) s.effects.emplace_back(host::ComputeDelay{delay * h});
  return s;
}

/// Without a quantum to speak of, a disturbance of a micrometre dies or grows where the linear loop says.
TEST(EncoderDelay, TheMarginIsTheOneOfTheLinearLoop) {
  const auto rings = [](double told, double delay) {
    LoopSetup s = with_encoder(45, told, delay);
    s.truth = s.believed = b7_mechanism(0.0);
    s.hold = host::V2{0.02, 0.17};
    s.start = host::V2{0.02 + 1e-6, 0.17};
    ControlLoop loop(s);
    double early = 0.0, late = 0.0;
    for (int n = 0; n < 900; ++n) {
      loop.tick();
      const auto o = loop.truth();
      const double now = std::hypot(o.effector_rate.x, o.effector_rate.y);
      if (now > 1e-2) return true;
      if (n >= 300 && n < 400) early = std::max(early, now);
      if (n >= 800) late = std::max(late, now);
    }
    return late > early;
  };
  for (const double told : {1.0, 2.0, 3.0}) {
    const double most = margin(told);
    RecordProperty("ticks_told_" + std::to_string(int(told)), std::to_string(most));
    EXPECT_GT(most, 0.1);
    EXPECT_LT(most, 7.0);
    EXPECT_FALSE(rings(told, 0.96 * most)) << "told " << told << ", margin " << most;
    EXPECT_TRUE(rings(told, 1.04 * most)) << "told " << told << ", margin " << most;
  }
}

struct Trace {
  std::vector<Vec2<double>> angle, jump;  ///< base joints, rad; change of torque per tick, N m
};
Trace follow(const LoopSetup& s) {
  ControlLoop loop(s);
  Trace out;
  Vec<double, 4> last;
  last.setZero();
  for (int n = 0; n < 1800; ++n) {
    const auto& q = loop.truth().q;
    const auto& r = loop.tick();
    EXPECT_EQ(r.state, State::running) << name(r.fault);
    if (n >= 543) {  // two rounds, start left behind
      out.angle.emplace_back(q[2], q[4]);
      out.jump.emplace_back(r.torque[0] - last[0], r.torque[2] - last[2]);
    }
    last = r.torque;
  }
  return out;
}

/// Rms over time and over both joints of the difference of two runs.
double difference(const std::vector<Vec2<double>>& a, const std::vector<Vec2<double>>& b) {
  double sum = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += 0.5 * (a[i] - b[i]).squaredNorm();
  return std::sqrt(sum / static_cast<double>(a.size()));
}

/// Rms over the circle of the rows of H_a = C_a^T M C_a: what turns noise of both u into torque.
double inertia_on_the_circle() {
  const M m(b7_mechanism());
  double sum = 0.0;
  constexpr int n = 100;
  for (int i = 0; i < n; ++i) {
    const double a = 2.0 * std::numbers::pi * i / n;
    const auto p = m.inverse({0.07 * std::cos(a), 0.17 + 0.07 * std::sin(a)}, {{{1, 1}}, -1});
    Mat<double, 18, 2> C;
    for (int k = 0; k < 2; ++k) C.col(k) = m.channel_rates(*p, m.base_rates(*p, Vec2<double>::Unit(k)));
    sum += (C.transpose() * m.mass().asDiagonal() * C).squaredNorm() / (2.0 * n);
  }
  return std::sqrt(sum);
}

/// A quantum q acts like noise of q / sqrt(12) in every sample, as long as the joints pass through quanta
/// faster than they are sampled. Error and chatter are what the linear loop makes of it, 12 to 20 bits, told
/// delay and half of the margin; within a factor of 1.4. From 12 to 20 bits, a factor of 256, the ratio stays
/// within 1.5: quanta of 12 bits are passed too slowly to be white, and that is all that is left unexplained.
TEST(EncoderQuantum, CostsWhatTheLinearLoopMakesOfIt) {
  for (const double told : {1.0, 2.0}) {
    for (const double delay : {0.0, 0.5 * margin(told)}) {
      const auto unit = LinearJoint(1.0 / ((1.0 + told) * h), delay).response();
      const double inertia = inertia_on_the_circle();
      const Trace smooth = follow(with_encoder(45, told, delay));
      std::array<double, 2> least{1e9, 1e9}, most{};
      for (const int bits : {12, 14, 16, 18, 20}) {
        const double noise = std::ldexp(2.0 * std::numbers::pi, -bits) / std::sqrt(12.0);
        const Trace run = follow(with_encoder(bits, told, delay));
        const std::array ratio{difference(run.angle, smooth.angle) / (noise * unit.place),
                               difference(run.jump, smooth.jump) / (noise * unit.jump * inertia)};
        for (std::size_t i = 0; i < 2; ++i) {
          EXPECT_GT(ratio[i], 0.7) << (i == 0 ? "error" : "chatter") << ", bits " << bits << ", told "
                                   << told;
          EXPECT_LT(ratio[i], 1.4) << (i == 0 ? "error" : "chatter") << ", bits " << bits << ", told "
                                   << told;
          least[i] = std::min(least[i], ratio[i]);
          most[i] = std::max(most[i], ratio[i]);
        }
      }
      for (std::size_t i = 0; i < 2; ++i) EXPECT_LT(most[i], 1.5 * least[i]) << i << ", told " << told;
    }
  }
}

/// Past the margin no encoder is fine enough: the loop rings to the size of its band, whatever the quantum.
TEST(EncoderQuantum, DoesNotMatterPastTheMargin) {
  const double told = 2.0, most = margin(told);
  for (const int bits : {16, 18, 20}) {
    const Trace calm = follow(with_encoder(bits, told, 0.85 * most)),
                ringing = follow(with_encoder(bits, told, 1.15 * most));
    const std::vector<Vec2<double>> none(calm.jump.size(), Vec2<double>::Zero());
    EXPECT_GT(difference(ringing.jump, none), 10.0 * difference(calm.jump, none)) << bits;
  }
}

}  // namespace
}  // namespace esmc::test
