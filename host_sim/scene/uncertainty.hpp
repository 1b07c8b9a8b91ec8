#pragma once
/// [uncertainty]: intervals of the mechanism's parameters. Plain values.

#include <array>
#include <optional>

namespace esmc::host {

/// A closed interval, lower <= upper.
struct Interval {
  double lower = 0.0, upper = 0.0;
  friend bool operator==(const Interval&, const Interval&) = default;
};

/// Intervals of true parameters around those of the model; equal for both legs, except friction.
struct UncertaintyScene {
  Interval m1{1, 1}, m2{1, 1}, J1{1, 1}, J2{1, 1};  ///< true / assumed
  Interval lg1, lg2;                                ///< true - assumed, m
  Interval gravity{1, 1};                           ///< true / assumed
  Interval payload;                                 ///< point mass at the effector beyond the assumed one, kg
  /// Of the four joints (RR: the first two), N m s/rad and N m; unset: those of the model.
  std::optional<std::array<Interval, 4>> viscous, coulomb;
  /// Half widths of lengths, as shares of the assumed ones, for simulated plants only: no gain covers them.
  double l1 = 0.0, l2 = 0.0, half_base = 0.0;

  std::optional<double>
      tube;  ///< largest error of the independent coordinates: m (five_bar), rad (rr); unset: computed
  double reaching_time = 0.0;  ///< s, from the edge of the tube to the surface
  bool workspace = false;      ///< gains for every place of the workspace, not only for the reference
};

/// Friction of joint j; without given intervals what the controller believes.
[[nodiscard]] inline Interval interval_of(const std::optional<std::array<Interval, 4>>& given,
                                          const std::array<double, 4>& believed, std::size_t j) {
  return given ? (*given)[j] : Interval{believed[j], believed[j]};
}

}  // namespace esmc::host
