#pragma once
/// Faults: every reason to take the torque away.

#include <array>
#include <cstddef>
#include <cstdint>

namespace esmc {

/// Each takes the torque away, at once or after a halt, and is latched until an operator's reset.
/// The values are the wire format of the command interface (docs/esmc.dbc): append only, never renumber.
enum class [[nodiscard]] Fault : std::uint8_t{
    none = 0,
    feedback_not_finite = 1,     ///< a drive sent NaN or infinity
    feedback_jump = 2,           ///< an angle moved further in a tick than its own rate and joint_speed allow
    stale_feedback = 3,          ///< more than max_age_ticks without a sample from an axis
    malformed_frame = 4,         ///< a frame of one of our drives has the wrong length or format
    heartbeat_lost = 5,          ///< no heartbeat of an axis for longer than heartbeat_timeout
    enable_open = 6,             ///< the enable input of the board is open
    emergency_stop = 7,          ///< on the bus or reported by an axis
    drive_error = 8,             ///< an axis reported an error
    drive_disarmed = 9,          ///< an axis left closed-loop control by itself
    bus_overload = 10,           ///< more frames in a tick than are read: later samples would be stale
    foreign_controller = 11,     ///< another node sends commands to our drives
    drive_configuration = 12,    ///< a value read back from a drive is not the configured one
    zero_not_confirmed = 13,     ///< relative encoders whose zero was not confirmed since power-up
    torque_mismatch = 14,        ///< the torque that a drive reports does not follow its command
    bus_off = 15,                ///< our CAN controller left the bus
    loop_not_closed = 16,        ///< the base angles fit no closed mechanism, or passive encoders contradict
    type1_singularity = 17,      ///< |sin theta_j2| below min_abs_sin_type1
    type2_singularity = 18,      ///< |D2| below min_abs_sin_type2, or the other assembly mode
    working_mode = 19,           ///< a leg bends to the other side than configured
    workspace = 20,              ///< the effector left the allowed box
    joint_speed = 21,            ///< a base joint turns faster than allowed
    joint_angle = 22,            ///< a base joint left its range
    reference_unreachable = 23,  ///< the reference lies outside the workspace
    sign_test = 24,              ///< a motor did not answer a small torque: sign test, homing
    join_infeasible = 25,        ///< joining the reference would exceed the limits of speed or torque
    command_lost = 26,           ///< no frames of the supervisor computer, or of its stream
    halt_failed = 27,            ///< the mechanism did not come to rest under control
    torque_not_finite = 28,      ///< the law produced NaN, infinity, or a torque that no shaft can carry
    tick_late = 29,              ///< two ticks in a row, or four of 64, began late
    enabling_timeout = 30,       ///< a drive is silent, or did not confirm torque control in time
    drives_not_confirmed = 31,   ///< settings that cannot be read back were not checked by hand
    home_no_stop = 32,           ///< homing: a joint met no end stop within its travel, or left it again
};

inline constexpr int fault_count = static_cast<int>(Fault::home_no_stop) + 1;

/// Names of the faults, in the order of their values.
inline constexpr std::array<const char*, fault_count> fault_names{"none",
                                                                  "feedback_not_finite",
                                                                  "feedback_jump",
                                                                  "stale_feedback",
                                                                  "malformed_frame",
                                                                  "heartbeat_lost",
                                                                  "enable_open",
                                                                  "emergency_stop",
                                                                  "drive_error",
                                                                  "drive_disarmed",
                                                                  "bus_overload",
                                                                  "foreign_controller",
                                                                  "drive_configuration",
                                                                  "zero_not_confirmed",
                                                                  "torque_mismatch",
                                                                  "bus_off",
                                                                  "loop_not_closed",
                                                                  "type1_singularity",
                                                                  "type2_singularity",
                                                                  "working_mode",
                                                                  "workspace",
                                                                  "joint_speed",
                                                                  "joint_angle",
                                                                  "reference_unreachable",
                                                                  "sign_test",
                                                                  "join_infeasible",
                                                                  "command_lost",
                                                                  "halt_failed",
                                                                  "torque_not_finite",
                                                                  "tick_late",
                                                                  "enabling_timeout",
                                                                  "drives_not_confirmed",
                                                                  "home_no_stop"};
static_assert(fault_names.back() != nullptr);

/// Name of an enumerator from the table of its enumeration; "unknown" beyond the table.
template <std::size_t n, class E>
[[nodiscard]] constexpr const char* name_in(const std::array<const char*, n>& names, E value) {
  const auto at = static_cast<std::size_t>(value);
  return at < n ? names[at] : "unknown";
}
[[nodiscard]] constexpr const char* name(Fault f) { return name_in(fault_names, f); }

/// Effect of a fault on a mechanism under torque.
enum class Reaction : std::uint8_t {
  zero_torque,  ///< at once: a measurement, a computation or an output cannot be trusted any more
  halt,         ///< the state is known and the drives obey: come to rest under control
};

/// Reaction to a fault where the mechanism can halt; zero_torque also for `none` and values without a name.
[[nodiscard]] constexpr Reaction reaction(Fault f) {
  switch (f) {
    case Fault::workspace:
    case Fault::joint_angle:
    case Fault::reference_unreachable:
    case Fault::command_lost:
    case Fault::tick_late:
    case Fault::join_infeasible:
    case Fault::home_no_stop:
      return Reaction::halt;
    default:
      return Reaction::zero_torque;
  }
}

}  // namespace esmc
