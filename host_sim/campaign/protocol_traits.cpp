#include "host_sim/campaign/protocol_traits.hpp"

#include <algorithm>
#include <bit>
#include <cmath>

#include "firmware/drive/canopen.hpp"
#include "firmware/drive/cia402.hpp"
#include "firmware/drive/mit.hpp"
#include "firmware/drive/odrive.hpp"

namespace esmc::host {
namespace {

using Frame = hal::CanFrame;

std::uint8_t node_id(int node) { return static_cast<std::uint8_t>(node); }
std::uint32_t node_bits(int node) { return static_cast<std::uint32_t>(node); }

double shaft(const Scene& s, std::size_t motor, double joint_torque) {
  return joint_torque * s.drives.direction[motor] / s.drives.gear_ratio[motor];
}
std::uint8_t other_size(const Frame& f, std::uint64_t any) {
  return static_cast<std::uint8_t>((f.size + 1U + any % 8U) % 9U);
}

// ---- ODrive ----

namespace odrive = drive::odrive;

constexpr ProtocolTraits odrive_dialect{
    .is_sample =
        [](const Frame& f, int node) {
          return f.id == odrive::identifier(node_id(node), odrive::Message::encoder_estimates);
        },
    .is_heartbeat =
        [](const Frame& f, int node) {
          return f.id == odrive::identifier(node_id(node), odrive::Message::heartbeat);
        },
    .is_torque =
        [](const Frame& f, int node) {
          return f.id == odrive::identifier(node_id(node), odrive::Message::set_input_torque);
        },
    .wrong_size = other_size,
    .put_number =
        [](Frame& f, int which, float value) {
          const auto bits = std::bit_cast<std::uint32_t>(value);
          for (unsigned i = 0; i < 4; ++i) {
            f.data[static_cast<unsigned>(which) * 4U + i] = static_cast<std::uint8_t>(bits >> (8U * i));
          }
        },
    .put_end = nullptr,
    .disarm = [](int node) -> FewFrames {
      return {{odrive::encode_set_axis_state(node_id(node), odrive::AxisState::idle)}, 1};
    },
    // After a NaN the drive disarms with an error.
    .fail = [](int node) -> FewFrames {
      return {{odrive::encode_torque(node_id(node), std::bit_cast<float>(0x7FC0'0000U))}, 1};
    },
    .emergency_stop = [](int node) { return odrive::encode_estop(node_id(node)); },
    .foreign_torque =
        [](const Scene& s, std::size_t motor, double torque) {
          return odrive::encode_torque(node_id(s.drives.nodes[motor]),
                                       static_cast<float>(shaft(s, motor, torque)));
        },
    .foreign_command =
        [](int node, unsigned choice) {
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
    .torque_step = [](const Scene&, std::size_t) { return 0.0; },
    .zero_is_a_step = true,
    .tells_its_state = true,
    .ticks_to_let_go = 0,
    .is_sign_of_life = nullptr,
    .samples_on_demand = false,
    .remote_is_nothing = false,
};

// ---- CiA 402 ----

namespace canopen = drive::canopen;
namespace cia402 = drive::cia402;

constexpr ProtocolTraits cia402_dialect{
    .is_sample =
        [](const Frame& f, int node) {
          return f.id == canopen::id_tpdo1 + node_bits(node) || f.id == canopen::id_tpdo2 + node_bits(node);
        },
    .is_heartbeat = [](const Frame& f, int node) { return f.id == canopen::id_heartbeat + node_bits(node); },
    .is_torque = [](const Frame& f, int node) { return f.id == canopen::id_rpdo1 + node_bits(node); },
    .wrong_size = other_size,
    .put_number = nullptr,
    .put_end =
        [](Frame& f, unsigned choice) {  // position of one PDO, velocity of the other
          const std::size_t at = f.size == 8 ? 2 : 0;
          hal::put_field(f, at, choice % 2 == 0 ? 0x7FFF'FFFFU : 0x8000'0000U, 4);
        },
    .disarm = [](int node) -> FewFrames {
      return {{cia402::encode_command(node_id(node), {0x0006, 0})}, 1};
    },
    // A lost connection becomes a fault, then the drive leaves operational.
    .fail = [](int node) -> FewFrames {
      return {{canopen::encode_sdo_write(node_id(node), cia402::abort_connection_option, 1, 2),
               canopen::encode_nmt(canopen::NmtCommand::enter_pre_operational, node_id(node))},
              2};
    },
    .emergency_stop = nullptr,
    .foreign_torque =
        [](const Scene& s, std::size_t motor, double torque) {
          const double thousandths = shaft(s, motor, torque) / s.drives.rated_torque[motor] * 1000.0;
          return cia402::encode_command(
              node_id(s.drives.nodes[motor]),
              {0x000F, static_cast<std::int16_t>(std::clamp(thousandths, -3e4, 3e4))});
        },
    .foreign_command =
        [](int node, unsigned choice) {
          switch (choice % 5) {
            case 0:
              return canopen::encode_nmt(canopen::NmtCommand::stop, 0);
            case 1:
              return canopen::encode_nmt(canopen::NmtCommand::reset_node, node_id(node));
            case 2:
              return canopen::encode_sdo_write(node_id(node), cia402::mode_of_operation, 1, 1);
            case 3:
              return canopen::encode_sync();
            default:
              return cia402::encode_command(node_id(node), {0x0007, 0});
          }
        },
    .torque_step =
        [](const Scene& s, std::size_t motor) {
          return s.drives.rated_torque[motor] * s.drives.gear_ratio[motor] * 1e-3;
        },
    .zero_is_a_step = true,
    .tells_its_state = true,
    .ticks_to_let_go = 0,
    .is_sign_of_life =
        [](const Scene& s, const Frame& f) {
          return f.id == canopen::id_heartbeat + node_bits(s.drives.controller_node);
        },
    .samples_on_demand = true,
    .remote_is_nothing = false,
};

// ---- MIT mode ----

namespace mit = drive::mit;

constexpr ProtocolTraits mit_dialect{
    .is_sample = [](const Frame&, int) { return true; },
    .is_heartbeat = nullptr,
    // With the frames that enter and leave motor mode: without the zero command between them a real drive
    // would not reply, and the emulated one does, in lockstep.
    .is_torque = [](const Frame& f, int node) { return f.id == node_bits(node); },
    .wrong_size = [](const Frame&, std::uint64_t any) { return static_cast<std::uint8_t>(1U + any % 4U); },
    .put_number = nullptr,
    .put_end =
        [](Frame& f, unsigned choice) {
          const auto end = static_cast<std::uint8_t>(choice % 2 == 0 ? 0xFF : 0x00);
          if (choice / 2 % 2 == 0) {
            f.data[1] = f.data[2] = end;
          } else {
            f.data[3] = end;
            f.data[4] = static_cast<std::uint8_t>((end & 0xF0U) | (f.data[4] & 0x0FU));
          }
        },
    .disarm = [](int node) -> FewFrames {
      return {{mit::encode_special(node_bits(node), mit::Special::leave)}, 1};
    },
    .fail = nullptr,
    .emergency_stop = nullptr,
    .foreign_torque =
        [](const Scene& s, std::size_t motor, double torque) {
          const auto range = static_cast<float>(s.drives.torque_range[motor]);
          return mit::encode_command(
              node_bits(s.drives.nodes[motor]),
              {.torque = mit::code(static_cast<float>(shaft(s, motor, torque)), range, mit::code_max_12)});
        },
    .foreign_command =
        [](int node, unsigned choice) {
          return mit::encode_special(node_bits(node),
                                     choice % 2 == 0 ? mit::Special::enter : mit::Special::leave);
        },
    .torque_step =
        [](const Scene& s, std::size_t motor) {
          return 2.0 * s.drives.torque_range[motor] * s.drives.gear_ratio[motor] / mit::code_max_12;
        },
    .zero_is_a_step = false,
    .tells_its_state = false,
    .ticks_to_let_go = 1,
    .is_sign_of_life = nullptr,
    .samples_on_demand = true,
    .remote_is_nothing = true,
};

}  // namespace

const ProtocolTraits& dialect(Protocol p) {
  switch (p) {
    case Protocol::cia402:
      return cia402_dialect;
    case Protocol::mit:
      return mit_dialect;
    case Protocol::odrive:
    case Protocol::odrive_0_5:
      break;
  }
  return odrive_dialect;
}

}  // namespace esmc::host
