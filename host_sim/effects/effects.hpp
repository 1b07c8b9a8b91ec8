#pragma once
/// Parameters of the effects a scene may name. One that is not named has no state and no cost.

#include <array>
#include <cstdint>
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
/// Dry friction in every joint: set-valued (a held joint does not creep), or tanh(rate / regularised).
struct CoulombFriction {
  static constexpr const char* type = "coulomb_friction";
  PerJoint torque{};         ///< N m
  double regularised = 0.0;  ///< rad/s; 0: set-valued
  PerJoint
      asymmetry{};  ///< N m: torque + asymmetry against positive rates, torque - asymmetry against negative
};
/// Spring and damper between rotor and joint; the rotor has its own angle and rate.
struct JointFlexibility {
  static constexpr const char* type = "joint_flexibility";
  // At the joint, per motor:
  PerJoint stiffness{}, damping{}, rotor_inertia{};  ///< N m/rad, N m s/rad, kg m2
};
/// Play between rotor and joint; inside the gap no torque passes.
struct Backlash {
  static constexpr const char* type = "backlash";
  double gap = 0.0;  ///< rad at the joint, from contact to contact
  // Of the contact, N m/rad, N m s/rad, kg m2; unused beside joint_flexibility:
  double stiffness = 0.0, damping = 0.0, rotor_inertia = 0.0;
};
/// Stops of the base joints: rigid, or with a stiffness springs that return restitution^2 of their energy.
struct EndStops {
  static constexpr const char* type = "end_stops";
  std::array<double, 2> lower{}, upper{};  ///< rad
  std::optional<double> stiffness;         ///< N m/rad
  double restitution = 0.0;                ///< rebound speed over impact speed
};
/// A point mass at the effector between two instants; no impact when it is attached or released.
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
/// The torque at the joint is clamped to +-limit.
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
/// I2t: a motor above its continuous torque for long is limited to it until it has cooled.
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
  bool operator==(const Encoder&) const = default;
};
/// White noise on every reading of the shaft, before the observer.
struct SensorNoise {
  static constexpr const char* type = "noise";
  double sigma = 0.0;         ///< rad at the joint
  double bandwidth = 1000.0;  ///< rad/s, of the observer where no encoder is named
  bool operator==(const SensorNoise&) const = default;
};
/// Constant error of the zero of each sensed joint.
struct SensorBias {
  static constexpr const char* type = "bias";
  PerJoint angle{};  ///< rad, per joint
  bool operator==(const SensorBias&) const = default;
};
/// The drive reports the reading of `ticks` ticks ago.
struct SensorDelay {
  static constexpr const char* type = "delay";
  int ticks = 0;
  bool operator==(const SensorDelay&) const = default;
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

// ---- bus: `from`, `to` in s since t = 0; while arming only what begins before 0 acts ----

/// Span of time in which an effect acts.
struct Span {
  double from = 0.0, to = 0.0;  ///< s
};
/// Frames take the time of their bits, one at a time, in the order of arbitration.
struct BitTiming {
  static constexpr const char* type = "bit_timing";
};
/// A receiver misses a frame that all others have, unnoticed: its buffer was full.
struct Loss {
  static constexpr const char* type = "loss";
  double probability = 0.0;  ///< per frame and receiver
  bool at_controller = true, at_drives = true;
  Span when{};
};
/// The sender reads an error in the last bit of a frame that the receivers have accepted, and repeats it.
struct Duplication {
  static constexpr const char* type = "duplication";
  double probability = 0.0;  ///< per frame
  Span when{};
};
/// Disturbed bits: detected, and the frame is repeated; or not detected by the CRC, rare on a real bus.
struct Corruption {
  static constexpr const char* type = "corruption";
  double detected = 0.0;    ///< probability per transmission
  double undetected = 0.0;  ///< probability per frame
  int bits = 1;             ///< of the payload that are flipped undetected
  Span when{};
};
/// A node that sends frames that no receiver uses, with random data.
struct BabblingNode {
  static constexpr const char* type = "babbling_node";
  std::uint32_t identifier = 0;
  bool extended = false;
  int size = 8;
  double rate_hz = 0.0;  ///< more than the bus carries: it is always ready with the next one
  Span when{};
};
/// The CAN controller of a node goes bus-off.
struct BusOff {
  static constexpr const char* type = "bus_off";
  double at = 0.0;       ///< s
  int drive = 0;         ///< 1, 2, ...: of this entry in [drives]; 0: of the controller
  bool restart = false;  ///< it rejoins after 128 times 11 recessive bits
};
/// A drive that is cut off from the bus.
struct DriveDropout {
  static constexpr const char* type = "drive_dropout";
  int drive = 1;  ///< entry in [drives], from 1
  Span when{};
};

using Effect = std::variant<ViscousFriction, CoulombFriction, JointFlexibility, Backlash, EndStops, Payload,
                            ExternalForce, TorqueLag, TorqueSaturation, TorqueRipple, ThermalLimit, Encoder,
                            SensorNoise, SensorBias, SensorDelay, Jitter, ComputeDelay, BitTiming, Loss,
                            Duplication, Corruption, BabblingNode, BusOff, DriveDropout>;

/// Name of the effect in scenes, "viscous_friction".
[[nodiscard]] inline const char* type_name(const Effect& e) {
  return std::visit([](const auto& x) { return x.type; }, e);
}

/// Returns a copy of the first effect of type T; none: there is no such effect.
template <class T>
[[nodiscard]] std::optional<T> find_effect(const std::vector<Effect>& effects) {
  for (const Effect& e : effects) {
    if (const T* found = std::get_if<T>(&e)) return *found;
  }
  return std::nullopt;
}

/// True for effects on frames: they need the virtual bus.
[[nodiscard]] inline bool acts_on_bus(const Effect& e) {
  return std::holds_alternative<BitTiming>(e) || std::holds_alternative<Loss>(e) ||
         std::holds_alternative<Duplication>(e) || std::holds_alternative<Corruption>(e) ||
         std::holds_alternative<BabblingNode>(e) || std::holds_alternative<BusOff>(e) ||
         std::holds_alternative<DriveDropout>(e);
}

}  // namespace esmc::host
