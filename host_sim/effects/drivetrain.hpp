#pragma once
/// From the drive's torque to the joint's: lag, ripple, an elastic gear with play, in this order. Their
/// states are integrated with those of the plant.

#include <algorithm>
#include <optional>
#include <span>
#include <vector>

#include "host_sim/effects/effects.hpp"

namespace esmc::host {

/// Motion of a shaft or joint: rad, rad/s.
struct Shaft {
  double angle = 0.0, rate = 0.0;
};

/// The drivetrain of one motor. Its states `own`: the lagged torque, then angle and rate of the rotor.
class Drivetrain {
 public:
  static constexpr int most_states = 3;

  /// `motor`: index in the order of [drives], below 4. `flank`, if not null: which
  /// flank of a gear with play presses (+1, -1; 0: none), in place of the state; it must outlive this object.
  Drivetrain(const std::vector<Effect>& effects, std::size_t motor, const int* flank = nullptr);
  [[nodiscard]] bool empty() const { return !lag_ && !ripple_ && !gear_; }  ///< the torque passes unchanged
  /// Number of states, <= most_states.
  [[nodiscard]] std::size_t states() const { return rotor_at() + (gear_ ? 2U : 0U); }
  /// Sets initial states `own`, states() zeros before: the rotor moves with the joint, in mid play.
  void start(Shaft joint, std::span<double> own) const;
  /// Returns the torque at the joint, N m, for the drive's `torque`; writes the slopes of the states `own`.
  double pass(double torque, Shaft joint, std::span<const double> own, std::span<double> slope) const;
  /// Depth, rad, by which flank `side` (+1, -1) presses; <= 0: no contact. Only with has_play().
  [[nodiscard]] double contact(int side, Shaft joint, std::span<const double> own) const {
    const Shaft at = rotor(joint, own);
    const double pressed = side * (at.angle - joint.angle) - gear_->half_gap;
    if (!(pressed > 0.0)) return pressed;
    return pressed + std::min(0.0, gear_->damping / gear_->stiffness * side * (at.rate - joint.rate));
  }
  [[nodiscard]] bool has_play() const { return gear_ && gear_->half_gap > 0.0; }
  /// Angle (rad) and rate (rad/s) at the drive's encoder: of the rotor if there is one, else of the joint.
  [[nodiscard]] Shaft rotor(Shaft joint, std::span<const double> own) const {
    return gear_ ? Shaft{own[rotor_at()], own[rotor_at() + 1]} : joint;
  }

 private:
  /// Spring, damper and play between joint and rotor.
  struct Gear {
    double stiffness, damping, inertia, half_gap;
  };
  [[nodiscard]] std::size_t rotor_at() const { return lag_ ? 1 : 0; }
  /// Torque through the gear by the twist of the rotor against the joint, rad and rad/s.
  [[nodiscard]] double transmitted(double twist, double rate) const;

  std::optional<double> lag_;  ///< 1/s
  std::optional<TorqueRipple> ripple_;
  std::optional<Gear> gear_;
  const int* flank_;
};

}  // namespace esmc::host
