/// Ten seconds of free motion of a five-bar: this plant against Simbody, in one run, taking turns, thread CPU
/// time. Error: largest distance of the effector from a much finer run, at the end of each second.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <string>
#include <vector>

#include "host_sim/integrate/dopri8.hpp"
#include "host_sim/integrate/fixed_step.hpp"
#include "host_sim/plant/kinematics.hpp"
#include "host_sim/plant/system.hpp"
#include "tests/benchmarks/free_motion_peer.hpp"

namespace esmc::host {
namespace {

constexpr LegParams<double> leg{0.25, 0.35, 0.12, 0.17, 0.40, 0.30, 2.5e-3, 3.2e-3};
constexpr FiveBarParams<double> params{0.125, 0.25, 9.81, {{leg, leg}}};
constexpr int seconds = 10;
using Path = std::vector<std::array<double, 2>>;  ///< effector at the end of each second

double cpu_s() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

double distance(const Path& a, const Path& b) {
  double worst = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    worst = std::max(worst, std::hypot(a[i][0] - b[i][0], a[i][1] - b[i][1]));
  }
  return worst;
}

using Run = test::PeerRun;

class Ours {
 public:
  [[nodiscard]] Run adaptive(double tolerance) const {
    Dopri8<Sys> m(system_);
    Tolerance t;
    t.absolute = t.relative = tolerance;
    return run([&](double from, double to, Sys::State& y) { (void)m.advance(from, to, y, t); });
  }
  [[nodiscard]] Run rk4(double step) const {
    Rk4<Sys> m(system_);
    return run([&](double from, double to, Sys::State& y) {
      const int n = static_cast<int>(std::lround((to - from) / step));
      for (int i = 0; i < n; ++i) m.step(from + i * step, step, y);
    });
  }
  [[nodiscard]] FiveBarPlant::State start() const {
    const double degree = std::acos(-1.0) / 180.0;
    return FiveBarPlant::from_joints(*close(params, {-80 * degree, -90 * degree}, 1), {0, 0, 0, 0});
  }
  [[nodiscard]] const FiveBarPlant& plant() const { return plant_; }

 private:
  using Sys = BareSystem<FiveBarPlant>;
  template <class Advance>
  [[nodiscard]] Run run(const Advance& advance) const {
    Run out;
    Sys::State y{};
    Sys::put(y, start().angle, start().rate);
    const double begin = cpu_s();
    for (int s = 0; s < seconds; ++s) {
      advance(s, s + 1.0, y);
      const auto o = plant_.output({Sys::angles(y), Sys::rates(y)});
      out.path.push_back({o.effector.x, o.effector.y});
      out.closure = std::max(out.closure, o.closure);
    }
    out.cpu_ms = 1e3 * (cpu_s() - begin);
    return out;
  }
  FiveBarPlant plant_{params};
  Sys system_{plant_};
};

struct Row {
  std::string name;
  double error, closure, cpu_ms;
};

}  // namespace
}  // namespace esmc::host

int main() {
  using namespace esmc;
  using namespace esmc::host;
  const Ours ours;
  const auto start = ours.start();
  const auto a = ours.plant().acceleration(start.angle, start.rate, {});
  const test::PeerStart from{start.angle, params.l0, leg.l1, leg.l2, leg.lg1,   leg.lg2,
                             leg.m1,      leg.m2,    leg.J1, leg.J2, params.m0, params.g};
  const auto theirs_at_start = test::peer_accelerations(from);
  const double relative[] = {a[0], a[1] - a[0], a[2], a[3] - a[2]};
  double worst = 0.0;
  for (std::size_t i = 0; i < 4; ++i)
    worst = std::max(worst, std::abs(theirs_at_start[i] - relative[i]) / std::abs(relative[i]));
  std::printf("the same mechanics: initial accelerations differ by %.1e relative\n", worst);

  const Path truth = ours.adaptive(1e-15).path;
  std::printf("reference: %.1e m from a run at ten times its tolerance\n\n",
              distance(truth, ours.adaptive(1e-14).path));
  std::vector<Row> mine, theirs;
  const double accuracies[] = {1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8};
  constexpr int turns = 3;
  for (int turn = 0; turn < turns; ++turn) {
    std::size_t k = 0;
    const auto take = [&](std::vector<Row>& rows, const std::string& name, const Run& r) {
      if (turn == 0) rows.push_back({name, distance(r.path, truth), r.closure, r.cpu_ms});
      rows[k].cpu_ms = std::min(rows[k].cpu_ms, r.cpu_ms);
      ++k;
    };
    for (double tolerance = 1e-2; tolerance > 1e-13; tolerance *= 0.1) {
      char name[40];
      std::snprintf(name, sizeof name, "esmc dopri8, tolerance %.0e", tolerance);
      take(mine, name, ours.adaptive(tolerance));
    }
    take(mine, "esmc rk4, 5 ms", ours.rk4(5e-3));
    take(mine, "esmc rk4, 1 ms", ours.rk4(1e-3));
    k = 0;
    for (const bool every : {false, true}) {
      for (const double accuracy : accuracies) {
        char name[60];
        std::snprintf(name, sizeof name, "Simbody RK-Merson %.0e%s", accuracy,
                      every ? ", projecting every step" : "");
        take(theirs, name, test::peer_run(from, accuracy, every, seconds));
      }
    }
  }
  std::printf("%-46s %12s %12s %10s\n", "", "error, m", "closure, m", "CPU, ms");
  for (const auto* rows : {&mine, &theirs}) {
    for (const Row& r : *rows)
      std::printf("%-46s %12.2e %12.2e %10.3f\n", r.name.c_str(), r.error, r.closure, r.cpu_ms);
  }
  double least = 1e300, most = 0.0;
  for (const Row& t : theirs) {
    double best = 1e300;
    for (const Row& m : mine) {
      if (m.error <= t.error) best = std::min(best, m.cpu_ms);
    }
    if (best > 1e299) continue;
    least = std::min(least, t.cpu_ms / best);
    most = std::max(most, t.cpu_ms / best);
  }
  std::printf("\nSimbody / esmc at equal error: min %.0f, max %.0f\n", least, most);
  return 0;
}
