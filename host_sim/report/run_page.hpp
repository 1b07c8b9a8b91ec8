#pragma once
/// The page of one run, from the values that the run has recorded.

#include <array>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "host_sim/plant/plant.hpp"
#include "host_sim/report/series.hpp"
#include "host_sim/report/spectrum.hpp"

namespace esmc::host {

/// A motor: the joint it drives (theta11, theta12, theta21, theta22; RR: theta1, theta2) and its limit, N m.
struct MotorLimit {
  std::size_t joint = 0;
  double torque = 0.0;
};

/// Where a mechanism can be, where it is singular, and what its motors can do there.
struct WorkspaceMap {
  using Path = std::vector<V2>;

  double x0 = 0, x1 = 0, y0 = 0, y1 = 0;  ///< corners of the grid, m
  int columns = 0, rows = 0;  ///< nodes of the grid; a node is at x0 + (x1 - x0) column / (columns - 1)
  /// Row by row from y0, NaN out of reach: the largest force (N) that the motors can exert on the world in
  /// every direction, beside holding the mechanism at rest. Below 0: they cannot hold it. Empty without
  /// motors.
  std::vector<double> force;
  /// sin(phi12 + phi22) at the same nodes, whose sign is the assembly mode; empty for RR.
  std::vector<double> type2_sine;
  std::vector<Path> type1, type2;  ///< loci: sin theta_j2 = 0, and sin(phi12 + phi22) = 0
};

/// Map of a five-bar in the working mode `bend` (signs of sin theta_j2). `nodes` along the longer side, >= 2.
/// Without rows and columns where the legs cannot meet.
[[nodiscard]] WorkspaceMap workspace_map(const FiveBarParams<double>& m, const std::array<int, 2>& bend,
                                         const std::vector<MotorLimit>& motors, int nodes);
/// Map of the RR arm; `bend`: sign of sin theta2.
[[nodiscard]] WorkspaceMap workspace_map(const RrParams<double>& m, int bend,
                                         const std::vector<MotorLimit>& motors, int nodes);

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
///   torque_limit  per motor, N m, in the order of the columns tau...; empty: none
///   mechanism {type: "five_bar" | "rr", half_base, legs: [{l1, l2}, ...]}; one entry in legs stands for both
///   working_mode [sign, ...], assembly_mode sign or 0: of the scene
///   workspace {x: [lo, hi], y, columns, rows, force: [N, ...], type2_sine: [...], type1: [[[x, y], ...],
///   ...], type2}:
///             a WorkspaceMap; null out of reach
///   histograms [{title, note, edges_s, counts, total, mean_s, p99_s, max_s}], one edge more than counts
///   bus_load  {start_s, bin_s, load: [share of the bus time, ...]}
///   surfaces  {column: {lambda: 1/s, layer: unit of s, 0: none}}, of sliding variables
///   spectrum  {step_hz, amplitudes: [[N m per line], ...]}, a list per motor, lines step_hz apart from 0
///   columns   names of the columns of log.csv, and "chatter": N m, mean change of torque per tick
///   rows      their values; a few thousand rows are enough, the page says so when ticks were left out
struct RunPage {
  nlohmann::ordered_json data;  ///< without the keys that the other members become
  PageMechanism mechanism;
  std::vector<NamedHistogram> histograms;  ///< those without entries are left out
  PageLoad load;
  std::vector<std::string> columns;      ///< of rows; the last one is chatter
  const std::vector<SeriesRow>& rows;    ///< must outlive this, as must the next
  const std::vector<Spectrum>& torques;  ///< per motor
  double rate_hz = 0.0;                  ///< of their values
};
/// The geometry that mechanism.js draws; RR: legs[0].
[[nodiscard]] nlohmann::ordered_json mechanism_json(const FiveBarParams<double>& m, bool five_bar);
/// The HTML of the page.
[[nodiscard]] std::string run_page(RunPage page);

}  // namespace esmc::host
