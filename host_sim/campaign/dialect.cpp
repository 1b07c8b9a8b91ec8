#include "host_sim/campaign/dialect.hpp"

#include <bit>

#include "firmware/drive/odrive.hpp"
#include "host_sim/error.hpp"

namespace esmc::host {
namespace {

namespace odrive = drive::odrive;

std::uint8_t node_id(int node) { return static_cast<std::uint8_t>(node); }

constexpr Dialect odrive_dialect{
    [](const hal::CanFrame& f, int node) {
      return f.id == odrive::identifier(node_id(node), odrive::Message::encoder_estimates);
    },
    [](const hal::CanFrame& f, int node) {
      return f.id == odrive::identifier(node_id(node), odrive::Message::heartbeat);
    },
    [](hal::CanFrame& f, int which, float value) {
      const auto bits = std::bit_cast<std::uint32_t>(value);
      for (unsigned i = 0; i < 4; ++i) {
        f.data[static_cast<unsigned>(which) * 4U + i] = static_cast<std::uint8_t>(bits >> (8U * i));
      }
    },
    [](int node) { return odrive::encode_set_axis_state(node_id(node), odrive::AxisState::idle); },
    [](int node) { return odrive::encode_torque(node_id(node), std::bit_cast<float>(0x7FC0'0000U)); },
    [](int node) { return odrive::encode_estop(node_id(node)); },
    [](int node, float torque) { return odrive::encode_torque(node_id(node), torque); },
    [](int node, int choice) {
      switch (choice % 4) {
        case 0:
          return odrive::encode_set_axis_state(node_id(node), odrive::AxisState::idle);
        case 1:
          return odrive::encode_set_axis_state(node_id(node), odrive::AxisState::closed_loop_control);
        case 2:
          return odrive::encode_clear_errors(node_id(node), odrive::Version::v0_6);
        default:
          return odrive::encode_set_controller_mode(node_id(node));
      }
    },
};

}  // namespace

const Dialect& dialect(Protocol p) {
  switch (p) {
    case Protocol::odrive:
    case Protocol::odrive_0_5:
      return odrive_dialect;
    case Protocol::cia402:
    case Protocol::mit:
      break;
  }
  throw InputError("", "esmc campaign speaks odrive and odrive_0.5 only");
}

}  // namespace esmc::host
