#pragma once
/// The result of a run: digest, errors, torque, energy; the document that --json prints.

#include <array>
#include <cstdint>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "host_sim/record/digest.hpp"
#include "host_sim/record/run_sums.hpp"
#include "host_sim/report/series.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

/// Throws Diverged, which says that the state is not finite from time t, s, on.
[[noreturn]] void throw_diverged(double t);
/// Throws Diverged where a state at time t, s, has an entry that is not finite.
inline void require_finite(std::span<const double> state, double t) {
  double zero = 0.0;  // NaN as soon as one is not finite
  for (const double v : state) zero += v * 0.0;
  if (zero != 0.0) throw_diverged(t);
}

struct BusSummary {
  std::uint64_t frames = 0, lost = 0;
  double load = 0.0;  ///< fraction of the bus time, worst-case bit stuffing; exact with bit_timing
  std::shared_ptr<const nlohmann::ordered_json>
      disturbances{};  ///< keys of the summary for a bus with effects
};

/// One tick for the statistics. `torque` per motor, N m at the joint.
struct TickRecord {
  double t = 0.0;
  std::span<const double> torque;
  bool has_reference = false;
  std::array<double, 2> reference{};   ///< m
  double effector_error = 0.0;         ///< m
  std::array<double, 2> base_error{};  ///< rad
  double power = 0.0;                  ///< sum of |torque rate| over the motors, W
  bool saturated = false;
  bool faulted = false;  ///< the supervisor has latched a fault (plant alone: a drive has left closed loop)
};

class Statistics {
 public:
  void add(const TickRecord& r);  ///< tick by tick
  [[nodiscard]] std::uint64_t ticks() const { return ticks_; }
  /// Time of the first tick with a fault, s; none: no fault. Errors from it on do not count.
  [[nodiscard]] std::optional<double> fault_time() const { return fault_time_; }

  Digest digest;
  double closure_max = 0.0, energy_error = 0.0;
  bool has_truth = true;  ///< false for a controller on its own: no closure, energy, final state, digest

  /// The objects `tracking` (null: no tick had a reference) and `torque` of the summary.
  [[nodiscard]] nlohmann::ordered_json tracking() const;
  [[nodiscard]] nlohmann::ordered_json torque() const;

  [[nodiscard]] const RunSums<double>& sums() const { return sums_; }
  /// Largest extent of the reference, m; 0 without one.
  [[nodiscard]] double path_size() const;

 private:
  RunSums<double> sums_;
  std::uint64_t ticks_ = 0;
  bool has_reference_ = false;
  std::array<double, 2> reference_low_{1e300, 1e300}, reference_high_{-1e300, -1e300};
  std::optional<double> fault_time_;
};

/// How simulation.accuracy was met.
struct AccuracyReport {
  double asked = 0.0;
  AccuracyOf of = AccuracyOf::end;
  double estimated = 0.0;       ///< difference to the pass before, which was coarser
  std::string method, between;  ///< between: of event_driven, from one event to the next
  double step = 0.0;            ///< mean, s
  Events events;
  // Of all passes:
  int passes = 0;
  long evaluations = 0;  ///< of right-hand sides
  double cpu_s = 0.0;
};

/// A fault, and what was measured against which limit, where that is known.
struct FaultRecord {
  std::string name;
  std::string where{};  ///< joint, node or key; empty: not known
  std::optional<double> measured{}, limit{};
  std::string unit{};  ///< of both
};

/// How a run ended, for the summary.
/// The sliding variable of a channel, s = e' + lambda e.
struct Surface {
  std::string channel;
  double lambda = 0.0;  ///< 1/s
  double layer = 0.0;   ///< abs(s) within which the reaching law does not switch, unit of s; 0: none
};
struct RunEnd {
  double wall_s = 0.0;       ///< of the loop alone
  bool interrupted = false;  ///< Ctrl-C
  std::string final_state = "off";
  std::vector<FaultRecord> faults;
  std::string odd_encoder;                  ///< joint whose encoder contradicts the others; empty: not known
  std::optional<double> fault_t;            ///< where the recorder of the run does not see the supervisor
  std::optional<std::uint64_t> late_ticks;  ///< against the wall clock; none in lockstep
  std::optional<BusSummary> bus;
  std::vector<double> q, qd;  ///< final state
  int state_dimension = 0;
  Method method = Method::rk4;  ///< that integrated the plant
  Effort effort;                ///< of event_driven
  std::optional<AccuracyReport> accuracy;
  std::uint64_t seed = 1;
  // For the report only.
  std::vector<Surface> surfaces;  ///< empty: no sliding law, or the controller runs elsewhere
  std::vector<NamedHistogram> histograms;
  Binned load;                   ///< bits on the bus per tick; empty where it was not seen
  std::uint64_t load_ticks = 0;  ///< of its entries that lie before t = 0
};

class FrameLog;
/// The bus part of a summary. `lost`: frames; `capacity`: bits that the bus could have carried.
[[nodiscard]] BusSummary bus_summary(const FrameLog& frames, std::uint64_t lost, double capacity);

/// The document summary.json of a run.
nlohmann::ordered_json make_summary(const Scene& scene, const Statistics& s, const RunEnd& end);

/// A few lines for the terminal, from the summary document, without its verdict.
std::string summary_text(const nlohmann::ordered_json& summary);

}  // namespace esmc::host
