#pragma once
/// The time that an order to enable may wait for drives.

#include <array>
#include <cstdint>

namespace esmc {

/// Limits the ticks in which enabling makes no progress. Every drive must send a frame within the limit, and
/// be set up or ready within it after that: power that comes later must not meet an old order. Reset by
/// assignment when enabling ends.
template <int axes_max>
struct EnablingWait {
  std::uint32_t ticks = 0;                                    ///< without progress
  bool waits = false, all = false;                            ///< enabling; every axis has sent a frame
  std::array<bool, static_cast<unsigned>(axes_max)> heard{};  ///< by axis: a frame since enabling began

  /// Counts ticks without progress; call once per tick while enabling, `passed` ticks after the last.
  /// `silent(i)`: ticks since the last frame of axis i; `setting_up(i)`: it is a motor whose set-up goes on.
  /// True: `ticks_max` is reached.
  template <class Silent, class SettingUp>
  bool expired(int axis_count, std::uint32_t passed, std::uint32_t ticks_max, Silent&& silent,
               SettingUp&& setting_up) {
    bool every = true, set_up = false;
    for (int i = 0; i < axis_count; ++i) {
      bool& h = heard[static_cast<unsigned>(i)];
      h = h || silent(i) == 0;
      every = every && h;
      set_up = set_up || setting_up(i);
    }
    if (every && !all) ticks = 0;
    all = every;
    waits = true;
    if (!every || !set_up) ticks += passed;
    return ticks >= ticks_max;
  }
};

}  // namespace esmc
