#pragma once
/// The verdict on a run: what summary.json, the terminal's last line and the headline of the report all say.

#include <fmt/format.h>

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <string>

namespace esmc::host {

/// "1 tick", "2 ticks".
inline std::string plural(std::uint64_t n, const char* word) {
  return fmt::format("{} {}{}", n, word, n == 1 ? "" : "s");
}

inline constexpr double chatter_share =
    0.05;  ///< mean change per tick over largest torque, above which it is chatter
inline constexpr double saturated_share = 0.9;  ///< of the ticks, above which the limit is the controller
inline constexpr double error_share = 0.05;     ///< of the path, above which the reference is not followed

inline constexpr double rest_share = 1e-6;         ///< of a leg's length, up to which a reference is at rest
inline constexpr double rest_error_share = 0.005;  ///< likewise, above which such a one is not held

/// {ok, word, reasons}: `word` is OK, CHECK or FAULT, the first reason is the decisive one. `path`: extent of
/// the reference, m; 0 without one. `leg`: l1 + l2, m.
nlohmann::ordered_json verdict_of(const nlohmann::ordered_json& summary, double path, double leg);

/// The verdict of a summary in one line.
std::string verdict_line(const nlohmann::ordered_json& summary);

}  // namespace esmc::host
