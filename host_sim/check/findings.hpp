#pragma once
/// What `esmc check` found: level, code, key of the scene, one sentence.

#include <fmt/format.h>

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "host_sim/names.hpp"

namespace esmc::host {

/// error: the scene would not run as its author meant. hint: probably a slip, and it may be meant.
enum class Level { hint, warning, error };
template <>
inline constexpr auto names_of<Level> = std::array{"hint", "warning", "error"};

/// Names are stable: programs read them. docs/output.md lists them.
enum class Code {
  torque_exceeded,
  torque_margin,
  loop_rings,
  gain_margin,
  loop_margin,
  delay_untold,
  no_gain,
  reference_jumps,
  reference_overshoots,
  not_followed,
  limit_crossed,
  unreachable,
  preload_lost,
  effect_idle,
  step_too_long,
  bus_load,
  bus_latency,
  identifier_clash,
  node_zero,
  sample_rate,
  heartbeat_timeout,
  units_suspicious,
  unattended,
  homing_sinks,
};
template <>
inline constexpr auto names_of<Code> =
    std::array{"torque_exceeded",      "torque_margin",    "loop_rings",    "gain_margin",
               "loop_margin",          "delay_untold",     "no_gain",       "reference_jumps",
               "reference_overshoots", "not_followed",     "limit_crossed", "unreachable",
               "preload_lost",         "effect_idle",      "step_too_long", "bus_load",
               "bus_latency",          "identifier_clash", "node_zero",     "sample_rate",
               "heartbeat_timeout",    "units_suspicious", "unattended",    "homing_sinks"};

static_assert(names_of<Code>.size() == static_cast<std::size_t>(Code::homing_sinks) + 1);

struct Finding {
  Level level;
  Code code;
  std::string where;  ///< key of the scene that decides it, "control.torque_limit"
  std::string text;
};

/// Findings of `esmc check`, in the order in which they were added.
class Findings {
 public:
  /// Adds a finding, its text formatted by fmt.
  template <class... Values>
  void add(Level level, Code code, std::string where, fmt::format_string<Values...> text,
           Values&&... values) {
    list_.push_back({level, code, std::move(where), fmt::format(text, std::forward<Values>(values)...)});
  }
  template <class... Values>
  void error(Code code, std::string where, fmt::format_string<Values...> text, Values&&... values) {
    add(Level::error, code, std::move(where), text, std::forward<Values>(values)...);
  }
  template <class... Values>
  void warning(Code code, std::string where, fmt::format_string<Values...> text, Values&&... values) {
    add(Level::warning, code, std::move(where), text, std::forward<Values>(values)...);
  }
  template <class... Values>
  void hint(Code code, std::string where, fmt::format_string<Values...> text, Values&&... values) {
    add(Level::hint, code, std::move(where), text, std::forward<Values>(values)...);
  }
  [[nodiscard]] const std::vector<Finding>& list() const { return list_; }
  [[nodiscard]] bool has(Code code) const { return std::ranges::count(list_, code, &Finding::code) > 0; }
  /// Number of findings of a level.
  [[nodiscard]] auto count(Level level) const { return std::ranges::count(list_, level, &Finding::level); }
  [[nodiscard]] bool refused_for(Code code) const {
    return std::ranges::any_of(list_,
                               [&](const Finding& f) { return f.level == Level::error && f.code == code; });
  }
  [[nodiscard]] bool refused() const { return count(Level::error) > 0; }

 private:
  std::vector<Finding> list_;
};

}  // namespace esmc::host
