#pragma once
/// The limits of controller, motors and moves at a place of a path, as rows of the timing and as shares.

#include "host_sim/design/efforts.hpp"
#include "host_sim/design/result.hpp"
#include "host_sim/plan/inertia.hpp"
#include "host_sim/plan/route.hpp"
#include "host_sim/plan/timing.hpp"

namespace esmc::host::plan {

/// Of limits.joint_speed: beyond it is a fault, and what is measured is not what is planned.
inline constexpr double speed_reserve = 0.98;

/// Names of the limits, by LimitKind.
inline constexpr const char* kind_text[] = {"the motors' torque", "limits.joint_speed", "speed",
                                            "acceleration", "jerk"};

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
    if (p.loaded) models_.emplace_back(*p.loaded);
    models_.emplace_back(p.controller.mechanism);
    if (p.uncertain) uncertain_ = *p.uncertain;
    if (uncertain_) uncertain_->points.resize(1);
    for (const auto& list : {p.friction.viscous, p.friction.dry, p.friction.asymmetry})
      for (const double v : list) rubs_ = rubs_ || v != 0.0;
  }
  MotorLimits(const MotorLimits&) = delete;
  MotorLimits& operator=(const MotorLimits&) = delete;

  [[nodiscard]] int count() const { return four_ ? 4 : 2; }

  /// Of a pose: the loads of forces on its independent coordinates, base joints or effector.
  struct Scale {
    bool by_base = true;
    std::array<Vec2<double>, 4> of{};
  };
  [[nodiscard]] Scale scale(const typename M::Pose& pose) const {
    const auto& c = p_.controller;
    Scale out;
    if constexpr (M::joints == 4) {
      if (four_) {
        out.by_base = M::abs_sin_type2(pose) >= M::min_abs_sin_type1(pose);
        Mat<double, 2, 4> row;  // of the joints by the independent coordinates, as four_motors() has them
        for (int k = 0; k < 2; ++k) {
          const Vec2<double> unit = Vec2<double>::Unit(k);
          const auto r =
              out.by_base ? c.mechanism.base_rates(pose, unit) : c.mechanism.chain_rates(pose, unit);
          row.row(k) << r.leg[0].transpose(), r.leg[1].transpose();
        }
        for (int i = 0; i < 4; ++i) {
          const Vec2<double> side = row.col(i);
          double width = 0.0;
          for (int j = 0; j < 4; ++j)
            width += c.torque_limit[j] * std::abs(cross(Vec2<double>(row.col(j)), side));
          out.of[static_cast<std::size_t>(i)] = width > 0.0 ? -perp(side) / width : Vec2<double>(0, 0);
        }
        return out;
      }
    }
    for (int i = 0; i < 2; ++i)
      out.of[static_cast<std::size_t>(i)] = Vec2<double>::Unit(i) / c.torque_limit[c.joint_of(i, 2)];
    return out;
  }
  /// Linear in the forces.
  [[nodiscard]] Loads loads(const Scale& scale, const typename M::Pose& pose, const Forces& f) const {
    Vec2<double> force = f.leg[0];
    if constexpr (M::joints == 4) {
      const M& m = p_.controller.mechanism;
      force = scale.by_base ? m.gather_on_base(pose, f.effector, f.leg) : m.gather(pose, f.effector, f.leg);
    }
    Loads out{};
    for (std::size_t i = 0; i < (four_ ? 4 : 2); ++i) out[i] = scale.of[i].dot(force);
    return out;
  }

  /// Loads of a motion: what a longer time leaves, dry friction included, what falls with it, which is
  /// viscous friction, and what falls with its square.
  struct Split {
    Loads rest{}, drag{}, push{};
  };
  [[nodiscard, gnu::noinline, gnu::flatten]] Split split(const Inertia<M>& m, const Desired<M>& d,
                                                         const Scale& scale) const {
    Forces rest = m.weight(d.pose);
    Split out;
    if (rubs_) {
      add(rest, dry(d.rates));
      out.drag = loads(scale, d.pose, friction(d.rates, p_.friction.viscous));
    }
    out.rest = loads(scale, d.pose, rest);
    out.push = loads(scale, d.pose, m.push(d.pose, d.rates, d.acceleration));
    return out;
  }
  /// Largest share of the motors that holding a pose takes, of each load; the worst plant where there is
  /// uncertainty.
  [[nodiscard]] Loads holding(const typename M::Pose& pose) {
    Loads out{};
    const Scale scale = this->scale(pose);
    const Desired<M> still{pose, M::Rates::Zero(), M::Rates::Zero()};
    const std::pair<Loads, Loads> less =
        reserve(still, {pose.effector, Vec2<double>(0, 0), Vec2<double>(0, 0)});
    for (const Inertia<M>& m : models_) {
      const Loads l = loads(scale, pose, m.weight(pose));
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
    const Scale scale = this->scale(d.pose);
    Loads viscous{};
    Forces stick;
    if (rubs_) {
      viscous = loads(scale, d.pose, friction(d.rates, p_.friction.viscous));
      stick = dry(d.rates);
    }
    for (const Inertia<M>& m : models_) {
      Forces still = m.weight(d.pose);
      if (rubs_) add(still, stick);
      const Loads c = loads(scale, d.pose, still),
                  a = loads(scale, d.pose, m.push(d.pose, M::Rates::Zero(), d.rates)),
                  b = loads(scale, d.pose, m.push(d.pose, d.rates, d.acceleration));
      for (std::size_t i = 0; i < static_cast<std::size_t>(count()); ++i) {
        const Affine &low = less.low[i], &high = less.high[i];
        const double least = high.rest - c[i] - 1.0, most = 1.0 + low.rest - c[i];
        const bool alike = low.per_u == high.per_u && low.per_x == high.per_x;
        out.push_back({a[i] - low.per_u, b[i] - low.per_x, viscous[i], alike ? least : -unlimited, most});
        if (!alike) out.push_back({a[i] - high.per_u, b[i] - high.per_x, viscous[i], least, unlimited});
      }
    }
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
      Forces push;  // on independent coordinate k: effector, or joint of the RR
      (M::joints == 4 ? push.effector : push.leg[0])[k] = 1.0;
      unit[k] = loads(scale(s.track.pose), s.track.pose, push);
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
    const Inertia<M>& m = loaded ? models_.front() : models_.back();
    Forces f = m.weight(d.pose);
    add(f, m.push(d.pose, d.rates, d.acceleration));
    if (rubs_) {
      add(f, dry(d.rates));
      add(f, friction(d.rates, p_.friction.viscous));
    }
    Channels w = Channels::Zero();
    if constexpr (M::joints == 4) w.template head<2>() = f.effector;
    for (int j = 0; j < legs; ++j) w.template segment<2>(first + rows * j) = f.leg[j];
    return design::effort(p_.controller, d.pose, w).torque;
  }
  [[nodiscard]] const std::vector<Inertia<M>>& models() const { return models_; }  ///< the last: unloaded

 private:
  static void add(Forces& to, const Forces& f) {
    to.effector += f.effector;
    for (int j = 0; j < legs; ++j) to.leg[j] += f.leg[j];
  }
  static Forces friction(const typename M::Rates& r, const std::array<double, 4>& coefficient) {
    Forces out;
    for (int j = 0; j < M::joints; ++j)
      out.leg[j / 2][j % 2] = coefficient[static_cast<std::size_t>(j)] * leg_of(r, j / 2)[j % 2];
    return out;
  }
  [[nodiscard]] Forces dry(const typename M::Rates& r) const {
    Forces out;
    for (int j = 0; j < M::joints; ++j) {
      const auto u = static_cast<std::size_t>(j);
      const double rate = leg_of(r, j / 2)[j % 2], sign = rate > 0.0 ? 1.0 : (rate < 0.0 ? -1.0 : 0.0);
      out.leg[j / 2][j % 2] = p_.friction.dry[u] * sign + (sign != 0.0 ? p_.friction.asymmetry[u] : 0.0);
    }
    return out;
  }

  const Problem<M>& p_;
  bool four_, rubs_ = false;  // four motors; friction
  std::vector<Inertia<M>> models_;
  std::optional<design::Problem<M>> uncertain_;
};

/// Leaves of a row the share of its limit that may be used.
inline void lower(Row& r, double share) {
  if (r.kind == LimitKind::torque) {
    r.low += 1.0 - share;
    r.high -= 1.0 - share;
  } else {
    const double factor = r.kind == LimitKind::acceleration ? share : share * share;
    r.low *= factor;
    r.high *= factor;
  }
}

/// Adds the rows of speeds, all in one, and accelerations that `move` and the controller allow.
template <class M>
void add_motion_rows(const Problem<M>& p, const Piece& piece, const Place<M>& at, std::vector<Row>& out) {
  double fastest = 0.0;  // of all rates, as shares of what is allowed
  const auto at_most = [&](double rate, double allowed) {
    fastest = std::max(fastest, std::abs(rate) / allowed);
  };
  const auto within = [&](double a, double b, double allowed) {
    out.push_back({a, b, 0.0, -allowed, allowed, LimitKind::acceleration});
  };
  for (int i = 0; i < 2; ++i) at_most(at.base1[i], speed_reserve * p.controller.limits.joint_speed);
  for (std::size_t k = piece.move; k <= piece.next; ++k) {
    const MoveScene& m = p.moves[k];
    if (m.kind == MoveKind::joint) {
      for (int i = 0; i < 2; ++i) {
        if (m.speed) at_most(at.base1[i], *m.speed);
        if (m.acceleration) within(at.base1[i], at.base2[i], *m.acceleration);
      }
      continue;
    }
    const double pace = at.tip.d1.norm();
    if (m.speed) at_most(pace, *m.speed);
    if (!m.acceleration) continue;
    // A polygon in the disc of accelerations, with corners along and across the path.
    constexpr int sides = 32;
    const Vec2<double> along = at.tip.d1 / pace;
    for (int i = 0; i < sides / 2; ++i) {
      const double angle = 2.0 * std::numbers::pi * (i + 0.5) / sides;
      const Vec2<double> normal = along * std::cos(angle) + perp(along) * std::sin(angle);
      within(normal.dot(at.tip.d1), normal.dot(at.tip.d2),
             *m.acceleration * std::cos(std::numbers::pi / sides));
    }
  }
  out.push_back({0.0, fastest * fastest, 0.0, -unlimited, 1.0, LimitKind::speed});
}

}  // namespace esmc::host::plan
