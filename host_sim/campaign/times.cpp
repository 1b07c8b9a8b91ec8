#include "host_sim/campaign/injections.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "firmware/drive/moteus.hpp"
#include "host_sim/bus/wire.hpp"

namespace esmc::host {
namespace {

constexpr double beat = 0.01;  // s: the emulated drives', and what a CiA 402 drive is set to

/// s; a CiA 402 drive and a moteus count whole ms.
double time_out(const Scene& s) {
  const double t = s.drives.watchdog_timeout;
  const bool whole = s.drives.protocol == Protocol::cia402 || s.drives.protocol == Protocol::moteus;
  return whole ? 1e-3 * std::ceil(1e3 * t - 1e-9) : t;
}

/// Bit times of the longest frame of the controller.
double longest_frame(const Scene& s) {
  if (s.data_bitrate > 0) return fd_bits(drive::moteus::torque_size, true, s.fast_bit(), true);
  return worst_bits(8);
}

// Drives count in ticks and allow half a tick of rounding; at exactly half a tick it may go either way.
constexpr double either_way = 1e-9;  // ticks

}  // namespace

EpisodeTimes episode_times(const Scene& s) {
  const auto ticks = [&](double seconds) { return static_cast<int>(std::llround(seconds * s.rate_hz)); };
  constexpr double ms = 1e3;
  EpisodeTimes t;
  t.tick = s.tick();
  t.halt_ticks = ticks(s.limits.halt_time);
  t.max_age_ticks = s.limits.max_age_ticks;
  t.heartbeat_ticks = static_cast<int>(std::ceil(s.drives.heartbeat_timeout * s.rate_hz));
  t.beat_ticks = std::max(1, static_cast<int>(std::floor(beat * s.rate_hz + 0.5 + either_way)));
  t.watchdog_ticks = static_cast<int>(std::ceil(time_out(s) * s.rate_hz + 0.5 - either_way));
  t.feed_ticks = s.drives.protocol == Protocol::cia402 ? static_cast<int>(heartbeat_ticks(s)) : 1;
  // A drive counts ticks from the one in which it was fed: up to a tick and a half more.
  t.watchdog_ms = ms * time_out(s) + 2.0 * ms * t.tick;
  t.frames_ms =
      (2.0 * s.motors() - 1.0) * longest_frame(s) / (s.bitrate / ms);  // two for each motor, one for the last
  t.jump = s.limits.feedback_jump > 0.0 ? s.limits.feedback_jump : s.limits.joint_speed * t.tick;
  t.steps_per_tick = std::max(1, static_cast<int>(std::ceil(t.tick / s.step - either_way)));
  const double lambda = std::max(s.lambda.position, s.lambda.angle);
  t.open_ticks = lambda > 0.0 ? static_cast<int>(std::floor(1.0 / (lambda * t.tick))) : t.open_ticks;
  t.read_back = s.drives.endpoints.has_value();
  t.silent_ticks =
      std::max(2, static_cast<int>(std::floor(
                      (s.drives.boot_time + 6.0 * std::min(0.15, s.drives.heartbeat_timeout)) * s.rate_hz)));
  if (s.command && s.command->arm_by_link)
    t.link_ticks = static_cast<int>(std::ceil(s.command->timeout * s.rate_hz));
  t.unattended = s.reference.unattended && s.command && s.command->source == link::Source::reference;
  t.zeros_at_boot = s.drives.protocol == Protocol::odrive_0_5;
  t.motors = static_cast<std::size_t>(s.motors());
  for (std::size_t i = 0; s.drives.protocol == Protocol::mit && i < t.motors; ++i) {
    const double gear = s.drives.gear_ratio[i];  // before limits.joint_speed, or within two turns
    t.out_of_range = t.out_of_range || s.drives.velocity_range[i] < s.limits.joint_speed * gear ||
                     s.drives.position_range[i] < 4.0 * std::numbers::pi * gear;
  }
  t.axes = s.drives.nodes.size();
  if (s.limits.after_halt != AfterHalt::hold) {
    t.off_after_halt_ticks = 4 * t.halt_ticks + ticks(s.limits.lower_time) + 4;
  }
  return t;
}

}  // namespace esmc::host
