#include "host_sim/spatial/plant.hpp"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>

namespace esmc::host {
namespace {

using M3d = Mat<double, 3, 3>;

/// a x b = tilde(a) b.
M3d tilde(const V3d& a) {
  M3d m;
  m << 0, -a.z(), a.y(), a.z(), 0, -a.x(), -a.y(), a.x(), 0;
  return m;
}

/// Columns: the body's axes in N.
M3d axes(const Vec<double, 4>& q) {
  const double s = q[0];
  const V3d v = q.tail<3>();
  return (s * s - v.dot(v)) * M3d::Identity() + 2.0 * v * v.transpose() + 2.0 * s * tilde(v);
}

V3d down(double gravity) { return V3d(0, 0, -gravity); }

}  // namespace

/// Pose and motion of the two bodies of a leg, in N. Both have the same axes and angular velocity.
struct SpatialPlant::Leg {
  V3d base, joint;    ///< ends of the leg, m
  V3d arm;            ///< from the mass centre of the platform to the joint, m
  V3d first;          ///< axis of the universal joint that the base holds
  M3d frame;          ///< second axis of the universal joint is column 1, the leg itself column 2
  V3d omega;          ///< rad/s
  V3d cylinder, rod;  ///< mass centres
  V3d cylinder_rate, rod_rate;
  double length_rate;  ///< m/s
};

SpatialPlant::SpatialPlant(const RigidBodyParams<double>& body, double gravity)
    : body_(body), gravity_(gravity) {}

SpatialPlant::SpatialPlant(const HexapodParams<double>& p)
    : body_(p.platform), p_(p), gravity_(p.gravity), legs_(true) {}

/// The x axis of N after the shortest turn that lays z along the leg at home.
V3d SpatialPlant::slide_axis_of_home(int j) const {
  const V3d d = p_.home_direction(j).normalized();
  return V3d::UnitX() - d.x() / (1.0 + d.z()) * (V3d::UnitZ() + d);
}

SpatialPlant::Leg SpatialPlant::leg(const SpatialState& s, int j) const {
  Leg l;
  l.base = p_.base[j];
  l.arm = axes(s.attitude) * p_.joint[j];
  l.joint = s.position + l.arm;
  l.first = slide_axis_of_home(j);
  const V3d along = l.joint - l.base, rate = s.velocity + s.turning.cross(l.arm);
  const double length = along.norm();
  const V3d n = along / length, second = n.cross(l.first).normalized();
  l.frame << second.cross(n), second, n;
  l.length_rate = n.dot(rate);
  const V3d swing = n.cross(rate) / length;
  // The second axis stays perpendicular to the first: that fixes the part about the leg.
  const double about = -l.first.dot(swing.cross(second)) / l.first.dot(n.cross(second));
  l.omega = swing + about * n;
  l.cylinder = l.base + p_.cylinder.centre * n;
  l.rod = l.joint - p_.rod.centre * n;
  l.cylinder_rate = l.omega.cross(l.cylinder - l.base);
  l.rod_rate = rate + l.omega.cross(l.rod - l.joint);
  return l;
}

/// The end of a leg at the platform, whose force on it is f: its acceleration is column 0 + columns 1 to 3
/// times f. `force`: of the motor, N.
Mat<double, 3, 4> SpatialPlant::end_acceleration(const Leg& l, double force) const {
  const V3d e1 = l.frame.col(0), e2 = l.frame.col(1), n = l.frame.col(2), w = l.omega;
  const V3d to_base = l.base - l.cylinder, to_joint = l.joint - l.rod, between = l.rod - l.cylinder;
  const V3d relative = l.rod_rate - l.cylinder_rate;
  const auto inertia = [&](const StrutParams<double>& p) -> M3d {
    return l.frame * V3d(p.transverse, p.transverse, p.axial).asDiagonal() * l.frame.transpose();
  };
  const M3d Ic = inertia(p_.cylinder), Ir = inertia(p_.rod);
  // Unknowns: cylinder a, alpha; rod a, alpha; multipliers. Rows 12 on: joints, J x = gamma.
  Mat<double, 9, 12> J = Mat<double, 9, 12>::Zero();
  Vec<double, 9> gamma;
  J.block<3, 3>(0, 0) = M3d::Identity();  // the cylinder's point at the base stays
  J.block<3, 3>(0, 3) = -tilde(to_base);
  gamma.head<3>() = -w.cross(w.cross(to_base));
  J.block<1, 3>(3, 3) = e2.cross(l.first).transpose();  // first . (alpha x e2)
  gamma[3] = -l.first.dot(w.cross(w.cross(e2)));
  J.block<3, 3>(4, 3) = M3d::Identity();  // no turning in the slide
  J.block<3, 3>(4, 9) = -M3d::Identity();
  gamma.segment<3>(4).setZero();
  for (int k = 0; k < 2; ++k) {  // no shift across it
    const V3d e = k == 0 ? e1 : e2;
    J.block<1, 3>(7 + k, 0) = -e.transpose();
    J.block<1, 3>(7 + k, 6) = e.transpose();
    J.block<1, 3>(7 + k, 3) = e.cross(between).transpose();
    gamma[7 + k] = -2.0 * w.cross(e).dot(relative) - w.cross(w.cross(e)).dot(between);
  }
  Mat<double, 21, 21> K = Mat<double, 21, 21>::Zero();
  K.block<3, 3>(0, 0) = p_.cylinder.mass * M3d::Identity();
  K.block<3, 3>(3, 3) = Ic;
  K.block<3, 3>(6, 6) = p_.rod.mass * M3d::Identity();
  K.block<3, 3>(9, 9) = Ir;
  K.block<12, 9>(0, 12) = J.transpose();
  K.block<9, 12>(12, 0) = J;
  Mat<double, 21, 4> right = Mat<double, 21, 4>::Zero();
  const V3d drive = (force - p_.rod.viscous * l.length_rate) * n;
  right.col(0) << p_.cylinder.mass * down(gravity_) - drive, -w.cross(Ic * w),
      p_.rod.mass * down(gravity_) + drive, -w.cross(Ir * w), gamma;
  right.block<3, 3>(6, 1) = M3d::Identity();
  right.block<3, 3>(9, 1) = tilde(to_joint);
  const Mat<double, 21, 4> x = K.partialPivLu().solve(right);
  Mat<double, 3, 4> end = x.middleRows<3>(6) - tilde(to_joint) * x.middleRows<3>(9);
  end.col(0) += w.cross(w.cross(to_joint));
  return end;
}

SpatialPlant::Acceleration SpatialPlant::acceleration(const SpatialState& s, const Input& u) const {
  const M3d R = axes(s.attitude), I = R * body_.inertia.asDiagonal() * R.transpose();
  const V3d spin = s.turning.cross(I * s.turning);
  if (!legs_) {
    const V3d force(u[0], u[1], u[2]), moment = R * V3d(u[3], u[4], u[5]);
    return {force / body_.mass + down(gravity_), I.inverse() * (moment - spin)};
  }
  // Unknowns: a and alpha of the platform, and its force on each leg.
  Mat<double, 24, 24> A = Mat<double, 24, 24>::Zero();
  Vec<double, 24> b = Vec<double, 24>::Zero();
  A.topLeftCorner<3, 3>() = body_.mass * M3d::Identity();
  A.block<3, 3>(3, 3) = I;
  b.head<3>() = body_.mass * down(gravity_);
  b.segment<3>(3) = -spin;
  for (int j = 0; j < 6; ++j) {
    const Leg l = leg(s, j);
    const Mat<double, 3, 4> end = end_acceleration(l, u[static_cast<std::size_t>(j)]);
    // a + alpha x arm + omega x (omega x arm) = end
    const int at = 6 + 3 * j;
    A.block<3, 3>(at, 0) = M3d::Identity();
    A.block<3, 3>(at, 3) = -tilde(l.arm);
    A.block<3, 3>(at, at) = -end.rightCols<3>();
    b.segment<3>(at) = end.col(0) - s.turning.cross(s.turning.cross(l.arm));
    A.block<3, 3>(0, at) = M3d::Identity();
    A.block<3, 3>(3, at) = tilde(l.arm);
  }
  const Vec<double, 24> x = A.partialPivLu().solve(b);
  return {x.head<3>(), x.segment<3>(3)};
}

SpatialEnergy SpatialPlant::energy(const SpatialState& s) const {
  const V3d in_body = axes(s.attitude).transpose() * s.turning;
  SpatialEnergy e;
  e.kinetic =
      0.5 * body_.mass * s.velocity.squaredNorm() + 0.5 * in_body.dot(body_.inertia.cwiseProduct(in_body));
  e.potential = body_.mass * gravity_ * s.position.z();
  for (int j = 0; legs_ && j < 6; ++j) {
    const Leg l = leg(s, j);
    const V3d w = l.frame.transpose() * l.omega;
    const auto add = [&](const StrutParams<double>& p, const V3d& at, const V3d& rate) {
      e.kinetic += 0.5 * p.mass * rate.squaredNorm() +
                   0.5 * (p.transverse * (w.x() * w.x() + w.y() * w.y()) + p.axial * w.z() * w.z());
      e.potential += p.mass * gravity_ * at.z();
    };
    add(p_.cylinder, l.cylinder, l.cylinder_rate);
    add(p_.rod, l.rod, l.rod_rate);
  }
  return e;
}

double SpatialPlant::power(const SpatialState& s, const Input& u) const {
  if (!legs_) {
    return V3d(u[0], u[1], u[2]).dot(s.velocity) + (axes(s.attitude) * V3d(u[3], u[4], u[5])).dot(s.turning);
  }
  double sum = 0.0;
  for (int j = 0; j < 6; ++j) {
    const double rate = leg(s, j).length_rate;
    sum += (u[static_cast<std::size_t>(j)] - p_.rod.viscous * rate) * rate;
  }
  return sum;
}

V3d SpatialPlant::angular_momentum(const SpatialState& s) const {
  const M3d R = axes(s.attitude);
  return R * body_.inertia.cwiseProduct(R.transpose() * s.turning);
}

double SpatialPlant::step(SpatialState& s, const Input& u, double h, double& work) const {
  using Rate = Vec<double, 14>;  // of position, attitude, velocity, angular velocity; power
  const auto rate = [&](const SpatialState& at) {
    const Acceleration a = acceleration(at, u);
    const V3d v = at.attitude.tail<3>();
    Rate r;
    r << at.velocity, -0.5 * at.turning.dot(v), 0.5 * (at.attitude[0] * at.turning + at.turning.cross(v)),
        a.point, a.turning, power(at, u);
    return r;
  };
  const auto moved = [&](const Rate& r, double dt) {
    return SpatialState{s.position + dt * r.head<3>(), s.attitude + dt * r.segment<4>(3),
                        s.velocity + dt * r.segment<3>(7), s.turning + dt * r.segment<3>(10)};
  };
  const Rate k1 = rate(s), k2 = rate(moved(k1, 0.5 * h)), k3 = rate(moved(k2, 0.5 * h)),
             k4 = rate(moved(k3, h)), mean = (k1 + 2.0 * k2 + 2.0 * k3 + k4) / 6.0;
  s = moved(mean, h);
  work += h * mean[13];
  const double norm = s.attitude.norm();
  s.attitude /= norm;
  return std::abs(norm - 1.0);
}

}  // namespace esmc::host
