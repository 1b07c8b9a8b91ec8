#pragma once
/// Input of a design: a controller without its gains, a motion, and uncertainty. And one state in the tube
/// around that motion. Controller side only: nothing of the plant.

#include <cmath>
#include <vector>

#include "firmware/cycle/controller.hpp"
#include "host_sim/scene/uncertainty.hpp"

namespace esmc::host::design {

/// A point of the motion.
struct Point {
  double time = 0.0;       ///< s; 0 for places of the workspace
  Motion2<double> now;     ///< in the reference's own space
  Motion2<double> before;  ///< at the oldest instant from which a torque acts now
};

/// Fastest motion through a place of a workspace; its directions are in Place.
struct Bounds {
  double speed = 0.0, acceleration = 0.0;  ///< of the effector, m/s and m/s2, >= 0
  double late = 0.0;                       ///< s, >= 0: largest age of the torque that acts now
};

template <class M>
struct Problem {
  ControllerConfig<M> controller;  ///< k is not read; layers only of saturation and tanh
  FiveBarParams<double> believed;  ///< RR: legs[0] and g
  UncertaintyScene uncertainty;
  std::vector<Point> points;
  std::size_t joining = 0;  ///< number of the first points that are the way onto the motion
  bool along_time = true;   ///< `points` are consecutive in time; else places of a workspace
  Bounds bounds;            ///< of a workspace
  double told_ticks = 0.0;  ///< delay that the law assumes, of torque and measurements together
  double lag = 0.0;         ///< s, >= 0: the part of it that is the delay of measurements
  Motion2<double> start;    ///< of the mechanism, in the reference's own space
};

/// Place in the tube: |e| = share_e E in direction angle_e; sigma = e' + lambda e likewise, |sigma| = share_s
/// lambda E. In a workspace also the directions of the reference's velocity and acceleration, and the share
/// of its speed.
struct Place {
  std::size_t point = 0;
  double angle_e = 0.0, share_e = 0.0, angle_s = 0.0, share_s = 0.0;
  double angle_v = 0.0, share_v = 0.0, angle_a = 0.0;
};

[[nodiscard]] inline Vec2<double> towards(double angle) { return {std::cos(angle), std::sin(angle)}; }

/// Reference at a place, now and at the instant from which a torque acts now.
template <class M>
[[nodiscard]] Motion2<double> motion_at(const Problem<M>& p, const Place& at) {
  Motion2<double> m = p.points[at.point].now;
  if (p.along_time) return m;
  m.velocity = towards(at.angle_v) * (at.share_v * p.bounds.speed);
  m.acceleration = towards(at.angle_a) * p.bounds.acceleration;
  return m;
}
template <class M>
[[nodiscard]] Motion2<double> motion_before(const Problem<M>& p, const Place& at) {
  if (p.along_time) return p.points[at.point].before;
  Motion2<double> m = motion_at(p, at);
  const double t = p.bounds.late;
  m.position += m.acceleration * (0.5 * t * t) - m.velocity * t;
  m.velocity -= m.acceleration * t;
  return m;
}

/// State at a place, in the terms of the law.
template <class M>
struct State {
  using Channels = typename M::Channels;
  Tracking<M> track;
  Vec2<double> error, error_rate;  ///< of the independent coordinates
  Channels wanted;                 ///< q''_r: acceleration of the law without its switching term
  Channels sliding;                ///< s
  Channels rates;                  ///< of the channels
  List<Channels, 2> column;        ///< C
};

/// Sets the desired pose, rates and acceleration in t from the reference m. False: out of reach.
template <class M>
[[nodiscard]] bool desired(const Problem<M>& p, const Motion2<double>& m, Tracking<M>& t) {
  const auto& c = p.controller;
  return c.reference.space == ReferenceSpace::effector
             ? desired_at_effector(c.mechanism, c.mode, m.position, m.velocity, m.acceleration,
                                   t.desired_pose, t.desired_rates, t.desired_acceleration)
             : desired_at_base(c.mechanism, c.mode, m.position, m.velocity, m.acceleration, t.desired_pose,
                               t.desired_rates, t.desired_acceleration);
}

/// Sets t.pose to the desired pose less the error e. False: out of reach, or of the working mode.
inline bool displaced(const FiveBar<double>& m, const FiveBar<double>::Mode& mode, const Vec2<double>& e,
                      Tracking<FiveBar<double>>& t) {
  return m.inverse(t.desired_pose.effector - e, mode, t.pose);
}
inline bool displaced(const Rr<double>& m, const Rr<double>::Mode& mode, const Vec2<double>& e,
                      Tracking<Rr<double>>& t) {
  t.pose = m.pose(Rr<double>::base_angles(t.desired_pose) - e);
  return Rr<double>::in_working_mode(t.pose, mode);
}

/// C at a pose: rates of the channels per rate of each independent coordinate.
template <class M>
[[nodiscard]] List<typename M::Channels, 2> columns(const M& m, const typename M::Pose& pose) {
  return {{m.channel_rates(pose, m.chain_rates(pose, Vec2<double>(1, 0))),
           m.channel_rates(pose, m.chain_rates(pose, Vec2<double>(0, 1)))}};
}

/// Sets s.wanted and s.sliding from s.track: the law without gain.
template <class M>
void ask(const Problem<M>& p, State<M>& s) {
  const auto& c = p.controller;
  Gains<M> without = c.gains;
  without.k.setZero();
  without.layer.setOnes();
  without.independent.k = 0.0;
  const Demand<M> d = demand(c.law, c.mechanism, without, Reaching::saturation, s.track);
  s.wanted = d.acceleration;
  s.sliding = d.sliding;
}

/// The state at a place of a tube of size E (m or rad). False: beyond reach, or the controller's limits.
template <class M>
[[nodiscard]] bool state_at(const Problem<M>& p, const Place& at, double tube, State<M>& s) {
  const auto& c = p.controller;
  const double lambda = c.gains.independent.lambda;
  if (!desired(p, motion_at(p, at), s.track)) return false;
  s.error = towards(at.angle_e) * (at.share_e * tube);
  const Vec2<double> sigma = towards(at.angle_s) * (at.share_s * lambda * tube);
  s.error_rate = sigma - s.error * lambda;
  if (!displaced(c.mechanism, c.mode, s.error, s.track)) return false;
  const bool all = c.motors == Motors::all && c.sensors == Sensors::all;
  if (!(M::min_abs_sin_type1(s.track.pose) >= c.limits.min_abs_sin_type1)) return false;
  if (!all && !(M::sin_type2_in_mode(s.track.pose, c.mode) >= c.limits.min_abs_sin_type2)) return false;
  s.track.rates = c.mechanism.chain_rates(s.track.pose,
                                          Vec2<double>(M::independent(s.track.desired_rates) - s.error_rate));
  s.rates = c.mechanism.channel_rates(s.track.pose, s.track.rates);
  s.column = columns(c.mechanism, s.track.pose);
  ask(p, s);
  return true;
}

}  // namespace esmc::host::design
