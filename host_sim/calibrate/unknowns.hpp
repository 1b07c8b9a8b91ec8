#pragma once
/// The unknowns of a calibration, and the readings that speak of them.

#include <array>
#include <complex>

#include "host_sim/least_squares.hpp"

namespace esmc::host {

/// Entry i of a vector of unknowns. An RR arm has neither the half base nor leg 2.
enum Unknown : int {
  unknown_l0,
  unknown_l11,
  unknown_l12,
  unknown_l21,
  unknown_l22,  // m
  unknown_o11,
  unknown_o12,
  unknown_o21,
  unknown_o22,  // rad, to be added to the readings of the encoders
  unknown_fx,
  unknown_fy,
  unknown_fa,  // frame of the effector readings: origin in the base frame, m, and angle, rad
  unknowns
};
using Unknowns = Vector;  ///< `unknowns` entries

/// Name of an unknown, 0 .. unknowns - 1: "half_base", "leg 1 l1", "offset theta11", ...
[[nodiscard]] const char* name_of(int unknown, bool five_bar);
[[nodiscard]] constexpr bool is_length(int unknown) { return unknown <= unknown_l22; }
/// "m" or "rad".
[[nodiscard]] constexpr const char* unit_of(int unknown) {
  return is_length(unknown) || unknown == unknown_fx || unknown == unknown_fy ? "m" : "rad";
}

/// theta11, theta12, theta21, theta22 as measured, rad; RR: the first two.
using MeasuredAngles = std::array<double, 4>;
/// A position of the effector from another instrument, and the encoders' angles at that instant.
struct EffectorReading {
  MeasuredAngles angle{};
  double x = 0.0, y = 0.0;  ///< m
};

}  // namespace esmc::host
