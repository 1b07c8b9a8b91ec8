#pragma once
/// What a scene promises of its loop: how long a drive goes on without its controller, how often it says that
/// it lives, what the controller bears. The judge and the faults take their times from here.

#include <cstddef>

#include "host_sim/scene/scene.hpp"

namespace esmc::host {

/// What decides the times of an episode, from its scene. What is not given is as at 1 kHz.
struct EpisodeTimes {
  double tick = 1e-3;  ///< s
  int arming_ticks = 40, join_ticks = 0, halt_ticks = 0;
  int max_age_ticks = 0;
  int open_ticks = 25;        ///< without samples, in which the motion stays what it was: 1 / lambda
  int heartbeat_ticks = 0;    ///< of the time-out
  int beat_ticks = 10;        ///< from one heartbeat of a drive to the next
  int watchdog_ticks = 11;    ///< from the last frame that feeds a drive until it lets go
  int feed_ticks = 1;         ///< from one such frame to the next
  double watchdog_ms = 12.0;  ///< from the last such frame to zero torque, at most
  double frames_ms = 0.0;     ///< that the frames need which take the torque away
  double jump = 0.05;         ///< rad per tick, the guard's; where it is off, what it would be by default
  int steps_per_tick = 1;     ///< of the integration
  bool out_of_range = false;  ///< a motion may leave the range of a drive's replies, which is a drive's error
  bool read_back =
      false;  ///< before arming, drives are asked: what the bus does to the answers is a refusal to arm
  int off_after_halt_ticks = 0;      ///< a halt ends without torque within so many ticks; 0: it holds
  int silent_ticks = 750;            ///< while enabling, without a word from a drive, and then it is refused
  int link_ticks = 0;                ///< the time-out of the command interface that arms; 0: there is none
  bool zeros_at_boot = false;        ///< the drives may report position 0 until their first closed loop
  std::size_t motors = 2, axes = 2;  ///< axes: with passive encoders

  /// Whether a drive's heartbeat can become too old where it comes so many ticks late.
  [[nodiscard]] bool heartbeat_expires(int late) const { return beat_ticks - 1 + late > heartbeat_ticks; }
  /// How late the next one is where those of so many ticks are lost.
  [[nodiscard]] int heartbeat_late(int lost) const { return rounded_up(lost, beat_ticks); }
  /// Whether a drive's watchdog can expire where it hears nothing for so many ticks.
  [[nodiscard]] bool watchdog_expires(int deaf) const {
    return rounded_up(deaf, feed_ticks) + feed_ticks >= watchdog_ticks;
  }

 private:
  [[nodiscard]] static int rounded_up(int n, int step) { return (n + step - 1) / step * step; }
};

/// Without those that only the loop itself knows: arming_ticks and join_ticks.
[[nodiscard]] EpisodeTimes episode_times(const Scene& scene);

}  // namespace esmc::host
