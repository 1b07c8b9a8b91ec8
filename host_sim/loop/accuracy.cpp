#include "host_sim/loop/accuracy.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <ctime>
#include <limits>
#include <optional>

#include "host_sim/controller/controller_config.hpp"
#include "host_sim/error.hpp"
#include "host_sim/plant/system.hpp"

namespace esmc::host {
namespace {

constexpr double inf = std::numeric_limits<double>::infinity();
constexpr double margin = 2.0;      // of what was asked over the difference of two passes
constexpr double rounding = 2e-15;  // no tolerance of a step below it
constexpr double nudge = 1e-10;     // rad, of the start
constexpr std::uint32_t pilot_ticks = 10;
constexpr double most_rows = 2e7;

/// Largest difference of the last row, and of all.
struct Deviation {
  double end = inf, all = inf;
};

[[nodiscard]] Deviation deviation(const std::vector<double>& a, const std::vector<double>& b,
                                  std::size_t width) {
  if (a.size() != b.size()) return {};
  Deviation d{0.0, 0.0};
  for (std::size_t i = 0; i < a.size(); ++i) {
    const double e = std::abs(a[i] - b[i]);
    d.all = e > d.all || std::isnan(e) ? e : d.all;
    if (i + width >= a.size()) d.end = e > d.end || std::isnan(e) ? e : d.end;
  }
  return d;
}

class Search {
 public:
  Search(Scene& scene, std::size_t width, const RunPass& run)
      : scene_(scene), asked_(*scene.accuracy), width_(width), run_(run), begin_(std::clock()) {}

  AccuracyReport find() {
    scene_.method = Method::event_driven;
    scene_.step = scene_.tick();
    if (agree_at_step()) return report();
    const std::optional<Between> controlled = choose_steps();
    if (!controlled && agree_at_step()) return report();
    const Between fine = controlled.value_or(Between::dopri5);
    scene_.step = scene_.tick();
    scene_.method = Method::event_driven;
    // Error control: 5th order once, 8th from then on; Radau where the step is bound by stability.
    double tolerance = asked_ / 100.0;
    for (int i = 0; i < 7 && tolerance >= rounding; ++i, tolerance = next_tolerance(tolerance)) {
      const Between b = i > 0 && fine == Between::dopri5 ? Between::dopri8 : fine;
      if (step({b, tolerance, rebound() / (i + 1)}, last_.has_value())) return report();
      if (i > 0 && stalled()) refuse_if_ill_posed();
    }
    refuse_if_ill_posed();
    if (!finite_) throw Diverged(*failure_);
    throw RunError(fmt::format(
        "accuracy = {} was not reached: the finest two passes differ by {:.2g}, and rounding is in the way",
        asked_, judged()));
  }

 private:
  static double next_tolerance(double t) {
    return t > 30.0 * rounding ? t / 30.0 : (t > rounding ? rounding : 0.0);
  }

  [[nodiscard]] double rebound() const { return 0.01 * asked_; }

  /// Of two passes that agree one is recorded: RK4 at scene.step, which hardly costs more than a lower order
  /// beside the tick. The other is a rough one without records; a better one follows where it was too rough
  /// to judge.
  bool agree_at_step() {
    last_.reset();
    // Steps of a tick may both miss a flank that presses for less: error control judges those.
    if (asked_ < 1e-9 || find_effect<Backlash>(scene_.effects)) return false;
    const bool closed = scene_.closed_loop();
    const Resolution rough{Between::heun3, 0.0, rebound()},
        better{!closed && smooth() ? Between::dopri8 : Between::dopri5, closed ? 0.0 : 1e-2 * asked_,
               rebound()};
    const bool few = asked_ >= (closed ? 1e-7 : (smooth() ? inf : 1e-4));
    (void)step(few ? rough : better, false);
    return step({Between::rk4, 0.0, rebound()}, true) || (few && step(better, false));
  }
  /// Whether nothing can have an event, and no limit cuts the torque of an open loop.
  [[nodiscard]] bool smooth() const {
    return !set_valued(scene_.effects) && !find_effect<EndStops>(scene_.effects) &&
           !find_effect<Backlash>(scene_.effects) && !find_effect<TorqueSaturation>(scene_.effects);
  }

  /// Sets scene.step to the longest part of a tick with which RK4 follows the first ticks. Where none does:
  /// returns the method of error control that needs fewer right-hand sides there.
  std::optional<Between> choose_steps() {
    const double ticks = std::min<double>(pilot_ticks, tick_count(scene_));
    const auto pilot = [&](Between b, double tolerance) -> std::optional<Pass> {
      Scene s = scene_;
      s.duration = ticks / scene_.rate_hz;
      s.resolution = {b, tolerance, rebound()};
      try {
        return run(s, false);
      } catch (const Diverged&) {
        return std::nullopt;
      }
    };
    scene_.method = Method::event_driven;
    const std::optional<Pass> exact = pilot(Between::dopri5, 0.01 * asked_);
    for (const int parts : {2, 5}) {
      if (!exact) break;
      scene_.step = scene_.tick() / parts;
      const std::optional<Pass> p = pilot(Between::rk4, 0.0);
      if (p && deviation(exact->rows, p->rows, width_).all <= 0.5 * asked_) return std::nullopt;
    }
    scene_.step = scene_.tick();
    const std::optional<Pass> implicit = pilot(Between::radau5, asked_ / 30.0);
    return implicit && (!exact || 2 * implicit->effort.evaluations < exact->effort.evaluations)
               ? Between::radau5
               : Between::dopri5;
  }

  Pass run(const Scene& s, bool recorded) {
    Pass p = run_(s, recorded);
    if (s.method == Method::rk4) {  // whose engine does not count
      p.effort.steps = static_cast<long>(steps_per_tick(s)) * tick_count(s);
      p.effort.evaluations = 4 * p.effort.steps;
    }
    evaluations_ += p.effort.evaluations;
    ++passes_;
    return p;
  }

  /// One more pass. True: a recorded one is within what was asked.
  bool step(const Resolution& r, bool recorded) {
    Scene s = scene_;
    s.resolution = r;
    s.method = recorded && smooth() && r.between == Between::rk4 ? Method::rk4 : Method::event_driven;
    if (!recorded && asked_ >= 1e3 * nudge) s.start_angle[0] += nudge;  // the rest follows by closure
    Pass now;
    try {
      if (!recorded) now = run(s, false);
      if (recorded || now.interrupted) {
        take(s);
        now = run(scene_, true);  // the recorder keeps a reference to it
        chosen_ = s;
        effort_ = now.effort;
      }
      finite_ = true;
    } catch (const Diverged& e) {  // too long a step, or no solution
      failure_ = e;
      last_.reset();
      return false;
    }
    if (now.interrupted) {
      last_ = std::move(now);
      return true;
    }
    bool met = false;
    if (last_) {
      const Deviation d = deviation(last_->rows, now.rows, width_);
      before_ = judged();
      deviation_ = d;
      const bool close = margin * judged() <= asked_;
      // At the end alone two passes may meet by chance: then the way there, or a third pass, must agree.
      met = close && (trajectory() || d.all <= 100.0 * asked_ || agreed_);
      agreed_ = close;
    }
    last_ = std::move(now);
    latest_ = std::move(s);
    // Two coarse passes that agree have shown that small errors do not grow; two fine ones have not.
    if (met && r.tolerance > 0.0 &&
        (last_->effort.events.total() > 0 || (scene_.closed_loop() && asked_ < 1e-6)))
      refuse_if_ill_posed();
    return met;
  }
  void take(const Scene& s) {
    scene_.method = s.method;
    scene_.step = s.step;
    scene_.resolution = s.resolution;
  }
  [[nodiscard]] bool trajectory() const { return scene_.accuracy_of == AccuracyOf::trajectory; }
  [[nodiscard]] double judged() const { return trajectory() ? deviation_.all : deviation_.end; }
  [[nodiscard]] bool stalled() const { return std::isfinite(before_) && !(judged() < 0.3 * before_); }

  /// A start that is off by 1e-10 must not change the result by a tenth of what is asked.
  void refuse_if_ill_posed() {
    if (!last_ || nudged_) return;
    Scene other = *latest_;
    other.start_angle[0] += nudge;
    Deviation d;
    try {
      d = deviation(last_->rows, run(other, false).rows, width_);
    } catch (const Diverged&) {  // which is a change, too
    }
    const double change = trajectory() ? d.all : d.end;
    if (!(change <= 0.1 * asked_)) {
      throw RunError(fmt::format(
          "accuracy = {}: ill_posed: the scene itself does not decide its result that far: {:g} rad on "
          "the start moves it by {:.2g}",
          asked_, nudge, change));
    }
    nudged_ = true;
  }

  [[nodiscard]] AccuracyReport report() {
    take(*chosen_);
    const Resolution& r = scene_.resolution;
    const Effort& e = effort_;
    AccuracyReport out;
    out.asked = asked_;
    out.of = scene_.accuracy_of;
    out.estimated = judged();
    out.method = e.smooth ? name(r.between) : name(Method::event_driven);
    out.between = name(r.between);
    out.step = e.steps > 0 ? scene_.duration / static_cast<double>(e.steps) : scene_.tick();
    out.events = e.events;
    out.passes = passes_;
    out.evaluations = evaluations_;
    out.cpu_s = static_cast<double>(std::clock() - begin_) / CLOCKS_PER_SEC;
    return out;
  }

  Scene& scene_;
  double asked_;
  std::size_t width_;
  const RunPass& run_;
  std::clock_t begin_;
  std::optional<Pass> last_;
  std::optional<Scene> latest_, chosen_;  // of last_; of the last recorded pass
  Effort effort_;                         // of that one
  Deviation deviation_;
  double before_ = inf;
  long evaluations_ = 0;
  int passes_ = 0;
  bool agreed_ = false, nudged_ = false, finite_ = false;
  std::optional<Diverged> failure_;
};

}  // namespace

std::uint32_t row_stride(const Scene& scene, std::uint32_t ticks) {
  if (scene.accuracy_of == AccuracyOf::trajectory) return 1;
  return std::max(1U, ticks / 64U);
}

AccuracyReport meet_accuracy(Scene& scene, std::size_t width, const RunPass& run) {
  if (scene.accuracy_of == AccuracyOf::trajectory &&
      scene.duration * scene.rate_hz * static_cast<double>(width) > most_rows) {
    throw InputError(
        scene.simulation_where,
        fmt::format("accuracy_of = \"trajectory\" keeps at most {:g} numbers: a shorter duration",
                    most_rows));
  }
  return Search(scene, width, run).find();
}

}  // namespace esmc::host
