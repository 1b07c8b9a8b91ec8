#pragma once
/// What real drives do wrong and emulated ones can be made to.

#include <array>
#include <cstdint>
#include <string_view>

#include "hal/can.hpp"

namespace esmc::host {

struct Defects {
  bool watchdog_off = false;
  bool watchdog_any_frame = false;
  bool short_frames_stale = false;
  bool no_nan_check = false;
  bool unsynchronised = false;
  bool timeout_stays_enabled = false;
  bool latched_timeout = false;
  bool torque_mode_limit = false;
  bool pre_operational_keeps_torque = false;
};

struct DefectName {
  std::string_view name;
  bool Defects::* flag;
  bool odrive, mit, cia402;  ///< which drives can have it
  std::string_view meaning;
};

inline constexpr std::array defect_names{
    DefectName{"watchdog_off", &Defects::watchdog_off, true, true, true, "the last torque is held for ever"},
    DefectName{"watchdog_any_frame", &Defects::watchdog_any_frame, true, false, false,
               "any frame to the drive feeds the watchdog, requests included"},
    DefectName{"short_frames_stale", &Defects::short_frames_stale, true, true, true,
               "bytes that a frame does not have are those of the frame before"},
    DefectName{"no_nan_check", &Defects::no_nan_check, true, false, false,
               "NaN passes as a set-point; a limiter of fmin and fmax makes full torque of it"},
    DefectName{"unsynchronised", &Defects::unsynchronised, true, false, false,
               "samples are taken at a clock of its own, 100 ppm fast: up to a period old when they are sent"},
    DefectName{"timeout_stays_enabled", &Defects::timeout_stays_enabled, true, true, false,
               "a time-out zeroes the torque, and the next command acts at once (MIT drives always do)"},
    DefectName{"latched_timeout", &Defects::latched_timeout, true, true, false,
               "after a time-out the drive is dead until it is restarted (odrive) or enters motor mode anew (mit)"},
    DefectName{"torque_mode_limit", &Defects::torque_mode_limit, true, false, false,
               "torque is cut to (2 rev/s - speed) / 6 N m s/rev, as ODrive 0.5 does by default"},
    DefectName{"pre_operational_keeps_torque", &Defects::pre_operational_keeps_torque, false, false, true,
               "made pre-operational, it goes on with its last torque: the profile's 6007 does not name that"},
};

/// The bytes of the frame received last, and of those before it where they were longer.
class StaleBytes {
 public:
  /// The frame as firmware sees it that does not look at its length: eight bytes.
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
