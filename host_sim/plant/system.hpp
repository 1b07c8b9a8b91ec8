#pragma once
/// A plant as the integrators see it: y = [angles, rates, work done on the mechanism, states of effects].
/// BareSystem has no effects, so that a scene without them pays no instruction for them.

#include <array>
#include <functional>
#include <limits>
#include <span>
#include <utility>
#include <vector>

#include "host_sim/effects/drivetrain.hpp"
#include "host_sim/effects/effects.hpp"
#include "host_sim/plant/inputs.hpp"
#include "host_sim/plant/plant.hpp"

namespace esmc::host {

/// Adds torques, N m, at the joint angles and rates of the model.
using JointLoad = std::function<void(std::span<const double> angle, std::span<const double> rate,
                                     std::span<double> torque)>;

struct EffectorLoad {
  /// Force in N on an effector at p moving with v.
  std::function<V2(V2 p, V2 v)> force;
  double from = -std::numeric_limits<double>::infinity(), to = -from;  ///< s
  /// Whether it acts in the stretch of time in hand: at the jump itself, where a stage of an integrator may
  /// lie, the time alone would be ambiguous.
  bool acting = true;
};

struct Loads {
  std::vector<JointLoad> joint;
  std::vector<EffectorLoad> effector;
  std::vector<double> breaks;  ///< instants at which a load jumps: no step may cross one

  /// Sets which effector loads act from here on: those whose interval holds `middle`, s. The caller ends the
  /// stretch at the next of `breaks`; nothing is switched within it.
  void begin(double middle) {
    for (EffectorLoad& load : effector) load.acting = middle > load.from && middle < load.to;
  }
};

/// The loads of all effects but set-valued ones (engine.hpp).
Loads make_loads(const std::vector<Effect>& effects);

/// Whether effects need the time-stepping scheme: Coulomb friction not regularised, or rigid end stops.
[[nodiscard]] bool set_valued(const std::vector<Effect>& effects);

/// Whether a motion with these effects may have an event, or a limit that cuts the torque of an open loop.
[[nodiscard]] bool may_have_events(const std::vector<Effect>& effects);

/// What the effects of a scene add: loads, and a drivetrain per motor.
struct Attachments {
  Loads loads;
  std::vector<Drivetrain> drivetrain;    ///< per motor; empty where no effect asks for one
  std::vector<std::size_t> motor_joint;  ///< joint of each motor
  std::array<int, 4> flank{};            ///< per motor: Drivetrain's, where the integration sets it

  [[nodiscard]] bool none() const {
    return loads.joint.empty() && loads.effector.empty() && drivetrain.empty();
  }
};

/// Angles, rates and work; the part all systems share.
template <class Plant, std::size_t Extra>
class MechanismState {
 public:
  static constexpr std::size_t positions = Plant::coordinates;
  static constexpr std::size_t work = 2 * positions;
  static constexpr std::size_t capacity = work + 1 + Extra;
  using Scalar = typename Plant::Scalar;
  using State = std::array<Scalar, capacity>;
  using Angles = typename Plant::Angles;
  using Joints = typename Plant::Joints;

  explicit MechanismState(const Plant& plant) : plant_(&plant) {}
  [[nodiscard]] const Plant& plant() const { return *plant_; }
  void set_plant(const Plant& plant) { plant_ = &plant; }  ///< must outlive this, as the first one
  void set_torques(const MotorTorques<Joints>& torques) { torques_ = torques; }

  /// Angles and rates of the bars within y; put() writes them.
  static Angles angles(const State& y) { return part(y, 0); }
  static Angles rates(const State& y) { return part(y, positions); }
  static void put(State& y, const Angles& angle, const Angles& rate) {
    for (std::size_t i = 0; i < positions; ++i) {
      y[i] = angle[i];
      y[positions + i] = rate[i];
    }
  }
  /// Angle (rad) and rate (rad/s), model convention, of a joint without a drivetrain.
  [[nodiscard]] Shaft shaft(std::size_t joint, const State& y) const {
    return {Plant::joint_angles(angles(y))[joint], Plant::joint_rates(rates(y))[joint]};
  }
  /// Moves the angles and rates in y onto the closure.
  void project(State& y) const {
    Angles angle = angles(y), rate = rates(y);
    plant_->project(angle, rate);
    put(y, angle, rate);
  }

 protected:
  /// Slopes of angles, rates and work under torques at the joints.
  void mechanism_slope(const Angles& angle, const Angles& rate, const Joints& torque, State& dy) const {
    put(dy, rate, plant_->acceleration(angle, rate, torque));
    const Joints w = Plant::joint_rates(rate);
    Scalar power = 0.0;
    for (std::size_t i = 0; i < w.size(); ++i) power += torque[i] * w[i];
    dy[work] = power;
  }
  [[nodiscard]] const MotorTorques<Joints>& torques() const { return torques_; }

 private:
  static Angles part(const State& y, std::size_t from) {
    Angles out;
    for (std::size_t i = 0; i < positions; ++i) out[i] = y[from + i];
    return out;
  }
  const Plant* plant_;
  MotorTorques<Joints> torques_{};
};

/// Nothing but the mechanism under its motors.
template <class Plant>
class BareSystem : public MechanismState<Plant, 0> {
 public:
  using Base = MechanismState<Plant, 0>;
  using State = typename Base::State;
  using Base::Base;
  BareSystem(const Plant& plant, const Attachments&) : Base(plant) {}
  static constexpr std::size_t size() { return Base::capacity; }
  static void start(const State&) {}
  /// Sets dy to the slope of y at time t, s.
  void slope(double t, const State& y, State& dy) const {
    this->mechanism_slope(Base::angles(y), Base::rates(y), this->torques().at(t), dy);
  }
};

template <class Plant>
class LoadedSystem : public MechanismState<Plant, Drivetrain::most_states * Plant::joints> {
 public:
  using Base = MechanismState<Plant, Drivetrain::most_states * Plant::joints>;
  using State = typename Base::State;
  using Joints = typename Plant::Joints;
  using Angles = typename Plant::Angles;

  /// Both must outlive this.
  LoadedSystem(const Plant& plant, const Attachments& attached) : Base(plant), attached_(&attached) {
    for (const Drivetrain& d : attached.drivetrain) size_ += d.states();
  }
  [[nodiscard]] std::size_t size() const { return size_; }

  void slope(double t, const State& y, State& dy) const {
    const auto angle = Base::angles(y), rate = Base::rates(y);
    const Joints torque =
        joint_torque(t, y, dy, angle, rate, Plant::joint_angles(angle), Plant::joint_rates(rate));
    this->mechanism_slope(angle, rate, torque, dy);
  }
  /// Torques at the joints, N m. Sets the slopes of the drivetrains' states in dy.
  Joints joint_torque(double t, const State& y, State& dy, const Angles& angle, const Angles& rate,
                      const Joints& theta, const Joints& w) const {
    Joints torque = this->torques().at(t);
    std::size_t at = Base::work + 1;
    for (std::size_t m = 0; m < attached_->drivetrain.size(); ++m) {
      const Drivetrain& d = attached_->drivetrain[m];
      const std::size_t j = attached_->motor_joint[m];
      torque[j] = d.pass(torque[j], {theta[j], w[j]}, std::span(y).subspan(at, d.states()),
                         std::span(dy).subspan(at, d.states()));
      at += d.states();
    }
    for (const JointLoad& load : attached_->loads.joint) load(theta, w, torque);
    if (!attached_->loads.effector.empty()) {
      const EffectorPoint at_tip = this->plant().effector_point(angle, rate);
      V2 force;
      for (const EffectorLoad& load : attached_->loads.effector)
        if (load.acting) force = force + load.force(at_tip.position, at_tip.rate);
      for (std::size_t i = 0; i < 2; ++i) torque[i] += dot(at_tip.torque_per_force[i], force);
    }
    return torque;
  }

  /// Sets the states of the drivetrains in y: each rotor has angle and rate of its joint, nothing is stored.
  void start(State& y) const {
    const Joints theta = Plant::joint_angles(Base::angles(y)), w = Plant::joint_rates(Base::rates(y));
    std::size_t at = Base::work + 1;
    for (std::size_t m = 0; m < attached_->drivetrain.size(); ++m) {
      const Drivetrain& d = attached_->drivetrain[m];
      const std::size_t j = attached_->motor_joint[m];
      d.start({theta[j], w[j]}, std::span(y).subspan(at, d.states()));
      at += d.states();
    }
  }
  /// Angle (rad) and rate (rad/s) at the encoder of a joint's drive: of the rotor where that is a body.
  [[nodiscard]] Shaft shaft(std::size_t joint, const State& y) const {
    const Shaft at_joint = Base::shaft(joint, y);
    std::size_t at = Base::work + 1;
    for (std::size_t m = 0; m < attached_->drivetrain.size(); ++m) {
      const Drivetrain& d = attached_->drivetrain[m];
      if (attached_->motor_joint[m] == joint) return d.rotor(at_joint, std::span(y).subspan(at, d.states()));
      at += d.states();
    }
    return at_joint;
  }

 protected:
  [[nodiscard]] const Attachments& attached() const { return *attached_; }

 private:
  const Attachments* attached_;
  std::size_t size_ = Base::work + 1;
};

}  // namespace esmc::host
