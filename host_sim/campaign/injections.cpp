#include "host_sim/campaign/injections.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <numbers>
#include <utility>

#include "host_sim/drives/placed_axes.hpp"

namespace esmc::host {
namespace {

constexpr unsigned in(Phase p) { return 1U << static_cast<unsigned>(p); }
constexpr unsigned everywhere = 0x1F, at_start = in(Phase::arming);
constexpr int for_ever = 1'000'000'000;
constexpr int never = InjectionRow::not_demanded;

// Lengths are for 1 kHz, max_age_ticks = 2 and a watchdog of 10 ms; draw_length adapts them. The result of
// faults that take samples depends on how many are lost: expect_of_lost_samples.
constexpr auto rows = std::to_array<InjectionRow>({
    {"nothing", Injected::nothing, everywhere, 1, 1, "none"},
    {"frame_loss", Injected::loss, everywhere, 1, 2, "stale_feedback"},
    {"burst_loss", Injected::loss, everywhere, 3, 25, "stale_feedback"},
    {"scattered_loss", Injected::scattered_loss, everywhere, 5, 40,
     "none stale_feedback heartbeat_lost drive_error drive_disarmed torque_mismatch sign_test"},
    {"duplication", Injected::duplication, everywhere, 1, 40, "none"},
    {"delay", Injected::delay, everywhere, 1, 40, "none stale_feedback drive_disarmed torque_mismatch", true},
    {"reordering", Injected::reordering, everywhere, 1, 40,
     "none stale_feedback drive_disarmed torque_mismatch", true},
    {"corruption", Injected::corruption, everywhere, 1, 5, "*"},
    {"not_finite", Injected::not_finite, everywhere, 1, 20, "feedback_not_finite", false, 0},
    {"denormal", Injected::denormal, everywhere, 1, 20, "none", true},
    {"huge", Injected::huge, everywhere, 1, 20, "feedback_jump joint_speed", true, 0},
    {"end_of_range", Injected::end_of_range, everywhere, 1, 20, "feedback_jump joint_speed drive_error", true,
     0},
    {"wrong_length", Injected::wrong_length, everywhere, 1, 20, "malformed_frame", false, 0},
    {"remote_frame", Injected::remote, everywhere, 1, 20, "malformed_frame stale_feedback", false, 0},
    {"fd_frame", Injected::flexible_rate, everywhere, 1, 20, "malformed_frame", false, 0},
    {"extended_frame", Injected::extended, everywhere, 1, 20, "stale_feedback"},
    {"frozen_sensor", Injected::frozen_sensor, everywhere, 1, 60, "none", true},
    {"sensor_jump", Injected::sensor_jump, everywhere, 0, 0, "feedback_jump drive_error", true, 0},
    {"sensor_step", Injected::sensor_step, everywhere, 0, 0, "none", true},
    {"sensor_flipped", Injected::sensor_flipped, everywhere, 0, 0, "none drive_error", true},
    {"swapped_nodes", Injected::swapped_nodes, at_start, 0, 0, "none", true},
    {"drive_error", Injected::drive_error, everywhere, 1, 1, "drive_error drive_disarmed", false, 2,
     Waits::for_heartbeat},
    {"drive_disarm", Injected::drive_disarm, everywhere, 1, 1, "drive_disarmed torque_mismatch", true, 2,
     Waits::for_heartbeat},
    {"drive_reset", Injected::drive_reset, everywhere, 1, 1,
     "drive_disarmed stale_feedback torque_mismatch drive_configuration", true, 2, Waits::for_heartbeat},
    {"drive_silent", Injected::drive_silent, everywhere, 0, 0, "stale_feedback"},
    {"late_power", Injected::late_power, at_start, 0, 0, "enabling_timeout"},
    {"zero_until_closed_loop", Injected::zero_until_closed_loop, at_start, 0, 0, "none"},
    {"heartbeat_lost", Injected::heartbeat_lost, everywhere, 0, 0, "heartbeat_lost", false, 2,
     Waits::for_heartbeat_timeout},
    {"drive_bus_off", Injected::drive_bus_off, everywhere, 1, 40,
     "stale_feedback drive_error drive_disarmed"},
    {"watchdog_off", Injected::watchdog_off, at_start, 0, 0, "none drive_configuration"},
    {"controller_death", Injected::controller_death, everywhere, 0, 0, "none"},
    {"controller_late", Injected::controller_late, everywhere, 1, 30,
     "none drive_error drive_disarmed feedback_jump torque_mismatch sign_test", true},
    {"controller_bus_off", Injected::controller_bus_off, everywhere, 1, 40, "bus_off stale_feedback", false,
     1},
    {"commands_lost", Injected::commands_lost, everywhere, 1, 40,
     "none drive_error drive_disarmed stale_feedback torque_mismatch sign_test", true},
    {"torque_lost", Injected::torque_lost, everywhere, 1, 40,
     "none drive_error drive_disarmed torque_mismatch", true},
    {"queue_full", Injected::queue_full, everywhere, 1, 40,
     "none drive_error drive_disarmed stale_feedback torque_mismatch sign_test", true},
    {"babbling_node", Injected::babbling, everywhere, 1, 40, "stale_feedback"},
    {"flood", Injected::flood, everywhere, 1, 5, "bus_overload", false, 0},
    {"foreign_controller", Injected::foreign_controller, everywhere, 1, 30, "foreign_controller", false, 1},
    {"emergency_stop", Injected::emergency_stop, everywhere, 1, 1, "emergency_stop", false, 1},
    {"enable_open", Injected::enable_open, everywhere, 1, 20, "enable_open", false, 0},
    {"computer_gone", Injected::computer_gone, everywhere, 0, 0, "command_lost"},
});

// Scene values of the rows.
constexpr int usual_age_ticks = 2, usual_watchdog_ticks = 10, usual_beat_ticks = 10;
constexpr double usual_tick = 1e-3;  // s
constexpr double usual_jump = 0.05;  // rad per tick

bool among(Injected k, std::initializer_list<Injected> list) {
  return std::ranges::find(list, k) != list.end();
}

/// Whether it keeps samples from the controller.
bool takes_samples(Injected k) {
  return among(k, {Injected::loss, Injected::extended, Injected::babbling, Injected::drive_bus_off,
                   Injected::drive_silent});
}

/// Of a passive encoder only the samples count.
bool of_motors(Injected k) {
  return among(k,
               {Injected::swapped_nodes, Injected::drive_error, Injected::drive_disarm, Injected::drive_reset,
                Injected::heartbeat_lost, Injected::watchdog_off, Injected::foreign_controller});
}

/// Whether it may keep the controller's frames from a drive until its watchdog acts.
bool starves(Injected k) {
  return among(k, {Injected::drive_bus_off, Injected::controller_death, Injected::controller_late,
                   Injected::controller_bus_off, Injected::commands_lost, Injected::torque_lost,
                   Injected::queue_full, Injected::babbling});
}

/// Length from the row, stretched so that it falls on both sides of the limits of the scene.
int draw_length(Draw& draw, const InjectionRow& row, const EpisodeTimes& t) {
  if (row.kind == Injected::late_power) {  // up to 60 s, mostly short: evenly by its logarithm
    return static_cast<int>(std::exp(draw.uniform(std::log(0.01), std::log(60.0))) / t.tick) + 1;
  }
  if (row.kind == Injected::computer_gone) return draw.between(1, 3 * t.link_ticks);
  if (row.longest == 0) return for_ever;
  int shortest = row.shortest, longest = row.longest;
  const int older = t.max_age_ticks - usual_age_ticks;
  if (row.kind == Injected::loss) {
    if (shortest > 1) shortest = std::max(1, shortest + older);
    longest = std::max(shortest, longest + older);
  } else if (takes_samples(row.kind) || row.kind == Injected::remote) {
    longest += std::max(0, older);
  }
  // A controller that is late must be able to read all waiting frames in one tick.
  const int unread = row.kind == Injected::controller_late ? 1000 / (3 * static_cast<int>(t.axes)) : for_ever;
  if (starves(row.kind)) {
    const int hungry = row.longest * (t.watchdog_ticks - 1) / usual_watchdog_ticks;
    longest = std::max(longest, std::min(hungry, unread));
  }
  return draw.between(shortest, longest);
}

/// Whether it loses, delays or changes requests to a drive or their answers.
bool disturbs_requests(Injected k) {
  return starves(k) || among(k, {Injected::scattered_loss, Injected::corruption, Injected::drive_silent});
}

double draw_amount(Draw& draw, Injected kind, const EpisodeTimes& t) {
  const double coarser =
      std::max(1.0, t.jump / usual_jump);  // guard against jumps, relative to the usual one
  switch (kind) {
    case Injected::scattered_loss:
      return draw.uniform(0.05, 0.6);
    case Injected::delay:
      return draw.between(1, std::max(5, t.max_age_ticks + 3));
    case Injected::denormal:
      return draw.signed_magnitude(1e-45, 1e-38);
    case Injected::huge:
      return draw.signed_magnitude(1e3, 3e38);
    case Injected::sensor_jump:
      return draw.signed_magnitude(0.15 * coarser, std::max(3.0, 0.6 * coarser));
    case Injected::sensor_step:
      return draw.signed_magnitude(1e-5, 0.04 * coarser);
    case Injected::flood:
      return draw.between(1100, 3000);
    case Injected::foreign_controller:
      return draw.uniform(-1.0, 1.0);
    default:
      return draw.uniform();
  }
}

int phase_length(Phase p, const EpisodeTimes& t) {
  if (p == Phase::arming)
    return 45 * std::max(t.beat_ticks, usual_beat_ticks) / usual_beat_ticks;  // heartbeats
  if (p == Phase::joining) return t.join_ticks;
  if (p == Phase::halting) return t.halt_ticks + 10;
  return p == Phase::running ? 15 : 5;
}

/// Expected result of lost samples, by their number.
void expect_of_lost_samples(Injection& i, const EpisodeTimes& t, const ProtocolTraits& traits) {
  const Injected kind = i.row->kind;
  i.stale = i.length > t.max_age_ticks;
  // Where the request for a sample is lost as well, one more sample is missing.
  const bool deaf = kind == Injected::babbling || kind == Injected::drive_bus_off;
  const bool asked = deaf && traits.samples_on_demand;
  i.must_pass = i.length + (asked ? 1 : 0) <= t.max_age_ticks;
  i.notice_ticks = i.stale ? t.max_age_ticks : never;
  // With a high max_age_ticks other guards may trip first.
  const int late = i.stale ? t.max_age_ticks + 1 : t.heartbeat_late(i.length);
  const bool beats = kind == Injected::babbling || i.drive < t.motors;
  if (beats && t.heartbeat_expires(late)) i.fits_too += " heartbeat_lost";
  if (deaf && !i.stale && t.watchdog_expires(i.length)) i.fits_too += " drive_error drive_disarmed";
  // Without feedback for longer than 1 / lambda, the motion differs from the prediction.
  if (std::min(i.length, t.max_age_ticks) > t.open_ticks) i.fits_too.append(" ").append(motion_faults);
  i.must_pass = i.must_pass && i.fits_too.empty();
}

/// Expected result of a fault as drawn, and its deadline.
void expect(Injection& i, const EpisodeTimes& t, const ProtocolTraits& traits) {
  const InjectionRow& row = *i.row;
  const double tick_ms = 1e3 * t.tick;
  const auto fits_if = [&](bool condition, std::string_view names) {
    if (condition) i.fits_too.append(" ").append(names);
  };
  i.notice_ticks = row.notice_ticks;
  if (row.waits == Waits::for_heartbeat) i.notice_ticks += t.beat_ticks;
  if (row.waits == Waits::for_heartbeat_timeout) i.notice_ticks += t.heartbeat_ticks;
  if (takes_samples(row.kind) || (row.kind == Injected::remote && traits.remote_is_nothing)) {
    expect_of_lost_samples(i, t, traits);
  }
  fits_if(t.out_of_range && row.wrong_motion, "drive_error");
  fits_if(t.read_back && i.phase == Phase::arming && disturbs_requests(row.kind), "drive_configuration");
  switch (row.kind) {
    case Injected::scattered_loss:  // commands are lost as well: in a slow loop the last torque acts longer
      fits_if(t.tick > 1.001 * usual_tick, motion_faults);
      break;
    case Injected::delay:
      fits_if(t.heartbeat_expires(static_cast<int>(i.amount)), "heartbeat_lost");
      break;
    case Injected::drive_reset:  // its heartbeat period begins anew
      fits_if(t.heartbeat_expires(t.beat_ticks), "heartbeat_lost");
      break;
    case Injected::late_power:
      i.usable_tick = i.length;
      i.must_pass = i.length + 2 * t.beat_ticks < t.silent_ticks;
      i.watch_ticks = i.length + t.arming_ticks;
      break;
    case Injected::zero_until_closed_loop:  // a passive encoder never enters closed loop
      if (i.drive >= t.motors) i.usable_tick = for_ever;
      fits_if(i.drive >= t.motors, "enabling_timeout");
      i.watch_ticks = t.silent_ticks + t.arming_ticks;
      break;
    case Injected::computer_gone:
      i.must_pass = i.length + 2 < t.link_ticks;
      i.notice_ticks = i.length > t.link_ticks && !t.unattended ? t.link_ticks + 1 : never;
      i.watch_ticks = t.link_ticks + t.off_after_halt_ticks;
      break;
    case Injected::controller_late:  // no sample was requested
      fits_if(traits.samples_on_demand && t.max_age_ticks == 0, "stale_feedback");
      break;
    default:
      break;
  }
  // A jammed bus or a controller in bus-off delivers no command: the drives' watchdogs end the torque.
  const bool mute = row.kind == Injected::babbling || row.kind == Injected::controller_bus_off;
  i.safe_ms = mute ? t.watchdog_ms : i.notice_ticks * tick_ms + std::max(tick_ms, t.frames_ms);
  if (row.kind == Injected::foreign_controller) i.safe_ms += traits.ticks_to_let_go * tick_ms;
  if (row.kind == Injected::foreign_controller && traits.torque_arms) i.safe_ms += i.length * tick_ms;
  if (starves(row.kind))
    i.watch_ticks = std::max(i.watch_ticks, static_cast<int>(std::ceil(t.watchdog_ms / tick_ms)));
  // After the loss of the computer the mechanism comes to rest under control, with torque until then.
  if (row.kind == Injected::computer_gone)
    i.safe_ms = t.off_after_halt_ticks > 0 ? i.safe_ms + t.off_after_halt_ticks * tick_ms : 1e12;
  const bool lets_go = row.kind == Injected::drive_disarm || row.kind == Injected::drive_reset;
  if (lets_go && !traits.tells_its_state) i.notice_ticks = never;
}

}  // namespace

std::span<const InjectionRow> injection_rows() { return rows; }

bool possible(const InjectionRow& row, const ProtocolTraits& d, const EpisodeTimes& t) {
  const std::pair<Injected, bool> needs[] = {
      {Injected::zero_until_closed_loop, t.zeros_at_boot},
      {Injected::computer_gone, t.link_ticks > 0},
      {Injected::not_finite, d.put_number != nullptr},
      {Injected::denormal, d.put_number != nullptr},
      {Injected::huge, d.put_number != nullptr},
      {Injected::end_of_range, d.put_end != nullptr},
      {Injected::heartbeat_lost, d.is_heartbeat != nullptr},
      {Injected::drive_error, d.fail != nullptr},
      {Injected::emergency_stop, d.emergency_stop != nullptr},
  };
  return std::ranges::all_of(needs, [&](const auto& n) { return n.first != row.kind || n.second; });
}

bool lists(std::string_view list, std::string_view word) {
  return fmt::format(" {} ", list).find(fmt::format(" {} ", word)) != std::string::npos;
}

Injection draw_injection(Draw& draw, const EpisodeTimes& times, const ProtocolTraits& traits,
                         std::string_view only) {
  Injection i;
  const auto wanted = [&](const InjectionRow& r) {
    return (only.empty() || r.name == only) && possible(r, traits, times);
  };
  const bool any = std::ranges::any_of(rows, wanted);  // false: `only` is not possible here, nothing is done
  do {
    i.row = any ? &rows[draw.below(rows.size())] : &rows.front();
  } while (any && !wanted(*i.row));
  do {
    i.phase = static_cast<Phase>(draw.below(phase_count));
  } while ((i.row->phases & in(i.phase)) == 0 || phase_length(i.phase, times) == 0);
  i.offset = i.row->phases == at_start ? 0 : draw.between(0, phase_length(i.phase, times) - 1);
  i.length = draw_length(draw, *i.row, times);
  i.drive = draw.below(of_motors(i.row->kind) ? times.motors : times.axes);
  i.choice = static_cast<int>(draw.below(64));
  i.amount = draw_amount(draw, i.row->kind, times);
  i.bits = draw.bits();
  expect(i, times, traits);
  return i;
}

bool has_to_show(const Injection& i, const Scene& scene) {
  const PlacedAxis axis = placed_axes(scene)[i.drive];
  const bool of_base = scene.joints() == 2 || axis.joint % 2 == 0;
  const DriveScene& d = scene.drives;
  const double turn = 2.0 * std::numbers::pi / axis.mount.gear_ratio;
  double angle = 0.0, rate = 0.0;  // of the joint, by which a sample is wrong
  switch (i.kind()) {
    case Injected::not_finite:
      return of_base || scene.all_sensors;
    case Injected::sensor_jump:
      angle = std::abs(i.amount);
      // The frame holds the low bits of a position.
      if (d.protocol == Protocol::mit) {
        const double span = 2.0 * d.position_range[axis.entry] / axis.mount.gear_ratio;
        angle = std::abs(std::remainder(angle, span));
      }
      break;
    case Injected::huge:
      (i.choice % 2 == 0 ? angle : rate) = std::abs(i.amount) * turn;
      break;
    case Injected::end_of_range:
      if (d.protocol == Protocol::mit) return true;  // the reply itself is an error
      angle = 0x1p31 / d.counts_per_turn * turn;
      rate = 0x1p31 * d.velocity_unit / axis.mount.gear_ratio;
      break;
    default:
      return true;
  }
  if (!of_base && !scene.all_sensors) return false;
  // The sample before may have been off by as much as the guard allows, in the other direction.
  const double jump = 2.0 * scene.limits.feedback_jump;
  const bool jumps = jump > 0.0 && std::abs(angle - rate * scene.tick()) > jump;
  return jumps || (of_base && rate > 2.0 * scene.limits.joint_speed);
}

hal::CanFrame foreign_command(const ProtocolTraits& traits, const Scene& scene, const Injection& i) {
  if (i.kind() != Injected::foreign_controller) return {};
  if (i.choice % 2 == 0) return traits.foreign_torque(scene, i.drive, i.amount * scene.torque_limit[i.drive]);
  return traits.foreign_command(scene.drives.nodes[i.drive], static_cast<unsigned>(i.choice / 2));
}

std::string describe(const Injection& i) {
  return fmt::format("{} in {} + {} ticks, {}, drive {}, amount {:.6g}, choice {}", i.row->name,
                     name(i.phase), i.offset,
                     i.length >= for_ever ? std::string("for ever") : fmt::format("for {} ticks", i.length),
                     i.drive + 1, i.amount, i.choice);
}

}  // namespace esmc::host
