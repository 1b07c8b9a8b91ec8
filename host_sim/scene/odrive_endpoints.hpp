#pragma once
/// Endpoints of an ODrive's configuration that affect torque and can be read over CAN with firmware 0.6.

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "firmware/drive/odrive.hpp"

namespace esmc::host {

/// Settings of an ODrive that are read back.
enum class OdriveValue : std::uint8_t {
  enable_watchdog,
  watchdog_timeout,  // s
  control_mode,
  input_mode,
  torque_mode_limit,  // whether torque is cut to vel_gain (vel_limit - speed)
  vel_limit,          // rev/s
  overspeed_error,    // whether it trips above vel_limit
  torque_constant,    // N m/A
  current_limit,      // A
  heartbeat_period,   // ms; 0: none
};
/// Path of a setting in the vendor's file, and its type.
struct OdriveValueName {
  OdriveValue value;
  const char* path;
  drive::odrive::ValueType type;
};
/// Every OdriveValue, in the order of the enumerator, which is the index: its path in the vendor's file (of
/// axis 0) and its type.
inline constexpr auto odrive_values = [] {
  using enum OdriveValue;
  using enum drive::odrive::ValueType;
  return std::array<OdriveValueName, 10>{{
      {enable_watchdog, "axis0.config.enable_watchdog", u8},
      {watchdog_timeout, "axis0.config.watchdog_timeout", f32},
      {control_mode, "axis0.controller.config.control_mode", u8},
      {input_mode, "axis0.controller.config.input_mode", u8},
      {torque_mode_limit, "axis0.controller.config.enable_torque_mode_vel_limit", u8},
      {vel_limit, "axis0.controller.config.vel_limit", f32},
      {overspeed_error, "axis0.controller.config.enable_overspeed_error", u8},
      {torque_constant, "axis0.config.motor.torque_constant", f32},
      {current_limit, "axis0.config.motor.current_soft_max", f32},
      {heartbeat_period, "axis0.config.can.heartbeat_msg_rate_ms", u32},
  }};
}();

/// Number of the endpoint of a setting.
struct OdriveEndpoint {
  OdriveValue value;
  std::uint16_t id;
  drive::odrive::ValueType type;
};
/// Endpoints of one version of the firmware.
struct OdriveEndpoints {
  std::array<std::uint8_t, 3> firmware{};  ///< major, minor, revision
  std::vector<OdriveEndpoint> list;        ///< of `odrive_values`, those that the file has

  /// Whether the file has an endpoint for v.
  [[nodiscard]] bool has(OdriveValue v) const {
    for (const OdriveEndpoint& e : list) {
      if (e.value == v) return true;
    }
    return false;
  }
};

/// Reads the vendor's flat_endpoints.json; its content goes to `text`. Throws InputError at `where` for a
/// file that is missing, over 16 MiB or of another form; endpoints that it does not have are left out.
OdriveEndpoints read_odrive_endpoints(const std::string& where, const std::string& path, std::string& text);

}  // namespace esmc::host
