#pragma once
/// A fault with what was measured and what was allowed, worked out again from the sample of its tick.

#include <cmath>
#include <optional>

#include "firmware/cycle/controller.hpp"
#include "host_sim/controller/controller_config.hpp"
#include "host_sim/record/summary.hpp"

namespace esmc::host {

/// Of a fault that the sample itself shows: the first joint or quantity, in the firmware's order, that is
/// beyond its limit. Else only the name. `before`: the sample of the tick before; null: none.
template <class World>
class FaultFinder {
 public:
  using M = typename World::Mechanism;

  explicit FaultFinder(const Scene& s)
      : scene_(s), mechanism_(params_of<M>(believed_mechanism(s))), mode_(mode_of<M>(s)) {}

  /// Notes a tick of the controller; the first one with a fault counts.
  void see(const TickResult<M>& r, const Sample<M>& now) {
    if (r.fault == Fault::none) {
      before_ = now;
    } else if (!found_) {
      found_ = record(r.fault, now);
    }
  }
  [[nodiscard]] const std::optional<FaultRecord>& found() const { return found_; }

 private:
  [[nodiscard]] FaultRecord record(Fault f, const Sample<M>& now) const {
    FaultRecord out{.name = name(f)};
    const LimitsScene& l = scene_.limits;
    const int sensed = scene_.all_sensors ? M::joints : 2;
    Vec<double, M::joints> angle = Vec<double, M::joints>::Zero();
    for (int i = 0; i < sensed; ++i) {
      const int j = ControllerConfig<M>::joint_of(i, sensed);
      const auto u = static_cast<std::size_t>(j);
      angle[j] = now.angle[j] +
                 now.rate[j] * (now.age_ticks[u] * scene_.tick() + now.phase[u] + scene_.drives.torque_lead);
      if (f == Fault::stale_feedback && now.age_ticks[u] > static_cast<std::uint32_t>(l.max_age_ticks))
        return at(out, j, now.age_ticks[u], l.max_age_ticks, "ticks without a sample");
      if (f == Fault::feedback_not_finite && !std::isfinite(angle[j])) out.where = World::joint_names[j];
      if (f == Fault::feedback_jump && before_) {
        const double off = std::abs(now.angle[j] - before_->angle[j] - now.rate[j] * scene_.tick());
        if (off > l.feedback_jump) return at(out, j, off, l.feedback_jump, "rad from its prediction");
      }
      const bool base = j % (M::joints / 2) == 0;
      if (f == Fault::joint_speed && base && !(std::abs(now.rate[j]) <= l.joint_speed))
        return at(out, j, now.rate[j], l.joint_speed, "rad/s");
      if (f == Fault::joint_angle && base && l.joint_angle) {
        const auto& range = (*l.joint_angle)[j == 0 ? 0 : 1];
        if (!(angle[j] >= range[0])) return at(out, j, angle[j], range[0], "rad");
        if (!(angle[j] <= range[1])) return at(out, j, angle[j], range[1], "rad");
      }
    }
    return of_pose(f, now, angle, out);
  }

  /// Faults that the pose shows.
  [[nodiscard]] FaultRecord of_pose(Fault f, const Sample<M>& now, const Vec<double, M::joints>& angle,
                                    FaultRecord out) const {
    const LimitsScene& l = scene_.limits;
    constexpr int second = M::joints / 2;
    auto e = estimate_from_base(mechanism_, mode_, Vec2<double>(angle[0], angle[second]),
                                Vec2<double>(now.rate[0], now.rate[second]));
    if constexpr (M::joints == 4) {
      if (scene_.all_sensors) e = estimate_from_all(mechanism_, angle, now.rate);
    }
    if (f == Fault::loop_not_closed) {
      out.where = e ? "limits.closure" : "base joints";
      if (e) return with(out, e->closure, l.closure, "m between the leg tips");
    }
    if (!e) return out;
    const V2 x{e->pose.effector.x(), e->pose.effector.y()};
    if (f == Fault::type1_singularity)
      return with(out, M::min_abs_sin_type1(e->pose), l.min_abs_sin_type1, "|sin theta_j2|");
    if (f == Fault::type2_singularity)
      return with(out, M::sin_type2_in_mode(e->pose, mode_), l.min_abs_sin_type2, "D2 in its assembly mode");
    if (f == Fault::workspace && l.workspace) {
      for (std::size_t i = 0; i < 2; ++i) {
        const double v = i == 0 ? x.x : x.y;
        const auto& range = (*l.workspace)[i];
        out.where = i == 0 ? "x" : "y";
        if (!(v >= range[0])) return with(out, v, range[0], "m");
        if (!(v <= range[1])) return with(out, v, range[1], "m");
      }
    }
    return out;
  }

  static FaultRecord with(FaultRecord r, double measured, double limit, const char* unit) {
    r.measured = measured;
    r.limit = limit;
    r.unit = unit;
    return r;
  }
  static FaultRecord at(FaultRecord r, int joint, double measured, double limit, const char* unit) {
    r.where = World::joint_names[joint];
    return with(std::move(r), measured, limit, unit);
  }

  const Scene& scene_;
  M mechanism_;
  typename M::Mode mode_;
  std::optional<Sample<M>> before_;
  std::optional<FaultRecord> found_;
};

}  // namespace esmc::host
