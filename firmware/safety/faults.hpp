#pragma once
/// Names of everything that ends a run. A fault is latched: only an operator's reset clears it.

#include <cstdint>

namespace esmc {

/// Everything that takes the torque away; each is latched until an operator's reset.
enum class [[nodiscard]] Fault : std::uint8_t{
    none,
    feedback_not_finite,  ///< a drive sent NaN or infinity
    feedback_jump,        ///< an angle moved further in a tick than its own rate and joint_speed allow
    stale_feedback,       ///< more than max_age_ticks without a sample from an axis
    malformed_frame,      ///< a frame of a drive of ours had the wrong length or format
    heartbeat_lost,       ///< an axis has not said that it lives for longer than heartbeat_timeout
    enable_open,          ///< the enable input of the board is open
    emergency_stop,  ///< seen on the bus or reported by an axis; never cleared without an operator's reset
    drive_error,     ///< an axis reported an error
    drive_disarmed,  ///< an axis left closed-loop control by itself
    bus_overload,  ///< more frames in a tick than the controller reads: samples would be older than they look
    foreign_controller,   ///< somebody else commands our drives
    drive_configuration,  ///< what a drive let us read back is not what it must be
    zero_not_confirmed,   ///< relative encoders, and nobody has confirmed their zero since power-up
    torque_mismatch,      ///< a drive reports another torque than it was told
    bus_off,              ///< our CAN controller left the bus
    loop_not_closed,    ///< the base angles fit no closed mechanism, or the passive encoders contradict them
    type1_singularity,  ///< |sin theta_j2| below min_abs_sin_type1
    type2_singularity,  ///< |D2| below min_abs_sin_type2, or the other assembly mode
    working_mode,       ///< a leg bends to the other side than the controller was told
    workspace,          ///< the effector left the allowed box
    joint_speed,        ///< a base joint turns faster than allowed
    joint_angle,        ///< a base joint left its range
    reference_unreachable,  ///< the reference lies outside the workspace
    sign_test,              ///< a motor did not answer a small torque as the model says
    join_infeasible,        ///< joining the reference would take more speed or torque than is allowed
    command_lost,           ///< the supervisor computer, or the stream it sends, is not heard any more
    halt_failed,            ///< the mechanism did not come to rest under control
    torque_not_finite,      ///< the law produced NaN or infinity, or a shaft torque that no motor has
    tick_late,              ///< two ticks in a row began more than half a period late
    enabling_timeout,       ///< a drive is silent, or did not confirm torque control in time
};
inline constexpr int fault_count = static_cast<int>(Fault::enabling_timeout) + 1;

[[nodiscard]] constexpr const char* name(Fault f) {
  switch (f) {
    case Fault::none:
      return "none";
    case Fault::feedback_not_finite:
      return "feedback_not_finite";
    case Fault::feedback_jump:
      return "feedback_jump";
    case Fault::stale_feedback:
      return "stale_feedback";
    case Fault::malformed_frame:
      return "malformed_frame";
    case Fault::heartbeat_lost:
      return "heartbeat_lost";
    case Fault::enable_open:
      return "enable_open";
    case Fault::emergency_stop:
      return "emergency_stop";
    case Fault::drive_error:
      return "drive_error";
    case Fault::drive_disarmed:
      return "drive_disarmed";
    case Fault::bus_overload:
      return "bus_overload";
    case Fault::foreign_controller:
      return "foreign_controller";
    case Fault::drive_configuration:
      return "drive_configuration";
    case Fault::zero_not_confirmed:
      return "zero_not_confirmed";
    case Fault::torque_mismatch:
      return "torque_mismatch";
    case Fault::bus_off:
      return "bus_off";
    case Fault::loop_not_closed:
      return "loop_not_closed";
    case Fault::type1_singularity:
      return "type1_singularity";
    case Fault::type2_singularity:
      return "type2_singularity";
    case Fault::working_mode:
      return "working_mode";
    case Fault::workspace:
      return "workspace";
    case Fault::joint_speed:
      return "joint_speed";
    case Fault::joint_angle:
      return "joint_angle";
    case Fault::reference_unreachable:
      return "reference_unreachable";
    case Fault::sign_test:
      return "sign_test";
    case Fault::join_infeasible:
      return "join_infeasible";
    case Fault::command_lost:
      return "command_lost";
    case Fault::halt_failed:
      return "halt_failed";
    case Fault::torque_not_finite:
      return "torque_not_finite";
    case Fault::tick_late:
      return "tick_late";
    case Fault::enabling_timeout:
      return "enabling_timeout";
  }
  return "unknown";
}

/// What a fault does to a mechanism under torque.
enum class Reaction : std::uint8_t {
  zero_torque,  ///< at once: what is measured, computed or applied cannot be trusted any more
  halt,         ///< the state is known and the drives obey: to rest under control
};

[[nodiscard]] constexpr Reaction reaction(Fault f) {
  switch (f) {
    case Fault::workspace:
    case Fault::joint_angle:
    case Fault::reference_unreachable:
    case Fault::command_lost:
    case Fault::tick_late:
    case Fault::join_infeasible:
      return Reaction::halt;
    default:
      return Reaction::zero_torque;
  }
}

}  // namespace esmc
