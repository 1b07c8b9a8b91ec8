#include "host_sim/campaign/injections.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>

namespace esmc::host {
namespace {

constexpr unsigned in(Phase p) { return 1U << static_cast<unsigned>(p); }
constexpr unsigned everywhere = 0x1F, at_start = in(Phase::arming);
constexpr int for_ever = 1'000'000;
constexpr int never = InjectionRow::not_demanded;

// Times are those of 1 kHz and max_age_ticks = 2. `loss`, `babbling`, `extended` and `drive_bus_off` take the
// samples away: what is due then depends on how many, see draw_injection.
constexpr std::array rows{
    InjectionRow{"nothing", Injected::nothing, everywhere, 1, 1, "none"},
    InjectionRow{"frame_loss", Injected::loss, everywhere, 1, 2, "stale_feedback"},
    InjectionRow{"burst_loss", Injected::loss, everywhere, 3, 25, "stale_feedback"},
    InjectionRow{"scattered_loss", Injected::scattered_loss, everywhere, 5, 40,
                 "none stale_feedback heartbeat_lost drive_error drive_disarmed torque_mismatch sign_test"},
    InjectionRow{"duplication", Injected::duplication, everywhere, 1, 40, "none"},
    InjectionRow{"delay", Injected::delay, everywhere, 1, 40,
                 "none stale_feedback drive_disarmed torque_mismatch", true},
    InjectionRow{"reordering", Injected::reordering, everywhere, 1, 40,
                 "none stale_feedback drive_disarmed torque_mismatch", true},
    InjectionRow{"corruption", Injected::corruption, everywhere, 1, 5, "*"},
    InjectionRow{"not_finite", Injected::not_finite, everywhere, 1, 20, "feedback_not_finite", false, 0, 1},
    InjectionRow{"denormal", Injected::denormal, everywhere, 1, 20, "none", true},
    InjectionRow{"huge", Injected::huge, everywhere, 1, 20, "feedback_jump joint_speed", true, 0, 1},
    InjectionRow{"end_of_range", Injected::end_of_range, everywhere, 1, 20,
                 "feedback_jump joint_speed drive_error", true, 0, 1},
    InjectionRow{"wrong_length", Injected::wrong_length, everywhere, 1, 20, "malformed_frame", false, 0, 1},
    InjectionRow{"remote_frame", Injected::remote, everywhere, 1, 20, "malformed_frame stale_feedback", false,
                 0, 1},
    InjectionRow{"fd_frame", Injected::flexible_rate, everywhere, 1, 20, "malformed_frame", false, 0, 1},
    InjectionRow{"extended_frame", Injected::extended, everywhere, 1, 20, "stale_feedback"},
    InjectionRow{"frozen_sensor", Injected::frozen_sensor, everywhere, 1, 60, "none", true},
    InjectionRow{"sensor_jump", Injected::sensor_jump, everywhere, 0, 0, "feedback_jump drive_error", true, 0,
                 1},
    InjectionRow{"sensor_step", Injected::sensor_step, everywhere, 0, 0, "none", true},
    InjectionRow{"sensor_flipped", Injected::sensor_flipped, everywhere, 0, 0, "none drive_error", true},
    InjectionRow{"swapped_nodes", Injected::swapped_nodes, at_start, 0, 0, "none", true},
    InjectionRow{"drive_error", Injected::drive_error, everywhere, 1, 1, "drive_error drive_disarmed", false,
                 12, 13},
    InjectionRow{"drive_disarm", Injected::drive_disarm, everywhere, 1, 1, "drive_disarmed torque_mismatch",
                 true, 12, 13},
    InjectionRow{"drive_reset", Injected::drive_reset, everywhere, 1, 1,
                 "drive_disarmed stale_feedback torque_mismatch drive_configuration", true, 12, 13},
    InjectionRow{"drive_silent", Injected::drive_silent, everywhere, 0, 0, "stale_feedback"},
    InjectionRow{"heartbeat_lost", Injected::heartbeat_lost, everywhere, 0, 0, "heartbeat_lost", false, 52,
                 53},
    InjectionRow{"drive_bus_off", Injected::drive_bus_off, everywhere, 1, 40,
                 "stale_feedback drive_error drive_disarmed"},
    InjectionRow{"watchdog_off", Injected::watchdog_off, at_start, 0, 0, "none drive_configuration"},
    InjectionRow{"controller_death", Injected::controller_death, everywhere, 0, 0, "none"},
    InjectionRow{"controller_late", Injected::controller_late, everywhere, 1, 30,
                 "none drive_error drive_disarmed feedback_jump torque_mismatch sign_test", true},
    InjectionRow{"controller_bus_off", Injected::controller_bus_off, everywhere, 1, 40,
                 "bus_off stale_feedback", false, 1, 12},
    InjectionRow{"commands_lost", Injected::commands_lost, everywhere, 1, 40,
                 "none drive_error drive_disarmed stale_feedback torque_mismatch sign_test", true},
    InjectionRow{"torque_lost", Injected::torque_lost, everywhere, 1, 40,
                 "none drive_error drive_disarmed torque_mismatch", true},
    InjectionRow{"queue_full", Injected::queue_full, everywhere, 1, 40,
                 "none drive_error drive_disarmed stale_feedback torque_mismatch sign_test", true},
    InjectionRow{"babbling_node", Injected::babbling, everywhere, 1, 40, "stale_feedback"},
    InjectionRow{"flood", Injected::flood, everywhere, 1, 5, "bus_overload", false, 0, 1},
    InjectionRow{"foreign_controller", Injected::foreign_controller, everywhere, 1, 30, "foreign_controller",
                 false, 1, 2},
    InjectionRow{"emergency_stop", Injected::emergency_stop, everywhere, 1, 1, "emergency_stop", false, 1, 2},
    InjectionRow{"enable_open", Injected::enable_open, everywhere, 1, 20, "enable_open", false, 0, 1},
};

/// Of a passive encoder only the samples count.
bool of_motors(Injected k) {
  switch (k) {
    case Injected::swapped_nodes:
    case Injected::drive_error:
    case Injected::drive_disarm:
    case Injected::drive_reset:
    case Injected::heartbeat_lost:
    case Injected::watchdog_off:
    case Injected::foreign_controller:
      return true;
    default:
      return false;
  }
}

void draw_amount(Draw& draw, Injection& i) {
  i.choice = static_cast<int>(draw.below(64));
  switch (i.row->kind) {
    case Injected::scattered_loss:
      i.amount = draw.uniform(0.05, 0.6);
      break;
    case Injected::delay:
      i.amount = draw.between(1, 5);
      break;
    case Injected::denormal:
      i.amount = draw.signed_magnitude(1e-45, 1e-38);
      break;
    case Injected::huge:
      i.amount = draw.signed_magnitude(1e3, 3e38);
      break;
    case Injected::sensor_jump:
      i.amount = draw.signed_magnitude(0.15, 3.0);
      break;
    case Injected::sensor_step:
      i.amount = draw.signed_magnitude(1e-5, 0.04);
      break;
    case Injected::flood:
      i.amount = draw.between(1100, 3000);
      break;
    case Injected::foreign_controller:
      i.amount = draw.uniform(-1.0, 1.0);
      break;
    default:
      i.amount = draw.uniform();
      break;
  }
  i.bits = draw.bits();
}

int phase_length(Phase p, const EpisodeTimes& t) {
  switch (p) {
    case Phase::arming:
      return 45;
    case Phase::joining:
      return t.join_ticks;
    case Phase::running:
      return 15;
    case Phase::halting:
      return t.halt_ticks + 10;
    case Phase::stopping:
      break;
  }
  return 5;
}

}  // namespace

const char* name(Phase p) {
  switch (p) {
    case Phase::arming:
      return "arming";
    case Phase::joining:
      return "joining";
    case Phase::running:
      return "running";
    case Phase::halting:
      return "halting";
    case Phase::stopping:
      return "stopping";
  }
  return "";
}

std::span<const InjectionRow> injection_rows() { return rows; }

bool possible(const InjectionRow& row, const Dialect& d) {
  switch (row.kind) {
    case Injected::not_finite:
    case Injected::denormal:
    case Injected::huge:
      return d.put_number != nullptr;
    case Injected::end_of_range:
      return d.put_end != nullptr;
    case Injected::heartbeat_lost:
      return d.is_heartbeat != nullptr;
    case Injected::drive_error:
      return d.fail != nullptr;
    case Injected::drive_disarm:
      return d.disarm != nullptr;
    case Injected::emergency_stop:
      return d.emergency_stop != nullptr;
    case Injected::foreign_controller:
      return d.foreign_torque != nullptr;
    default:
      return true;
  }
}

bool takes_samples(Injected k) {
  return k == Injected::loss || k == Injected::extended || k == Injected::babbling ||
         k == Injected::drive_bus_off || k == Injected::drive_silent;
}

bool lists(std::string_view list, std::string_view word) {
  while (!list.empty()) {
    const std::size_t end = std::min(list.find(' '), list.size());
    if (list.substr(0, end) == word) return true;
    list.remove_prefix(std::min(end + 1, list.size()));
  }
  return false;
}

Injection draw_injection(Draw& draw, const EpisodeTimes& times, const Dialect& dialect) {
  Injection i;
  do {
    i.row = &rows[draw.below(rows.size())];
  } while (!possible(*i.row, dialect));
  do {
    i.phase = static_cast<Phase>(draw.below(phase_count));
  } while ((i.row->phases & in(i.phase)) == 0 || phase_length(i.phase, times) == 0);
  i.offset = i.row->phases == at_start ? 0 : draw.between(0, phase_length(i.phase, times) - 1);
  i.length = i.row->longest == 0 ? for_ever : draw.between(i.row->shortest, i.row->longest);
  i.drive = draw.below(of_motors(i.row->kind) ? times.motors : times.axes);
  draw_amount(draw, i);

  i.notice_ticks = i.row->notice_ticks;
  i.safe_ms = i.row->safe_ms;
  if (i.row->kind == Injected::heartbeat_lost) {
    i.notice_ticks = times.heartbeat_ticks + 2;
    i.safe_ms = i.notice_ticks + 1;
  }
  if (takes_samples(i.row->kind) || (i.row->kind == Injected::remote && dialect.remote_is_nothing)) {
    i.stale = i.length > times.max_age_ticks;
    // Where the request for the next sample is lost with the last one, one more is missing.
    const bool asked = dialect.samples_on_demand &&
                       (i.row->kind == Injected::babbling || i.row->kind == Injected::drive_bus_off);
    i.must_pass = i.length + (asked ? 1 : 0) <= times.max_age_ticks;
    i.notice_ticks = i.stale ? times.max_age_ticks : never;
    // A jammed bus carries no command either: there the drives' watchdogs end it.
    i.safe_ms = i.row->kind == Injected::babbling ? 12.0 : times.max_age_ticks + 1.0;
  }
  i.unwatched = i.row->kind == Injected::watchdog_off ||
                (i.row->kind == Injected::torque_lost && !dialect.watches_setpoints);
  const bool lets_go = i.row->kind == Injected::drive_disarm || i.row->kind == Injected::drive_reset;
  if (lets_go && !dialect.tells_its_state) i.notice_ticks = never;
  if (i.row->kind == Injected::foreign_controller) i.safe_ms += dialect.ticks_to_let_go;
  return i;
}

std::string describe(const Injection& i) {
  return fmt::format("{} in {} + {} ticks, {}, drive {}, amount {:.6g}, choice {}", i.row->name,
                     name(i.phase), i.offset,
                     i.length >= for_ever ? std::string("for ever") : fmt::format("for {} ticks", i.length),
                     i.drive, i.amount, i.choice);
}

}  // namespace esmc::host
