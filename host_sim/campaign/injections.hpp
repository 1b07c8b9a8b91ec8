#pragma once
/// The faults of a campaign: one row per fault, with its expected result. Written from the drives' side,
/// without the controller's code.

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "host_sim/campaign/draw.hpp"
#include "host_sim/campaign/protocol_traits.hpp"
#include "host_sim/campaign/times.hpp"

namespace esmc::host {

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

/// Draws a fault. `only`: name of its row, where it is possible; empty: any.
[[nodiscard]] Injection draw_injection(Draw& draw, const EpisodeTimes& times, const ProtocolTraits& traits,
                                       std::string_view only = {});
/// Whether a guard of this scene must notice the wrong numbers in samples; true for faults without any.
[[nodiscard]] bool has_to_show(const Injection& i, const Scene& scene);
/// Frame of the fault foreign_controller; empty for other faults.
[[nodiscard]] hal::CanFrame foreign_command(const ProtocolTraits& traits, const Scene& scene,
                                            const Injection& i);
[[nodiscard]] std::string describe(const Injection& i);

}  // namespace esmc::host
