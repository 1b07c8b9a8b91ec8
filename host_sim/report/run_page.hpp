#pragma once
/// The page of one run, from the values that the run has recorded.

#include <array>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "host_sim/report/series.hpp"
#include "host_sim/report/workspace.hpp"

namespace esmc::host {

/// The true mechanism, for its drawing and the map of its workspace.
struct PageMechanism {
  bool five_bar = true;  ///< false: RR, with legs[0]
  FiveBarParams<double> params;
  std::array<int, 2> working_mode{};  ///< signs of sin theta_j2
  std::vector<MotorLimit> motors;     ///< empty: no limits are known
};
/// Bits on the bus per tick.
struct PageLoad {
  Binned bits;               ///< empty: not recorded
  std::uint64_t before = 0;  ///< ticks of it before t = 0
  double tick = 0.0;         ///< s
  double bitrate = 0.0;      ///< bit/s
};
struct RunPage {
  nlohmann::ordered_json data;  ///< of render_report(), without the keys that the other members become
  PageMechanism mechanism;
  std::vector<NamedHistogram> histograms;  ///< those without entries are left out
  PageLoad load;
  std::vector<std::string> columns;  ///< of rows; the last one is chatter
  const std::vector<SeriesRow>& rows;
};
/// The geometry that mechanism.js draws; RR: legs[0].
[[nodiscard]] nlohmann::ordered_json mechanism_json(const FiveBarParams<double>& m, bool five_bar);
/// The HTML of the page.
[[nodiscard]] std::string run_page(RunPage page);

}  // namespace esmc::host
