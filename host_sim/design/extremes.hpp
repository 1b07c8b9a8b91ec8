#pragma once
/// Extremes of delta [F34] over the uncertain parameters at one state, with [F36] for the mass centres. A row
/// depends on one bar, payload and gravity, linearly but for the place of the mass centre, which enters row
/// phi as a square: its extremes are at corners, and at the vertex of that square.

#include <array>
#include <tuple>

#include "host_sim/design/problem.hpp"

namespace esmc::host::design {

/// Parameters that are uncertain, as the causes of a gain.
enum class Cause { mass, mass_centre, inertia, gravity, payload, friction, count };
[[nodiscard]] inline const char* name(Cause c) {
  constexpr std::array names{"mass", "mass centre", "inertia", "gravity", "payload", "friction"};
  return names[static_cast<std::size_t>(c)];
}

/// Smallest and largest value.
struct Span {
  double low = 0.0, high = 0.0;
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
inline constexpr Span nothing{1e300, -1e300};

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

/// The uncertainty of a problem.
template <class M>
class Uncertain {
 public:
  using Channels = typename M::Channels;
  static constexpr int legs = M::joints / 2, bars = M::joints;
  static constexpr int first = M::channels - 8 * legs;  ///< row of leg 1: 2 for the 5R, 0 for RR

  explicit Uncertain(const Problem<M>& p) : p_(&p), mass_(p.controller.mechanism.mass()) {
    const auto& u = p.uncertainty;
    const auto times = [](const Interval& f, double v) { return Interval{f.lower * v, f.upper * v}; };
    for (int b = 0; b < bars; ++b) {
      const auto& leg = p.believed.legs[static_cast<std::size_t>(b / 2)];
      const bool outer = b % 2 == 1;
      const double m = outer ? leg.m2 : leg.m1, J = outer ? leg.J2 : leg.J1;
      box_[b] = {
          times(outer ? u.m2 : u.m1, m), times(outer ? u.J2 : u.J1, J), outer ? u.lg2 : u.lg1, {m, J, 0.0}};
      const auto j = static_cast<std::size_t>(b);
      const double d = outer ? leg.d2 : leg.d1, dry = outer ? leg.gamma2 : leg.gamma1;
      viscous_[j] = u.viscous ? (*u.viscous)[j] : Interval{d, d};
      dry_[j] = u.coulomb ? (*u.coulomb)[j] : Interval{dry, dry};
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

  [[nodiscard]] static Bar bar(const State<M>& s, int b) {
    const int base = first + 8 * (b / 2), i = b % 2;
    Bar out;
    out.angle = base + 2 + i;
    out.x = base + 4 + 2 * i;
    out.along = axis(s.track.pose, b / 2, i);
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

  /// Delta of one bar [F36], N and N m: force and moment of the controller less those of the true bar.
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
    const auto& leg = p_->believed.legs[static_cast<std::size_t>(joint / 2)];
    const bool outer = joint % 2 == 1;
    const double rate = joint_rate(s.track.rates, joint), d = outer ? leg.d2 : leg.d1,
                 dry = outer ? leg.gamma2 : leg.gamma1;
    const auto j = static_cast<std::size_t>(joint);
    Span out = nothing;
    for (const double v : {viscous_[j].lower, viscous_[j].upper}) out.hold((d - v) * rate);
    const double sign = rate > 0 ? 1.0 : (rate < 0 ? -1.0 : 0.0);
    Span stick = nothing;
    for (const double g : {dry_[j].lower, dry_[j].upper}) stick.hold((dry - g) * sign);
    const int row = first + 8 * (joint / 2) + joint % 2;
    if (std::abs(rate) <= swing * std::hypot(s.column[0][row], s.column[1][row])) {
      stick.hold(dry_[j].upper);
      stick.hold(-dry_[j].upper);
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

  /// Share of a bar in the true inertia, in independent coordinates.
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

  [[nodiscard]] static double joint_rate(const typename M::Rates& r, int joint) {
    if constexpr (first > 0) {
      return r.leg[joint / 2][joint % 2];
    } else {
      return r[joint];
    }
  }

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
  [[nodiscard]] static Vec2<double> axis(const typename M::Pose& pose, [[maybe_unused]] int leg, int i) {
    if constexpr (first > 0) {
      return pose.leg[leg].axis[i];
    } else {
      return pose.arm.axis[i];
    }
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
  std::array<Interval, 4> viscous_{}, dry_{};
};

}  // namespace esmc::host::design
