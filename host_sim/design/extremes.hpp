#pragma once
/// Extremes of delta [F34] over the uncertain parameters at one state, with [F36] for the mass centres. A row
/// depends on one bar, payload and gravity, linearly but for the place of the mass centre, which enters row
/// phi as a square: its extremes are at corners, and at the vertex of that square.

#include <array>
#include <cmath>
#include <tuple>
#include <vector>

#include "firmware/cycle/instances.hpp"
#include "host_sim/scene/friction.hpp"
#include "host_sim/scene/uncertainty.hpp"

namespace esmc::host::design {

/// The part of leg j of a mechanism, a pose or rates.
template <class T>
const auto& leg_of(const T& of, [[maybe_unused]] int j) {
  if constexpr (requires { of.leg(j); }) {
    return of.leg(j);
  } else if constexpr (requires { of.leg[j]; }) {
    return of.leg[j];
  } else if constexpr (requires { of.arm(); }) {
    return of.arm();
  } else if constexpr (requires { of.arm; }) {
    return of.arm;
  } else {
    return of;
  }
}

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

/// Input of a design: a controller without its gains, a motion, and uncertainty. Nothing of the plant.
template <class M>
struct Problem {
  ControllerConfig<M> controller;  ///< k is not read; layers only of saturation and tanh
  FiveBarParams<double> believed;  ///< RR: legs[0] and g
  UncertaintyScene uncertainty;
  std::vector<Point> points;
  std::size_t joining = 0;      ///< number of the first points that are the way onto the motion
  bool along_time = true;       ///< `points` are consecutive in time; else places of a workspace
  Bounds bounds;                ///< of a workspace
  double told_ticks = 0.0;      ///< delay that the law assumes, of torque and measurements together
  double lag = 0.0;             ///< s, >= 0: the part of it that is the delay of measurements
  Motion2<double> start;        ///< of the mechanism, in the reference's own space
  void (*between)() = nullptr;  ///< called now and then, where given; may throw, which ends the design
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

/// Parameters that are uncertain, as the causes of a gain. `count` is no cause and has no name().
enum class Cause { mass, mass_centre, inertia, gravity, payload, friction, count };
[[nodiscard]] inline const char* name(Cause c) {
  constexpr std::array names{"mass", "mass centre", "inertia", "gravity", "payload", "friction"};
  return names[static_cast<std::size_t>(c)];
}

/// Smallest and largest value.
struct Span {
  double low = 0.0, high = 0.0;
  /// Adds a to low and b to high; hold() widens the span to contain v.
  void add(double a, double b) {
    low += a;
    high += b;
  }
  void hold(double v) {
    low = std::min(low, v);
    high = std::max(high, v);
  }
  [[nodiscard]] double size() const { return std::max(std::abs(low), std::abs(high)); }
};
inline constexpr Span nothing{1e300, -1e300};  ///< empty; hold() makes it the span of one value

/// Values of one bar.
struct Corner {
  double m, J, offset;  ///< kg, kg m2; true less believed place of the mass centre, m
};
/// Intervals of one bar.
struct Box {
  Interval m, J, offset;
  Corner believed;
};

/// A bar in a state: its rows and their accelerations.
struct Bar {
  int angle = 0, x = 0;  ///< rows
  Vec2<double> along;    ///< axis
  Vec2<double> a;        ///< wanted, of the believed mass centre
  double alpha = 0, omega = 0, omega_r = 0;
  Mat<double, 2, 2> A;  ///< d velocity of that point / d independent rates
  Vec2<double> turn;    ///< d omega / d independent rates
};

/// Force and moment at the believed mass centre.
struct Wrench {
  Vec2<double> force = Vec2<double>::Zero();
  double moment = 0.0;
};

/// The uncertainty of a problem, which must outlive this.
template <class M>
class Uncertain {
 public:
  using Channels = typename M::Channels;
  static constexpr int legs = M::joints / 2, bars = M::joints;
  static constexpr int first = M::channels - 8 * legs;  ///< row of leg 1: 2 for the 5R, 0 for RR

  explicit Uncertain(const Problem<M>& p)
      : p_(&p), mass_(p.controller.mechanism.mass()), friction_(friction_of(p.believed)) {
    const auto& u = p.uncertainty;
    const auto times = [](const Interval& f, double v) { return Interval{f.lower * v, f.upper * v}; };
    for (int b = 0; b < bars; ++b) {
      const auto& leg = p.believed.legs[static_cast<std::size_t>(b / 2)];
      const bool outer = b % 2 == 1;
      const double m = outer ? leg.m2 : leg.m1, J = outer ? leg.J2 : leg.J1;
      box_[b] = {
          times(outer ? u.m2 : u.m1, m), times(outer ? u.J2 : u.J1, J), outer ? u.lg2 : u.lg1, {m, J, 0.0}};
      const auto j = static_cast<std::size_t>(b);
      viscous_[j] = interval_of(u.viscous, friction_.viscous, j);
      dry_[j] = interval_of(u.coulomb, friction_.dry, j);
    }
  }

  [[nodiscard]] const Channels& mass() const { return mass_; }   ///< M as believed
  [[nodiscard]] const Box& box(int b) const { return box_[b]; }  ///< of bar b, leg by leg
  /// True gravity, m/s2.
  [[nodiscard]] Interval gravity() const {
    return {p_->uncertainty.gravity.lower * p_->believed.g, p_->uncertainty.gravity.upper * p_->believed.g};
  }
  [[nodiscard]] const Interval& payload() const { return p_->uncertainty.payload; }  ///< kg
  /// Whether the effector has rows with mass, which hold an uncertain payload.
  [[nodiscard]] bool effector_rows() const { return first > 0 && mass_[0] > 0.0; }

  /// Bar b of the mechanism in state s, leg by leg.
  [[nodiscard]] static Bar bar(const State<M>& s, int b) {
    const int base = first + 8 * (b / 2), i = b % 2;
    Bar out;
    out.angle = base + 2 + i;
    out.x = base + 4 + 2 * i;
    out.along = leg_of(s.track.pose, b / 2).axis[i];
    out.a = {s.wanted[out.x], s.wanted[out.x + 1]};
    out.alpha = s.wanted[out.angle];
    out.omega = s.rates[out.angle];
    out.omega_r = out.omega + s.sliding[out.angle];
    for (int k = 0; k < 2; ++k) {
      out.A(0, k) = s.column[k][out.x];
      out.A(1, k) = s.column[k][out.x + 1];
      out.turn[k] = s.column[k][out.angle];
    }
    return out;
  }

  /// Delta of bar `s` [F36], N and N m: force and moment of the controller less those of the true bar, which
  /// has the values c under gravity g, m/s2. Of its intervals `of` only the believed values are used.
  [[nodiscard]] Wrench lack(const Bar& s, const Box& of, const Corner& c, double g) const {
    const Vec2<double> n = perp(s.along);
    const double believed_g = p_->believed.g, dl = -c.offset;
    const Vec2<double> a(s.a.x(), s.a.y() + g);
    Wrench out;
    out.force = s.a * (of.believed.m - c.m) + Vec2<double>(0, of.believed.m * believed_g - c.m * g) +
                (n * s.alpha - s.along * (s.omega * s.omega_r)) * (c.m * dl);
    out.moment = (of.believed.J - c.J) * s.alpha + c.m * dl * dot(n, a) - c.m * dl * dl * s.alpha;
    return out;
  }
  /// Delta, N, in frame N, of a point mass `m`, kg, at the effector and of gravity g on the believed one.
  [[nodiscard]] Vec2<double> tip_lack(const State<M>& s, double m, double g) const {
    const double own = first > 0 ? mass_[0] : 0.0;
    const Vec2<double> a = tip_wanted(s);
    return -Vec2<double>(a.x(), a.y() + g) * m + Vec2<double>(0, own * (p_->believed.g - g));
  }
  /// Acceleration of the effector that the law wants without its switching term, m/s2.
  [[nodiscard]] Vec2<double> tip_wanted(const State<M>& s) const {
    if constexpr (first > 0) {
      return {s.wanted[0], s.wanted[1]};
    } else {
      const Bar b = bar(s, 1);
      return b.a + (perp(b.along) * b.alpha - b.along * (b.omega * b.omega_r)) * beyond(0);
    }
  }
  /// Distance from the believed mass centre of the distal bar to its end, m.
  [[nodiscard]] double beyond(int leg) const {
    const auto& l = p_->believed.legs[static_cast<std::size_t>(leg)];
    return l.l2 - l.lg2;
  }

  /// Believed less true friction of a joint, N m. `swing`: variation of the independent rates in the tube:
  /// where the joint may come to rest, dry friction is anything up to its limit.
  [[nodiscard]] Span friction(const State<M>& s, int joint, double swing) const {
    const auto j = static_cast<std::size_t>(joint);
    const double rate = leg_of(s.track.rates, joint / 2)[joint % 2], d = friction_.viscous[j],
                 dry = friction_.dry[j];
    Span out = nothing;
    for (const double v : {viscous_[j].lower, viscous_[j].upper}) out.hold((d - v) * rate);
    const double sign = rate > 0 ? 1.0 : (rate < 0 ? -1.0 : 0.0);
    Span stick = nothing;
    for (const double g : {dry_[j].lower, dry_[j].upper}) stick.hold((dry - g) * sign);
    const int row = first + 8 * (joint / 2) + joint % 2;
    if (std::abs(rate) <= swing * std::hypot(s.column[0][row], s.column[1][row])) {
      const double most = dry_[j].upper + std::abs(friction_.asymmetry[j]);
      stick.hold(most);
      stick.hold(-most);
    }
    out.add(stick.low, stick.high);
    return out;
  }

  /// Extremes of delta, row by row [F35]; rows without mass are empty. `only`: of one cause.
  [[nodiscard]] std::array<Span, M::channels> rows(const State<M>& s, double swing,
                                                   Cause only = Cause::count) const {
    std::array<Span, M::channels> out{};
    const auto at = [&](int row) -> Span& { return out[static_cast<std::size_t>(row)]; };
    const auto open = [&](Cause c, const Interval& v, double closed) {
      return only == Cause::count || only == c ? v : Interval{closed, closed};
    };
    const Interval g = open(Cause::gravity, gravity(), p_->believed.g),
                   load = open(Cause::payload, payload(), 0.0);
    for (int b = 0; b < bars; ++b) {
      const Corner& c = box_[b].believed;
      const Box of{open(Cause::mass, box_[b].m, c.m), open(Cause::inertia, box_[b].J, c.J),
                   open(Cause::mass_centre, box_[b].offset, 0.0), c};
      const Bar bar_at = bar(s, b);
      std::tie(at(bar_at.x), at(bar_at.x + 1), at(bar_at.angle)) = bar_rows(s, b, bar_at, of, g, load);
    }
    if (effector_rows()) {
      at(0) = at(1) = nothing;
      for (const double gravity_now : {g.lower, g.upper}) {
        for (const double load_now : {load.lower, load.upper}) {
          const Vec2<double> w = tip_lack(s, load_now, gravity_now);
          at(0).hold(w.x());
          at(1).hold(w.y());
        }
      }
    }
    for (int leg = 0; leg < legs && (only == Cause::count || only == Cause::friction); ++leg) {
      // s_theta1 = s_phi1, s_theta2 = s_phi2 - s_phi1
      const Span inner = friction(s, 2 * leg, swing), outer = friction(s, 2 * leg + 1, swing);
      const int row = first + 8 * leg + 2;
      at(row).add(inner.low - outer.high, inner.high - outer.low);
      at(row + 1).add(outer.low, outer.high);
    }
    return out;
  }

  /// Share of a bar with the values c in the true inertia, in independent coordinates.
  [[nodiscard]] static Mat<double, 2, 2> inertia(const Bar& b, const Corner& c) {
    const Mat<double, 2, 2> A = b.A + perp(b.along) * b.turn.transpose() * c.offset;
    return A.transpose() * A * c.m + b.turn * b.turn.transpose() * c.J;
  }
  /// Velocity of the effector per independent rate, column by column.
  [[nodiscard]] Mat<double, 2, 2> tip_columns(const State<M>& s) const {
    if constexpr (first > 0) {
      return Mat<double, 2, 2>::Identity();
    } else {
      const Bar b = bar(s, 1);
      return b.A + perp(b.along) * b.turn.transpose() * beyond(0);
    }
  }
  /// Mass at the effector as believed, kg.
  [[nodiscard]] double own_tip() const { return first > 0 ? mass_[0] : 0.0; }

 private:
  /// Extremes of the rows x, y and phi of bar b, whose parameters are in `of`, under gravity g and payload.
  [[nodiscard]] std::tuple<Span, Span, Span> bar_rows(const State<M>& s, int b, const Bar& bar_at,
                                                      const Box& of, const Interval& g,
                                                      const Interval& load) const {
    const Vec2<double> n = perp(bar_at.along);
    const bool carries = b % 2 == 1 && !effector_rows();
    Span x = nothing, y = nothing, turn = nothing;
    for (const double gravity_now : {g.lower, g.upper}) {
      const double pull = dot(n, Vec2<double>(bar_at.a.x(), bar_at.a.y() + gravity_now));
      const double bend = bar_at.alpha != 0.0
                              ? std::clamp(-0.5 * pull / bar_at.alpha, of.offset.lower, of.offset.upper)
                              : of.offset.lower;
      for (const double load_now : {load.lower, load.upper}) {
        Wrench tip;
        if (carries) {
          tip.force = to_leg(tip_lack(s, load_now, gravity_now), b / 2) * (1.0 / legs);
          tip.moment = beyond(b / 2) * dot(n, tip.force);
        }
        for (const double mass : {of.m.lower, of.m.upper}) {
          for (const double inertia : {of.J.lower, of.J.upper}) {
            for (const double offset : {of.offset.lower, of.offset.upper, bend}) {
              const Wrench w = lack(bar_at, of, {mass, inertia, offset}, gravity_now);
              x.hold(w.force.x() + tip.force.x());
              y.hold(w.force.y() + tip.force.y());
              turn.hold(w.moment + tip.moment);
            }
          }
        }
      }
    }
    return {x, y, turn};
  }
  [[nodiscard]] Vec2<double> to_leg(const Vec2<double>& v, [[maybe_unused]] int leg) const {
    if constexpr (first > 0) {
      return p_->controller.mechanism.frame(leg).to_leg(v);
    } else {
      return v;
    }
  }

  const Problem<M>* p_;
  Channels mass_;
  List<Box, bars> box_{};
  JointFriction friction_;  // as believed
  std::array<Interval, 4> viscous_{}, dry_{};
};

}  // namespace esmc::host::design
