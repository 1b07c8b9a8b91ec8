#pragma once
/// From the drive's torque to the joint's: lag, ripple, play, an elastic gear. Each is a stage that the
/// torque passes; the states of a stage are integrated with those of the plant.

#include <memory>
#include <span>
#include <vector>

#include "host_sim/effects/effects.hpp"

namespace esmc::host {

struct Shaft {
  double angle = 0.0, rate = 0.0;
};

class DrivetrainStage {
 public:
  virtual ~DrivetrainStage() = default;
  [[nodiscard]] virtual int states() const { return 0; }
  /// Sets the own states to those of a joint with nothing stored and the rotor in the middle of its play.
  virtual void start(Shaft, std::span<double>) const {}
  /// Torque that goes on towards the joint; writes the slopes of its own states.
  virtual double pass(double torque, Shaft rotor, Shaft joint, std::span<const double> own,
                      std::span<double> slope) const = 0;
  /// Where the rotor is a body of its own: own[0], own[1] are its angle and rate.
  [[nodiscard]] virtual bool has_rotor() const { return false; }
};

/// The stages of one motor, in the order the torque takes.
class Drivetrain {
 public:
  static constexpr int most_states = 3;

  Drivetrain(const std::vector<Effect>& effects, std::size_t motor);
  [[nodiscard]] bool empty() const { return stages_.empty(); }
  [[nodiscard]] std::size_t states() const { return states_; }
  void start(Shaft joint, std::span<double> own) const;
  /// Returns the torque at the joint, N m, for the drive's `torque`; writes the slopes of the states `own`.
  double pass(double torque, Shaft joint, std::span<const double> own, std::span<double> slope) const;
  /// Angle (rad) and rate (rad/s) that the drive's encoder sees: of the rotor if a stage has one, else of the
  /// joint. `own`: all states of this drivetrain.
  [[nodiscard]] Shaft rotor(Shaft joint, std::span<const double> own) const {
    return rotor_at_ < 0 ? joint
                         : Shaft{own[static_cast<std::size_t>(rotor_at_)],
                                 own[static_cast<std::size_t>(rotor_at_) + 1]};
  }

 private:
  std::vector<std::unique_ptr<DrivetrainStage>> stages_;
  std::size_t states_ = 0;
  int rotor_at_ = -1;
};

}  // namespace esmc::host
