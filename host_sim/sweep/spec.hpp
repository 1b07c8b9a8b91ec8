#pragma once
/// What a sweep is asked to do: the file that `esmc sweep` takes. docs/sweep.md is its reference.

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "host_sim/sweep/sample.hpp"

namespace esmc::host {

/// What a case is judged by; smaller is better in all of them. The order is that of `objectives`.
enum class Objective : std::uint8_t {
  rms_m,
  max_m,
  settled_rms_m,
  settled_max_m,
  rms_rad,
  max_rad,
  settled_rms_rad,
  settled_max_rad,
  torque_max_nm,
  torque_activity_nm,
  saturated_ticks,
  energy_j,
  faulted,
  tick_ns,
};
inline constexpr std::size_t objective_count = static_cast<std::size_t>(Objective::tick_ns) + 1;

struct ObjectiveText {
  std::string_view name, meaning;
};
inline constexpr std::array<ObjectiveText, objective_count> objectives{{
    {"rms_m", "effector error, root mean square, m"},
    {"max_m", "largest effector error, m"},
    {"settled_rms_m", "effector error after the first 0.25 s, root mean square, m"},
    {"settled_max_m", "largest effector error after the first 0.25 s, m"},
    {"rms_rad", "error of the base joints, root mean square, rad"},
    {"max_rad", "largest error of the base joints, rad"},
    {"settled_rms_rad", "error of the base joints after the first 0.25 s, root mean square, rad"},
    {"settled_max_rad", "largest error of the base joints after the first 0.25 s, rad"},
    {"torque_max_nm", "peak torque, N m"},
    {"torque_activity_nm", "mean change of a motor's torque from tick to tick, N m"},
    {"saturated_ticks", "ticks in which a torque was at its limit"},
    {"energy_j",
     "work of the motors, braking counted as spent: sum over ticks and motors of |torque x rate| x tick, J"},
    {"faulted", "1 where the run ended in a fault, else 0"},
    {"tick_ns",
     "wall-clock time per control tick of the whole simulation, ns; not repeatable, goes to timing.csv"},
}};
using Score = std::array<double, objective_count>;

using SweepValue = std::variant<bool, std::int64_t, double, std::string>;
/// The value as TOML text.
[[nodiscard]] std::string text_of(const SweepValue& v);

/// One [[vary]].
struct Vary {
  std::string key, where;          ///< FILE:LINE
  std::vector<SweepValue> values;  ///< empty: a range
  bool factor = false;             ///< range and values are factors on what the scene says
};

struct SweepSpec {
  std::string file, text;   ///< the text as read
  std::string text_of_run;  ///< as left with the results: `scene` is the scene.toml beside it
  std::string scene;        ///< path of the scene file
  std::vector<std::string> sets;
  std::string sets_where;  ///< for errors
  std::uint64_t seed = 1;
  Design design;
  std::vector<Vary> vary;                        ///< as the axes of the design
  std::vector<Objective> wanted;                 ///< columns of cases.csv
  std::vector<std::vector<std::size_t>> pareto;  ///< of the fronts: places in `wanted`
};

/// Throws InputError where two of them set the same key or parts of it.
void refuse_overlaps(const std::vector<Vary>& vary, const std::vector<std::string>& effects);

/// Reads the file of a sweep. Throws InputError naming file, line, key and what is allowed. Whether the scene
/// has the keys is not checked here.
[[nodiscard]] SweepSpec read_sweep(const std::string& file);

}  // namespace esmc::host
