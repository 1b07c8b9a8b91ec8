#pragma once
/// From the drive's torque to the joint's: lag, ripple, play, an elastic gear. Each is a stage that the
/// torque passes; the states of a stage are integrated with those of the plant.

#include <algorithm>
#include <functional>
#include <span>
#include <vector>

#include "host_sim/effects/effects.hpp"

namespace esmc::host {

/// Motion of a shaft or joint: rad, rad/s.
struct Shaft {
  double angle = 0.0, rate = 0.0;
};

/// The stages of one motor, in the order the torque takes.
class Drivetrain {
 public:
  static constexpr int most_states = 3;

  /// `motor`: index in the order of [drives], below 4. `flank`, if not null: which
  /// flank of a gear with play presses (+1, -1; 0: none), in place of the state; it must outlive this object.
  Drivetrain(const std::vector<Effect>& effects, std::size_t motor, const int* flank = nullptr);
  [[nodiscard]] bool empty() const { return stages_.empty(); }  ///< the torque passes unchanged
  [[nodiscard]] std::size_t states() const { return states_; }  ///< number of states, <= most_states
  /// Sets initial states `own`, states() zeros before: the rotor moves with the joint, in mid play.
  void start(Shaft joint, std::span<double> own) const;
  /// Returns the torque at the joint, N m, for the drive's `torque`; writes the slopes of the states `own`.
  double pass(double torque, Shaft joint, std::span<const double> own, std::span<double> slope) const;
  /// Depth, rad, by which flank `side` (+1, -1) presses; <= 0: no contact. Only with has_play().
  [[nodiscard]] double contact(int side, Shaft joint, std::span<const double> own) const {
    const Shaft at = rotor(joint, own);
    const double pressed = side * (at.angle - joint.angle) - play_.half_gap;
    if (!(pressed > 0.0)) return pressed;
    return pressed + std::min(0.0, play_.damping / play_.stiffness * side * (at.rate - joint.rate));
  }
  [[nodiscard]] bool has_play() const { return play_.half_gap > 0.0; }  ///< a stage has a gap
  /// Angle (rad) and rate (rad/s) at the drive's encoder: of the rotor if a stage has one, else of the joint.
  /// `own`: all states of this drivetrain.
  [[nodiscard]] Shaft rotor(Shaft joint, std::span<const double> own) const {
    return has_rotor_ ? Shaft{own[rotor_at_], own[rotor_at_ + 1]} : joint;
  }

 private:
  struct Stage {
    std::size_t states = 0;
    /// Torque that goes on towards the joint; writes the slopes of the stage's own states.
    std::function<double(double torque, Shaft rotor, Shaft joint, std::span<const double> own,
                         std::span<double> slope)>
        pass;
  };
  void add(std::size_t states, decltype(Stage::pass) pass);
  /// Spring, damper and play between joint and rotor, whose angle and rate are the stage's states.
  void add_gear(double stiffness, double damping, double inertia, double gap, const int* flank);
  struct Play {
    double stiffness = 0.0, damping = 0.0, half_gap = 0.0;
  };

  std::vector<Stage> stages_;
  Play play_;
  std::size_t states_ = 0, rotor_at_ = 0;
  bool has_rotor_ = false;  ///< a body of its own
};

}  // namespace esmc::host
