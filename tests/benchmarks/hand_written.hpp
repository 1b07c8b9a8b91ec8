#pragma once
/// The law `esmc` with `implicit` for an RR arm, written out as one would for this arm alone, with all that
/// the arm of the firmware knows and says: what the serial algorithm, which knows any chain, is measured
/// against. Tested against it in straight_line_test.cpp.

#include <array>

#include "firmware/control/law.hpp"
#include "firmware/mechanism/rr.hpp"
#include "firmware/numeric/elementary.hpp"

namespace esmc::test {

class HandWrittenArm {
 public:
  HandWrittenArm(const RrParams<double>& p, const Gains<Rr<double>>& g)
      : p_(p.arm), gravity_(p.g), gain_(g) {}

  /// Joint torques, N m. `s`: the sliding variables theta1, theta2, phi1, phi2, x1, y1, x2, y2.
  Vec2<double> operator()(const Tracking<Rr<double>>& t, std::array<double, 8>& s) const {
    const Vec2<double>&u1 = t.pose.arm.axis[0], &u2 = t.pose.arm.axis[1];
    const Vec2<double>&d1 = t.desired_pose.arm.axis[0], &d2 = t.desired_pose.arm.axis[1];
    const double w1 = t.rates[0], w2 = w1 + t.rates[1];
    const double v1 = t.desired_rates[0], v2 = v1 + t.desired_rates[1];
    const double a1 = t.desired_acceleration[0], a2 = a1 + t.desired_acceleration[1];

    const double turn1 = p_.J1 * channel(2, angle_between(u1, d1), v1 - w1, a1, s[2]);
    const double turn2 = p_.J2 * channel(3, angle_between(u2, d2), v2 - w2, a2, s[3]);

    // Of the unit vectors along the bars: error, its rate, acceleration of the reference.
    const double ex1 = d1.x() - u1.x(), ey1 = d1.y() - u1.y();
    const double rx1 = u1.y() * w1 - d1.y() * v1, ry1 = d1.x() * v1 - u1.x() * w1;
    const double ax1 = -d1.y() * a1 - d1.x() * v1 * v1, ay1 = d1.x() * a1 - d1.y() * v1 * v1;
    const double ex2 = d2.x() - u2.x(), ey2 = d2.y() - u2.y();
    const double rx2 = u2.y() * w2 - d2.y() * v2, ry2 = d2.x() * v2 - u2.x() * w2;
    const double ax2 = -d2.y() * a2 - d2.x() * v2 * v2, ay2 = d2.x() * a2 - d2.y() * v2 * v2;

    const double fx1 = p_.m1 * channel(4, p_.lg1 * ex1, p_.lg1 * rx1, p_.lg1 * ax1, s[4]);
    const double fy1 = p_.m1 * (channel(5, p_.lg1 * ey1, p_.lg1 * ry1, p_.lg1 * ay1, s[5]) + gravity_);
    const double fx2 = p_.m2 * channel(6, p_.l1 * ex1 + p_.lg2 * ex2, p_.l1 * rx1 + p_.lg2 * rx2,
                                       p_.l1 * ax1 + p_.lg2 * ax2, s[6]);
    const double fy2 = p_.m2 * (channel(7, p_.l1 * ey1 + p_.lg2 * ey2, p_.l1 * ry1 + p_.lg2 * ry2,
                                        p_.l1 * ay1 + p_.lg2 * ay2, s[7]) +
                                gravity_);

    const double second = turn2 + p_.lg2 * (u2.x() * fy2 - u2.y() * fx2);
    const double first =
        turn1 + p_.lg1 * (u1.x() * fy1 - u1.y() * fx1) + p_.l1 * (u1.x() * fy2 - u1.y() * fx2);
    s[0] = s[2];
    s[1] = s[3] - s[2];
    return {first + second + friction(p_.d1, p_.gamma1, t.rates[0]),
            second + friction(p_.d2, p_.gamma2, t.rates[1])};
  }

 private:
  static double angle_between(const Vec2<double>& u, const Vec2<double>& d) {
    return angle_of_unit(u.x() * d.y() - u.y() * d.x(), u.x() * d.x() + u.y() * d.y());
  }
  static double friction(double viscous, double coulomb, double rate) {
    return viscous * rate + (rate > 0 ? coulomb : (rate < 0 ? -coulomb : 0.0));
  }
  /// v' of a channel: q''_d + lambda e' + k sat(s / layer).
  [[nodiscard, gnu::always_inline]] double channel(int row, double e, double rate, double reference,
                                                   double& s) const {
    const double lambda = gain_.lambda[row];
    s = rate + lambda * e;
    const double layer = gain_.layer[row], sat = s > layer ? 1.0 : (s < -layer ? -1.0 : s / layer);
    return reference + lambda * rate + gain_.k[row] * sat;
  }

  LegParams<double> p_;
  double gravity_;
  Gains<Rr<double>> gain_;
};

}  // namespace esmc::test
