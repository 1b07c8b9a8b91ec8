#pragma once
/// The limits of controller, motors and moves at a place of a path, as rows of the timing and as shares.

#include "host_sim/design/efforts.hpp"
#include "host_sim/design/result.hpp"
#include "host_sim/plan/route.hpp"
#include "host_sim/plan/timing.hpp"

namespace esmc::host::plan {

/// Of limits.joint_speed: beyond it is a fault, and what is measured is not what is planned.
inline constexpr double speed_reserve = 0.98;

/// Names of the limits, by LimitKind.
inline constexpr const char* kind_text[] = {
    "the motors' torque", "limits.joint_speed", "acceleration", "speed", "acceleration", "jerk"};

/// Motion of the effector at a point that the path passes with a state of its timing.
[[nodiscard]] inline Motion2<double> motion_at(const CurvePoint& tip, const Timing::State& s) {
  return {tip.p, tip.d1 * s.rate, tip.d2 * (s.rate * s.rate) + tip.d1 * s.acceleration};
}

/// rest + per_u u + per_x x of a motion along the path, with x = s'^2 and u = s''.
struct Affine {
  double rest = 0.0, per_u = 0.0, per_x = 0.0;
};
/// What the worst plant takes beyond the believed one at a place, of each load: tangents at a motion, to
/// convex functions of the motion.
struct Reserve {
  std::array<Affine, 4> low{}, high{};
};
/// Loads of the motors as shares of what they can give. Two motors: each one's torque. Four: the force across
/// each side of the polygon of forces that they give together.
using Loads = std::array<double, 4>;

template <class M>
class MotorLimits {
 public:
  using Channels = typename M::Channels;
  static constexpr int legs = M::joints / 2, first = M::has_type2 ? 2 : 0,
                       rows = (M::channels - first) / legs;

  explicit MotorLimits(const Problem<M>& p) : p_(p), four_(p.controller.allocate != nullptr) {
    if (p.uncertain) uncertain_ = *p.uncertain;
    if (uncertain_) uncertain_->points.resize(1);
    for (const auto& list : {p.friction.viscous, p.friction.dry, p.friction.asymmetry})
      for (const double v : list) rubs_ = rubs_ || v != 0.0;
  }
  MotorLimits(const MotorLimits&) = delete;
  MotorLimits& operator=(const MotorLimits&) = delete;

  [[nodiscard]] int count() const { return four_ ? 4 : 2; }

  /// Linear in the forces w on the channels.
  [[nodiscard]] Loads loads(const typename M::Pose& pose, const Channels& w) const {
    const auto& c = p_.controller;
    Loads out{};
    if constexpr (M::joints == 4) {
      if (four_) {
        const FourMotors<double> four = four_motors(c.mechanism, pose, w);
        for (int i = 0; i < 4; ++i) {
          const Vec2<double> side = four.rows.row(i).transpose();
          double width = 0.0;
          for (int j = 0; j < 4; ++j)
            width += c.torque_limit[j] * std::abs(cross(Vec2<double>(four.rows.row(j).transpose()), side));
          out[static_cast<std::size_t>(i)] = width > 0.0 ? cross(four.F, side) / width : 0.0;
        }
        return out;
      }
    }
    const Vec2<double> torque = c.mechanism.base_torque(pose, w);
    for (int i = 0; i < 2; ++i)
      out[static_cast<std::size_t>(i)] = torque[i] / c.torque_limit[ControllerConfig<M>::joint_of(i, 2)];
    return out;
  }

  /// Forces on the channels of a motion, friction included.
  [[nodiscard]] Channels forces(const M& m, const Desired<M>& d) const {
    Channels a = m.channel_accelerations(d.pose, d.rates, d.acceleration);
    m.add_rotors(a);
    Channels w = forces_of(m, d.pose, a);
    if (rubs_) w += friction(d.rates, p_.friction.viscous) + dry(d.rates);
    return w;
  }

  /// Loads of a motion: what a longer time leaves, friction included, and what falls with its square.
  [[nodiscard]] std::pair<Loads, Loads> split(const M& m, const Desired<M>& d) const {
    Channels rest = forces_of(m, d.pose, Channels::Zero().eval());
    if (rubs_) rest += friction(d.rates, p_.friction.viscous) + dry(d.rates);
    return {loads(d.pose, rest), loads(d.pose, forces(m, d) - rest)};
  }
  /// Largest share of the motors that holding a pose takes, of each load; the worst plant where there is
  /// uncertainty.
  [[nodiscard]] Loads holding(const typename M::Pose& pose) {
    Loads out{};
    const Desired<M> still{pose, M::Rates::Zero(), M::Rates::Zero()};
    const std::pair<Loads, Loads> less =
        reserve(still, {pose.effector, Vec2<double>(0, 0), Vec2<double>(0, 0)});
    for (const M* m : {p_.loaded ? &*p_.loaded : nullptr, &p_.controller.mechanism}) {
      if (m == nullptr) continue;
      const Loads l = loads(pose, forces_of(*m, pose, Channels::Zero().eval()));
      for (std::size_t i = 0; i < l.size(); ++i) {
        out[i] = std::max({out[i], l[i] - less.first[i], less.second[i] - l[i]});
        if (std::isnan(l[i])) out[i] = std::numeric_limits<double>::infinity();
      }
    }
    return out;
  }
  [[nodiscard]] bool rubs() const { return rubs_; }  ///< friction is planned for

  /// Adds the rows of the motors at a place.
  void add_rows(const Place<M>& at, const Reserve& less, std::vector<Row>& out) const {
    const Desired<M>& d = at.at;
    Loads viscous{}, stick{};
    if (rubs_) {
      viscous = loads(d.pose, friction(d.rates, p_.friction.viscous));
      stick = loads(d.pose, dry(d.rates));
    }
    const auto add = [&](const M& m) {
      const auto still = M::Rates::Zero();
      const Channels weight = forces_of(m, d.pose, Channels::Zero().eval());
      Channels push = m.channel_accelerations(d.pose, still, d.rates);
      Channels bend = m.channel_accelerations(d.pose, d.rates, d.acceleration);
      m.add_rotors(push);
      m.add_rotors(bend);
      const Loads a = loads(d.pose, forces_of(m, d.pose, push) - weight),
                  b = loads(d.pose, forces_of(m, d.pose, bend) - weight), c = loads(d.pose, weight);
      for (std::size_t i = 0; i < static_cast<std::size_t>(count()); ++i) {
        const double rest = c[i] + stick[i];
        const Affine &low = less.low[i], &high = less.high[i];
        out.push_back(
            {a[i] - low.per_u, b[i] - low.per_x, viscous[i], 1.0 + low.rest - rest, LimitKind::torque});
        out.push_back(
            {high.per_u - a[i], high.per_x - b[i], -viscous[i], 1.0 - high.rest + rest, LimitKind::torque});
      }
    };
    add(p_.controller.mechanism);
    if (p_.loaded) add(*p_.loaded);
  }

  /// What the worst plant takes beyond the believed one on the motion itself: smallest and largest of the
  /// believed load less the true one. Zeros without uncertainty.
  [[nodiscard]] std::pair<Loads, Loads> reserve(const Desired<M>& d, const Motion2<double>& tip) {
    std::pair<Loads, Loads> out{};
    if (!uncertain_) return out;
    Motion2<double> m = tip;
    if (uncertain_->controller.reference.space == ReferenceSpace::base_joints)
      m = {M::base_angles(d.pose), M::base(d.rates), M::base(d.acceleration)};
    uncertain_->points[0] = {0.0, m, m};
    design::State<M> s;
    if (!design::state_at(*uncertain_, {}, 0.0, s)) return out;
    const design::Worst<M> worst(design::Uncertain<M>(*uncertain_), s, 0.0);
    List<Loads, 2> unit{};
    for (int k = 0; k < 2; ++k) {
      Channels push = Channels::Zero();
      push[k] = 1.0;  // on independent coordinate k: effector, or joint of the RR
      unit[k] = loads(s.track.pose, push);
    }
    for (std::size_t i = 0; i < static_cast<std::size_t>(count()); ++i) {
      const design::Span span = worst.along(Vec2<double>(unit[0][i], unit[1][i]));
      out.first[i] = std::min(0.0, design::margin * span.low);
      out.second[i] = std::max(0.0, design::margin * span.high);
    }
    return out;
  }

  /// Torques of the motors, N m, as the controller would share them.
  [[nodiscard]] Vec<double, M::joints> torques(const Desired<M>& d, bool loaded) const {
    return design::effort(p_.controller, d.pose,
                          forces(loaded && p_.loaded ? *p_.loaded : p_.controller.mechanism, d))
        .torque;
  }

 private:
  static double rate_of(const typename M::Rates& r, int joint) {
    return design::Uncertain<M>::joint_rate(r, joint);
  }
  static int row_of(int joint) { return first + rows * (joint / 2) + joint % 2; }

  Channels friction(const typename M::Rates& r, const std::array<double, 4>& coefficient) const {
    Channels w = Channels::Zero();
    for (int j = 0; j < M::joints; ++j)
      w[row_of(j)] = coefficient[static_cast<std::size_t>(j)] * rate_of(r, j);
    return w;
  }
  Channels dry(const typename M::Rates& r) const {
    Channels w = Channels::Zero();
    for (int j = 0; j < M::joints; ++j) {
      const auto u = static_cast<std::size_t>(j);
      const double rate = rate_of(r, j), sign = rate > 0.0 ? 1.0 : (rate < 0.0 ? -1.0 : 0.0);
      w[row_of(j)] = p_.friction.dry[u] * sign + (sign != 0.0 ? p_.friction.asymmetry[u] : 0.0);
    }
    return w;
  }

  const Problem<M>& p_;
  bool four_, rubs_ = false;  // four motors; friction
  std::optional<design::Problem<M>> uncertain_;
};

/// What is left of the right side of a row where only a share of its limit may be used.
[[nodiscard]] inline double lowered(const Row& r, double share) {
  if (r.kind == LimitKind::torque) return r.c - (1.0 - share);
  return r.kind == LimitKind::acceleration ? r.c * share : r.c * share * share;
}

/// Adds the rows of speeds and accelerations that `move` and the controller allow.
template <class M>
void add_motion_rows(const Problem<M>& p, const Piece& piece, const Place<M>& at, std::vector<Row>& out) {
  const auto square = [](double v) { return v * v; };
  for (int i = 0; i < 2; ++i) {
    const double allowed = speed_reserve * p.controller.limits.joint_speed;
    out.push_back({0.0, square(at.base1[i]), 0.0, square(allowed), LimitKind::joint_speed});
  }
  for (std::size_t k = piece.move; k <= piece.next; ++k) {
    const MoveScene& m = p.moves[k];
    const double speed = m.speed.value_or(0.0), acceleration = m.acceleration.value_or(0.0);
    constexpr LimitKind fast = LimitKind::speed, hard = LimitKind::acceleration;
    if (m.kind == MoveKind::joint) {
      for (int i = 0; i < 2; ++i) {
        if (m.speed) out.push_back({0.0, square(at.base1[i]), 0.0, square(speed), fast});
        if (!m.acceleration) continue;
        out.push_back({at.base1[i], at.base2[i], 0.0, acceleration, hard});
        out.push_back({-at.base1[i], -at.base2[i], 0.0, acceleration, hard});
      }
      continue;
    }
    if (m.speed) out.push_back({0.0, at.tip.d1.squaredNorm(), 0.0, square(speed), fast});
    if (!m.acceleration) continue;
    // A polygon in the disc of accelerations, with corners along and across the path.
    constexpr int sides = 32;
    const double pace = at.tip.d1.norm();
    const Vec2<double> along = at.tip.d1 / pace;
    for (int i = 0; i < sides; ++i) {
      const double angle = 2.0 * std::numbers::pi * (i + 0.5) / sides;
      const Vec2<double> normal = along * std::cos(angle) + perp(along) * std::sin(angle);
      out.push_back({normal.dot(at.tip.d1), normal.dot(at.tip.d2), 0.0,
                     acceleration * std::cos(std::numbers::pi / sides), hard});
    }
  }
}

}  // namespace esmc::host::plan
