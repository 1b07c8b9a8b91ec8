#include "host_sim/loop/accuracy.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <ctime>
#include <limits>
#include <optional>
#include <utility>

#include "host_sim/controller/controller_config.hpp"
#include "host_sim/error.hpp"
#include "host_sim/plant/system.hpp"

namespace esmc::host {
namespace {

constexpr double inf = std::numeric_limits<double>::infinity();
// Of what was asked over the difference of two passes equally good, or from a better one.
constexpr double margin = 2.0, better = 1.25;
constexpr int heun3 = static_cast<int>(Between::heun3), rk4 = static_cast<int>(Between::rk4),
              dopri5 = static_cast<int>(Between::dopri5), dopri8 = static_cast<int>(Between::dopri8);
constexpr double rounding = 2e-15;  // no tolerance of a step below it
constexpr double nudge = 1e-10;     // rad, of the start
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
    if (agree_at_tick()) return report();
    const Between fine = stiff() ? Between::radau5 : Between::dopri8;
    double tolerance = 30.0 * std::max(rounding, asked_ / 3000.0);  // next finer than the steps of a tick
    for (int i = 0; i < 7 && tolerance > rounding; ++i) {
      tolerance = std::max(rounding, tolerance / 30.0);
      if (step({fine, tolerance, rebound() / (i + 1)}, last_.has_value(), margin)) return report();
      if (i > 1 && stalled()) refuse_if_ill_posed();
    }
    refuse_if_ill_posed();
    if (!finite_) throw Diverged(*failure_);
    throw RunError(fmt::format(
        "accuracy = {} was not reached: the finest two passes differ by {:.2g}, and rounding is in the way",
        asked_, judged()));
  }

 private:
  [[nodiscard]] double rebound() const { return 0.01 * asked_; }

  /// Passes of one step per tick, of rising order.
  bool agree_at_tick() {
    // Explicit methods of a step per tick are not stable where a lag is that much shorter than the tick.
    if (ticks_of_lag() > 2.5) return false;
    const bool many = asked_ <= 1e-7, events = may_have_events(scene_.effects);
    if (!scene_.closed_loop()) return agree_with_judge(many, events);
    // Every second one is recorded, better than the rough one before, worse than that after it. Heun's method
    // at once where events are located.
    int order = many ? dopri8 - 1 : (events || asked_ < 1e-4 ? rk4 - 1 : (asked_ < 1e-3 ? 1 : 0));
    (void)at_tick(order, false, 1.0);
    for (bool recorded = true, again = false; ++order <= dopri8;) {
      if (again && !events) last_share_ = 0.25;
      if (at_tick(order, recorded, recorded ? 1.0 : better)) return true;
      // Where Heun's method is that far off, RK4 is probably off too: then dopri5, far better, is recorded.
      again = recorded && order == rk4 && judged() > (events ? 10.0 : 2.5) * asked_;
      recorded = !recorded || again;
    }
    return false;
  }
  /// The tick over the drives' lag of torque; 0: none.
  [[nodiscard]] double ticks_of_lag() const {
    const auto lag = find_effect<TorqueLag>(scene_.effects);
    return lag && lag->time_constant > 0.0 ? scene_.tick() / lag->time_constant : 0.0;
  }
  /// Open loop: the judge needs no ticks. It has error control or, where a rotor on a spring would make that
  /// take short steps, dopri8 over four ticks (with events dopri5 over two). Each recorded pass is compared
  /// with it, and with the one before.
  bool agree_with_judge(bool many, bool events) {
    const std::vector<Effect>& effects = scene_.effects;
    const bool spring = find_effect<JointFlexibility>(effects) || find_effect<Backlash>(effects);
    const std::uint32_t at_once = row_stride(scene_, tick_count(scene_));  // ticks from row to row
    const bool strides = spring && !many && at_once > 3;
    const Between by = events ? Between::dopri5 : Between::dopri8;
    (void)step(strides ? Resolution{by, 0.0, rebound(), events ? 2 : 4}
                       : Resolution{by, (events || many ? 1e-2 : 1e-3) * asked_, rebound()},
               false, 1.0);
    judge_ = std::exchange(last_, std::nullopt);
    judge_margin_ = events ? margin : better;
    judge_controls_ = !strides;
    // A chain that closes has poses that magnify errors; where a spring makes the judge expensive, an arm is
    // not worth the look.
    const bool looks =
        judge_ && !events && asked_ < 1e-4 && at_once > 3 && !(spring && scene_.type == MechanismType::rr);
    int order = many ? dopri8 : (looks ? first_order() : rk4);
    for (bool finer = many || at_once < 2 || (events && !strides); order <= dopri8; ++order) {
      // A judge in strides is worse than the pass: of the same method the error is 31 times as large at most.
      if (strides && order > rk4) judge_margin_ = events ? 1.0 : (order == dopri8 ? 0.25 : better);
      if (at_tick(order, true, 1.0)) return true;
      if (agreed_ && !contradicted_ && at_tick(heun3, false, better)) return true;  // a third pass
      if (order < dopri5 || !last_ || std::exchange(finer, true)) continue;
      // A better judge of this pass is cheaper than a recorded one of dopri8.
      judge_.reset();
      if (step({Between::dopri8, 0.0, rebound(), 2}, false, better)) return true;
    }
    judge_.reset();
    return false;
  }
  /// The first method whose pass may be within what is asked. RK4 at a tick is off by about a 256th of its
  /// error over four ticks, a pass that costs a quarter; dopri5 by a two-hundredth of that. Too large an
  /// error says nothing: four ticks are then too long for RK4 to be stable.
  int first_order() {
    (void)step({Between::rk4, 0.0, rebound(), 4}, false, 1.0);
    const double error = judged() / (256.0 * judge_margin_ * asked_);
    last_.reset();
    deviation_ = {};
    agreed_ = false;
    if (!(error > 1.5 && error < 1e4)) return rk4;
    return error < 200.0 ? dopri5 : dopri8;
  }
  bool at_tick(int order, bool recorded, double less) {
    return step({static_cast<Between>(order), 0.0, rebound()}, recorded, less);
  }

  /// Whether error control in the first ten ticks needs less than half the right-hand sides with Radau's
  /// method.
  bool stiff() {
    const auto pilot = [&](Between b, double tolerance) {
      Scene s = scene_;
      s.duration = std::min<double>(10, tick_count(scene_)) / scene_.rate_hz;
      s.resolution = {b, tolerance, rebound()};
      try {
        return static_cast<double>(run(s, false).effort.evaluations);
      } catch (const Diverged&) {
        return inf;
      }
    };
    return 2 * pilot(Between::radau5, asked_ / 30.0) < pilot(Between::dopri5, 0.01 * asked_);
  }

  Pass run(const Scene& s, bool recorded) {
    Pass p = run_(s, recorded);
    if (p.effort.steps == 0 && p.effort.smooth) {  // an engine that does not count
      constexpr std::array slopes{1, 2, 3, 4, 6, 12};
      p.effort.steps = static_cast<long>(steps_per_tick(s)) * tick_count(s) / s.resolution.ticks;
      p.effort.evaluations = slopes[static_cast<std::size_t>(s.resolution.between)] * p.effort.steps;
    }
    evaluations_ += p.effort.evaluations;
    ++passes_;
    return p;
  }

  /// One more pass. True: a recorded one is within what was asked, `less` times their difference being so.
  bool step(const Resolution& r, bool recorded, double less) {
    Scene s = scene_;
    s.resolution = r;
    if (!recorded && !last_ && asked_ >= 1e3 * nudge)
      s.start_angle[0] += nudge;  // the rest follows by closure
    Pass now;
    try {
      if (!recorded) now = run(s, false);
      if (recorded || now.interrupted) {
        scene_.resolution = r;
        now = run(scene_, true);  // the recorder keeps a reference to it
        chosen_ = r;
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
    if (last_ || judge_) {
      before_ = judged();
      contradicted_ = false;
      deviation_ = last_ ? deviation(last_->rows, now.rows, width_) : Deviation{};
      deviation_ = {last_share_ * deviation_.end, last_share_ * deviation_.all};
      if (judge_) {
        const Deviation d = deviation(judge_->rows, now.rows, width_);
        const double off = judge_margin_ * d.end;
        contradicted_ = judge_controls_ && off > asked_ && deviation_.end <= asked_;
        if (off < deviation_.end) deviation_ = {off, judge_margin_ * d.all};
      }
      const bool close = less * judged() <= asked_;
      // At the end alone two passes may meet by chance: then the way there, or a third pass, must agree.
      // Two passes that agree with each other and not with error control may share a step that is too long:
      // then a third pass must agree, too.
      const bool rough = judge_ && !judge_controls_ && may_have_events(scene_.effects);
      const double spread = rough && judged() > 0.6 * asked_ ? 1.0 : 100.0;
      met = close && (!contradicted_ || agreed_) &&
            (trajectory() || deviation_.all <= spread * asked_ || agreed_);
      agreed_ = close;
    }
    // Euler's error is at least three times that of the midpoint rule after it.
    last_share_ = r.between == Between::semi_implicit_euler ? 0.5 : 1.0;
    last_ = std::move(now);
    latest_ = std::move(s);
    if (met && doubtful(r)) refuse_if_ill_posed();
    return met;
  }
  /// Two coarse passes that agree have shown that small errors do not grow; two fine ones have not, two that
  /// are the same, for the tick is shorter than the steps that they want, nothing at all, nor have two after
  /// one, from another start, that was far off.
  [[nodiscard]] bool doubtful(const Resolution& r) const {
    if (std::isfinite(before_) && before_ > 100.0 * asked_) return true;
    return r.tolerance > 0.0 && (last_->effort.events.total() > 0 || deviation_.all == 0.0 ||
                                 (scene_.closed_loop() && asked_ < 1e-6));
  }
  [[nodiscard]] bool trajectory() const { return scene_.accuracy_of == AccuracyOf::trajectory; }
  [[nodiscard]] double judged() const { return trajectory() ? deviation_.all : deviation_.end; }
  [[nodiscard]] bool stalled() const { return std::isfinite(before_) && !(judged() < 0.3 * before_); }

  /// A start that is off by 1e-10 must not change the result by a tenth of what is asked. Of a trajectory the
  /// start is a row: there it is off by a hundredth of what is asked at most.
  void refuse_if_ill_posed() {
    if (!last_ || nudged_) return;
    Scene other = *latest_;
    const double off = trajectory() ? std::min(nudge, 0.01 * asked_) : nudge;
    other.start_angle[0] += off;
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
          asked_, off, change));
    }
    nudged_ = true;
  }

  [[nodiscard]] AccuracyReport report() {
    scene_.resolution = chosen_;
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
  std::optional<Pass> last_, judge_;
  std::optional<Scene> latest_;  // of last_
  Resolution chosen_;            // of the last recorded pass
  Effort effort_;                // of that one
  Deviation deviation_;
  double before_ = inf, judge_margin_ = margin;
  bool judge_controls_ = false, contradicted_ = false;  // it has error control, and finds the pass far off
  double last_share_ = 1.0;  // of the difference from last_: what the better one of the two is off by
  long evaluations_ = 0;
  int passes_ = 0;
  bool agreed_ = false, nudged_ = false, finite_ = false;
  std::optional<Diverged> failure_;
};

}  // namespace

std::uint32_t row_stride(const Scene& scene, std::uint32_t ticks) {
  if (scene.accuracy_of == AccuracyOf::trajectory) return 1;
  return std::max(1U, ticks / 16U);
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
