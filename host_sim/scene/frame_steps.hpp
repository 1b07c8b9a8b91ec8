#pragma once
/// The integers in which drives report and take numbers.

#include <numbers>
#include <vector>

#include "firmware/drive/mit.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

/// Steps of the integers in a drive's frames, at the shaft; 0: floats.
struct FrameSteps {
  double position = 0.0, velocity = 0.0, torque = 0.0;  ///< rad, rad/s, N m
};

/// Steps of drive `entry` in the lists of [drives]; those past the motors are encoders.
[[nodiscard]] inline FrameSteps frame_steps(const DriveScene& d, std::size_t entry) {
  constexpr double turn = 2.0 * std::numbers::pi;
  const auto at = [&](const std::vector<double>& of_motors) {
    return entry < of_motors.size() ? of_motors[entry] : 0.0;
  };
  if (d.protocol == Protocol::cia402)
    return {turn / d.counts_per_turn, d.velocity_unit, 1e-3 * at(d.rated_torque)};
  if (d.protocol != Protocol::mit) return {};
  const double torque = 2.0 * at(d.torque_range) / drive::mit::code_max_12;
  if (d.dialect == drive::mit::Dialect::cubemars_v3) return {turn / 3600.0, d.velocity_unit, torque};
  return {2.0 * at(d.position_range) / drive::mit::code_max_16,
          2.0 * at(d.velocity_range) / drive::mit::code_max_12, torque};
}

}  // namespace esmc::host
