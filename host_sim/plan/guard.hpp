#pragma once
/// What the controller guards, place by place along a program.

#include <string>

#include "host_sim/plan/limits.hpp"
#include "host_sim/turns.hpp"

namespace esmc::host::plan {

[[nodiscard]] inline std::string place_text(const Vec2<double>& p) {
  return fmt::format("({:.4g}, {:.4g}) m", p.x(), p.y());
}

/// Checks places in the order of the way; it follows the turns of the base joints.
template <class M>
class WayGuard {
 public:
  WayGuard(const Problem<M>& p, MotorLimits<M>& motors) : p_(p), motors_(motors), base_(p.start_base) {
    for (const Range<double>& r : p.controller.limits.joint_angle)
      turns_ = turns_ || r.lower != Range<double>{}.lower || r.upper != Range<double>{}.upper;
  }

  /// A stretch begins; rewind() leads back to there.
  void begin() { from_ = base_; }
  void rewind() { base_ = from_; }
  /// Throws Refused for a pose where the controller would raise a fault; move(): in which move it is.
  template <class F>
  void check(const typename M::Pose& pose, const F& move) {
    const auto& c = p_.controller;
    check_modes(pose, move);
    if (!c.limits.workspace_x.contains(pose.effector.x()) ||
        !c.limits.workspace_y.contains(pose.effector.y()))
      throw Refused(move(), "to", "leads beyond limits.workspace at {}", place_text(pose.effector));
    if (!turns_) return;
    const Vec2<double> wrapped = M::base_angles(pose);
    for (int k = 0; k < 2; ++k) {
      base_[k] = nearest_turn(wrapped[k], base_[k]);
      if (c.limits.joint_angle[static_cast<std::size_t>(k)].contains(base_[k])) continue;
      throw Refused(move(), "to", "leads beyond limits.joint_angle at {}: base joint {} at {:.4g} rad",
                    place_text(pose.effector), k + 1, base_[k]);
    }
  }
  /// Throws Refused for a pose that no torque holds.
  void check_holding(const typename M::Pose& pose, std::size_t move) const {
    const Loads still = motors_.holding(pose);
    const auto most = std::max_element(still.begin(), still.end());
    if (*most < 1.0) return;
    throw Refused(move, "to",
                  "leads to {}, where motor {} takes {:.3g} % of its torque to hold the mechanism at rest",
                  place_text(pose.effector), most - still.begin() + 1, 100.0 * *most);
  }
  /// Whether a move states another working mode than the controller has.
  [[nodiscard]] bool changes_mode(std::size_t move) const {
    const MoveScene& m = p_.moves[move];
    for (std::size_t j = 0; j < m.working_mode.size(); ++j) {
      if constexpr (M::joints == 4) {
        if (m.working_mode[j] != p_.controller.mode.working[static_cast<int>(j)]) return true;
      } else {
        if (m.working_mode[j] != p_.controller.mode.working) return true;
      }
    }
    return false;
  }

 private:
  template <class F>
  void check_modes(const typename M::Pose& pose, const F& move) const {
    const auto& c = p_.controller;
    const double type1 = M::min_abs_sin_type1(pose), type2 = M::sin_type2_in_mode(pose, c.mode);
    if (!(type1 >= c.limits.min_abs_sin_type1) || !M::in_working_mode(pose, c.mode)) {
      const bool asked = changes_mode(move());
      throw Refused(move(), asked ? "working_mode" : "to",
                    "{} at {}: |sin theta_j2| = {:.3g}, limits.min_abs_sin_type1 = {:g}, and the controller "
                    "keeps its working mode",
                    asked ? "changes by crossing type 1" : "leads into a type-1 singularity",
                    place_text(pose.effector), type1, c.limits.min_abs_sin_type1);
    }
    const bool regular = c.motors == Motors::all && c.sensors == Sensors::all;
    if (regular || type2 >= c.limits.min_abs_sin_type2) return;
    throw Refused(move(), "to", "leads {} at {}: |D2| = {:.3g}, limits.min_abs_sin_type2 = {:g}",
                  type2 < 0.0 ? "into the other assembly mode" : "into a type-2 singularity",
                  place_text(pose.effector), std::abs(type2), c.limits.min_abs_sin_type2);
  }

  const Problem<M>& p_;
  MotorLimits<M>& motors_;
  Vec2<double> base_, from_ = base_;  // rad, not wrapped
  bool turns_ = false;                // a joint angle is limited, so that turns are followed
};

}  // namespace esmc::host::plan
