#pragma once
/// The report of one run: a single HTML file that needs nothing but a browser.

#include <nlohmann/json_fwd.hpp>
#include <string>

namespace esmc::host {

/// Puts the data of one run into the page `report.html.in`, which draws everything itself when it is opened.
///
/// `data`, all keys optional (the page shows what it finds):
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
///
/// Never throws on the content of `data`: invalid UTF-8 is replaced, NaN and infinity become gaps.
[[nodiscard]] std::string render_report(const nlohmann::ordered_json& data);

}  // namespace esmc::host
