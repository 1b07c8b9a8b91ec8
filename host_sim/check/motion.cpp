#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <string_view>

#include "host_sim/check/check.hpp"
#include "host_sim/check/margins.hpp"
#include "host_sim/record/verdict.hpp"

namespace esmc::host {
namespace {

/// Without a controller there are no ticks, in which some effects act.
void judge_open_loop(const Scene& s, Findings& f) {
  std::string idle;
  for (const Effect& e : s.effects) {
    const std::string type = type_name(e);
    constexpr std::string_view ticked[] = {ThermalLimit::type, Jitter::type,      ComputeDelay::type,
                                           Encoder::type,      SensorNoise::type, SensorBias::type,
                                           SensorDelay::type};
    if (std::ranges::find(ticked, type) != std::end(ticked)) idle += (idle.empty() ? "" : ", ") + type;
  }
  if (idle.empty()) return;
  f.warning(Code::effect_idle, "effects",
            "without a controller there are no ticks and no readings: {} {} no effect", idle,
            idle.find(',') == std::string::npos ? "has" : "have");
}

constexpr const char* torque_key = "control.torque_limit";
constexpr double much = 0.7;  ///< share of a limit that leaves little to correct errors with

/// Torque that is short for a part of the time is a warning: the mechanism may come back to its reference,
/// and a law that does not follow it does not ask for that torque. `saturated`: share of the ticks as
/// simulated.
Level shortage(const Margins& m, std::optional<double> saturated) {
  return (saturated ? *saturated > 0.5 : m.short_ticks > 0.2 * m.ticks) ? Level::error : Level::warning;
}

void judge_each(const Scene& s, const Margins& m, Level level, Findings& f) {
  for (std::size_t i = 0; i < m.torque.size(); ++i) {
    const double share = m.torque[i] / m.torque_limit[i];
    std::string text = fmt::format("motor {}: the reference alone takes {:.3g} N m of torque_limit = {} N m",
                                   i + 1, m.torque[i], s.torque_limit[i]);
    if (m.torque_limit[i] != s.torque_limit[i])
      text += fmt::format(", at which it gives {:.3g} N m (control.model)", m.torque_limit[i]);
    if (!(share <= 1.0)) {
      f.add(level, Code::torque_exceeded, torque_key, "{}", text);
    } else if (share > much) {
      f.warning(Code::torque_margin, torque_key, "{}; little is left to correct errors with", text);
    }
  }
}

/// Four motors share the load: only their sum can be too small.
void judge_together(const Margins& m, Level level, Findings& f) {
  if (!(m.share <= 1.0)) {
    std::vector<std::size_t> held;
    for (std::size_t i = 0; i < m.share_torque.size(); ++i) {
      if (!(std::abs(m.share_torque[i]) < m.torque_limit[i] * (1.0 - 1e-9))) held.push_back(i + 1);
    }
    std::string names = fmt::format("{}", fmt::join(held, ", "));
    if (const std::size_t last = names.rfind(", "); last != std::string::npos)
      names.replace(last, 2, " and ");
    f.add(level, Code::torque_exceeded, torque_key,
          "motor{} {}: at their torque_limit the four motors together give {:.3g} % of what the reference "
          "alone takes (t = {:.3f} s)",
          held.size() == 1 ? "" : "s", names, 100.0 / m.share, m.share_t);
  } else if (m.share > much) {
    f.warning(
        Code::torque_margin, torque_key,
        "the reference alone takes {:.3g} % of what the four motors together give within torque_limit (t = "
        "{:.3f} s); little is left to correct errors with",
        100.0 * m.share, m.share_t);
  }
}

/// Torque that saturation or heating of a drive cuts off, and jumps of the reference: of position an error,
/// of speed a warning. `m`: along the reference.
void judge_drives(const Scene& s, const Margins& m, Level level, Findings& f) {
  for (std::size_t i = 0; i < m.drive_short.size(); ++i) {
    if (m.drive_short[i] == 0.0) continue;
    f.add(level, Code::torque_exceeded, "effects",
          "motor {}: the reference alone takes {:.3g} N m, and its drive gives less ({}); the motors are "
          "short in {:.2g} % of "
          "the ticks",
          i + 1, m.drive_short[i],
          find_effect<ThermalLimit>(s.effects) ? "thermal_limit" : "torque_saturation",
          100.0 * m.short_ticks / m.ticks);
  }
  const char* unit = s.reference.type == ReferenceType::joint_sine ? "rad" : "m";
  if (m.position_jump > 0.0)
    f.error(Code::reference_jumps, "reference", "the reference jumps by {:.3g} {} in one tick",
            m.position_jump, unit);
  if (m.speed_jump > 0.05 * m.speed_max) {
    f.warning(Code::reference_jumps, "reference",
              "at t = {:.3f} s the speed of the reference jumps by {:.3g} {}/s: a blow for the motors, and "
              "no law follows "
              "it{}",
              m.jump_t, m.speed_jump, unit,
              s.reference.type == ReferenceType::file ? "; let the table end at rest" : "");
  }
}

/// Splines through the corners of a table leave the box of its points.
void judge_table(const Scene& s, const Margins& m, Findings& f) {
  if (s.reference.type != ReferenceType::file) return;
  Extent x, y;
  for (const PathPoint& p : s.reference.table) {
    x.widen(p.x);
    y.widen(p.y);
  }
  const double beyond = std::max({x.low - m.x.low, m.x.high - x.high, y.low - m.y.low, m.y.high - y.high});
  if (beyond > 0.02 * std::max(x.high - x.low, y.high - y.low)) {
    f.warning(Code::reference_overshoots, "reference.path",
              "between its points the spline goes {:.3g} mm beyond all of them: more points at the corners",
              1e3 * beyond);
  }
}

/// A start that jumps onto the reference, and a law without a model.
void judge_start_and_sag(const Scene& s, const Margins& m, Findings& f) {
  if (m.off_reference) {
    f.warning(
        Code::reference_jumps, "reference.join",
        "the start is {:.3g} mm off the reference: a jump that saturates the motors; reference.join (s) "
        "leads onto it",
        1e3 * m.start_off);
  }
  const LegParams<double>& leg = s.mechanism.legs[0];
  const double reach = leg.l1 + leg.l2;  // what sags further hangs
  if (!(m.sag > error_share * (m.path() > 0.0 ? m.path() : reach))) return;
  f.add(m.sag > reach ? Level::error : Level::warning, Code::not_followed, "control.kp",
        "law = \"pd\" knows no weight: for the torques of the reference the effector has to be {:.3g} mm off "
        "it; a larger control.kp, or a law with a model",
        1e3 * m.sag);
}

/// Rigid stops in the way; soft ones as far as the motors may push into them.
void judge_stops(const Scene& s, const Extent& angle, std::size_t i, bool start, Findings& f) {
  const auto stops = find_effect<EndStops>(s.effects);
  if (!stops || !angle.beyond({stops->lower[i], stops->upper[i]})) return;
  const double depth = std::max(angle.high - stops->upper[i], stops->lower[i] - angle.low);
  const bool yields = stops->stiffness && !s.torque_limit.empty() &&
                      *stops->stiffness * depth <= s.torque_limit[i * s.torque_limit.size() / 2];
  f.add(yields ? Level::warning : Level::error, Code::limit_crossed, "effects",
        "base joint {} {}, {:.3g} rad beyond end_stops from {:g} to {:g}", i + 1,
        start ? fmt::format("starts at {:.3g} rad", angle.low)
              : fmt::format("spans [{:.3g}, {:.3g}] rad along the reference", angle.low, angle.high),
        depth, stops->lower[i], stops->upper[i]);
}

/// Limits of the controller, at the start or along the reference.
void judge_limits(const Scene& s, const Margins& m, bool start, Findings& f) {
  const auto least = [&](double v) {
    return fmt::format(fmt::runtime(start ? "= {:.3g} at the start" : "falls to {:.3g} along the reference"),
                       v);
  };
  if (!(m.sin_type1 >= s.limits.min_abs_sin_type1)) {
    f.error(Code::limit_crossed, "limits.min_abs_sin_type1",
            "|sin theta_j2| {}, below limits.min_abs_sin_type1 = {}", least(m.sin_type1),
            s.limits.min_abs_sin_type1);
  }
  if (guarded_type2(s) && !(m.sin_type2 >= s.limits.min_abs_sin_type2))
    f.error(Code::limit_crossed, "limits.min_abs_sin_type2", "|D2| {}, below limits.min_abs_sin_type2 = {}",
            least(m.sin_type2), s.limits.min_abs_sin_type2);
  if (const auto& w = s.limits.workspace; w && (m.x.beyond((*w)[0]) || m.y.beyond((*w)[1]))) {
    f.error(Code::limit_crossed, "limits.workspace", "{} beyond limits.workspace",
            start ? fmt::format("the start ({:.3g}, {:.3g}) m is", m.x.low, m.y.low)
                  : fmt::format("the reference spans x = [{:.3g}, {:.3g}], y = [{:.3g}, {:.3g}] m,", m.x.low,
                                m.x.high, m.y.low, m.y.high));
  }
  for (std::size_t i = 0; i < 2; ++i) {
    const Extent& angle = m.angle[i];
    if (s.limits.joint_angle && angle.beyond((*s.limits.joint_angle)[i])) {
      f.error(Code::limit_crossed, "limits.joint_angle", "base joint {} {}, beyond limits.joint_angle", i + 1,
              start ? fmt::format("starts at {:.3g} rad", angle.low)
                    : fmt::format("spans [{:.3g}, {:.3g}] rad along the reference", angle.low, angle.high));
    }
    judge_stops(s, angle, i, start, f);
    if (!(m.joint_speed[i] <= s.limits.joint_speed)) {
      f.error(Code::limit_crossed, "limits.joint_speed",
              "base joint {} {} at {:.3g} rad/s{}, limits.joint_speed = {}", i + 1,
              start ? "starts" : "turns", m.joint_speed[i], start ? "" : " along the reference",
              s.limits.joint_speed);
    }
  }
}

/// Ranges of position and speed in the frames of MIT drives, and of position in CiA 402: beyond them a drive
/// that does not clamp wraps around, and the controller takes its joint to be elsewhere.
void judge_ranges(const Scene& s, const Margins& start, const Margins& m, Findings& f) {
  const DriveScene& d = s.drives;
  const bool mit = d.protocol == Protocol::mit && d.dialect != drive::mit::Dialect::cubemars_v3;
  if (!mit && d.protocol != Protocol::cia402) return;
  for (std::size_t k = 0; k < 2; ++k) {
    const std::size_t motor = k * static_cast<std::size_t>(s.motors()) / 2;
    const double gear = d.gear_ratio[motor];
    const double range =
        mit ? d.position_range[motor] : 2147483648.0 / d.counts_per_turn * 2.0 * std::numbers::pi;
    Extent angle = m.angle[k];
    angle.widen(start.angle[k].low);
    // A zero that is confirmed may be anywhere in the range.
    const double most = d.zero == Zero::absolute
                            ? std::max(angle.high - d.offset[motor], d.offset[motor] - angle.low)
                            : 0.5 * (angle.high - angle.low);
    if (!(most * gear < range)) {
      f.error(Code::limit_crossed, mit ? "drives.position_range" : "drives.counts_per_turn",
              "base joint {} goes {:.3g} rad from the drive's zero, {:.3g} rad before the gear: the drive's "
              "position ends at {:.3g} rad",
              k + 1, most, most * gear, range);
    }
    if (!mit) continue;
    const double speed = d.velocity_range[motor] / gear;
    const bool slower = m.joint_speed[k] < speed;
    if (speed < s.limits.joint_speed) {
      f.add(
          slower ? Level::warning : Level::error, Code::limit_crossed, "drives.velocity_range",
          "the drive's speed ends at {:.3g} rad/s of base joint {}{}: a drive that does not clamp reports a "
          "faster joint with the wrong sign",
          speed, k + 1,
          slower ? fmt::format(", limits.joint_speed is {:g}", s.limits.joint_speed)
                 : fmt::format(", the reference takes {:.3g}", m.joint_speed[k]));
    }
  }
}

void judge_preload(const Scene& s, const Margins& m, Findings& f) {
  for (std::size_t i = 0; i < m.preload.size(); ++i) {
    if (!(m.preload[i] < std::abs(s.preload[i]) * (1.0 - 1e-9))) continue;
    f.warning(
        Code::preload_lost, "control.preload",
        "motor {}: of control.preload = {:g} N m {:.3g} N m are left at t = {:.3f} s{}: other signs, less of "
        "it, or a higher torque_limit",
        i + 1, s.preload[i], std::copysign(1.0, s.preload[i]) * m.preload[i], m.preload_t[i],
        m.preload[i] > 0.0 ? "" : ", its sign is lost and the gear changes sides");
  }
}

}  // namespace

bool guarded_type2(const Scene& s) {
  return s.type == MechanismType::five_bar && !(s.all_motors && s.all_sensors);
}

void judge_motion(const Scene& s, const Margins& start, const Margins& m, std::optional<double> saturated,
                  Findings& f) {
  judge_step(s, f);
  if (s.closed_loop())
    judge_limits(s, start, true, f);
  else
    judge_open_loop(s, f);
  if (!m.unreachable.empty()) f.error(Code::unreachable, "reference", "{}", m.unreachable);
  if (!m.unreachable.empty() || !s.closed_loop()) return;
  judge_limits(s, m, false, f);
  judge_ranges(s, start, m, f);
  judge_preload(s, m, f);
  const Level level = shortage(m, saturated);
  if (m.together)
    judge_together(m, level, f);
  else
    judge_each(s, m, level, f);
  judge_drives(s, m, level, f);
  judge_table(s, m, f);
  judge_start_and_sag(s, m, f);
  judge_gains(s, f);
  judge_stability(s, f);
}

}  // namespace esmc::host
