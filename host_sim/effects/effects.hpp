#pragma once
/// The effects a scene may name: their parameters. One that is not named has no state and no cost: everything
/// made from this list is empty then.

#include <array>
#include <optional>
#include <string>
#include <variant>
#include <vector>

namespace esmc::host {

/// Entries per joint are in the order of the model (RR: the first two), per motor in the order of [drives].
using PerJoint = std::array<double, 4>;

// ---- plant ----

/// Torque -d * (relative rate) in every joint.
struct ViscousFriction {
  static constexpr const char* type = "viscous_friction";
  PerJoint coefficient{};  ///< N m s/rad
};
/// Dry friction in every joint: set-valued (a held joint stays where it is), or the cheap tanh(rate /
/// regularised).
struct CoulombFriction {
  static constexpr const char* type = "coulomb_friction";
  PerJoint torque{};         ///< N m
  double regularised = 0.0;  ///< rad/s; 0: set-valued
};
/// Spring and damper between rotor and joint: the rotor gets an angle and a rate of its own.
struct JointFlexibility {
  static constexpr const char* type = "joint_flexibility";
  PerJoint stiffness{}, damping{},
      rotor_inertia{};  ///< N m/rad, N m s/rad, kg m2, all at the joint, per motor
};
/// Play between rotor and joint; inside the gap no torque passes. Alone it brings its own contact stiffness.
struct Backlash {
  static constexpr const char* type = "backlash";
  double gap = 0.0;  ///< rad at the joint, from contact to contact
  double stiffness = 0.0, damping = 0.0,
         rotor_inertia = 0.0;  ///< of the contact; unused beside joint_flexibility
};
/// Stops for the base joints. Rigid (restitution by impulse) or, with a stiffness, springs that give back
/// restitution^2 of their energy.
struct EndStops {
  static constexpr const char* type = "end_stops";
  std::array<double, 2> lower{}, upper{};  ///< rad
  std::optional<double> stiffness;         ///< N m/rad
  double restitution = 0.0;                ///< rebound speed over impact speed
};
/// A point mass taken up at the effector, already moving with it, and let go.
struct Payload {
  static constexpr const char* type = "payload";
  double mass = 0.0, from = 0.0, to = 0.0;  ///< kg, s, s
};
/// A force at the effector: constant between two instants, or a hand: spring and damper towards an anchor.
struct ExternalForce {
  static constexpr const char* type = "external_force";
  bool human = false;
  std::array<double, 2> force{};          ///< N
  std::array<double, 2> anchor{};         ///< m
  double stiffness = 0.0, damping = 0.0;  ///< N/m, N s/m
  double from = 0.0, to = 0.0;            ///< s
};

// ---- drive ----

/// The torque follows its setpoint with a first-order lag.
struct TorqueLag {
  static constexpr const char* type = "torque_lag";
  double time_constant = 0.0;  ///< s
};
/// The torque at the joint cannot exceed a limit, whatever is asked.
struct TorqueSaturation {
  static constexpr const char* type = "torque_saturation";
  double limit = 0.0;  ///< N m at the joint
};
/// Cogging: amplitude * sin(per_turn * rotor angle), added to the torque.
struct TorqueRipple {
  static constexpr const char* type = "torque_ripple";
  double amplitude = 0.0;  ///< N m at the joint
  double per_turn = 0.0;   ///< periods per turn of the joint
};
/// I2t: a motor that has been above its continuous torque for long is held down to it until it has cooled.
struct ThermalLimit {
  static constexpr const char* type = "thermal_limit";
  double continuous = 0.0;     ///< N m at the joint
  double time_constant = 0.0;  ///< s
};

// ---- sensor ----

/// The shaft angle is known in steps of 2^-bits turns; the drive tracks it with a second-order observer.
struct Encoder {
  static constexpr const char* type = "encoder";
  int bits = 0;
  double bandwidth = 1000.0;  ///< rad/s, critically damped
};
/// White noise on every reading of the shaft, before the observer.
struct SensorNoise {
  static constexpr const char* type = "noise";
  double sigma = 0.0;         ///< rad at the joint
  double bandwidth = 1000.0;  ///< rad/s, of the observer where no encoder is named
};
/// Constant error of the zero of each sensed joint.
struct SensorBias {
  static constexpr const char* type = "bias";
  PerJoint angle{};  ///< rad, per joint
};
/// What the drive reports is old.
struct SensorDelay {
  static constexpr const char* type = "delay";
  int ticks = 0;
};

// ---- timing ----

/// The torque of a tick takes effect late by |N(0, sigma)|.
struct Jitter {
  static constexpr const char* type = "jitter";
  double sigma = 0.0;  ///< s
};
/// The torque of a tick takes effect this much later; it may be longer than a tick.
struct ComputeDelay {
  static constexpr const char* type = "compute_delay";
  double time = 0.0;  ///< s
};

using Effect = std::variant<ViscousFriction, CoulombFriction, JointFlexibility, Backlash, EndStops, Payload,
                            ExternalForce, TorqueLag, TorqueSaturation, TorqueRipple, ThermalLimit, Encoder,
                            SensorNoise, SensorBias, SensorDelay, Jitter, ComputeDelay>;

[[nodiscard]] inline const char* type_name(const Effect& e) {
  return std::visit([](const auto& x) { return x.type; }, e);
}

template <class T>
[[nodiscard]] std::optional<T> find_effect(const std::vector<Effect>& effects) {
  for (const Effect& e : effects) {
    if (const T* found = std::get_if<T>(&e)) return *found;
  }
  return std::nullopt;
}

}  // namespace esmc::host
