#pragma once
/// Times that a scene promises: watchdogs, heartbeats and the limits of the controller, for faults and judge.

#include <cstddef>

#include "host_sim/scene/scene.hpp"

namespace esmc::host {

/// Defaults are those of 1 kHz.
struct EpisodeTimes {
  double tick = 1e-3;  ///< s
  int arming_ticks = 40, join_ticks = 0, halt_ticks = 0;
  int max_age_ticks = 0;
  int open_ticks = 25;           ///< without samples, in which the motion hardly changes: 1 / lambda
  int heartbeat_ticks = 0;       ///< time-out of a drive's heartbeats
  int beat_ticks = 10;           ///< from one heartbeat of a drive to the next
  int watchdog_ticks = 11;       ///< from the last frame that feeds a drive until it lets go
  int feed_ticks = 1;            ///< from one such frame to the next
  double watchdog_ms = 12.0;     ///< from the last such frame to zero torque, at most
  double frames_ms = 0.0;        ///< time on the bus of the frames that take the torque away
  double jump = 0.05;            ///< rad per tick, the guard's; where it is off, what it would be by default
  int steps_per_tick = 1;        ///< steps of the integration in a tick
  bool out_of_range = false;     ///< a motion may leave the range of a drive's replies: a drive error
  bool read_back = false;        ///< drives are asked before arming: a lost answer is a refusal to arm
  int off_after_halt_ticks = 0;  ///< a halt ends without torque within so many ticks; 0: it holds
  int silent_ticks = 750;        ///< silence of a drive while enabling, until arming is refused
  int link_ticks = 0;            ///< the time-out of the command interface that arms; 0: there is none
  bool zeros_at_boot = false;    ///< the drives may report position 0 until their first closed loop
  std::size_t motors = 2, axes = 2;  ///< axes: with passive encoders

  /// Whether a heartbeat that is `late` ticks late can be too old.
  [[nodiscard]] bool heartbeat_expires(int late) const { return beat_ticks - 1 + late > heartbeat_ticks; }
  /// Ticks by which the next heartbeat is late where the heartbeats of `lost` ticks are lost.
  [[nodiscard]] int heartbeat_late(int lost) const { return rounded_up(lost, beat_ticks); }
  /// Whether a watchdog can expire in a drive that receives nothing for `deaf` ticks.
  [[nodiscard]] bool watchdog_expires(int deaf) const {
    return rounded_up(deaf, feed_ticks) + feed_ticks >= watchdog_ticks;
  }

 private:
  [[nodiscard]] static int rounded_up(int n, int step) { return (n + step - 1) / step * step; }
};

/// Returns the times of a scene, except arming_ticks and join_ticks: the loop measures and sets those two.
[[nodiscard]] EpisodeTimes episode_times(const Scene& scene);

}  // namespace esmc::host
