// What `simulation.accuracy` costs against the best choice by hand: the cheapest integrator and step of 1, 2,
// 5, ... per tick whose true error is within what was asked. Truth: the same scene asked for 1e-3 of that, at
// least 1e-10; accuracy_promise judges that. Left out: scenes that are not well-posed, of which 1e-10 rad on
// the start moves the end by more than a tenth of what was asked. Cost: ratio of CPU times, the median over
// interleaved runs in this process: of 0.3 ms each, the least of either side would be that of whichever met a
// rare faster moment. usage: accuracy_cost smooth|events FIRST COUNT [SHOW]: scenes FIRST .. FIRST + COUNT -
// 1

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "host_sim/error.hpp"
#include "host_sim/loop/run.hpp"
#include "host_sim/plant/system.hpp"
#include "host_sim/scene/scene.hpp"
#include "tests/studies/accuracy_scenes.hpp"

namespace {

using namespace esmc::host;
constexpr double inf = std::numeric_limits<double>::infinity();

struct Run {
  judge::Vector q;  ///< empty: refused, or not finite
  double cpu_s = 0.0;
  bool fault = false;
  std::string refusal;
  std::optional<AccuracyReport> accuracy;
};
double cpu_now() {
  timespec t{};
  ::clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}
Run run(const Scene& scene) {
  Run out;
  const double begin = cpu_now();
  try {
    const Trace t = trace(scene);
    out.q = t.end.q;
    out.fault = !t.end.faults.empty();
    out.accuracy = t.end.accuracy;
  } catch (const RunError& e) {
    out.refusal = e.what();
  }
  out.cpu_s = cpu_now() - begin;
  for (const double v : out.q)
    if (!std::isfinite(v)) return {{}, out.cpu_s, out.fault, "not finite", {}};
  return out;
}
double distance(const judge::Vector& a, const judge::Vector& b) {
  if (a.size() != b.size() || a.empty()) return inf;
  double d = 0;
  for (std::size_t i = 0; i < a.size(); ++i) d = std::max(d, std::abs(a[i] - b[i]));
  return d;
}

/// A choice by hand.
struct Choice {
  Scene scene;
  double error = inf, cpu_s = inf;
  [[nodiscard]] std::string text() const {
    char step[32];
    std::snprintf(step, sizeof step, " %g", scene.step);
    return std::string(name(scene.method)) + step;
  }
};
std::vector<Choice> hand_choices(const Scene& scene, const judge::Vector& truth, double least) {
  std::vector<Method> methods{Method::event_driven, Method::moreau_jean};
  if (!set_valued(scene.effects))
    methods = {Method::semi_implicit_euler, Method::rk4,   Method::dopri5, Method::dopri8,
               Method::event_driven,        Method::radau5};
  std::vector<Choice> out;
  for (const Method m : methods) {
    for (const int parts : {1, 2, 5, 10, 20, 50, 100}) {
      Choice c{scene};
      c.scene.accuracy.reset();
      c.scene.method = m;
      c.scene.step = scene.tick() / parts;
      const Run r = run(c.scene);
      c.error = distance(r.q, truth);
      c.cpu_s = r.cpu_s;
      out.push_back(c);
      if (c.error <= least || r.cpu_s > 0.5) break;
    }
  }
  return out;
}

double quantile(std::vector<double> v, double p) {
  if (v.empty()) return 0.0;
  std::sort(v.begin(), v.end());
  return v[std::min(v.size() - 1, static_cast<std::size_t>(p * static_cast<double>(v.size())))];
}
double share(const std::vector<double>& v, double most) {
  if (v.empty()) return 100.0;
  return 100.0 * static_cast<double>(std::count_if(v.begin(), v.end(), [&](double r) { return r <= most; })) /
         static_cast<double>(v.size());
}
void print(const char* what, const std::vector<double>& v) {
  std::printf(
      "  %-28s %3zu scenes: median %.2f, 90 %% %.2f, 95 %% %.2f, most %.2f; within 2 x %.1f %%, 3 x %.1f "
      "%%\n",
      what, v.size(), quantile(v, 0.5), quantile(v, 0.9), quantile(v, 0.95), quantile(v, 1.0), share(v, 2.0),
      share(v, 3.0));
}

struct Totals {
  std::vector<double> best, rk4, refused_s;
  int outside = 0, no_truth = 0, ill_posed = 0;
};

/// How far the end moves with 1e-10 rad on the start.
double sensitivity(Scene scene, const judge::Vector& truth) {
  scene.start_angle[0] += 1e-10;
  return distance(run(scene).q, truth);
}

/// Of each candidate: how many times its CPU time the run with accuracy takes.
std::vector<double> ratios(const std::vector<Choice*>& candidates, const Scene& asked) {
  constexpr int rounds = 15;
  std::vector<std::vector<double>> of(candidates.size());
  for (int i = 0; i < rounds; ++i) {
    const double cpu_s = run(asked).cpu_s;
    for (std::size_t c = 0; c < candidates.size(); ++c)
      of[c].push_back(cpu_s / run(candidates[c]->scene).cpu_s);
  }
  std::vector<double> out;
  for (const auto& r : of) out.push_back(quantile(r, 0.5));
  return out;
}

void compare(const Scene& scene, double asked, std::vector<Choice>& all, Totals& totals, std::string& line,
             const judge::Vector& truth) {
  Scene with = scene;
  with.accuracy = asked;
  const Run first = run(with);
  char text[300];
  if (first.q.empty()) {
    totals.refused_s.push_back(first.cpu_s);
    std::snprintf(text, sizeof text, "\n    %g refused after %.2g s: %s", asked, first.cpu_s,
                  first.refusal.c_str());
    line += text;
    return;
  }
  if (truth.empty()) {
    ++totals.no_truth;
    return;
  }
  const double error = distance(first.q, truth);
  if (error > asked) ++totals.outside;
  double least = inf;
  std::vector<Choice*> candidates;
  Choice* rk4 = nullptr;
  for (Choice& c : all)
    if (c.error <= asked) least = std::min(least, c.cpu_s);
  for (Choice& c : all) {
    if (c.error > asked) continue;
    const bool plain = c.scene.step == c.scene.tick() &&
                       c.scene.method == (set_valued(scene.effects) ? Method::event_driven : Method::rk4);
    if (plain) rk4 = &c;
    if (plain || c.cpu_s < 1.5 * least) candidates.push_back(&c);
  }
  if (candidates.empty()) return;
  const std::vector<double> times = ratios(candidates, with);
  const auto most = static_cast<std::size_t>(std::max_element(times.begin(), times.end()) - times.begin());
  const Choice* best = candidates[most];
  totals.best.push_back(times[most]);
  for (std::size_t c = 0; c < candidates.size(); ++c)
    if (candidates[c] == rk4) totals.rk4.push_back(times[c]);
  const AccuracyReport& a = *first.accuracy;
  std::snprintf(
      text, sizeof text,
      "\n    %g: %.2f x %s (%.3f ms, error %.1e)%s; here %s step %.2g, error %.1e of %.1e estimated, %d "
      "passes, %ld slopes, %ld events",
      asked, times[most], best->text().c_str(), 1e3 * best->cpu_s, best->error,
      error > asked ? " OUTSIDE" : "", a.between.c_str(), a.step, error, a.estimated, a.passes, a.evaluations,
      a.events.total());
  line += text;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 4) return 2;
  const bool smooth = std::string(argv[1]) == "smooth", show = argc > 4;
  const auto first = std::strtoull(argv[2], nullptr, 10), count = std::strtoull(argv[3], nullptr, 10);
  constexpr std::array asked{1e-3, 1e-4, 1e-6};
  std::array<Totals, asked.size()> totals;
  for (auto seed = first; seed < first + count; ++seed) {
    const judge::Case c = smooth ? judge::draw_smooth(seed) : judge::draw(seed);
    Scene scene = read_scene_text(judge::scene(c), "scene", {});
    scene.accuracy = 1e-9;
    const Run truth = run(scene);
    std::string line;
    if (truth.fault) continue;
    std::vector<Choice> all;
    const double moves = truth.q.empty() ? 0.0 : sensitivity(scene, truth.q);
    if (!truth.q.empty()) all = hand_choices(scene, truth.q, asked.back());
    for (std::size_t k = 0; k < asked.size(); ++k) {
      if (moves > 0.1 * asked[k]) {
        ++totals[k].ill_posed;
      } else {
        compare(scene, asked[k], all, totals[k], line, truth.q);
      }
    }
    if (!show) continue;
    std::printf("%llu %s %s%s%s%s%s%s%s\n", static_cast<unsigned long long>(seed), c.five_bar ? "5R" : "RR",
                c.closed ? "closed" : "open", c.rubs ? " friction" : "",
                c.stops ? (c.soft ? " soft" : " rigid") : "", c.gear ? " gear" : "", c.play ? " play" : "",
                c.load ? " load" : "", line.c_str());
    std::fflush(stdout);
  }
  for (std::size_t k = 0; k < asked.size(); ++k) {
    const Totals& t = totals[k];
    std::printf("asked %g\n", asked[k]);
    print("against the best choice", t.best);
    print("against RK4 at every tick", t.rk4);
    std::printf(
        "  refused: %zu, after at most %.2g s; outside: %d; without a truth: %d; not well-posed: %d\n",
        t.refused_s.size(), quantile(t.refused_s, 1.0), t.outside, t.no_truth, t.ill_posed);
  }
  return 0;
}
