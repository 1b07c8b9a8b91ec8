#pragma once
/// Configuration and rates of all bars of a mechanism, from its base joints.

#include <array>
#include <cmath>
#include <complex>

#include <Eigen/Core>

#include "host_sim/identify/problem.hpp"

namespace esmc::host {

/// Bars 1, 2 of leg 1, then of leg 2, angles in the leg's own frame. An RR arm has the first two.
struct MotionAt {
  std::array<double, 4> angle{}, rate{};  ///< rad, rad/s, of the bars
  Eigen::Matrix<double, 4, 2> D =
      Eigen::Matrix<double, 4, 2>::Zero();  ///< rates of the bars per rate of the base joints
  Eigen::Matrix<double, 4, 2> D_dot =
      Eigen::Matrix<double, 4, 2>::Zero();  ///< its derivative along the motion, 1/s
};

/// Fills `m` from base angles (rad) and rates (rad/s). False, with `m` undefined, where the base angles fit
/// no closed mechanism or the rates are not finite (type 2).
inline bool motion_at(const IdentifyProblem& p, const std::array<double, 2>& base,
                      const std::array<double, 2>& base_rate, MotionAt& m) {
  using Complex = std::complex<double>;
  const Eigen::Vector2d w(base_rate[0], base_rate[1]);
  if (!p.five_bar) {
    m.angle = {base[0], base[0] + base[1], 0.0, 0.0};
    m.D << 1, 0, 1, 1, 0, 0, 0, 0;
  } else {
    const Complex elbow1 = p.l0 + std::polar(p.l1[0], base[0]),
                  elbow2 = -p.l0 - std::polar(p.l1[1], -base[1]);
    const Complex between = elbow1 - elbow2;
    const double d = std::abs(between), along = (d * d + p.l2[1] * p.l2[1] - p.l2[0] * p.l2[0]) / (2.0 * d);
    const double square = p.l2[1] * p.l2[1] - along * along;
    if (!(d > 0.0 && square > 0.0)) return false;
    const double side = std::sqrt(square);
    for (const double s : {side, -side}) {
      const Complex tip = elbow2 + between / d * Complex(along, s);
      m.angle = {base[0], std::arg(tip - elbow1), base[1], -std::arg(elbow2 - tip)};
      if (std::sin(m.angle[1] + m.angle[3]) * p.assembly > 0.0) break;
    }
    // Derivative of the closed loop: U (rates of the distal bars) = V (rates of the base joints).
    const auto column = [](const Complex& z) { return Eigen::Vector2d(z.real(), z.imag()); };
    const auto i = Complex(0.0, 1.0);
    const Complex bar[4] = {std::polar(p.l1[0], m.angle[0]), std::polar(p.l2[0], m.angle[1]),
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

}  // namespace esmc::host
