#pragma once
/// ODrive CANSimple on the wire: identifiers, bytes and units of the messages used for torque control.
/// id = node << 5 | command; little endian; floats IEEE binary32; revolutions and N m at the motor shaft.
/// As far as used here, firmware 0.6 and 0.5.6 differ in the last bytes of the heartbeat only.

#include <array>
#include <bit>
#include <cstdint>
#include <optional>

#include "hal/can.hpp"

/// ODrive CANSimple on the wire.
namespace esmc::drive::odrive {

/// Generations of the protocol.
enum class Version : std::uint8_t { v0_6, v0_5_6 };

/// Command numbers.
enum class Message : std::uint8_t {
  get_version = 0x00,          ///< 0.6, drive -> us, cyclic or on request (RTR): protocol, hardware, firmware
  heartbeat = 0x01,            ///< drive -> us: u32 axis_error, u8 axis_state, ...
  estop = 0x02,                ///< any node -> drive, no payload: disarm with an error
  get_error = 0x03,            ///< 0.6, drive -> us: u32 active errors, u32 disarm reason
  rx_sdo = 0x04,               ///< 0.6, us -> drive: u8 0 read, 1 write, u16 endpoint, u8 0, value
  tx_sdo = 0x05,               ///< 0.6, drive -> us: u8 0, u16 endpoint, u8 0, value
  set_axis_state = 0x07,       ///< us -> drive: u32 AxisState, 4 bytes unused
  encoder_estimates = 0x09,    ///< drive -> us: f32 position rev, f32 velocity rev/s
  set_controller_mode = 0x0B,  ///< us -> drive: u32 control mode, u32 input mode
  set_input_torque = 0x0E,     ///< us -> drive: f32 N m, 4 bytes unused
  clear_errors = 0x18,         ///< us -> drive: 0.6 u8 identify, 0.5.6 none
  get_torques = 0x1C,          ///< 0.6, drive -> us, cyclic or on request: f32 target, f32 estimate, N m
};

/// The states of an axis that are used here.
enum class AxisState : std::uint8_t { undefined = 0, idle = 1, closed_loop_control = 8 };
inline constexpr std::uint32_t control_mode_torque = 1;
inline constexpr std::uint32_t input_mode_passthrough = 1;
inline constexpr std::uint8_t node_max = 0x3E;
inline constexpr std::uint8_t node_broadcast = 0x3F;  ///< 0.6 only
inline constexpr std::uint32_t error_watchdog_0_6 = 0x0100'0000;
inline constexpr std::uint32_t error_watchdog_0_5_6 = 0x0000'0800;
inline constexpr std::uint32_t error_estop_0_6 = 0x0200'0000;
inline constexpr std::uint32_t error_estop_0_5_6 = 0x0000'4000;

/// CAN identifier (11 bits) of a message of or to a node. `node`: 0..node_max or broadcast, not checked.
[[nodiscard]] constexpr std::uint32_t identifier(std::uint8_t node, Message m) {
  return (std::uint32_t{node} << 5U) | static_cast<std::uint32_t>(m);
}

/// True for messages that only a controller sends to an axis: axis state (07); mode and set points, of which
/// position and speed carry a torque too (0B..0E); limits (0F); trajectories and anticogging (10..13); reboot
/// (16); errors, zero, gains (18..1B); 0.5.6: node (06); 0.6: firmware update (1F).
[[nodiscard]] constexpr bool is_command(std::uint32_t message, Version v) {
  constexpr std::uint32_t both = 1U << 0x07U | 0x1FU << 0x0BU | 0xFU << 0x10U | 1U << 0x16U | 0xFU << 0x18U;
  const std::uint32_t all = both | (v == Version::v0_6 ? 1U << 0x1FU : 1U << 0x06U);
  return (all >> (message & 0x1FU) & 1U) != 0;
}

namespace detail {
constexpr void put_u32(hal::CanFrame& f, std::size_t at, std::uint32_t v) {
  for (unsigned i = 0; i < 4; ++i) f.data[at + i] = static_cast<std::uint8_t>(v >> (8U * i));
}
constexpr std::uint32_t get_u32(const hal::CanFrame& f, std::size_t at) {
  static_assert(std::endian::native == std::endian::little);
  return std::bit_cast<std::uint32_t>(
      std::array<std::uint8_t, 4>{f.data[at], f.data[at + 1], f.data[at + 2], f.data[at + 3]});
}
constexpr hal::CanFrame frame(std::uint8_t node, Message m, std::uint8_t size) {
  return hal::data_frame(identifier(node, m), size);
}
}  // namespace detail

/// Set_Axis_State: request for an axis state.
[[nodiscard]] constexpr hal::CanFrame encode_set_axis_state(std::uint8_t node, AxisState s) {
  hal::CanFrame f = detail::frame(node, Message::set_axis_state, 8);
  detail::put_u32(f, 0, static_cast<std::uint32_t>(s));
  return f;
}
/// Request for torque control with unfiltered set points.
[[nodiscard]] constexpr hal::CanFrame encode_set_controller_mode(std::uint8_t node) {
  hal::CanFrame f = detail::frame(node, Message::set_controller_mode, 8);
  detail::put_u32(f, 0, control_mode_torque);
  detail::put_u32(f, 4, input_mode_passthrough);
  return f;
}
/// Request to clear the errors of the axis; v0_5_6: of both axes of its board.
[[nodiscard]] constexpr hal::CanFrame encode_clear_errors(std::uint8_t node, Version v) {
  return detail::frame(node, Message::clear_errors, v == Version::v0_6 ? 1 : 0);  // 0.6: identify = 0
}
/// Order to disarm at once, with an error.
[[nodiscard]] constexpr hal::CanFrame encode_estop(std::uint8_t node) {
  return detail::frame(node, Message::estop, 0);
}
/// Writes the command of a torque at the motor shaft (N m, not checked) into f, a classic data frame already.
constexpr void put_torque(hal::CanFrame& f, std::uint8_t node, float torque) {
  f.id = identifier(node, Message::set_input_torque);
  f.size = 8;
  detail::put_u32(f, 0, std::bit_cast<std::uint32_t>(torque));
  detail::put_u32(f, 4, 0);
}
/// Command of a torque at the motor shaft (N m, not checked) as a frame of its own.
[[nodiscard]] constexpr hal::CanFrame encode_torque(std::uint8_t node, float torque) {
  hal::CanFrame f;
  put_torque(f, node, torque);
  return f;
}
/// Encoder report of an emulated drive: motor turns, turns per second. Neither NaN nor range is checked.
[[nodiscard]] constexpr hal::CanFrame encode_encoder_estimates(std::uint8_t node, float position_rev,
                                                               float velocity_rev_s) {
  hal::CanFrame f = detail::frame(node, Message::encoder_estimates, 8);
  detail::put_u32(f, 0, std::bit_cast<std::uint32_t>(position_rev));
  detail::put_u32(f, 4, std::bit_cast<std::uint32_t>(velocity_rev_s));
  return f;
}
/// Heartbeat of an emulated drive. Bytes 5..7 are 0, as in torque control (0.6: procedure_result and
/// trajectory_done; 0.5.6: motor, encoder and controller flags, trajectory_done in the last bit).
[[nodiscard]] constexpr hal::CanFrame encode_heartbeat(std::uint8_t node, std::uint32_t error, AxisState s) {
  hal::CanFrame f = detail::frame(node, Message::heartbeat, 8);
  detail::put_u32(f, 0, error);
  f.data[4] = static_cast<std::uint8_t>(s);
  return f;
}

/// Cyclic state of a drive.
struct Heartbeat {
  std::uint32_t axis_error;
  AxisState axis_state;          ///< may hold a value without a name here: the drive has more states
  std::uint8_t component_flags;  ///< 0.5.6: motor, encoder or controller in error; 0.6: 0
};
/// Get_Encoder_Estimates: motor turns and turns per second.
struct EncoderEstimates {
  float position_rev, velocity_rev_s;
};
/// Get_Torques of 0.6: N m at the motor shaft. The estimate comes from the measured current.
struct Torques {
  float target, estimate;
};
/// Get_Torques of an emulated drive (0.6).
[[nodiscard]] constexpr hal::CanFrame encode_torques(std::uint8_t node, Torques t) {
  hal::CanFrame f = detail::frame(node, Message::get_torques, 8);
  detail::put_u32(f, 0, std::bit_cast<std::uint32_t>(t.target));
  detail::put_u32(f, 4, std::bit_cast<std::uint32_t>(t.estimate));
  return f;
}

/// True for a classic data frame of exactly this size, whatever its identifier.
[[nodiscard]] constexpr bool has_size(const hal::CanFrame& f, std::uint8_t size) {
  return ((f.size ^ size) | f.remote | f.fd) == 0;
}

/// Decodes a heartbeat; empty for a wrong length, remote or FD frame. The caller checks the identifier.
[[nodiscard]] constexpr std::optional<Heartbeat> decode_heartbeat(const hal::CanFrame& f, Version v) {
  if (!has_size(f, 8)) return std::nullopt;
  const auto flags = static_cast<std::uint8_t>(f.data[5] | f.data[6] | (f.data[7] & 0x7FU));
  return Heartbeat{detail::get_u32(f, 0), static_cast<AxisState>(f.data[4]),
                   v == Version::v0_5_6 ? flags : std::uint8_t{0}};
}
/// Decodes Get_Encoder_Estimates as decode_heartbeat does; a NaN or infinity is passed on.
[[nodiscard]] constexpr std::optional<EncoderEstimates> decode_encoder_estimates(const hal::CanFrame& f) {
  if (!has_size(f, 8)) return std::nullopt;
  return EncoderEstimates{std::bit_cast<float>(detail::get_u32(f, 0)),
                          std::bit_cast<float>(detail::get_u32(f, 4))};
}
/// Decodes Get_Torques as decode_heartbeat does; a NaN or infinity is passed on.
[[nodiscard]] constexpr std::optional<Torques> decode_torques(const hal::CanFrame& f) {
  if (!has_size(f, 8)) return std::nullopt;
  return Torques{std::bit_cast<float>(detail::get_u32(f, 0)), std::bit_cast<float>(detail::get_u32(f, 4))};
}
/// True if an emulated drive takes the frame: a classic data frame of this size or longer.
[[nodiscard]] constexpr bool has_at_least(const hal::CanFrame& f, std::uint8_t size) {
  return f.size >= size && !f.remote && !f.fd;
}
/// Torque in a command to an emulated drive: N m at the shaft, any float; empty unless has_at_least(f, 4).
[[nodiscard]] constexpr std::optional<float> decode_torque(const hal::CanFrame& f) {
  if (!has_at_least(f, 4)) return std::nullopt;
  return std::bit_cast<float>(detail::get_u32(f, 0));
}
/// AxisState that a command to an emulated drive requests, any number; empty unless has_at_least(f, 4).
[[nodiscard]] constexpr std::optional<std::uint32_t> decode_axis_state_request(const hal::CanFrame& f) {
  if (!has_at_least(f, 4)) return std::nullopt;
  return detail::get_u32(f, 0);
}
/// Set_Controller_Mode.
struct ControllerMode {
  std::uint32_t control, input;
};
/// Decodes Set_Controller_Mode to any numbers; empty unless has_size(f, 8). The caller checks the identifier.
[[nodiscard]] constexpr std::optional<ControllerMode> decode_controller_mode(const hal::CanFrame& f) {
  if (!has_size(f, 8)) return std::nullopt;
  return ControllerMode{detail::get_u32(f, 0), detail::get_u32(f, 4)};
}

/// Types of the endpoints that are read.
enum class ValueType : std::uint8_t { u8, u32, f32 };  ///< booleans are u8

/// Remote frame that requests the version of a drive (0.6).
[[nodiscard]] constexpr hal::CanFrame encode_version_request(std::uint8_t node) {
  hal::CanFrame f = detail::frame(node, Message::get_version, 8);
  f.remote = true;
  return f;
}
/// Request to read the value of an endpoint (0.6), which the drive answers with a TxSdo.
[[nodiscard]] constexpr hal::CanFrame encode_read(std::uint8_t node, std::uint16_t endpoint) {
  hal::CanFrame f = detail::frame(node, Message::rx_sdo, 8);
  detail::put_u32(f, 0, std::uint32_t{endpoint} << 8U);
  return f;
}
/// Endpoint of an RxSdo or TxSdo. The caller checks that it has four bytes or more.
[[nodiscard]] constexpr std::uint16_t endpoint_of(const hal::CanFrame& f) {
  return static_cast<std::uint16_t>(detail::get_u32(f, 0) >> 8U);
}
/// Major, minor and revision of the firmware in a Get_Version; empty for a wrong length, remote or FD frame.
[[nodiscard]] constexpr std::optional<std::array<std::uint8_t, 3>> decode_version(const hal::CanFrame& f) {
  if (!has_size(f, 8)) return std::nullopt;
  return std::array{f.data[4], f.data[5], f.data[6]};
}
/// Value of a TxSdo, a NaN too; integers beyond 2^24 are rounded. Empty: remote, FD, or too short for `type`.
[[nodiscard]] constexpr std::optional<float> decode_value(const hal::CanFrame& f, ValueType type) {
  if (!has_at_least(f, type == ValueType::u8 ? 5 : 8)) return std::nullopt;
  if (type == ValueType::u8) return static_cast<float>(f.data[4]);
  const std::uint32_t raw = detail::get_u32(f, 4);
  return type == ValueType::u32 ? static_cast<float>(raw) : std::bit_cast<float>(raw);
}

/// Get_Version of an emulated drive (0.6). `firmware`: major, minor, revision.
[[nodiscard]] constexpr hal::CanFrame encode_version(std::uint8_t node,
                                                     const std::array<std::uint8_t, 3>& firmware) {
  hal::CanFrame f = detail::frame(node, Message::get_version, 8);
  f.data[0] = 2;  // version of the protocol
  for (unsigned i = 0; i < 3; ++i) f.data[4 + i] = firmware[i];
  return f;
}
/// Get_Error of an emulated drive (0.6): its active errors, and those at its last disarming.
[[nodiscard]] constexpr hal::CanFrame encode_errors(std::uint8_t node, std::uint32_t active,
                                                    std::uint32_t disarm_reason) {
  hal::CanFrame f = detail::frame(node, Message::get_error, 8);
  detail::put_u32(f, 0, active);
  detail::put_u32(f, 4, disarm_reason);
  return f;
}
/// TxSdo of an emulated drive. `raw`: the value's bits; of a u8 the low eight.
[[nodiscard]] constexpr hal::CanFrame encode_value(std::uint8_t node, std::uint16_t endpoint,
                                                   std::uint32_t raw) {
  hal::CanFrame f = detail::frame(node, Message::tx_sdo, 8);
  detail::put_u32(f, 0, std::uint32_t{endpoint} << 8U);
  detail::put_u32(f, 4, raw);
  return f;
}

// By hand from the message table: node 3, 1.5 N m.
static_assert(encode_torque(3, 1.5F) ==
              hal::CanFrame{.id = 0x06E, .size = 8, .data = {0x00, 0x00, 0xC0, 0x3F}});

}  // namespace esmc::drive::odrive
