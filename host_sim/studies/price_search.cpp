/// What each integrator costs in a scene, and the cheapest variant of a scene that suffices.

#include <algorithm>
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

constexpr int most_steps_per_tick = 100;
constexpr double most_steps = 1e6;  // of a run; a long scene has fewer steps per tick to compare
constexpr double fine_enough = 1e-11;

/// Methods that the effects of a scene allow.
std::vector<Method> methods_for(const Scene& s) {
  if (set_valued(s.effects)) return {Method::moreau_jean};
  return {Method::semi_implicit_euler, Method::rk4, Method::dopri5, Method::dopri8, Method::radau5};
}

/// The method that the runs of `m` are compared with.
Method judge_of(Method m) {
  return m == Method::moreau_jean ? m : (m == Method::dopri8 ? Method::dopri5 : Method::dopri8);
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
  // Two fine runs; where explicit ones diverge, implicit ones.
  const bool jumps = set_valued(scene.effects);
  std::vector<std::pair<Method, int>> fine{{Method::dopri8, counts.back()}, {Method::dopri5, counts.back()}};
  if (jumps) fine = {{Method::moreau_jean, 4 * counts.back()}, {Method::moreau_jean, 2 * counts.back()}};
  std::vector<Outcome> judges(2);
  const auto judge = [&](std::uint64_t i) {
    judges[i] = run(fine[i].first, fine[i].second);
    return true;
  };
  run_each(processors(), 2, judge);
  if (!std::isfinite(end_distance(judges[0], judges[1]))) {
    fine = {{Method::radau5, counts.back()}, {Method::radau5, counts[counts.size() - 2]}};
    run_each(processors(), 2, judge);
  }
  IntegratorStudy out;
  out.doubt = end_distance(judges[0], judges[1]);
  std::vector<std::vector<IntegratorPrice>> rows(methods.size());
  run_each(processors(), methods.size(), [&](std::uint64_t m) {
    for (const int n : counts) {
      const Outcome o = run(methods[m], n);
      const Outcome& against = judges[judge_of(methods[m]) == fine[0].first ? 0 : 1];
      rows[m].push_back({{methods[m], scene.tick() / n}, end_distance(o, against), o.cost, o.cpu_s});
      if (rows[m].back().error <= std::max(fine_enough, out.doubt)) break;  // finer ones show rounding
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
    std::vector<Subset> out;
    for (const auto& [sum, s] : all) out.push_back(s);
    return out;
  }

  /// The cheapest stepping within the tolerance: they are tried from the cheapest on.
  void choose_stepping(Minimal& out) {
    const Scene scene = v_.scene(best_);
    out.stepping = {method_in_use(scene), scene.step};
    out.outcome = v_.run(best_);
    out.difference = difference(best_);
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
      const Outcome o = v_.bench().run(v_.scene(best_, s));
      const double d = v_.bench().distance(o, v_.run(fullest_));
      if (!(d <= tolerance_)) continue;
      out.stepping = s;
      out.outcome = o;
      out.difference = d;
      return;
    }
  }

  static constexpr std::size_t most_listed = 14;  // effects, whose subsets are listed
  static constexpr int most_tried = 64;
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
