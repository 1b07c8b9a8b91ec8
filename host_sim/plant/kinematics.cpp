#include "host_sim/plant/kinematics.hpp"

#include <cmath>

namespace esmc::host {

std::optional<std::array<double, 2>> reach(const LegParams<double>& leg, V2 p, int bend) {
  const double r = std::hypot(p.x, p.y);
  if (!(r > 0.0 && r <= leg.l1 + leg.l2 && r >= std::abs(leg.l1 - leg.l2))) return std::nullopt;
  // Half-angle form of the law of cosines: keeps its digits where acos loses half of them.
  const double far = std::sqrt((leg.l1 + leg.l2 - r) * (leg.l1 + leg.l2 + r));
  const double near = std::sqrt((r - (leg.l1 - leg.l2)) * (r + (leg.l1 - leg.l2)));
  const double theta2 = 2.0 * bend * std::atan2(far, near);
  const double theta1 =
      std::atan2(p.y, p.x) - std::atan2(leg.l2 * std::sin(theta2), leg.l1 + leg.l2 * std::cos(theta2));
  return std::array<double, 2>{std::remainder(theta1, 2.0 * std::acos(-1.0)), theta2};
}

std::optional<std::array<double, 4>> reach(const FiveBarParams<double>& m, V2 p,
                                           const std::array<int, 2>& bend) {
  const auto a = reach(m.legs[0], {p.x - m.l0, p.y}, bend[0]);
  const auto b = reach(m.legs[1], {-(p.x + m.l0), p.y}, bend[1]);
  if (!a || !b) return std::nullopt;
  return std::array<double, 4>{(*a)[0], (*a)[1], (*b)[0], (*b)[1]};
}

V2 leg_tip(const LegParams<double>& leg, const std::array<double, 2>& theta) {
  return {leg.l1 * std::cos(theta[0]) + leg.l2 * std::cos(theta[0] + theta[1]),
          leg.l1 * std::sin(theta[0]) + leg.l2 * std::sin(theta[0] + theta[1])};
}

double type2_sine(const std::array<double, 4>& theta) {
  return std::sin(theta[0] + theta[1] + theta[2] + theta[3]);
}

std::optional<std::array<double, 4>> close(const FiveBarParams<double>& m, const std::array<double, 2>& base,
                                           int assembly) {
  const V2 e1{m.l0 + m.legs[0].l1 * std::cos(base[0]), m.legs[0].l1 * std::sin(base[0])};
  const V2 e2{-m.l0 - m.legs[1].l1 * std::cos(base[1]), m.legs[1].l1 * std::sin(base[1])};
  const V2 w = e1 - e2;
  const double d = std::hypot(w.x, w.y), r1 = m.legs[0].l2, r2 = m.legs[1].l2;
  if (!(d > 0.0 && d <= r1 + r2 && d >= std::abs(r1 - r2))) return std::nullopt;
  // Triangle elbow 2, elbow 1, effector: angle at elbow 2 by half angles.
  const double angle =
      2.0 * std::atan2(std::sqrt((r1 + r2 - d) * (r1 + d - r2)), std::sqrt((d + r1 + r2) * (d + r2 - r1)));
  const double direction = std::atan2(w.y, w.x) - assembly * angle;
  const V2 p = e2 + r2 * V2{std::cos(direction), std::sin(direction)};
  const double phi12 = std::atan2(p.y - e1.y, p.x - e1.x), phi22 = std::atan2(p.y - e2.y, e2.x - p.x);
  const double turn = 2.0 * std::acos(-1.0);
  return std::array<double, 4>{base[0], std::remainder(phi12 - base[0], turn), base[1],
                               std::remainder(phi22 - base[1], turn)};
}

std::array<double, 2> joint_rates(const LegParams<double>& leg, const std::array<double, 2>& theta, V2 v) {
  const double a = theta[0] + theta[1];
  const double det = leg.l1 * leg.l2 * std::sin(theta[1]);
  const double w1 = leg.l2 * (std::cos(a) * v.x + std::sin(a) * v.y) / det;
  const double outer = -leg.l1 * (std::cos(theta[0]) * v.x + std::sin(theta[0]) * v.y) / det;
  return {w1, outer - w1};
}

}  // namespace esmc::host
