#pragma once
/// Integration from event to event: smooth between two, restarted at each.

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>

#include "host_sim/plant/engine_base.hpp"
#include "host_sim/plant/event_system.hpp"
#include "host_sim/plant/moreau_jean.hpp"

namespace esmc::host {

template <class Plant, class Inner>
class EventEngine final : public SystemEngine<Plant, EventSystem<Plant>> {
 public:
  using Sys = EventSystem<Plant>;
  using State = typename Sys::State;
  using Guards = typename Sys::Guards;
  using Torques = MotorTorques<typename Plant::Joints>;

  EventEngine(const Plant& plant, std::unique_ptr<Attachments> attached, const std::vector<Effect>& effects,
              const Resolution& resolution, const typename Plant::State& initial)
      : SystemEngine<Plant, Sys>(plant, std::move(attached), initial, effects, resolution.rebound_min),
        inner_(system_),
        probe_(system_),
        resolution_(resolution),
        smooth_(system_.smooth()),
        crowd_(system_, {find_effect<CoulombFriction>(effects), find_effect<EndStops>(effects)}) {
    tolerance_.absolute = tolerance_.relative = resolution.tolerance;
    tolerance_.max_attempts = attempts_max;
  }

  void run(double t, double step, int steps, const Torques& torque) override {
    system_.set_torques(torque);
    constant_ = torque.open == nullptr || torque.open->wave.empty();
    attached_->loads.begin(t + 0.5 * step * steps);
    const double end = t + step * steps;
    while (t < end) {
      const double to = clamp_switch(t, end, torque);
      stretch(t, to, step);
      t = to;
    }
  }
  [[nodiscard]] Method method() const override { return Method::event_driven; }
  [[nodiscard]] Effort effort() const override {
    return {system_.evaluations(), steps_, system_.events(), smooth_};
  }

 private:
  static constexpr long attempts_max = 20'000;  // of steps in one stretch
  static constexpr int crowd_min = 200;         // events in one stretch

  /// Integrates from t to `end` in steps of at most `step`, torques and loads being smooth between.
  void stretch(double t, double end, double step) {
    const double last = end - 1e-12 * (end - t);
    if (!smooth_) first_ = system_.begin(t, y_, first_);
    if (constant_ && system_.frozen()) return;
    for (int events = 0; t < last;) {
      const double rest = end - t;
      const auto pieces = std::max(1.0, std::ceil(rest / step - 1e-9));
      double h = rest / pieces;
      bool event = false;
      if constexpr (requires(Inner i) { i.advance(0.0, 0.0, y_, Tolerance{}); }) {
        if (resolution_.tolerance > 0.0) {
          before_ = y_;
          const Advance done =
              inner_.advance(t, end, y_, tolerance_, [&](double from, double length, const State& y) {
                t = from;
                h = length;
                if (happened(from, h, y)) return event = true;
                before_ = y;
                return false;
              });
          steps_ += done.steps;
          if (!done.ok && !event) return fail();
          t = event ? t : end;
        } else {
          fixed(t, h, event);
        }
      } else {
        fixed(t, h, event);
      }
      if (!all_finite(system_.size(), y_)) return fail();
      if (!event) continue;
      t += locate(t, h);
      system_.switch_modes(t, y_);
      first_ = system_.guards(t, y_);
      if (++events >= crowd_min) return crowd(t, end);
    }
  }
  void fixed(double& t, double h, bool& event) {
    before_ = y_;
    ++steps_;
    inner_.step(t, h, y_);
    event = happened(t, h, y_);
    if (!event) t += h;
  }
  void fail() { y_.fill(std::numeric_limits<double>::quiet_NaN()); }

  /// Whether the modes have ended within the step of h from t (before_) to y. h becomes shorter where that
  /// may have been, for a part of the step, earlier than its end shows.
  [[nodiscard]] bool happened(double t, double& h, const State& y) {
    if (smooth_) return false;
    last_ = system_.guards(t + h, y);
    const State bend = inner_.bend();
    bool event = last_.least() < 0.0;
    if (!event && !may_dip(0.125 * h * system_.guard_change(bend))) {
      first_ = last_;
      return false;
    }
    State middle = before_;
    for (std::size_t i = 0; i < system_.size(); ++i)
      middle[i] = 0.5 * (before_[i] + y[i]) + 0.125 * h * bend[i];
    for (int i = 0; i < 8; ++i) {
      middle_ = system_.guards(t + 0.5 * h, middle);
      const double part = dip(t, h, middle_, last_);
      if (part == 1.0) break;
      event = true;
      h *= part;
      last_ = guards_after(t, h, middle);
      (void)guards_after(t, 0.5 * h, middle);
    }
    if (!event) first_ = last_;
    return event;
  }
  Guards guards_after(double t, double h, State& y) {
    y = before_;
    probe_.step(t, h, y);
    return system_.guards(t + h, y);
  }
  static constexpr double inf = std::numeric_limits<double>::infinity();
  static constexpr double near = 0.05;  // of its depth: how well a parabola knows its lowest point
  /// Whether dip() could find anything if no guard in the middle is further than `off` from its mean.
  [[nodiscard]] bool may_dip(double off) const {
    for (std::size_t i = 0; i < last_.count; ++i) {
      const double lowest = std::min(first_.value[i], last_.value[i]) - off;
      if (!(lowest >= near * (std::max(first_.value[i], last_.value[i]) - lowest))) return true;
    }
    return false;
  }
  /// Part of the step at which a guard is negative that the end of the step does not show, 1: none. A
  /// parabola through the guard's value in the middle tells where to look.
  [[nodiscard]] double dip(double t, double h, const Guards& inside, const Guards& last) {
    double first = 1.0;
    for (std::size_t i = 0; i < last.count; ++i) {
      const double a = first_.value[i], b = last.value[i], m = inside.value[i];
      const double slope = 4.0 * m - 3.0 * a - b, curve = 2.0 * (a + b - 2.0 * m);
      if (b < 0.0 || !(slope < 0.0 && curve > -0.5 * slope)) continue;  // no lowest point inside
      const double part = -0.5 * slope / curve, lowest = a + 0.5 * slope * part;
      if (part >= first || !(lowest < near * (std::max(a, b) - lowest))) continue;
      State there{};
      if (guards_after(t, part * h, there).value[i] < 0.0) first = part;
    }
    return first;
  }

  /// Guards after a step of length `at` from before_.
  struct Trial {
    double at;
    Guards guards;
  };
  /// Length of the step from before_ at t, at most h, that ends at the first event; y_: the state there. The
  /// step is made anew each time, so the event lies on the method's own solution.
  double locate(double t, double h) {
    Trial low{0.0, first_}, high{h, last_}, third{0.5 * h, middle_};
    double made = -1.0, left = inf;  // left: of the guard after the trial before
    for (int i = 0; i < 100 && high.at - low.at > 1e-15 * h && high.guards.least() < -nothing; ++i) {
      made = left == inf && i > 0 ? -1.0 : crossing(low, high, third);
      if (!(made > low.at && made < high.at)) made = 0.5 * (low.at + high.at);
      const Guards now = guards_at(t, made);
      const double f = std::abs(now.least());
      // Where a trial has come no closer, the next one is in the middle.
      left = f < 0.25 * (i == 0 ? std::min(std::abs(first_.least()), -last_.least()) : left) ? f : inf;
      Trial& end = now.least() < 0.0 ? high : low;
      third = std::exchange(end, {made, now});
    }
    if (made != high.at) (void)guards_at(t, high.at);
    return high.at;
  }
  static constexpr double nothing = 1e-13;  // of a guard
  /// Where the first guard passes the middle of what is accepted: each by the inverse parabola through three
  /// trials, or by a line. One that is nothing at the beginning, after its own event, by the line through its
  /// quotients by time.
  static double crossing(const Trial& low, const Trial& high, const Trial& third) {
    double first = high.at;
    for (std::size_t i = 0; i < high.guards.count; ++i) {
      const auto value = [&](const Trial& trial) { return trial.guards.value[i] + 0.5 * nothing; };
      const double a = value(low), b = value(high), c = value(third);
      if (!(b < 0.0)) continue;
      double at = low.at + (high.at - low.at) * a / (a - b);
      if (low.at == 0.0 && a < 10.0 * nothing) {
        at = third.at + (high.at - third.at) * c / (c - b * third.at / high.at);
      } else {
        const double parabola = low.at * b * c / ((a - b) * (a - c)) + high.at * a * c / ((b - a) * (b - c)) +
                                third.at * a * b / ((c - a) * (c - b));
        if (parabola > low.at && parabola < high.at) at = parabola;
      }
      first = std::min(first, at);
    }
    return first;
  }
  /// Sets y_ to the state after h.
  Guards guards_at(double t, double h) {
    y_ = before_;
    inner_.step(t, h, y_);
    return system_.guards(t + h, y_);
  }

  /// More events than can be told apart: small steps of moreau_jean to the end of the stretch.
  void crowd(double t, double end) {
    constexpr int steps = 64;
    const double h = (end - t) / steps;
    system_.release();
    for (int i = 0; i < steps; ++i) {
      system_.follow(y_);
      crowd_.step(t + i * h, h, y_);
    }
    system_.restart();
  }

  /// First instant in (t, end] at which a waveform meets the drives' limit, or `end`.
  static double clamp_switch(double t, double end, const Torques& torque) {
    if (torque.open == nullptr || !std::isfinite(torque.open->limit)) return end;
    double first = end;
    for (const Waveform& w : torque.open->wave) {
      const auto beyond = [&](double at) { return std::abs(w.at(at)) > torque.open->limit; };
      constexpr int parts = 4;
      const double inside = t + 1e-9 * (end - t);
      double low = inside;
      for (int i = 1; i <= parts; ++i) {
        double high = i == parts ? end : inside + i * (end - inside) / parts;
        if (beyond(high) == beyond(inside)) {
          low = high;
          continue;
        }
        for (int k = 0; k < 60; ++k) {
          const double middle = 0.5 * (low + high);
          (beyond(middle) == beyond(inside) ? low : high) = middle;
        }
        if (high < first) first = high;
        break;
      }
    }
    return first;
  }

  using SystemEngine<Plant, Sys>::attached_, SystemEngine<Plant, Sys>::system_, SystemEngine<Plant, Sys>::y_;
  Inner inner_, probe_;
  Resolution resolution_;
  bool smooth_, constant_ = true;
  long steps_ = 0;
  MoreauJean<Sys, Plant> crowd_;
  Tolerance tolerance_;
  State before_{};
  Guards first_, middle_, last_;  // at before_, about the middle of the step after it, and at its end
};

}  // namespace esmc::host
