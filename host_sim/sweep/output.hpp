#pragma once
/// The files of a complete sweep. All but the timing are a function of specification, scene and program.

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "host_sim/sweep/cases.hpp"

namespace esmc::host {

/// The results of all cases.
struct SweepTable {
  std::size_t columns = 0;
  std::vector<double> values;  ///< case by case, `columns` each
  std::vector<std::uint32_t> outcome;

  /// Value of objective `column` in case `index`; neither is checked.
  [[nodiscard]] double at(std::uint64_t index, std::size_t column) const {
    return values[index * columns + column];
  }
};

/// Rows of `points` (all of one length, smaller is better) that no other row dominates, in the order of the
/// first column, then the second, ... Of equal rows the first one stands for all. Rows with a number that is
/// not finite are left out.
[[nodiscard]] std::vector<std::size_t> pareto_front(const std::vector<std::vector<double>>& points);

/// Returns counts, ranges and fronts of a sweep: the object that --json prints.
[[nodiscard]] nlohmann::ordered_json sweep_summary(const SweepSpec& spec, const CaseScenes& scenes,
                                                   const SweepTable& table);
[[nodiscard]] std::string sweep_text(const nlohmann::ordered_json& summary);  ///< for the terminal

/// Writes cases.csv row by row. Throws RunError.
void write_cases(const std::string& file, const SweepSpec& spec, const CaseScenes& scenes,
                 const SweepTable& table);
/// Writes case,tick_ns: wall-clock time, which no two runs share. Throws RunError.
void write_timing(const std::string& file, const SweepSpec& spec, const SweepTable& table);
[[nodiscard]] std::string sweep_page(const SweepSpec& spec, const CaseScenes& scenes, const SweepTable& table,
                                     const nlohmann::ordered_json& summary);

}  // namespace esmc::host
