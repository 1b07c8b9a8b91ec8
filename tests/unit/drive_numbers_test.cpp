/// Numbers of the drives' protocols, written down once more from the vendors' documents and the profile.

#include <gtest/gtest.h>

#include <array>
#include <cstdint>

#include "firmware/drive/cia402_axis.hpp"
#include "firmware/drive/mit_axis.hpp"
#include "firmware/drive/moteus_axis.hpp"
#include "firmware/drive/odrive_axis.hpp"

namespace esmc::drive {
namespace {

template <class A, std::size_t n>
constexpr bool are(const std::array<A, n>& names, const std::array<unsigned, n>& values) {
  for (std::size_t i = 0; i < n; ++i) {
    if (static_cast<unsigned>(names[i]) != values[i]) return false;
  }
  return true;
}

// ---- CANSimple

using odrive::Message;
static_assert(are(std::array{Message::get_version, Message::heartbeat, Message::estop, Message::get_error,
                             Message::rx_sdo, Message::tx_sdo, Message::set_axis_state,
                             Message::encoder_estimates, Message::set_controller_mode,
                             Message::set_input_torque, Message::clear_errors, Message::get_torques},
                  {0x00, 0x01, 0x02, 0x03, 0x04, 0x05, 0x07, 0x09, 0x0B, 0x0E, 0x18, 0x1C}));
static_assert(are(std::array{odrive::AxisState::undefined, odrive::AxisState::idle,
                             odrive::AxisState::closed_loop_control},
                  {0, 1, 8}));
static_assert(OdriveReadBack::version_endpoint == 0xFFFF);
static_assert(odrive::control_mode_torque == 1 && odrive::input_mode_passthrough == 1);
static_assert(odrive::node_max == 62 && odrive::node_broadcast == 63);
static_assert(odrive::error_watchdog_0_6 == 1U << 24U && odrive::error_watchdog_0_5_6 == 1U << 11U);
static_assert(odrive::error_estop_0_6 == 1U << 25U && odrive::error_estop_0_5_6 == 1U << 14U);
constexpr std::uint32_t commands_of(odrive::Version v) {
  std::uint32_t all = 0;
  for (std::uint32_t m = 0; m < 32; ++m) all |= (odrive::is_command(m, v) ? 1U : 0U) << m;
  return all;
}
// 07, 0B to 13, 16, 18 to 1B; 06 of one version, 1F of the other
static_assert(commands_of(odrive::Version::v0_6) == 0x8F4F'F880U);
static_assert(commands_of(odrive::Version::v0_5_6) == 0x0F4F'F8C0U);

// ---- MIT mode

static_assert(are(std::array{mit::Special::enter, mit::Special::leave, mit::Special::set_zero},
                  {0xFC, 0xFD, 0xFE}));
static_assert(mit::code_max_16 == 65535 && mit::code_max_12 == 4095);
static_assert(mit::middle_16 == 32768 && mit::middle_12 == 2048);
static_assert(mit::v3_command == 8 * 256 && mit::v3_reply == 0x29 * 256 && mit::v3_command_max == 0x10FF);
static_assert(MitAxis::position_at_rail == 256 &&
              MitAxis::velocity_at_rail == 512);  // the low bits are the drive's
static_assert(MitAxis::position_lost == 1024);

// ---- moteus

using namespace moteus;
static_assert(are(std::array{Kind::write, Kind::read, Kind::reply, Kind::error}, {0, 1, 2, 3}));
static_assert(are(std::array{Type::i8, Type::i16, Type::i32, Type::f32}, {0, 1, 2, 3}));
static_assert(width(Type::i8) == 1 && width(Type::i16) == 2 && width(Type::i32) == 4 &&
              width(Type::f32) == 4);
static_assert(are(std::array{reg::mode, reg::position, reg::velocity, reg::torque, reg::home_state,
                             reg::fault_code, reg::map_version},
                  {0, 1, 2, 3, 0x0C, 0x0F, 0x102}));
static_assert(are(std::array{reg::position_command, reg::velocity_command, reg::feedforward_torque,
                             reg::kp_scale, reg::kd_scale, reg::max_torque, reg::stop_position,
                             reg::watchdog_timeout, reg::velocity_limit},
                  {0x20, 0x21, 0x22, 0x23, 0x24, 0x25, 0x26, 0x27, 0x28}));
static_assert(reg::commands == 9 && map_version_known == 5 && no_register == 0xFFFF'FFFFU);
static_assert(mode_stopped == 0 && mode_fault == 1 && mode_position == 10 && mode_timeout == 11);
static_assert(no_operation == 0x50 && reply_wanted == 0x8000 && torque_size == 32 && reply_size == 20);
static_assert(i16_torque == 0.01F && i16_time == 0.001F);
constexpr bool has_units(std::uint32_t name, float i8, float i16, float i32) {
  return unit(name, Type::i8) == i8 && unit(name, Type::i16) == i16 && unit(name, Type::i32) == i32 &&
         unit(name, Type::f32) == 1.0F;
}
static_assert(has_units(0x00, 1, 1, 1) && has_units(0x04, 1, 1, 1) && has_units(0x29, 1, 1, 1));
static_assert(has_units(0x01, 0.01F, 1e-4F, 1e-5F) && has_units(0x20, 0.01F, 1e-4F, 1e-5F));
static_assert(has_units(0x02, 0.1F, 2.5e-4F, 1e-5F) && has_units(0x21, 0.1F, 2.5e-4F, 1e-5F));
static_assert(has_units(0x03, 0.5F, 0.01F, 1e-3F) && has_units(0x22, 0.5F, 0.01F, 1e-3F));
static_assert(has_units(0x23, 1 / 127.0F, 1 / 32767.0F, 1 / 2147483647.0F));
static_assert(has_units(0x24, 1 / 127.0F, 1 / 32767.0F, 1 / 2147483647.0F));
static_assert(has_units(0x25, 0.5F, 0.01F, 1e-3F) && has_units(0x26, 0.01F, 1e-4F, 1e-5F));
static_assert(has_units(0x27, 0.01F, 0.001F, 1e-6F) && has_units(0x28, 0.1F, 2.5e-4F, 1e-5F));

// ---- CiA 402

constexpr bool is(canopen::Object o, unsigned index, unsigned sub) {
  return o.index == index && o.sub == sub;
}
static_assert(is(cia402::device_type, 0x1000, 0) && is(cia402::error_register, 0x1001, 0));
static_assert(is(cia402::sync_cob_id, 0x1005, 0) && is(cia402::sync_period, 0x1006, 0));
static_assert(is(cia402::emergency_cob_id, 0x1014, 0) && is(cia402::consumer_heartbeat, 0x1016, 1));
static_assert(is(cia402::producer_heartbeat, 0x1017, 0) && is(cia402::error_behaviour, 0x1029, 1));
static_assert(is(cia402::abort_connection_option, 0x6007, 0) && is(cia402::error_code, 0x603F, 0));
static_assert(is(cia402::controlword, 0x6040, 0) && is(cia402::statusword, 0x6041, 0));
static_assert(is(cia402::quick_stop_option, 0x605A, 0) && is(cia402::fault_reaction_option, 0x605E, 0));
static_assert(is(cia402::mode_of_operation, 0x6060, 0) && is(cia402::mode_display, 0x6061, 0));
static_assert(is(cia402::supported_modes, 0x6502, 0) && is(cia402::position, 0x6064, 0));
static_assert(is(cia402::velocity, 0x606C, 0) && is(cia402::target_torque, 0x6071, 0));
static_assert(is(cia402::actual_torque, 0x6077, 0) && is(cia402::max_torque, 0x6072, 0));
static_assert(is(cia402::torque_offset, 0x60B2, 0) && is(cia402::rated_torque, 0x6076, 0));
static_assert(is(cia402::interpolation_value, 0x60C2, 1) && is(cia402::interpolation_index, 0x60C2, 2));
static_assert(cia402::rpdo_communication == 0x1400 && cia402::rpdo_mapping == 0x1600);
static_assert(cia402::tpdo_communication == 0x1800 && cia402::tpdo_mapping == 0x1A00);
static_assert(cia402::transmission_every_sync == 1 && cia402::transmission_at_once == 255);
static_assert(cia402::error_keeps_state == 1 && cia402::mode_cyclic_torque == 10);
static_assert(cia402::supports_cyclic_torque == 512);
static_assert(cia402::control_disable_voltage == 0 && cia402::control_quick_stop == 2);
static_assert(cia402::control_shutdown == 6 && cia402::control_switch_on == 7);
static_assert(cia402::control_enable_operation == 15 && cia402::control_fault_reset == 128);

/// CiA 301, predefined connection set: four bits of function, seven of node.
static_assert(canopen::node_max == 127 && canopen::node_mask == 127);
static_assert(canopen::function_mask == 15 * 128);
static_assert(are(
    std::array{canopen::id_nmt, canopen::id_sync, canopen::id_emergency, canopen::id_tpdo1, canopen::id_rpdo1,
               canopen::id_tpdo2, canopen::id_rpdo2, canopen::id_tpdo3, canopen::id_rpdo3, canopen::id_tpdo4,
               canopen::id_rpdo4, canopen::id_sdo_reply, canopen::id_sdo_request, canopen::id_heartbeat},
    {0x000, 0x080, 0x080, 0x180, 0x200, 0x280, 0x300, 0x380, 0x400, 0x480, 0x500, 0x580, 0x600, 0x700}));
static_assert(canopen::cob_invalid == 1U << 31U && canopen::cob_no_rtr == 1U << 30U);
// Of SDO, in the order of CiA 301.
static_assert(are(std::array{canopen::abort_time_out, canopen::abort_command, canopen::abort_read_only,
                             canopen::abort_no_object, canopen::abort_not_mappable, canopen::abort_pdo_length,
                             canopen::abort_length, canopen::abort_no_sub_index, canopen::abort_value,
                             canopen::abort_device_state},
                  {0x0504'0000, 0x0504'0001, 0x0601'0002, 0x0602'0000, 0x0604'0041, 0x0604'0042, 0x0607'0010,
                   0x0609'0011, 0x0609'0030, 0x0800'0022}));

/// Every statusword against the table of masks; no two rows may claim the same word.
TEST(DriveNumbers, StatuswordDecidesTheState) {
  using cia402::State;
  struct Row {
    unsigned mask, value;
    State state;
    bool free;
  };
  const std::array<Row, 8> rows{{{0x4F, 0x00, State::not_ready, true},
                                 {0x4F, 0x40, State::switch_on_disabled, true},
                                 {0x6F, 0x21, State::ready_to_switch_on, true},
                                 {0x6F, 0x23, State::switched_on, false},
                                 {0x6F, 0x27, State::operation_enabled, false},
                                 {0x6F, 0x07, State::quick_stop_active, false},
                                 {0x4F, 0x0F, State::fault_reaction_active, false},
                                 {0x4F, 0x08, State::fault, true}}};
  for (unsigned word = 0; word < 0x10000; ++word) {
    State expected = State::unknown;
    int claims = 0;
    for (const Row& r : rows) {
      if ((word & r.mask) != r.value) continue;
      expected = r.state;
      ++claims;
    }
    ASSERT_LE(claims, 1);
    ASSERT_EQ(cia402::state_of(static_cast<std::uint16_t>(word)), expected) << word;
  }
  for (const Row& r : rows) EXPECT_EQ(cia402::is_torque_free(r.state), r.free);
  EXPECT_FALSE(cia402::is_torque_free(State::unknown));
}

}  // namespace
}  // namespace esmc::drive
