#pragma once
/// The price list of a scene: variants of it, what each changes and costs, and the cheapest that suffices.

#include <toml++/toml.h>

#include <cstdint>
#include <limits>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "host_sim/loop/progress.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

/// An effect of the list: one of the scene, or one that it could name.
struct Candidate {
  toml::table entry;  ///< as in [[effects]]
  bool named = false;
  [[nodiscard]] std::string type() const { return *entry["type"].value<std::string>(); }
  [[nodiscard]] std::string parameters() const;  ///< "bits = 14, bandwidth = 500.0"
};

/// Effects that the scene does not name, with parameters of a usual mechanism of its size and loop. Effects
/// of the bus are not among them.
std::vector<Candidate> plausible_effects(const Scene& scene);

/// Distance from what cannot be compared.
inline constexpr double no_distance = std::numeric_limits<double>::infinity();

/// What a variant gave.
struct Outcome {
  double value = std::numeric_limits<double>::quiet_NaN();  ///< the metric; of `end` not used
  std::vector<double> q;                                    ///< at the end; empty: the scene is impossible
  std::string fault;                                        ///< it ended in; empty: none
  int states = 0;
  double cost = 0.0;   ///< counted, instructions
  double cpu_s = 0.0;  ///< of this run
  [[nodiscard]] bool sound() const;
};

/// Runs variants and compares them by one metric. For several threads at once.
class Bench {
 public:
  /// `metric`: a key of the summary's tracking, or "end". `expected`: number of runs, for a progress bar.
  Bench(std::string metric, std::uint64_t expected)
      : metric_(std::move(metric)), progress_(expected), expected_(expected) {}
  [[nodiscard]] const std::string& metric() const { return metric_; }
  [[nodiscard]] bool of_end() const { return metric_ == "end"; }

  /// Runs a scene without files. A state that is not finite, or a reference out of reach, shows in sound().
  Outcome run(const Scene& scene, bool single_precision = false);
  /// Distance of two outcomes: of the metric, of `end` the largest of q; infinite where one is not sound.
  [[nodiscard]] double distance(const Outcome& a, const Outcome& b) const;

 private:
  std::string metric_;
  std::mutex mutex_;
  Progress progress_;
  std::uint64_t expected_, runs_ = 0;
};
/// Largest difference of q at the end; infinite where one is not finite.
double end_distance(const Outcome& a, const Outcome& b);

/// Method and step; without a step those of the scene.
struct Stepping {
  Method method = Method::rk4;
  double step = 0.0;
};

/// Subsets of a list of effects, bit i for candidate i.
using Subset = std::uint64_t;

/// A scene with other effects than its own.
class Variants {
 public:
  /// `table`: of the scene, all overrides merged; `file`: its name. `bench` must outlive this.
  Variants(toml::table table, std::string file, Bench& bench);

  [[nodiscard]] const std::vector<Candidate>& candidates() const { return candidates_; }
  [[nodiscard]] Bench& bench() const { return bench_; }
  [[nodiscard]] Subset named() const { return named_; }
  /// Adds the effects of plausible_effects() to the candidates.
  void offer_plausible();
  /// Method and step of all variants from here on, in place of those of the scene.
  void use(const Stepping& s) { stepping_ = s; }

  /// The table of a variant, with the stepping where it is given.
  [[nodiscard]] toml::table table(Subset effects, const std::optional<Stepping>& stepping) const;
  /// Throws InputError for an impossible one.
  [[nodiscard]] Scene scene(Subset effects, const std::optional<Stepping>& stepping = {}) const;
  /// Outcome of the variant, which is run once.
  const Outcome& run(Subset effects);
  [[nodiscard]] const std::map<Subset, Outcome>& tried() const { return done_; }
  /// Runs several, side by side.
  void run_all(const std::vector<Subset>& some);
  /// The scene with other keys ("control.rate_hz=500") and effects; empty: impossible.
  [[nodiscard]] std::optional<Scene> changed(const std::vector<std::string>& sets,
                                             const std::optional<Effect>& effect = {}) const;

 private:
  toml::table table_;
  std::string file_;
  Bench& bench_;
  std::vector<Candidate> candidates_;
  Subset named_ = 0;
  std::optional<Stepping> stepping_;
  std::map<Subset, Outcome> done_;
};

/// Error of a method with a step, in this scene.
struct IntegratorPrice {
  Stepping stepping;
  double error = 0.0;  ///< largest of final_state.q; infinite: it diverged
  double cost = 0.0, cpu_s = 0.0;
};
struct IntegratorStudy {
  std::vector<IntegratorPrice> rows;
  double doubt = 0.0;  ///< of the reference: difference of two fine runs
  /// Cheapest row with this error; null: none.
  [[nodiscard]] const IntegratorPrice* cheapest(double error) const;
};
IntegratorStudy price_integrators(const Scene& scene, Bench& bench);

/// The cheapest variant within `tolerance` of the fullest one, and the cheapest stepping that keeps it.
struct Minimal {
  Subset effects = 0;
  Stepping stepping;
  Outcome outcome;
  double difference = 0.0;
};
Minimal find_minimal(Variants& variants, Subset fullest, double tolerance);

}  // namespace esmc::host
