#pragma once
/// What a run amounts to: digest, errors, torque, energy; the document that --json prints.

#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "host_sim/fnv.hpp"
#include "host_sim/report/series.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

/// The larger of two, or NaN where there is one: std::max may drop it.
[[nodiscard]] inline double larger(double a, double b) { return b > a || std::isnan(b) ? b : a; }

[[noreturn]] void throw_diverged(double t);
/// Throws Diverged where a state at time t is not finite.
inline void require_finite(std::span<const double> state, double t) {
  double zero = 0.0;  // unless something is not
  for (const double v : state) zero += v * 0.0;
  if (zero != 0.0) throw_diverged(t);
}

/// FNV-1a 64 over the little-endian doubles of q then qd at every tick from t = 0.
///
/// A chain of multiplications that each wait for the one before. Given in portions with other work between
/// them, the processor does that work meanwhile.
class Digest {
 public:
  void add(std::span<const double> values) {
    for (const double v : values) {
      auto bits = std::bit_cast<std::uint64_t>(v);
      for (int i = 0; i < 8; ++i, bits >>= 8U) hash_ = fnv_byte(hash_, static_cast<std::uint8_t>(bits));
    }
  }
  [[nodiscard]] std::string text() const;
  [[nodiscard]] std::uint64_t value() const { return hash_; }

 private:
  std::uint64_t hash_ = fnv_start;
};

/// Root mean square and maximum of an error, over the whole run and after the start transient.
/// A sample of several components counts each component (base joints) or is one distance (effector).
class ErrorStatistics {
 public:
  void add(bool settled, double error) {
    all_.add(error);
    if (settled) settled_.add(error);
  }
  struct Moments {
    double square = 0.0, largest = 0.0;
    std::uint64_t count = 0;
    void add(double e) {
      square += e * e;
      largest = larger(largest, e);
      ++count;
    }
    [[nodiscard]] double rms() const {
      return count > 0 ? std::sqrt(square / static_cast<double>(count)) : 0.0;
    }
  };
  [[nodiscard]] const Moments& all() const { return all_; }
  [[nodiscard]] const Moments& settled() const { return settled_; }

 private:
  Moments all_, settled_;
};

struct BusSummary {
  /// What only a bus with effects knows.
  struct Message {
    std::uint32_t id = 0;
    bool extended = false;
    std::uint64_t frames = 0;
    double mean_s = 0.0, max_s = 0.0;  ///< from the request to send to the last bit
  };
  struct Node {
    std::string name, state;
    int transmit_errors = 0, receive_errors = 0;
  };
  struct Disturbances {
    std::uint64_t errors = 0, missed = 0, duplicated = 0, corrupted = 0;
    bool timed = false;
    std::vector<Message> messages;
    std::vector<Node> nodes;
  };
  std::uint64_t frames = 0, lost = 0;
  double load = 0.0;  ///< fraction of the bus time, worst-case bit stuffing; exact with bit_timing
  std::optional<Disturbances> disturbances{};
};

/// One tick as the statistics see it. `torque` per motor, N m at the joint.
struct TickRecord {
  double t = 0.0;
  std::span<const double> torque;
  bool has_reference = false;
  double effector_error = 0.0;         ///< m
  std::array<double, 2> base_error{};  ///< rad
  double power = 0.0;                  ///< sum of |torque rate| over the motors, W
  bool saturated = false;
  bool faulted = false;  ///< the supervisor has latched a fault (plant alone: a drive has left closed loop)
};

class Statistics {
 public:
  static constexpr double settling_time = 0.25;  ///< s

  void add(const TickRecord& r);
  [[nodiscard]] std::uint64_t ticks() const { return ticks_; }
  /// Time of the tick that found the fault; from it on errors do not count.
  [[nodiscard]] std::optional<double> fault_time() const { return fault_time_; }

  Digest digest;
  double closure_max = 0.0, energy_error = 0.0;
  bool has_truth = true;  ///< false for a controller on its own: no closure, energy, final state, digest

  /// The document of the command, without what only the loop knows (wall time, bus, supervisor).
  [[nodiscard]] nlohmann::ordered_json tracking() const;
  [[nodiscard]] nlohmann::ordered_json torque() const;

  [[nodiscard]] const ErrorStatistics& effector() const { return effector_; }
  [[nodiscard]] const ErrorStatistics& base() const { return base_; }
  [[nodiscard]] double torque_max() const { return torque_max_; }  ///< N m
  /// Mean change of a motor's torque from tick to tick, N m.
  [[nodiscard]] double torque_activity() const {
    return deltas_ > 0 ? delta_sum_ / static_cast<double>(deltas_) : 0.0;
  }
  [[nodiscard]] std::uint64_t saturated_ticks() const { return saturated_; }
  [[nodiscard]] double power_sum() const { return power_sum_; }  ///< over the ticks, W

 private:
  ErrorStatistics effector_, base_;
  std::vector<double> last_torque_;
  double torque_max_ = 0.0, delta_sum_ = 0.0, power_sum_ = 0.0;
  std::uint64_t ticks_ = 0, deltas_ = 0, saturated_ = 0;
  bool has_reference_ = false;
  std::optional<double> fault_time_;
};

/// How a run ended, for the summary.
struct RunEnd {
  double wall_s = 0.0;       ///< of the loop alone
  bool interrupted = false;  ///< Ctrl-C
  std::string final_state = "off";
  std::vector<std::string> faults;
  std::string odd_encoder;                  ///< joint whose encoder contradicts the others; empty: not known
  std::optional<double> fault_t;            ///< where the recorder of the run does not see the supervisor
  std::optional<std::uint64_t> late_ticks;  ///< against the wall clock; none in lockstep
  std::optional<BusSummary> bus;
  std::vector<double> q, qd;  ///< final state
  int state_dimension = 0;
  Method method = Method::rk4;  ///< that integrated the plant
  std::uint64_t seed = 1;
  // For the report alone.
  std::vector<NamedHistogram> histograms;
  Binned load;                   ///< bits on the bus per tick; empty where it was not seen
  std::uint64_t load_ticks = 0;  ///< of its entries that lie before t = 0
};

nlohmann::ordered_json make_summary(const Scene& scene, const Statistics& s, const RunEnd& end);

inline constexpr double chatter_share =
    0.05;  ///< mean change per tick over largest torque, above which it is chatter
inline constexpr double saturated_share = 0.9;  ///< of the ticks, above which the limit is the controller

/// What a person should look at, one sentence each; faults are not among them.
std::vector<std::string> concerns(const nlohmann::ordered_json& summary);

/// The few lines a person wants, from the summary document.
std::string summary_text(const nlohmann::ordered_json& summary);

}  // namespace esmc::host
