#pragma once
/// Counts of a campaign: sums and maxima, so that the order of the episodes does not matter.

#include <array>
#include <cstdint>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <utility>
#include <vector>

#include "host_sim/campaign/episode.hpp"
#include "host_sim/report/study_page.hpp"

namespace esmc::host {

/// Counts of times, in bins of a quarter of a millisecond.
class Times {
 public:
  static constexpr double bin_ms = 0.25;
  void add(double ms);
  [[nodiscard]] double longest() const { return longest_; }  ///< ms; 0: none
  [[nodiscard]] std::uint64_t count() const;
  /// Empty bins left out; a time on an edge belongs to the bin that ends there.
  [[nodiscard]] std::vector<Bar> bars() const;
  /// [{up_to_ms, count}]
  [[nodiscard]] nlohmann::ordered_json json() const;

 private:
  std::map<int, std::uint64_t> bins_;
  double longest_ = 0.0;
};

struct FaultTotals {
  std::uint64_t episodes = 0, under_torque = 0;
  std::array<std::uint64_t, phase_count> phases{};
  std::array<std::uint64_t, 4> drives{};                      ///< by the afflicted drive
  std::map<std::string, std::uint64_t, std::less<>> latched;  ///< names of the controller's first fault
  Times notice, safe;
};

struct Violation {
  std::uint64_t tick, digest;
  std::string fault, phase, invariant;
};

class CampaignTotals {
 public:
  void add(const EpisodeResult& e);
  [[nodiscard]] std::uint64_t episodes() const { return episodes_; }
  [[nodiscard]] std::uint64_t violation_count() const { return violation_count_; }
  [[nodiscard]] double simulated_s() const { return static_cast<double>(ticks_us_) * 1e-6; }
  /// The document of `--json`.
  [[nodiscard]] nlohmann::ordered_json json() const;
  [[nodiscard]] std::string text() const;  ///< for the terminal, with the first ten violations
  /// Tables for a page.
  [[nodiscard]] std::string markdown() const;
  /// The page of --out; `wanted`: episodes that were asked for.
  [[nodiscard]] std::string page(const std::string& command, std::uint64_t wanted) const;

 private:
  [[nodiscard]] TextTable fault_rows() const;
  [[nodiscard]] std::vector<std::pair<const char*, const Times*>> reactions() const;
  static constexpr std::size_t violations_max = 1000;

  std::uint64_t episodes_ = 0, ticks_us_ = 0, violation_count_ = 0, digest_ = 0;
  std::map<std::uint64_t, Violation> violations_;  ///< by seed; of more than violations_max the first ones
  std::map<std::string, FaultTotals, std::less<>> faults_;
  std::map<std::string, std::uint64_t, std::less<>> protocols_;
  Times stale_, safe_, death_;
};

}  // namespace esmc::host
