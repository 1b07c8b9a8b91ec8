#pragma once
/// A plant in motion: its state, the effects attached to it, the integrator, and the account of its energy.

#include <array>
#include <memory>
#include <optional>
#include <vector>

#include "host_sim/plant/engine_base.hpp"

namespace esmc::host {

template <class Plant>
class Motion {
 public:
  using State = typename Plant::State;
  using Output = typename Plant::Output;
  using Joints = typename Plant::Joints;

  struct Setup {
    Plant plant;
    Plant with_payload;  ///< the same mechanism with the scene's payload at its effector
    std::vector<Effect> effects;
    std::vector<std::size_t> motor_joint;  ///< joint of each motor
    Method method = Method::rk4;           ///< moreau_jean and event_driven alone take set-valued effects
    Resolution resolution{};               ///< of event_driven
    const Hand* hand = nullptr;            ///< one that may pull at the effector; outlives the motion
  };

  /// `initial`: the state at t = 0, which is moved onto the closure.
  Motion(const Setup& setup, const State& initial);

  [[nodiscard]] const Plant& plant() const { return loaded_ ? setup_->with_payload : setup_->plant; }
  [[nodiscard]] const State& state() const { return state_; }  ///< bars in N: rad, rad/s
  [[nodiscard]] Output output() const { return plant().output(state_); }
  /// In use: moreau_jean where effects are set-valued.
  [[nodiscard]] Method method() const { return engine_->method(); }
  [[nodiscard]] Effort effort() const { return engine_->effort(); }  ///< of event_driven since the start
  /// Number of states: positions and rates of the mechanism, and states of effects.
  [[nodiscard]] int state_dimension() const {
    return 2 * Plant::coordinates + static_cast<int>(engine_->effect_states());
  }
  /// Angle (rad) and rate (rad/s), model convention, of the shaft whose encoder the joint's drive reads.
  [[nodiscard]] Shaft shaft(std::size_t joint) const { return engine_->shaft(joint); }

  /// Advances from t, s, where the last advance ended, over `seconds` in `steps` >= 1 equal steps; more where
  /// an effect begins or ends in between. A state that diverges becomes not finite: the caller checks.
  void advance(double t, double seconds, int steps, const MotorTorques<Joints>& torque);

  /// Change of energy less the work of motors and loads, relative to the largest kinetic energy, change of
  /// potential energy or work seen so far.
  [[nodiscard]] double energy_error();
  /// Kinetic and potential energy now, J.
  [[nodiscard]] double energy() const {
    return plant().kinetic_energy(state_) + plant().potential_energy(state_);
  }
  [[nodiscard]] double work() const { return engine_->work(); }  ///< of motors and loads since t = 0, J

 private:
  void set_payload(bool loaded);
  void run(double t, double seconds, int steps, const MotorTorques<Joints>& torque);

  std::unique_ptr<Setup> setup_;  // engines point into it
  std::unique_ptr<Engine<Plant>> engine_;
  State state_;
  std::optional<Payload> payload_;
  std::vector<double> breaks_;  ///< ascending instants no step may cross
  bool loaded_ = false;
  double energy_start_ = 0.0, potential_start_ = 0.0, energy_scale_ = 0.0;
};

extern template class Motion<FiveBarPlant>;
extern template class Motion<RrPlant>;

}  // namespace esmc::host
