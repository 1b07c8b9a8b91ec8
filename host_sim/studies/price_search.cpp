/// What each integrator costs in a scene, and the cheapest variant of a scene that suffices.

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

#include "host_sim/controller/controller_config.hpp"
#include "host_sim/error.hpp"
#include "host_sim/parallel.hpp"
#include "host_sim/plant/system.hpp"
#include "host_sim/studies/ledger.hpp"
#include "host_sim/studies/price.hpp"

namespace esmc::host {
namespace {

constexpr int most_steps_per_tick = 50;
constexpr double most_steps = 1e6;  // of a run; a long scene has fewer steps per tick to compare
constexpr double fine_enough = 1e-11;

/// Methods that the effects of a scene allow.
std::vector<Method> methods_for(const Scene& s) {
  if (set_valued(s.effects)) return {Method::moreau_jean};
  return {Method::semi_implicit_euler, Method::rk4, Method::dopri5, Method::dopri8, Method::radau5};
}

/// 1, 2, 5, 10, ... steps per tick; a tick is the longest step.
std::vector<int> counts_for(const Scene& s) {
  const double most = std::clamp(most_steps / tick_count(s), 5.0, double{most_steps_per_tick});
  std::vector<int> out;
  for (int decade = 1; decade <= most; decade *= 10) {
    for (const int n : {1, 2, 5}) {
      if (n * decade <= most) out.push_back(n * decade);
    }
  }
  return out;
}

/// The scene with this method and fixed step; s.step > 0, s: here 0 does not stand for the scene's own.
/// Without `accuracy`, which would choose the steps.
Scene with_stepping(Scene scene, const Stepping& s) {
  scene.method = s.method;
  scene.step = s.step;
  scene.accuracy.reset();
  return scene;
}

}  // namespace

const IntegratorPrice* IntegratorStudy::cheapest(double error) const {
  const IntegratorPrice* best = nullptr;
  for (const IntegratorPrice& r : rows) {
    if (r.error + doubt <= error && (best == nullptr || r.cost < best->cost)) best = &r;
  }
  return best;
}

IntegratorStudy price_integrators(const Scene& scene, Bench& bench) {
  const std::vector<Method> methods = methods_for(scene);
  const std::vector<int> counts = counts_for(scene);
  const auto run = [&](Method m, int n) { return bench.run(with_stepping(scene, {m, scene.tick() / n})); };
  // Two fine runs of different methods; where explicit ones diverge, implicit ones.
  const int last = counts.back();
  std::array<std::pair<Method, int>, 2> fine{{{Method::dopri8, 2 * last}, {Method::dopri5, 2 * last}}};
  if (set_valued(scene.effects)) fine = {{{Method::moreau_jean, 8 * last}, {Method::moreau_jean, 4 * last}}};
  std::array<Outcome, 2> judges;
  const auto judge = [&](std::uint64_t i) {
    judges[i] = run(fine[i].first, fine[i].second);
    return true;
  };
  run_each(processors(), 2, judge);
  if (!std::isfinite(end_distance(judges[0], judges[1]))) {
    fine = {{{Method::radau5, 2 * last}, {Method::radau5, last}}};
    run_each(processors(), 2, judge);
  }
  IntegratorStudy out;
  out.doubt = end_distance(judges[0], judges[1]);
  std::vector<std::vector<IntegratorPrice>> rows(methods.size());
  run_each(processors(), methods.size(), [&](std::uint64_t m) {
    const Outcome& against = judges[fine[0].first == methods[m] && fine[1].first != methods[m] ? 1 : 0];
    double best = no_distance;
    int stalled = 0;
    for (const int n : counts) {
      const Outcome o = run(methods[m], n);
      const double error = end_distance(o, against);
      rows[m].push_back({{methods[m], scene.tick() / n}, error, o.cost, o.cpu_s});
      stalled = error < 0.5 * best || !std::isfinite(error) ? 0 : stalled + 1;
      best = std::min(best, error);
      // Finer ones show rounding, of the arithmetic or of a quantised measurement.
      if (error <= std::max(fine_enough, out.doubt) || stalled == 2) break;
    }
    return true;
  });
  for (const auto& of_method : rows) out.rows.insert(out.rows.end(), of_method.begin(), of_method.end());
  return out;
}

namespace {

class Search {
 public:
  Search(Variants& variants, Subset fullest, double tolerance)
      : v_(variants),
        fullest_(fullest),
        tolerance_(tolerance),
        best_(fullest),
        full_(variants.scene(fullest)) {}

  Minimal find() {
    eliminate();
    try_cheaper();
    Minimal out;
    out.effects = best_;
    choose_stepping(out);
    return out;
  }

 private:
  [[nodiscard]] double difference(Subset s) { return v_.bench().distance(v_.run(s), v_.run(fullest_)); }
  [[nodiscard]] bool better(Subset s) {
    const Outcome& now = v_.run(s);
    if (!(difference(s) <= tolerance_)) return false;
    const double best = v_.run(best_).cost;
    return now.cost < best || (now.cost == best && std::popcount(s) < std::popcount(best_));
  }

  /// Backward elimination, one effect at a time; where none can go alone, two that compensate each other.
  void eliminate() {
    while (take_away(1) || take_away(2)) {
    }
  }
  bool take_away(int count) {
    std::vector<Subset> less;
    const std::size_t n = v_.candidates().size();
    for (std::size_t i = 0; i < n; ++i) {
      for (std::size_t j = count == 1 ? i : i + 1; j < (count == 1 ? i + 1 : n); ++j) {
        const Subset gone = Subset{1} << i | Subset{1} << j;
        if ((best_ & gone) == gone) less.push_back(best_ & ~gone);
      }
    }
    v_.run_all(less);
    const Subset before = best_;
    for (const Subset s : less) {
      if (better(s)) best_ = s;
    }
    return best_ != before;
  }

  /// Elimination goes one way. Of the subsets that would be cheaper than its result, those are tried that
  /// the sum of single changes says are closest to the fullest scene.
  void try_cheaper() {
    int left = most_tried;
    for (const Subset s : promising()) {
      if (!(cost_of(s) < v_.run(best_).cost)) continue;
      if (--left < 0) break;
      if (better(s)) best_ = s;
    }
    eliminate();
  }
  [[nodiscard]] double cost_of(Subset s) const {
    Scene scene = full_;
    std::erase_if(scene.effects, [&](const Effect& e) {
      for (std::size_t i = 0; i < v_.candidates().size(); ++i) {
        if (v_.candidates()[i].type() == type_name(e)) return (s >> i & 1U) == 0;
      }
      return false;
    });
    return counted_cost(scene);
  }
  /// All subsets of the fullest, the closest by the sum of single changes first; none where they are many.
  [[nodiscard]] std::vector<Subset> promising() {
    std::vector<std::pair<Subset, double>> one;  // effect, change without it
    for (Subset rest = fullest_; rest != 0; rest &= rest - 1) {
      const Subset bit = rest & (~rest + 1);
      const Outcome& o = v_.run(fullest_ & ~bit);
      const bool signed_change = o.sound() && !v_.bench().of_end();
      one.emplace_back(bit, signed_change ? o.value - v_.run(fullest_).value : difference(fullest_ & ~bit));
    }
    if (one.size() > most_listed) return {};
    std::vector<std::pair<double, Subset>> all;
    for (Subset kept = 0; kept < Subset{1} << one.size(); ++kept) {
      Subset s = 0;
      double sum = 0.0;
      for (std::size_t i = 0; i < one.size(); ++i) {
        if ((kept >> i & 1U) != 0)
          s |= one[i].first;
        else
          sum += one[i].second;
      }
      all.emplace_back(std::isfinite(sum) ? std::abs(sum) : no_distance, s);
    }
    std::ranges::sort(all);
    std::vector<Subset> out(all.size());
    std::ranges::transform(all, out.begin(), &std::pair<double, Subset>::second);
    return out;
  }

  /// The cheapest stepping: of the best subset, and of others within the tolerance that can be stepped
  /// coarser.
  void choose_stepping(Minimal& out) {
    out = {best_, {}, v_.run(best_), difference(best_)};
    const Scene own = v_.scene(best_);
    out.stepping = {method_in_use(own), own.step};
    std::vector<std::pair<double, Subset>> good;
    for (const auto& [subset, outcome] : v_.tried()) {
      if (difference(subset) <= tolerance_) good.emplace_back(outcome.cost, subset);
    }
    std::ranges::sort(good);
    if (good.size() > most_stepped) good.resize(most_stepped);
    for (const auto& [cost, subset] : good) coarsen(subset, out);
  }
  /// Tries methods and steps from the cheapest on. One that moves the metric by more than the tolerance is
  /// not taken, even where its error happens to make up for an effect that is left out.
  void coarsen(Subset subset, Minimal& out) {
    const Scene scene = v_.scene(subset);
    std::vector<std::pair<double, Stepping>> cheaper;
    for (const Method m : methods_for(scene)) {
      for (const int n : counts_for(scene)) {
        const Stepping s{m, scene.tick() / n};
        if (const double cost = counted_cost(with_stepping(scene, s)); cost < out.outcome.cost)
          cheaper.emplace_back(cost, s);
      }
    }
    std::ranges::sort(cheaper, {}, &std::pair<double, Stepping>::first);
    for (const auto& [cost, s] : cheaper) {
      const Outcome o = v_.bench().run(with_stepping(scene, s));
      const double d = v_.bench().distance(o, v_.run(fullest_));
      if (!(d <= tolerance_ && v_.bench().distance(o, v_.run(subset)) <= tolerance_)) continue;
      out = {subset, s, o, d};
      return;
    }
  }

  static constexpr std::size_t most_listed = 14;  // effects, whose subsets are listed
  static constexpr int most_tried = 64;
  static constexpr std::size_t most_stepped = 16;
  Variants& v_;
  Subset fullest_;
  double tolerance_;
  Subset best_;
  Scene full_;
};

}  // namespace

Minimal find_minimal(Variants& variants, Subset fullest, double tolerance) {
  return Search(variants, fullest, tolerance).find();
}

}  // namespace esmc::host
