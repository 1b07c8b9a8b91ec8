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
/// A single HTML file that needs nothing but a browser. Never throws on the content of `data`: invalid UTF-8
/// is replaced, NaN and infinity become gaps. Keys of the page's data, all optional (the page shows what it
/// finds):
///   kind      "sim" | "hil"
///   command   what to type to repeat the run
///   version   of this program; compiler: that built it
///   scene_toml  text of the scene as run
///   summary   the object of summary.json
///   concerns  sentences about the run that a person should read
///   torque_limit  per motor, N m, in the order of the columns tau...; empty: none
///   mechanism {type: "five_bar" | "rr", half_base, legs: [{l1, l2}, ...]}; one entry in legs stands for both
///   working_mode [sign, ...], assembly_mode sign or 0: of the scene
///   workspace {x: [lo, hi], y, columns, rows, force: [N, ...], type2_sine: [...], type1: [[[x, y], ...],
///   ...], type2}:
///             a WorkspaceMap; null out of reach
///   histograms [{title, note, edges_s, counts, total, mean_s, p99_s, max_s}], one edge more than counts
///   bus_load  {start_s, bin_s, load: [share of the bus time, ...]}
///   columns   names of the columns of log.csv, and "chatter": N m, mean change of torque per tick
///   rows      their values; a few thousand rows are enough, the page says so when ticks were left out
struct RunPage {
  nlohmann::ordered_json data;  ///< without the keys that the other members become
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
