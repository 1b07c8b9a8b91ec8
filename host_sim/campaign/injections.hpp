#pragma once
/// The faults of a campaign: one row per fault, with its expected result. Written from the drives' side,
/// without the controller's code.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "host_sim/campaign/protocol_traits.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

/// Times that a scene promises: watchdogs, heartbeats and the limits of the controller, for faults and judge.
/// Defaults are those of 1 kHz.
struct EpisodeTimes {
  double tick = 1e-3;  ///< s
  int arming_ticks = 40, join_ticks = 0, halt_ticks = 0;
  int max_age_ticks = 0;
  int open_ticks = 25;           ///< without samples, in which the motion hardly changes: 1 / lambda
  int heartbeat_ticks = 0;       ///< time-out of a drive's heartbeats
  int beat_ticks = 10;           ///< from one heartbeat of a drive to the next
  int watchdog_ticks = 11;       ///< from the last frame that feeds a drive until its torque is zero
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
  bool unattended = false;       ///< the reference goes on when the console is gone
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

/// Random numbers of an episode, the same on every machine. SplitMix64: neighbouring seeds give unrelated
/// streams.
class Draw {
 public:
  explicit Draw(std::uint64_t seed) : state_(seed) {}

  std::uint64_t bits() {
    state_ += 0x9E37'79B9'7F4A'7C15ULL;
    std::uint64_t z = state_;
    z = (z ^ (z >> 30U)) * 0xBF58'476D'1CE4'E5B9ULL;
    z = (z ^ (z >> 27U)) * 0x94D0'49BB'1331'11EBULL;
    return z ^ (z >> 31U);
  }
  /// Draws an integer in 0 .. n - 1; n > 0. The bias is below n / 2^64.
  std::uint64_t below(std::uint64_t n) { return bits() % n; }
  /// Draws an integer in lowest .. highest, both included; lowest <= highest.
  int between(int lowest, int highest) {
    return lowest + static_cast<int>(below(static_cast<std::uint64_t>(highest - lowest) + 1));
  }
  bool one_in(std::uint64_t n) { return below(n) == 0; }  ///< true with probability 1 / n; n > 0
  /// Draws a number in [0, 1), or in [lowest, highest).
  double uniform() { return static_cast<double>(bits() >> 11U) * 0x1p-53; }
  double uniform(double lowest, double highest) { return lowest + (highest - lowest) * uniform(); }
  /// Draws a number of a magnitude in lowest .. highest, both > 0, of either sign and each power of two
  /// equally often; without library functions whose last bit may differ.
  double signed_magnitude(double lowest, double highest) {
    const double size = std::ldexp(1.0 + uniform(), between(std::ilogb(lowest), std::ilogb(highest)));
    return (one_in(2) ? 1.0 : -1.0) * std::clamp(size, lowest, highest);
  }

 private:
  std::uint64_t state_;
};

enum class Phase : std::uint8_t { arming, joining, running, halting, stopping };
template <>
inline constexpr auto names_of<Phase> = std::array{"arming", "joining", "running", "halting", "stopping"};
inline constexpr std::size_t phase_count = names_of<Phase>.size();

enum class Injected : std::uint8_t {
  nothing,
  // frames of a drive on their way to the controller
  loss,
  scattered_loss,
  duplication,
  delay,
  reordering,
  corruption,
  not_finite,
  denormal,
  huge,
  end_of_range,
  wrong_length,
  remote,
  flexible_rate,
  extended,
  // encoders
  frozen_sensor,
  sensor_jump,
  sensor_step,
  sensor_flipped,
  swapped_nodes,
  // drives
  drive_error,
  drive_disarm,
  drive_reset,
  drive_silent,
  late_power,
  zero_until_closed_loop,
  heartbeat_lost,
  drive_bus_off,
  watchdog_off,
  // controller
  controller_death,
  controller_late,
  controller_bus_off,
  commands_lost,
  torque_lost,
  queue_full,
  // bus
  babbling,
  flood,
  foreign_controller,
  emergency_stop,
  enable_open,
  // supervisor computer
  computer_gone,
};

/// Message that a controller needs, or misses, before it can notice a fault.
enum class Waits : std::uint8_t { for_nothing, for_heartbeat, for_heartbeat_timeout };

/// A fault and its expected result.
struct InjectionRow {
  std::string_view name;
  Injected kind;
  unsigned phases;        ///< bit per phase in which it can begin
  int shortest, longest;  ///< ticks; 0, 0: until the end
  /// Controller faults that fit, separated by blanks; "none": it may pass without one; "*": any, because the
  /// fault may turn a frame into any other.
  std::string_view fits;
  /// The measured motion is wrong in a way that no single frame shows: a limit of the motion trips.
  bool wrong_motion = false;
  /// Ticks from its beginning within which the controller must latch it, while there is torque.
  int notice_ticks = not_demanded;
  /// Its ticks are added to notice_ticks.
  Waits waits = Waits::for_nothing;
  static constexpr int not_demanded = -1;
};

/// Controller faults that a wrong sensor ends in.
inline constexpr std::string_view motion_faults =
    "feedback_jump loop_not_closed type1_singularity type2_singularity working_mode workspace joint_speed "
    "joint_angle "
    "reference_unreachable join_infeasible halt_failed sign_test";

[[nodiscard]] std::span<const InjectionRow> injection_rows();
/// Whether a drive of this protocol can show the fault, on a scene with these times.
[[nodiscard]] bool possible(const InjectionRow& row, const ProtocolTraits& d, const EpisodeTimes& t);
/// Whether a blank-separated list holds a word.
[[nodiscard]] bool lists(std::string_view list, std::string_view word);

/// A fault as drawn.
struct Injection {
  const InjectionRow* row = nullptr;
  Phase phase = Phase::running;
  int offset = 0;  ///< ticks into the phase
  int length = 0;  ///< ticks; a large number where it stays
  std::size_t drive = 0;
  double amount = 0.0;
  int choice = 0;          ///< among variants of a fault
  std::uint64_t bits = 0;  ///< of a generator of its own
  int notice_ticks = InjectionRow::not_demanded;
  double safe_ms = 0.0;    ///< from its beginning until the torque is zero at all drives that hear
  int watch_ticks = 30;    ///< from its beginning, to wait for the drives' watchdogs
  std::string fits_too{};  ///< names that fit on this scene
  bool stale = false;      ///< takes away more samples than are extrapolated
  bool must_pass = false;  ///< so few samples that no fault fits
  int usable_tick = 0;     ///< of the episode; from it on every drive and encoder can be heard

  [[nodiscard]] Injected kind() const { return row->kind; }
};

/// Draws a possible fault. `only`: name of its row (where that is not possible: `nothing`); empty: any.
[[nodiscard]] Injection draw_injection(Draw& draw, const EpisodeTimes& times, const ProtocolTraits& traits,
                                       std::string_view only = {});
/// Whether a guard of this scene must notice the wrong numbers in samples; true for faults without any.
[[nodiscard]] bool has_to_show(const Injection& i, const Scene& scene);
/// Frame of the fault foreign_controller; empty for other faults.
[[nodiscard]] hal::CanFrame foreign_command(const ProtocolTraits& traits, const Scene& scene,
                                            const Injection& i);
[[nodiscard]] std::string describe(const Injection& i);

}  // namespace esmc::host
