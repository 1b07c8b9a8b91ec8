#pragma once
/// From the torques that the drives were told to the motion of the plant over a tick: limits and delays.

#include <algorithm>
#include <cmath>
#include <deque>
#include <optional>

#include "host_sim/effects/random.hpp"
#include "host_sim/plant/motion.hpp"

namespace esmc::host {

/// The limits of one drive.
class TorqueStage {
 public:
  explicit TorqueStage(const std::vector<Effect>& effects)
      : saturation_(find_effect<TorqueSaturation>(effects)), thermal_(find_effect<ThermalLimit>(effects)) {}

  /// Delivered torque over a tick of `seconds`, N m; sets `clipped` where it differs from `torque`, never
  /// clears it. Heats the motor: call once per tick.
  [[nodiscard]] double operator()(double torque, double seconds, bool& clipped) {
    double out = torque;
    if (saturation_) out = std::clamp(out, -saturation_->limit, saturation_->limit);
    if (thermal_) {
      if (hot_) out = std::clamp(out, -thermal_->continuous, thermal_->continuous);
      // First-order heating towards (torque / continuous)^2, exact while the torque is held.
      const double load = out / thermal_->continuous;
      heat_ += (load * load - heat_) * -std::expm1(-seconds / thermal_->time_constant);
      hot_ = hot_ ? heat_ > cooled : heat_ > 1.0;
    }
    clipped = clipped || out != torque;
    return out;
  }
  [[nodiscard]] int states() const { return thermal_ ? 1 : 0; }  ///< number of them

 private:
  static constexpr double cooled = 0.9;  ///< hysteresis, so that the limit does not chatter
  std::optional<TorqueSaturation> saturation_;
  std::optional<ThermalLimit> thermal_;
  double heat_ = 0.0;
  bool hot_ = false;
};

template <class Plant>
class Actuators {
 public:
  using Joints = typename Plant::Joints;

  /// Copies all. `motor_joint`: joint of each motor; `seed`: of the jitter.
  Actuators(const std::vector<Effect>& effects, const std::vector<std::size_t>& motor_joint,
            std::uint64_t seed)
      : motor_joint_(motor_joint),
        stage_(motor_joint.size(), TorqueStage(effects)),
        late_(find_effect<ComputeDelay>(effects)),
        jitter_(find_effect<Jitter>(effects)),
        random_(seed, 1000) {}

  /// Torques that the drives deliver for the commands `asked` over `tick` seconds, per joint, N m. Sets
  /// `clipped` if a limit acts, never clears it. Heats the motors: call once per tick.
  Joints deliver(const Joints& asked, double tick, bool& clipped) {
    Joints out{};
    for (std::size_t m = 0; m < motor_joint_.size(); ++m)
      out[motor_joint_[m]] = stage_[m](asked[motor_joint_[m]], tick, clipped);
    return out;
  }

  /// Moves the plant over `seconds` from t, s, in steps no longer than `step`, s. `torque`, N m per joint,
  /// acts at once, or after the delay of compute_delay and jitter; until then earlier torques act.
  template <class Moves = Motion<Plant>>
  void advance(Moves& motion, double t, double seconds, double step, const Joints& torque) {
    if (!late_ && !jitter_) return motion.advance(t, seconds, count(seconds, step), {torque, nullptr});
    double delay = late_ ? late_->time : 0.0;
    if (jitter_) delay += std::abs(jitter_->sigma * random_());
    const double from =
        pending_.empty() ? t + delay : std::max(t + delay, pending_.back().at);  // none overtakes another
    pending_.push_back({from, torque});
    const double end = t + seconds;
    while (t < end) {
      while (!pending_.empty() && pending_.front().at <= t) {
        acting_ = pending_.front().torque;
        pending_.pop_front();
      }
      const double to = pending_.empty() ? end : std::min(end, pending_.front().at);
      motion.advance(t, to - t, count(to - t, step), {acting_, nullptr});
      t = to;
    }
  }
  [[nodiscard]] int states() const {
    int n = 0;
    for (const TorqueStage& s : stage_) n += s.states();
    return n;
  }

 private:
  struct Change {
    double at;
    Joints torque;
  };
  static int count(double seconds, double step) {
    return std::max(1, static_cast<int>(std::ceil(seconds / step - 1e-9)));
  }

  std::vector<std::size_t> motor_joint_;
  std::vector<TorqueStage> stage_;
  std::optional<ComputeDelay> late_;
  std::optional<Jitter> jitter_;
  Normal random_;
  std::deque<Change> pending_;
  Joints acting_{};
};

}  // namespace esmc::host
