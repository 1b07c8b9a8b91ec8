#pragma once
/// The method of small steps for set-valued effects.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>
#include <span>

#include "host_sim/effects/effects.hpp"

namespace esmc::host {

struct SetValued {
  std::optional<CoulombFriction> friction;
  std::optional<EndStops> stops;
};

/// Time stepping for set-valued friction and rigid stops (Moreau 1988, Jean 1999; theta = 1/2): velocities
/// may jump, contact acts by impulses over the step, the rate of a joint that sticks is exactly zero.
///
/// Per step h:  v_free = v + h a(t + h/2, q + h/2 v, (v + v+) / 2), v+ predicted by a first pass;  impulses
/// r_i at the joints with
///   w+ = w_free + W r,   friction: |r_i| <= h torque_i, w_i+ = 0 or r_i = -h torque_i sgn w_i+
///                        stop:      r_i pushes back only, w_i+ = -e w_i or more where it touches
/// and q+ = q + h (v + v+) / 2. Second order between the instants at which a joint sticks, slips or hits,
/// first order across them; exact for constant deceleration to rest.
template <class Sys, class Plant>
class MoreauJean {
 public:
  using State = typename Sys::State;
  static constexpr int order = 1;
  static constexpr const char* name = "moreau_jean";

  /// `system` must outlive this.
  MoreauJean(const Sys& system, const SetValued& contact) : system_(&system), contact_(contact) {}

  /// Advances y from t by one step of h, s.
  void step(double t, double h, State& y) {
    const Sys& s = *system_;
    const Angles before = Sys::rates(y);
    State middle = y, slope{};
    for (std::size_t i = 0; i < Sys::positions; ++i) middle[i] += 0.5 * h * before[i];
    // Once with the forces of the rates before, once with those of the mean: what sticks is known by then.
    double impulse_work = 0.0;
    Angles after = before;
    for (int pass = 0; pass < 2; ++pass) {
      s.slope(t + 0.5 * h, middle, slope);
      for (std::size_t i = 0; i < Sys::positions; ++i) after[i] = before[i] + h * slope[Sys::positions + i];
      const Angles angle = Sys::angles(middle);
      rows_ = 0;
      collect(h, Plant::joint_angles(angle), Plant::joint_rates(before));
      impulse_work = rows_ == 0 ? 0.0 : resolve(angle, before, after);
      for (std::size_t i = 0; i < Sys::positions; ++i)
        middle[Sys::positions + i] = 0.5 * (before[i] + after[i]);
      if (pass == 0) {
        for (std::size_t i = Sys::work + 1; i < s.size(); ++i) middle[i] += 0.5 * h * slope[i];
      }
    }
    for (std::size_t i = Sys::work + 1; i < s.size(); ++i) y[i] += h * slope[i];
    s.slope(t + 0.5 * h, middle, slope);  // for its power at the mean rate
    y[Sys::work] += h * slope[Sys::work] + impulse_work;
    bool moving = false;
    for (std::size_t i = 0; i < Sys::positions; ++i) {
      moving = moving || before[i] != 0.0 || after[i] != 0.0;
      y[i] += 0.5 * h * (before[i] + after[i]);
      y[Sys::positions + i] = after[i];
    }
    if (moving) s.project(y);  // what rests is not touched, not even by rounding
  }

 private:
  using Angles = typename Plant::Angles;
  using Joints = typename Plant::Joints;
  static constexpr std::size_t most_rows = Plant::joints + 2;
  static constexpr double inf = std::numeric_limits<double>::infinity();

  struct Row {
    std::size_t joint = 0;
    double lower = 0.0, upper = 0.0;  ///< of the impulse, N m s
    double rebound = 0.0;             ///< w + rebound is what complements the impulse
    bool friction = false;
    Angles response{};  ///< of the bars to a unit impulse
    double impulse = 0.0;
    [[nodiscard]] bool sticks() const { return friction && impulse > lower && impulse < upper; }
  };

  void collect(double h, const Joints& theta, const Joints& w) {
    if (contact_.friction && !(contact_.friction->regularised > 0.0)) {
      for (std::size_t j = 0; j < static_cast<std::size_t>(Plant::joints); ++j) {
        const double most = h * contact_.friction->torque[j];
        if (most > 0.0) row_[rows_++] = {j, -most, most, 0.0, true, {}, 0.0};
      }
    }
    if (!contact_.stops || contact_.stops->stiffness) return;
    for (std::size_t i = 0; i < 2; ++i) {
      const std::size_t j = i * Plant::joints / 2;
      const double e = contact_.stops->restitution;
      if (theta[j] >= contact_.stops->upper[i])
        row_[rows_++] = {j, -inf, 0.0, e * std::max(w[j], 0.0), false, {}, 0.0};
      if (theta[j] <= contact_.stops->lower[i])
        row_[rows_++] = {j, 0.0, inf, e * std::min(w[j], 0.0), false, {}, 0.0};
    }
  }

  /// Projected Gauss-Seidel over the rows. Returns the work of the impulses.
  double resolve(const Angles& angle, const Angles& before, Angles& after) {
    const Sys& s = *system_;
    double scale = 0.0;
    for (std::size_t i = 0; i < rows_; ++i) {
      Joints unit{};
      unit[row_[i].joint] = 1.0;
      row_[i].response = s.plant().response(angle, unit);
    }
    for (const double v : Plant::joint_rates(after)) scale = std::max(scale, std::abs(v));
    constexpr int most_sweeps = 1000;
    for (int sweep = 0; sweep < most_sweeps; ++sweep) {
      double change = 0.0;
      for (std::size_t i = 0; i < rows_; ++i) {
        Row& r = row_[i];
        const double yields = Plant::joint_rates(r.response)[r.joint];
        if (!(yields > 0.0)) continue;  // held by the others already
        const double w = Plant::joint_rates(after)[r.joint] + r.rebound;
        const double next = std::clamp(r.impulse - w / yields, r.lower, r.upper), delta = next - r.impulse;
        if (delta == 0.0) continue;
        r.impulse = next;
        for (std::size_t k = 0; k < after.size(); ++k) after[k] += delta * r.response[k];
        change = std::max(change, std::abs(delta * yields));
      }
      if (change <= 1e-17 * scale) break;
    }
    settle(scale, after);
    double work = 0.0;
    const Joints w0 = Plant::joint_rates(before), w1 = Plant::joint_rates(after);
    for (std::size_t i = 0; i < rows_; ++i)
      work += row_[i].impulse * 0.5 * (w0[row_[i].joint] + w1[row_[i].joint]);
    return work;
  }

  /// What sticks rests exactly. Two independent joints at rest hold a mechanism of two degrees of freedom.
  void settle(double scale, Angles& after) const {
    const auto rows = std::span(row_).first(rows_);
    const auto stuck = std::ranges::count_if(rows, &Row::sticks);
    if (stuck == 0) return;
    const Joints w = Plant::joint_rates(after);
    double left = 0.0;
    for (const double v : w) left = std::max(left, std::abs(v));
    if (stuck >= 2 && left <= 1e-9 * scale) {
      after.fill(0.0);
      return;
    }
    if constexpr (Plant::joints == 2) {  // joint rates are free coordinates of the arm
      Joints kept = w;
      for (const Row& r : rows) {
        if (r.sticks()) kept[r.joint] = 0.0;
      }
      after = {kept[0], kept[0] + kept[1]};
    }
  }

  const Sys* system_;
  SetValued contact_;
  std::array<Row, most_rows> row_{};
  std::size_t rows_ = 0;
};

}  // namespace esmc::host
