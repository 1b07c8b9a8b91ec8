#pragma once
/// The page of one run, from the values that the run has recorded.

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "host_sim/record/log.hpp"
#include "host_sim/record/run_options.hpp"
#include "host_sim/record/summary.hpp"

namespace esmc::host {

/// A single HTML file that needs nothing but a browser. Never throws on the content of a text: invalid UTF-8
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
[[nodiscard]] std::string run_page(const RunOptions& o, const Scene& scene,
                                   const nlohmann::ordered_json& summary, const RunEnd& end, const Log& log);

}  // namespace esmc::host
