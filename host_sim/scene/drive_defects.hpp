#pragma once
/// Defects of real drives that emulated ones can have.

#include <array>
#include <cstdint>
#include <string>
#include <string_view>

#include "hal/can.hpp"

namespace esmc::host {

/// Defects of one emulated drive; meanings in defect_names.
struct Defects {
  bool watchdog_off = false;
  bool watchdog_any_frame = false;
  bool short_frames_stale = false;
  bool no_nan_check = false;
  bool unsynchronised = false;
  bool timeout_stays_enabled = false;
  bool latched_timeout = false;
  bool torque_mode_limit = false;
  bool zero_until_closed_loop = false;
  bool clears_both_axes = false;
  bool pre_operational_keeps_torque = false;
  bool no_6072 = false;
  bool no_1029 = false;
  bool rtr_bit_required = false;
  bool torque_offset_left = false;
  bool no_rpdo_deadline = false;
  bool position_invalid = false;
  bool relative_position = false;
  bool other_registers = false;
  bool refuses_watchdog = false;
  bool low_max_torque = false;
  bool classic_replies = false;
  bool timeout_damps = false;
};

/// Name, protocols and meaning of a defect.
struct DefectName {
  std::string_view name;
  bool Defects::*flag;
  std::string_view protocols;  ///< protocols of the drives that can have it
  std::string_view meaning;
};

inline constexpr std::string_view odrives = "odrive, odrive_0.5", odrives_and_mit = "odrive, odrive_0.5, mit",
                                  every_drive = "odrive, odrive_0.5, mit, cia402";
inline constexpr std::array defect_names{
    DefectName{"watchdog_off", &Defects::watchdog_off, "odrive, odrive_0.5, mit, cia402, moteus",
               "the last torque is held for ever"},
    DefectName{"watchdog_any_frame", &Defects::watchdog_any_frame, odrives,
               "any frame to the drive feeds the watchdog, requests included"},
    DefectName{"short_frames_stale", &Defects::short_frames_stale, every_drive,
               "bytes that a frame does not have are those of the frame before"},
    DefectName{"no_nan_check", &Defects::no_nan_check, odrives,
               "NaN passes as a set-point; a limiter of fmin and fmax makes full torque of it"},
    DefectName{
        "unsynchronised", &Defects::unsynchronised, odrives,
        "samples are taken at a clock of its own, 100 ppm fast: up to a period old when they are sent"},
    DefectName{"timeout_stays_enabled", &Defects::timeout_stays_enabled, odrives_and_mit,
               "a time-out zeroes the torque, and the next command acts at once (MIT drives always do)"},
    DefectName{
        "latched_timeout", &Defects::latched_timeout, odrives_and_mit,
        "after a time-out the drive is dead until it is restarted (odrive) or enters motor mode anew (mit)"},
    DefectName{"torque_mode_limit", &Defects::torque_mode_limit, odrives,
               "torque is cut to (2 rev/s - speed) / 6 N m s/rev, as ODrive 0.5 does by default"},
    DefectName{"zero_until_closed_loop", &Defects::zero_until_closed_loop, "odrive_0.5",
               "position and speed are reported as 0 from power-up to the first closed loop, as firmware "
               "0.5.6 does"},
    DefectName{"clears_both_axes", &Defects::clears_both_axes, "odrive_0.5",
               "Clear_Errors to the other axis of its board, node xor 1, clears its errors as well"},
    DefectName{
        "pre_operational_keeps_torque", &Defects::pre_operational_keeps_torque, "cia402",
        "made pre-operational, it goes on with its last torque: the profile's 6007 does not name that"},
    DefectName{"no_6072", &Defects::no_6072, "cia402",
               "it has no object for its torque limit, as EPOS4: nothing can be read back"},
    DefectName{"no_1029", &Defects::no_1029, "cia402",
               "without our heartbeat it goes pre-operational and reports no position"},
    DefectName{"rtr_bit_required", &Defects::rtr_bit_required, "cia402",
               "a TPDO's COB-ID without bit 30 (no RTR) is refused with 0609 0030"},
    DefectName{"torque_offset_left", &Defects::torque_offset_left, "cia402",
               "object 60B2, which adds to the target torque, is 10 % of the rated torque at power-up"},
    DefectName{"no_rpdo_deadline", &Defects::no_rpdo_deadline, "cia402",
               "it has no 1400:5: hearing our heartbeat but no RPDO, it keeps its last torque"},
    DefectName{"position_invalid", &Defects::position_invalid, "moteus",
               "position and speed are NaN: no encoder at the output is valid"},
    DefectName{"relative_position", &Defects::relative_position, "moteus",
               "home state 0: the position counts from power-up"},
    DefectName{"other_registers", &Defects::other_registers, "moteus",
               "version 4 of the register map, as older firmware has it"},
    DefectName{"refuses_watchdog", &Defects::refuses_watchdog, "moteus",
               "register 027 is answered with an error, and the time-out is the drive's own of 0.1 s"},
    DefectName{"low_max_torque", &Defects::low_max_torque, "moteus",
               "servo.max_current_A allows 0.05 N m: the rest of a torque is cut off without a fault"},
    DefectName{"classic_replies", &Defects::classic_replies, "moteus",
               "replies are classic frames, cut after 8 bytes"},
    DefectName{"timeout_damps", &Defects::timeout_damps, "moteus",
               "servo.timeout_mode 12, as delivered: after a time-out it damps instead of letting go"},
};

/// Gives a drive of `protocol` the defect `name`. Returns why that is impossible; empty: done.
[[nodiscard]] inline std::string set_defect(Defects& defects, std::string_view name,
                                            std::string_view protocol) {
  std::string all;
  for (const DefectName& d : defect_names) {
    all += (all.empty() ? "" : ", ") + std::string(d.name);
    if (d.name != name) continue;
    if ((", " + std::string(d.protocols) + ",").find(", " + std::string(protocol) + ",") ==
        std::string::npos) {
      return "not with protocol " + std::string(protocol) + ", only with " + std::string(d.protocols);
    }
    defects.*d.flag = true;
    return "";
  }
  return "unknown, allowed are " + all;
}

/// Receive buffer of firmware that ignores the length of frames; 0 at first.
class StaleBytes {
 public:
  /// Returns `f` padded to eight bytes with those of the frames before, and stores its own bytes.
  hal::CanFrame fill(hal::CanFrame f) {
    for (std::uint8_t i = 0; i < f.size && i < hal::can_classic_size_max; ++i) last_[i] = f.data[i];
    for (std::uint8_t i = 0; i < hal::can_classic_size_max; ++i) f.data[i] = last_[i];
    f.size = hal::can_classic_size_max;
    return f;
  }

 private:
  std::array<std::uint8_t, hal::can_classic_size_max> last_{};
};

}  // namespace esmc::host
