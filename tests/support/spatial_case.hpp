#pragma once
/// Random mechanisms in space with random states, for the firmware's scalar S and, exactly the same, for the
/// oracles.

#include "host_sim/spatial/hexapod.hpp"
#include "host_sim/spatial/plant.hpp"
#include "tests/support/random_mechanism.hpp"

namespace esmc::test {

using namespace host;

template <class S>
Quaternion<S> random_attitude(Random& r) {
  Quaternion<double> q;
  do {
    q = {r.in<double>(-1, 1), r.vector<double, 3>(1)};
  } while (q.squared_norm() < 0.01 || q.squared_norm() > 1.0);
  q = normalised(q);
  return normalised(Quaternion<S>{S(q.w), q.v.template cast<S>()});
}

template <class S>
RigidBodyParams<S> random_body(Random& r) {
  RigidBodyParams<S> b;
  b.mass = r.in<S>(0.5, 3);
  // Principal inertias of a body of positive mass obey the triangle inequality.
  const S x = r.in<S>(0.005, 0.03), y = r.in<S>(0.005, 0.03), z = r.in<S>(0.005, 0.03);
  b.inertia = Vec3<S>(y + z, x + z, x + y);
  return b;
}

/// A platform of 6-UPS with points that are irregular by some centimetres.
template <class S>
HexapodParams<S> random_hexapod(Random& r) {
  HexapodParams<S> p;
  p.platform = random_body<S>(r);
  for (int j = 0; j < 6; ++j) {
    const double pair = 2.0943951 * (j / 2), side = j % 2 == 0 ? -1.0 : 1.0;
    const double low = pair + side * r.in<double>(0.75, 0.95), high = pair + side * r.in<double>(0.1, 0.3);
    p.base[j] =
        Vec3<double>(0.4 * std::cos(low), 0.4 * std::sin(low), r.in<double>(-0.03, 0.03)).template cast<S>();
    p.joint[j] =
        Vec3<double>(0.2 * std::cos(high), 0.2 * std::sin(high), r.in<double>(-0.08, 0.0)).template cast<S>();
  }
  p.home = Vec3<S>(r.in<S>(-0.03, 0.03), r.in<S>(-0.03, 0.03), r.in<S>(0.45, 0.6));
  p.cylinder = {r.in<S>(0.05, 0.2), r.in<S>(0.2, 0.8), r.in<S>(0.001, 0.005), r.in<S>(0.0001, 0.001), S(0)};
  p.rod = {r.in<S>(0.05, 0.2), r.in<S>(0.1, 0.5), r.in<S>(0.001, 0.005), r.in<S>(0.0001, 0.001),
           r.in<S>(0, 3)};
  p.gravity = r.chance(0.2) ? S(0) : r.in<S>(1, 10);
  return p;
}

template <class S>
HexapodParams<double> in_double(const HexapodParams<S>& p) {
  HexapodParams<double> d;
  d.platform = {double(p.platform.mass), p.platform.inertia.template cast<double>()};
  for (int j = 0; j < 6; ++j) {
    d.base[j] = p.base[j].template cast<double>();
    d.joint[j] = p.joint[j].template cast<double>();
  }
  d.home = p.home.template cast<double>();
  const auto strut = [](const StrutParams<S>& s) {
    return StrutParams<double>{double(s.centre), double(s.mass), double(s.transverse), double(s.axial),
                               double(s.viscous)};
  };
  d.cylinder = strut(p.cylinder);
  d.rod = strut(p.rod);
  d.gravity = double(p.gravity);
  return d;
}

/// The platform near home, tilted by up to half a radian, and moving.
template <class S>
struct PlatformState {
  Vec3<S> position;
  Quaternion<S> attitude;
  Vec<S, 6> rate;  ///< velocity in N, omega in the frame of the platform

  static PlatformState near_home(const HexapodParams<S>& p, Random& r) {
    return {p.home + r.vector<S, 3>(0.05), exponential(r.vector<S, 3>(0.3)), r.vector<S, 6>(2)};
  }
  [[nodiscard]] SpatialState plant() const {
    SpatialState s;
    s.position = position.template cast<double>();
    s.attitude << double(attitude.w), attitude.v.template cast<double>();
    s.attitude.normalize();
    s.velocity = rate.template head<3>().template cast<double>();
    s.turning = rotated(Quaternion<double>{s.attitude[0], s.attitude.template tail<3>()},
                        Vec3<double>(rate.template tail<3>().template cast<double>()));
    return s;
  }
};

/// Diagonal of M: the forces of unit accelerations. The weight is in rows of vertical velocities only, which
/// have the mass of the row before.
template <class M>
typename M::Channels mass_of(const M& m) {
  const typename M::Channels zero = M::Channels::Zero(), weight = m.force(zero, zero);
  typename M::Channels out = m.force(M::Channels::Ones().eval(), zero);
  for (int i = 1; i < M::channels; ++i) {
    if (weight[i] != 0) out[i] = out[i - 1];
  }
  return out;
}

/// p0#' of the plant's acceleration: its angular part in the frame of the platform.
inline Vec<double, 6> independent_acceleration(const SpatialState& s, const SpatialPlant::Acceleration& a) {
  const Quaternion<double> q{s.attitude[0], s.attitude.tail<3>()};
  Vec<double, 6> out;
  out << a.point, rotated(q.conjugate(), a.turning);
  return out;
}

}  // namespace esmc::test
