#pragma once
/// The effects a scene may name. One that is not named has no state and no cost: the lists below are empty then.

#include <array>
#include <optional>
#include <span>
#include <string>
#include <variant>
#include <vector>

namespace esmc::host {

/// Plant: torque -d * (relative rate) in every joint.
struct ViscousFriction {
  static constexpr const char* type = "viscous_friction";
  std::array<double, 4> coefficient{};  ///< N m s/rad, per joint in the order of the model
};
/// Sensor: the shaft angle is known in steps of 2^-bits turns; the drive tracks it with a second-order observer.
struct Encoder {
  static constexpr const char* type = "encoder";
  int bits = 0;
  double bandwidth = 1000.0;  ///< rad/s, critically damped
};
/// Drive: the torque at the joint cannot exceed a limit, whatever is asked.
struct TorqueSaturation {
  static constexpr const char* type = "torque_saturation";
  double limit = 0.0;  ///< N m at the joint
};

using Effect = std::variant<ViscousFriction, Encoder, TorqueSaturation>;

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

/// The effects that put torques on joints, as the integrator sees them.
class JointLoads {
 public:
  explicit JointLoads(const std::vector<Effect>& effects) {
    for (const Effect& e : effects) {
      if (const auto* v = std::get_if<ViscousFriction>(&e)) viscous_.push_back(*v);
    }
  }
  /// Adds the torques at the joint rates of the model, N m.
  void add(std::span<const double> rate, std::span<double> torque) const {
    for (const ViscousFriction& v : viscous_) {
      for (std::size_t i = 0; i < rate.size(); ++i) torque[i] -= v.coefficient[i] * rate[i];
    }
  }

 private:
  std::vector<ViscousFriction> viscous_;
};

}  // namespace esmc::host
