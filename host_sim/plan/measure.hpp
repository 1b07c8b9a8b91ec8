#pragma once
/// What a timed stretch takes of every limit, by the table that the firmware reads.

#include <algorithm>
#include <cmath>

#include "host_sim/plan/guard.hpp"
#include "host_sim/plan/table.hpp"

namespace esmc::host::plan {

/// Share of the torque that is left to the sampled loop where no plant is to saturate.
inline constexpr double loop_reserve = 0.07;
inline constexpr double at_limit = 0.99;  ///< share from which a limit counts as active

/// More of a limit than is allowed.
struct Excess {
  double from, to;  ///< part of the path
  LimitKind kind;
  double share;
};

template <class M>
class Measurement {
 public:
  Measurement(const Problem<M>& p, const Route<M>& route, MotorLimits<M>& motors)
      : p_(p), route_(route), motors_(motors) {}

  /// The stretch whose timings follow.
  void begin(const Stretch& stretch) {
    stretch_ = &stretch;
    limits_tip_ = limits_joints_ = false;
    for (std::size_t i = stretch.first; i <= stretch.last; ++i) {
      if (p_.moves[i].speed || p_.moves[i].acceleration)
        (p_.moves[i].kind == MoveKind::joint ? limits_joints_ : limits_tip_) = true;
    }
  }

  /// Share of a limit that an optimal timing may use.
  [[nodiscard]] double allowed(LimitKind kind) const {
    return kind == LimitKind::torque && p_.uncertain ? 1.0 - loop_reserve : 1.0;
  }
  /// Measures the shares of all limits: at the ends of the quintics, and tick by
  /// tick where a limit is near; elsewhere torques and joints every few ticks. Returns the time of the
  /// largest share, s.
  double take(const Timing& timing) {
    table_ = fitted(timing);
    use_ = {};
    excess_.clear();
    most_ = 0.0;
    constexpr double calm = 0.75, looks = 16.0, longest_stride = 8.0;  // share; per piece of the path; ticks
    const double duration = timing.duration(), step = std::max(p_.tick, duration / 20000.0);
    const double stride = std::clamp(duration / (step * looks * static_cast<double>(stretch_->pieces.size())),
                                     1.0, longest_stride);
    const auto n = static_cast<std::uint64_t>(duration / step);
    std::size_t k = 0;
    const auto motion = [&](std::uint64_t i) {
      const double t = static_cast<double>(i) * step;
      while (k > 0 && table_[k].begin > t) --k;
      while (k + 1 < table_.size() && table_[k + 1].begin <= t) ++k;
      return table_[k].curve.at(t - table_[k].begin);
    };
    const auto look = [&](std::uint64_t i) {
      return add_joint_use(timing, static_cast<double>(i) * step, motion(i), step);
    };
    double last = look(0);
    for (std::uint64_t i = 0; i < n;) {
      const std::uint64_t next = std::min(n, i + static_cast<std::uint64_t>(stride));
      const double now = look(next);
      while (++i < next) {
        if (std::max(last, now) > calm) (void)look(i);
      }
      last = now;
    }
    for (std::uint64_t i = 0; limits_tip_ && i <= n; ++i)
      add_tip_use(timing, static_cast<double>(i) * step, motion(i), step);
    for (const TimedPiece& piece : table_) {
      for (const double t : {0.0, piece.curve.duration}) {
        const Motion2<double> m = piece.curve.at(t);
        (void)add_joint_use(timing, piece.begin + t, m, 0.0);
        if (limits_tip_) add_tip_use(timing, piece.begin + t, m, 0.0);
      }
    }
    return where_;
  }
  // Of the last timing.
  [[nodiscard]] const std::vector<TimedPiece>& table() const { return table_; }
  [[nodiscard]] const Uses& use() const { return use_; }
  [[nodiscard]] const std::vector<Excess>& excess() const { return excess_; }

  [[nodiscard]] std::optional<Desired<M>> desired(const Motion2<double>& m) const {
    return desired_at_effector(p_.controller.mechanism, p_.controller.mode, m.position, m.velocity,
                               m.acceleration);
  }

 private:
  [[nodiscard]] std::vector<TimedPiece> fitted(const Timing& timing) const {
    return fit_quintics(timing.breaks(), [&](double t) {
      const Timing::State after = timing.at(t);
      const CurvePoint tip = route_.tip(*stretch_, after.s);
      return Knot{motion_at(tip, timing.at(t, true)), motion_at(tip, after)};
    });
  }
  /// Adds a share of a limit at time t, which lasts for `weight`, s.
  void add(LimitKind kind, std::size_t i, double share, const Timing& timing, double t, double weight) {
    Use& use = use_[static_cast<std::size_t>(kind)][i];
    use.share = std::max(use.share, share);
    if (share > most_) {
      most_ = share;
      where_ = t;
    }
    if (share > allowed(kind)) {
      const auto span = timing.span(t);
      excess_.push_back({span.first, span.second, kind, share});
    }
    if (share > at_limit * allowed(kind)) use.active += weight;
  }
  /// Adds torques, and speeds and accelerations of joints, at the motion m. Returns the largest share.
  double add_joint_use(const Timing& timing, double t, const Motion2<double>& m, double weight) {
    const auto d = desired(m);
    if (!d)
      throw Refused(Route<M>::piece_at(*stretch_, timing.at(t).s).move, "to",
                    "leads out of reach at " + place_text(m.position));
    double most = 0.0;
    const auto take = [&](LimitKind kind, std::size_t i, double share) {
      most = std::max(most, share);
      add(kind, i, share, timing, t, weight);
    };
    const Loads loads = motors_.shares(*d, m);
    for (std::size_t i = 0; i < static_cast<std::size_t>(motors_.count()); ++i)
      take(LimitKind::torque, i, loads[i]);
    const Vec2<double> rate = M::base(d->rates), acceleration = M::base(d->acceleration);
    for (std::size_t i = 0; i < 2; ++i)
      take(LimitKind::joint_speed, i,
           std::abs(rate[static_cast<int>(i)]) / (speed_reserve * p_.controller.limits.joint_speed));
    if (!limits_joints_) return most;
    const Piece& piece = Route<M>::piece_at(*stretch_, timing.at(t).s);
    for (std::size_t k = piece.move; k <= piece.next; ++k) {
      const MoveScene& move = p_.moves[k];
      if (move.kind != MoveKind::joint) continue;
      if (move.speed) take(LimitKind::speed, 0, rate.cwiseAbs().maxCoeff() / *move.speed);
      if (move.acceleration)
        take(LimitKind::acceleration, 0, acceleration.cwiseAbs().maxCoeff() / *move.acceleration);
    }
    return most;
  }
  /// Adds speed and acceleration of the effector, where a move limits them.
  void add_tip_use(const Timing& timing, double t, const Motion2<double>& m, double weight) {
    const Piece& piece = Route<M>::piece_at(*stretch_, timing.at(t).s);
    for (std::size_t k = piece.move; k <= piece.next; ++k) {
      const MoveScene& move = p_.moves[k];
      if (move.kind == MoveKind::joint) continue;
      if (move.speed) add(LimitKind::speed, 0, m.velocity.norm() / *move.speed, timing, t, weight);
      if (move.acceleration)
        add(LimitKind::acceleration, 0, m.acceleration.norm() / *move.acceleration, timing, t, weight);
    }
  }

  const Problem<M>& p_;
  const Route<M>& route_;
  MotorLimits<M>& motors_;
  const Stretch* stretch_ = nullptr;
  bool limits_tip_ = false, limits_joints_ = false;  // a move of the stretch limits speed or acceleration
  std::vector<TimedPiece> table_;
  std::vector<Excess> excess_;
  Uses use_{};
  double most_ = 0.0, where_ = 0.0;  // largest share and its time, s
};

}  // namespace esmc::host::plan
