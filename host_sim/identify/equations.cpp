#include "host_sim/identify/equations.hpp"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

#include "host_sim/error.hpp"
#include "host_sim/record/derivatives.hpp"

namespace esmc::host {
namespace {

/// Bars 1, 2 of leg 1, then of leg 2, angles in the leg's own frame. An RR arm has the first two.
struct MotionAt {
  std::array<double, 4> angle{}, rate{};  ///< rad, rad/s, of the bars
  /// Rates of the bars per rate of the base joints, and the derivative of that along the motion, 1/s.
  Eigen::Matrix<double, 4, 2> D = Eigen::Matrix<double, 4, 2>::Zero(), D_dot = D;
};

/// False where the base angles fit no closed mechanism.
bool motion_at(const IdentifyProblem& p, const std::array<double, 2>& base,
               const std::array<double, 2>& base_rate, MotionAt& m) {
  using Plane = std::complex<double>;
  const Eigen::Vector2d w(base_rate[0], base_rate[1]);
  if (!p.five_bar) {
    m.angle = {base[0], base[0] + base[1], 0.0, 0.0};
    m.D << 1, 0, 1, 1, 0, 0, 0, 0;
  } else {
    const Plane elbow1 = p.l0 + std::polar(p.l1[0], base[0]), elbow2 = -p.l0 - std::polar(p.l1[1], -base[1]);
    const Plane between = elbow1 - elbow2;
    const double d = std::abs(between), along = (d * d + p.l2[1] * p.l2[1] - p.l2[0] * p.l2[0]) / (2.0 * d);
    const double square = p.l2[1] * p.l2[1] - along * along;
    if (!(d > 0.0 && square > 0.0)) return false;
    const double side = std::sqrt(square);
    for (const double s : {side, -side}) {
      const Plane tip = elbow2 + between / d * Plane(along, s);
      m.angle = {base[0], std::arg(tip - elbow1), base[1], -std::arg(elbow2 - tip)};
      if (std::sin(m.angle[1] + m.angle[3]) * p.assembly > 0.0) break;
    }
    // Derivative of the closed loop: U (rates of the distal bars) = V (rates of the base joints).
    const auto column = [](const Plane& z) { return Eigen::Vector2d(z.real(), z.imag()); };
    const auto i = Plane(0.0, 1.0);
    const Plane bar[4] = {std::polar(p.l1[0], m.angle[0]), std::polar(p.l2[0], m.angle[1]),
                          std::polar(p.l1[1], -m.angle[2]), std::polar(p.l2[1], -m.angle[3])};
    Eigen::Matrix2d U, V, U_dot, V_dot;
    U << column(i * bar[1]), column(-i * bar[3]);
    V << column(-i * bar[0]), column(i * bar[2]);
    Eigen::Matrix2d inverse;
    inverse << U(1, 1), -U(0, 1), -U(1, 0), U(0, 0);
    inverse *= 1.0 / (U(0, 0) * U(1, 1) - U(0, 1) * U(1, 0));
    const Eigen::Matrix2d G = inverse * V;
    const Eigen::Vector2d outer = G * w;
    U_dot << column(-bar[1] * outer[0]), column(-bar[3] * outer[1]);
    V_dot << column(bar[0] * w[0]), column(bar[2] * w[1]);
    const Eigen::Matrix2d G_dot = inverse * (V_dot - U_dot * G);
    m.D << 1.0, 0.0, G(0, 0), G(0, 1), 0.0, 1.0, G(1, 0), G(1, 1);
    m.D_dot << 0.0, 0.0, G_dot(0, 0), G_dot(0, 1), 0.0, 0.0, G_dot(1, 0), G_dot(1, 1);
  }
  const Eigen::Vector4d rate = m.D * w;
  for (int k = 0; k < 4; ++k) m.rate[static_cast<std::size_t>(k)] = rate[k];
  return rate.allFinite() && m.D_dot.allFinite();
}

constexpr auto rate_half = derivative_half;

double sign(double v) { return v > 0.0 ? 1.0 : (v < 0.0 ? -1.0 : 0.0); }

Tick tick_of(const IdentifyProblem& p, const MotionAt& m) {
  const int inertial = inertial_columns(p.five_bar), joints = joints_of(p.five_bar);
  Tick t{Matrix::Zero(2, inertial + 2 * joints),
         Matrix::Zero(2, inertial + 2 * joints),
         {},
         {},
         {},
         Matrix::Zero(2, joints)};
  const auto rate = [&](int bar) { return m.rate[static_cast<std::size_t>(bar)]; };
  const auto angle = [&](int bar) { return m.angle[static_cast<std::size_t>(bar)]; };
  for (int leg = 0; leg < joints / 2; ++leg) {
    const int one = 2 * leg, two = one + 1, column = per_leg * leg;
    const Eigen::Vector2d D1 = m.D.row(one), D2 = m.D.row(two), E1 = m.D_dot.row(one), E2 = m.D_dot.row(two);
    const double between = angle(two) - angle(one), l1 = p.l1[static_cast<std::size_t>(leg)];
    const double c = l1 * std::cos(between), s = l1 * std::sin(between);
    // T = a w1^2 / 2 + c w2^2 / 2 + h l1 cos(phi2 - phi1) w1 w2; V = g (s sin phi1 + h sin phi2)
    t.momentum.col(column) = D1 * rate(one);
    t.force.col(column) = -E1 * rate(one);
    t.momentum.col(column + 1) = D2 * rate(two);
    t.force.col(column + 1) = -E2 * rate(two);
    t.momentum.col(column + 2) = c * (D1 * rate(two) + D2 * rate(one));
    t.force.col(column + 2) = -c * (E1 * rate(two) + E2 * rate(one)) - s * rate(one) * rate(two) * (D1 - D2) +
                              p.gravity * std::cos(angle(two)) * D2;
    t.force.col(column + 3) = p.gravity * std::cos(angle(one)) * D1;
    if (leg == 0 && p.five_bar) {  // a mass at the tip of leg 1
      const double l2 = p.l2[0], w1 = rate(one), w2 = rate(two);
      const Eigen::Vector2d q1 = l1 * l1 * D1, q2 = l2 * l2 * D2;
      t.momentum.col(2 * per_leg) = q1 * w1 + q2 * w2 + l2 * t.momentum.col(column + 2);
      t.force.col(2 * per_leg) = -l1 * l1 * E1 * w1 - l2 * l2 * E2 * w2 + l2 * t.force.col(column + 2) +
                                 l1 * t.force.col(column + 3);
    }
    t.joint.row(one) = D1.transpose();
    t.joint.row(two) = (D2 - D1).transpose();
    t.joint_dot.row(one) = E1.transpose();
    t.joint_dot.row(two) = (E2 - E1).transpose();
    t.angle[one] = angle(one);
    t.angle[two] = between;
    const double relative[2] = {rate(one), rate(two) - rate(one)};
    for (int k = 0; k < 2; ++k) {
      const Eigen::Vector2d J = t.joint.row(one + k);
      t.relative[one + k] = relative[k];
      t.force.col(inertial + one + k) = J * relative[k];
      t.force.col(inertial + joints + one + k) = J * sign(relative[k]);
    }
  }
  if (!p.five_bar) t.joint.bottomRows<2>().setZero();
  return t;
}

/// Smooth windows over ticks: sin^4, zero with three derivatives at both ends. `u` in ticks from the
/// beginning.
struct Window {
  double length;
  [[nodiscard]] double value(double u) const {
    return u <= 0.0 || u >= length ? 0.0 : std::pow(std::sin(std::numbers::pi * u / length), 4);
  }
  [[nodiscard]] double slope(double u) const {
    if (u <= 0.0 || u >= length) return 0.0;
    const double x = std::numbers::pi * u / length, s = std::sin(x);
    return 4.0 * s * s * s * std::cos(x) * std::numbers::pi / length;
  }
  /// Integral of the window from 0 to u, ticks.
  [[nodiscard]] double integral(double u) const {
    const double x = std::clamp(u, 0.0, length) * std::numbers::pi / length;
    return (3.0 * x / 8.0 - std::sin(2.0 * x) / 4.0 + std::sin(4.0 * x) / 32.0) * length / std::numbers::pi;
  }
};

}  // namespace

Equations::Equations(const IdentifyProblem& p) : p_(p), length_(std::round(p.window / p.tick)) {
  const Window window{length_};
  const auto slope = slope_weights();
  ticks_.reserve(p.torque.size());
  for (std::size_t n = rate_half; n + rate_half < p.torque.size(); ++n) {
    std::array<double, 2> rate{};
    for (std::size_t k = 0; k < slope.size(); ++k) {
      for (std::size_t j = 0; j < 2; ++j) rate[j] += slope[k] * p.angle[j][n + k - rate_half] / p.tick;
    }
    MotionAt m;
    if (!motion_at(p, {p.angle[0][n], p.angle[1][n]}, rate, m))
      refuse(
          "row {}: the measured base angles fit no closed mechanism with the scene's lengths: calibrate "
          "them first",
          n + 1);
    ticks_.push_back(tick_of(p, m));
  }
  // A rate is smoothed over some ticks, and the kink that friction makes of it where it turns round shifts
  // that instant. By how much is one more unknown per joint, which is not reported.
  for (std::size_t n = 1; n < ticks_.size(); ++n) {
    for (Eigen::Index k = 0; k < ticks_[n].reversal.cols(); ++k) {
      const double turned = sign(ticks_[n].relative[k]) - sign(ticks_[n - 1].relative[k]);
      ticks_[n].reversal.col(k) = turned * ticks_[n].joint.row(k).transpose();
    }
  }
  const auto length = static_cast<std::size_t>(length_),
             hop = std::max<std::size_t>(1, length / hops_per_window);
  // The torque of a window may have been asked before it: `margin` ticks of it stay free at either end.
  const std::size_t margin = static_cast<std::size_t>(std::min(delay_max, 0.5 * length_));
  for (std::size_t first = margin; first + length + margin < ticks_.size(); first += hop)
    first_.push_back(first);
  const double mean = 1.0 / (p.tick * window.integral(length_));
  for (std::size_t i = 0; i < length; ++i) {
    share_.push_back(p.tick * mean * window.value(static_cast<double>(i)));
    slope_.push_back(-mean * window.slope(static_cast<double>(i)));
  }
  W = Matrix::Zero(2 * static_cast<Eigen::Index>(first_.size()), ticks_.front().momentum.cols());
  reversal = Matrix::Zero(W.rows(), ticks_.front().reversal.cols());
  for (std::size_t k = 0; k < first_.size(); ++k) {
    auto rows = W.middleRows<2>(2 * static_cast<Eigen::Index>(k));
    for (std::size_t i = 1; i < length; ++i) {
      const Tick& t = ticks_[first_[k] + i];
      reversal.middleRows<2>(2 * static_cast<Eigen::Index>(k)) += share_[i] * t.reversal;
      rows += share_[i] * t.force + slope_[i] * t.momentum;
    }
  }
  known_ = windowed([&](const Tick& t, double mean_of, double momentum_of) -> Eigen::Vector2d {
    Eigen::Vector2d out = Eigen::Vector2d::Zero();
    for (int j = 0; j < joints_of(p.five_bar); ++j) {
      const auto u = static_cast<std::size_t>(j);
      const double ripple =
          p.ripple_amplitude[u] * std::sin(p.ripple_per_turn[u] * t.angle[j] + p.ripple_phase[u]);
      out += (p.asymmetry[u] - ripple) * mean_of * t.joint.row(j).transpose() +
             p.rotor[u] * t.relative[j] *
                 (momentum_of * t.joint.row(j) - mean_of * t.joint_dot.row(j)).transpose();
    }
    return out;
  });
}

Vector Equations::torque(double delay, int joint) const {
  const Window window{length_};
  Vector out = Vector::Zero(W.rows());
  if (joint < 0) out -= known_;
  const double whole = window.integral(length_);
  const auto length = static_cast<std::ptrdiff_t>(length_);
  const auto reach = static_cast<std::ptrdiff_t>(std::ceil(std::abs(delay))) + 2;
  for (std::size_t k = 0; k < first_.size(); ++k) {
    const auto first = static_cast<std::ptrdiff_t>(first_[k]);
    for (std::ptrdiff_t i = -reach; i < length + reach; ++i) {
      const double u = static_cast<double>(i) + delay;  // where this tick's torque begins to act
      const double share = window.integral(u + 1.0) - window.integral(u);
      const std::ptrdiff_t asked = first + i + static_cast<std::ptrdiff_t>(rate_half);
      if (share == 0.0 || asked < 0 || asked >= static_cast<std::ptrdiff_t>(p_.torque.size())) continue;
      // Gathered on the base joints where the mechanism is, on average, while it acts.
      const double middle =
          std::clamp(static_cast<double>(first) + u + 0.5, 0.0, static_cast<double>(ticks_.size() - 2));
      const auto at = static_cast<std::size_t>(middle);
      const double beyond = middle - static_cast<double>(at);
      const auto& tau = p_.torque[static_cast<std::size_t>(asked)];
      Eigen::Vector4d asked_of(tau[0], tau[1], tau[2], tau[3]);
      if (joint >= 0) asked_of = asked_of[joint] * Eigen::Vector4d::Unit(joint);
      out.segment<2>(2 * static_cast<Eigen::Index>(k)) +=
          share / whole * (ticks_[at].joint * (1.0 - beyond) + ticks_[at + 1].joint * beyond).transpose() *
          asked_of;
    }
  }
  return out;
}

}  // namespace esmc::host
