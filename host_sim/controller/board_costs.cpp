#include "host_sim/controller/board_costs.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <span>
#include <string_view>
#include <vector>

namespace esmc::host {
namespace {

constexpr double share_max = 0.6;
constexpr double cycles_per_instruction = 1.5;  // assumed: docs/boards.md

/// Names of the law and of the optional parts, as in the tables of costs.
std::vector<std::string_view> parts_of(const Scene& s) {
  std::vector<std::string_view> out{name(s.law)};
  if (s.sliding() && s.reaching > ReachingChoice::implicit) out.emplace_back(name(s.reaching));
  if (has_elbow_rotors(s.believed.value_or(s.mechanism))) out.emplace_back("elbow_rotors");
  if (!s.model.plain_motors()) out.emplace_back("motor_map");
  if (s.disturbance_observer > 0.0) out.emplace_back("momentum_observer");
  if (s.predictor) out.emplace_back("predictor");
  if (!s.encoder_sigma.empty()) out.emplace_back("closure_projection");
  if (s.all_motors) out.emplace_back("four_motors");
  return out;
}

}  // namespace

std::string budget_excess(const Scene& scene, const Board& board) {
  const std::span<const Cost> costs =
      board.single_precision ? std::span<const Cost>(costs_float) : costs_double;
  double instructions = 0.0, flash = board.image_flash;
  for (const std::string_view part : parts_of(scene)) {
    const auto cost = std::ranges::find(costs, part, [](const Cost& c) { return std::string_view(c.name); });
    if (cost == costs.end()) continue;
    instructions += cost->instructions;
    flash += cost->flash;
  }
  const double cycles = cycles_per_instruction * instructions, tick = board.clock_hz * scene.tick();
  if (cycles > share_max * tick) {
    return fmt::format(
        "the controller takes {:.0f} of the {:.0f} cycles of a tick of {}, at most {:.0f} % are allowed: "
        "control.rate_hz = {:.0f} or less",
        cycles, tick, board.name, 100.0 * share_max, std::floor(share_max * board.clock_hz / cycles));
  }
  const auto beyond = [&](const char* memory, double used, double all) {
    return used <= share_max * all
               ? std::string()
               : fmt::format(
                     "the image takes {:.0f} of the {:.0f} bytes of {} of {}, at most {:.0f} % are allowed",
                     used, all, memory, board.name, 100.0 * share_max);
  };
  const std::string excess = beyond("flash", flash, board.flash);
  return excess.empty() ? beyond("RAM", board.image_ram, board.ram) : excess;
}

}  // namespace esmc::host
