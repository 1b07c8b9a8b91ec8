#include "host_sim/campaign/protocol_traits.hpp"

#include <algorithm>
#include <bit>

#include "firmware/drive/canopen.hpp"
#include "firmware/drive/cia402.hpp"
#include "firmware/drive/mit.hpp"
#include "firmware/drive/moteus.hpp"
#include "firmware/drive/odrive.hpp"

namespace esmc::host {
namespace {

using Frame = hal::CanFrame;
using Frames = std::vector<Frame>;

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
using odrive::AxisState, odrive::Message;

bool is(const Frame& f, int node, Message m) { return f.id == odrive::identifier(node_id(node), m); }

constexpr ProtocolTraits odrive_traits{
    .is_sample = [](const Frame& f, int node) { return is(f, node, Message::encoder_estimates); },
    .is_heartbeat = [](const Frame& f, int node) { return is(f, node, Message::heartbeat); },
    .is_torque = [](const Frame& f, int node) { return is(f, node, Message::set_input_torque); },
    .wrong_size = other_size,
    .put_number =
        [](Frame& f, int which, float value) {
          hal::put_field(f, which == 0 ? 0 : 4, std::bit_cast<std::uint32_t>(value), 4);
        },
    .disarm = [](int node) { return Frames{odrive::encode_set_axis_state(node_id(node), AxisState::idle)}; },
    // After a NaN the drive disarms with an error.
    .fail =
        [](int node) {
          return Frames{odrive::encode_torque(node_id(node), std::bit_cast<float>(0x7FC0'0000U))};
        },
    .emergency_stop = [](int node) { return odrive::encode_estop(node_id(node)); },
    .foreign_torque =
        [](const Scene& s, std::size_t motor, double torque) {
          return odrive::encode_torque(node_id(s.drives.nodes[motor]),
                                       static_cast<float>(shaft(s, motor, torque)));
        },
    .foreign_command =
        [](int node, unsigned choice) {
          const std::uint8_t id = node_id(node);
          const Frame all[] = {odrive::encode_set_axis_state(id, AxisState::idle),
                               odrive::encode_set_axis_state(id, AxisState::closed_loop_control),
                               odrive::encode_clear_errors(id, odrive::Version::v0_6),
                               odrive::encode_set_controller_mode(id)};
          return all[choice % std::size(all)];
        },
    .torque_step = [](const Scene&, std::size_t) { return 0.0; },
};

// ---- CiA 402 ----

namespace canopen = drive::canopen;
namespace cia402 = drive::cia402;

bool is(const Frame& f, int node, std::uint32_t function) { return f.id == function + node_bits(node); }

constexpr ProtocolTraits cia402_traits{
    .is_sample = [](const Frame& f,
                    int node) { return is(f, node, canopen::id_tpdo1) || is(f, node, canopen::id_tpdo2); },
    .is_heartbeat = [](const Frame& f, int node) { return is(f, node, canopen::id_heartbeat); },
    .is_torque = [](const Frame& f, int node) { return is(f, node, canopen::id_rpdo1); },
    .wrong_size = other_size,
    .put_end =
        [](Frame& f, unsigned choice) {  // position of one PDO, velocity of the other
          hal::put_field(f, f.size == 8 ? 2 : 0, choice % 2 == 0 ? 0x7FFF'FFFFU : 0x8000'0000U, 4);
        },
    .disarm =
        [](int node) {
          return Frames{cia402::encode_command(node_id(node), {0x0006, 0})};
        },
    // A lost connection becomes a fault, then the drive leaves operational.
    .fail =
        [](int node) {
          return Frames{canopen::encode_sdo_write(node_id(node), cia402::abort_connection_option, 1, 2),
                        canopen::encode_nmt(canopen::NmtCommand::enter_pre_operational, node_id(node))};
        },
    .foreign_torque =
        [](const Scene& s, std::size_t motor, double torque) {
          const double thousandths = shaft(s, motor, torque) / s.drives.rated_torque[motor] * 1000.0;
          return cia402::encode_command(
              node_id(s.drives.nodes[motor]),
              {0x000F, static_cast<std::int16_t>(std::clamp(thousandths, -3e4, 3e4))});
        },
    .foreign_command =
        [](int node, unsigned choice) {
          const std::uint8_t id = node_id(node);
          const Frame all[] = {canopen::encode_nmt(canopen::NmtCommand::stop, 0),
                               canopen::encode_nmt(canopen::NmtCommand::reset_node, id),
                               canopen::encode_sdo_write(id, cia402::mode_of_operation, 1, 1),
                               canopen::encode_sync(), cia402::encode_command(id, {0x0007, 0})};
          return all[choice % std::size(all)];
        },
    .torque_step =
        [](const Scene& s, std::size_t motor) {
          return s.drives.rated_torque[motor] * s.drives.gear_ratio[motor] * 1e-3;
        },
    .is_sign_of_life = [](const Scene& s,
                          const Frame& f) { return is(f, s.drives.controller_node, canopen::id_heartbeat); },
    .samples_on_demand = true,
};

// ---- MIT mode ----

namespace mit = drive::mit;

constexpr ProtocolTraits mit_traits{
    .is_sample = [](const Frame&, int) { return true; },
    // With the frames that enter and leave motor mode: without the zero command between them a real drive
    // would not reply, and the emulated one does, in lockstep.
    .is_torque = [](const Frame& f, int node) { return f.id == node_bits(node); },
    .wrong_size = [](const Frame&, std::uint64_t any) { return static_cast<std::uint8_t>(1U + any % 4U); },
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
    .disarm = [](int node) { return Frames{mit::encode_special(node_bits(node), mit::Special::leave)}; },
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
    .samples_on_demand = true,
    .remote_is_nothing = true,
};

// ---- moteus ----

namespace moteus = drive::moteus;

constexpr ProtocolTraits moteus_traits{
    .is_sample = [](const Frame&, int) { return true; },
    .is_torque = [](const Frame& f, int node) { return f.id == (moteus::reply_wanted | node_bits(node)); },
    .wrong_size = [](const Frame&, std::uint64_t any) { return static_cast<std::uint8_t>(1U + any % 16U); },
    .put_number =
        [](Frame& f, int which, float value) {  // a reply begins with the mode and a row of three numbers
          hal::put_field(f, which == 0 ? 5 : 9, std::bit_cast<std::uint32_t>(value), 4);
        },
    .disarm =
        [](int node) {
          Frame f;
          moteus::put_query(f, node_id(node), true);
          return Frames{f};
        },
    // A stop position together with a limit of the speed is refused with fault 45.
    .fail =
        [](int node) {
          using enum moteus::Kind;
          Frame f;
          moteus::Builder b(f, node_bits(node));
          b.begin(write, moteus::Type::i8, 1, moteus::reg::mode);
          b.value(moteus::Type::i8, moteus::mode_position);
          b.begin(write, moteus::Type::i8, 1, moteus::reg::stop_position);
          b.value(moteus::Type::i8, 0);
          b.begin(write, moteus::Type::i8, 1, moteus::reg::velocity_limit);
          b.value(moteus::Type::i8, 1);
          b.pad();
          return Frames{f};
        },
    .foreign_torque =
        [](const Scene& s, std::size_t motor, double torque) {
          Frame f;
          moteus::put_torque(f, node_id(s.drives.nodes[motor]), static_cast<float>(shaft(s, motor, torque)),
                             {.torque = 30'000, .time = 100}, false);
          return f;
        },
    .foreign_command =
        [](int node, unsigned choice) {
          Frame f;
          if (choice % 2 == 0) {
            moteus::put_query(f, node_id(node), true);
          } else {
            moteus::put_torque(f, node_id(node), 0.0F, {.torque = 1, .time = 100}, true);
          }
          return f;
        },
    .torque_step = [](const Scene&, std::size_t) { return 0.0; },
    .torque_arms = true,
    .samples_on_demand = true,
    .remote_is_nothing = true,
};

}  // namespace

const ProtocolTraits& protocol_traits(Protocol p) {
  if (p == Protocol::cia402) return cia402_traits;
  if (p == Protocol::moteus) return moteus_traits;
  return p == Protocol::mit ? mit_traits : odrive_traits;
}

}  // namespace esmc::host
