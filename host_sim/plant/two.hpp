#pragma once
/// Two doubles side by side: the same operation on both legs of a 5R as one instruction (SSE2, which every x86-64
/// has, NEON). Each half has the bits that a double alone would have.

#include <array>
#include <cmath>
#include <cstdint>

#include "firmware/mechanism/params.hpp"
#include "firmware/numeric/elementary.hpp"

namespace esmc::host {
using Two = double __attribute__((vector_size(16)));
}  // namespace esmc::host

namespace esmc::ieee {
/// Out of the compiler's sight, in two.cpp: of a constant that it sees gcc loads one half and doubles it, at every
/// use.
template <>
struct Constants<host::Two> {
  using Real = double;
  using Bits = std::uint64_t __attribute__((vector_size(16)));
  static const host::Two kToInteger, kQuadrantsPerRadian;
  static const std::array<host::Two, 3> kHalfPi;
  static const std::array<host::Two, 6> kSine, kCosine;
};
}  // namespace esmc::ieee

namespace esmc::host {

/// Sine and cosine of a bar's angle. Beyond the range of firmware/numeric (a day of turning) the C library takes
/// over.
[[nodiscard]] SinCos<double> far_direction(double angle);
[[nodiscard]] SinCos<Two> far_direction(Two angle);

[[nodiscard]] inline SinCos<double> direction(double angle) {
  return std::fabs(angle) <= ieee::Constants<double>::kLargestAngle ? ieee::sin_cos_in_range(angle)
                                                                    : far_direction(angle);
}
[[nodiscard]] inline SinCos<Two> direction(Two angle) {
  constexpr double most = ieee::Constants<double>::kLargestAngle;
  const bool near = (std::fabs(angle[0]) <= most) & (std::fabs(angle[1]) <= most);
  return near ? ieee::sin_cos_in_range(angle) : far_direction(angle);
}

[[nodiscard]] inline LegParams<Two> side_by_side(const LegParams<double>& a, const LegParams<double>& b) {
  return {Two{a.l1, b.l1}, Two{a.l2, b.l2}, Two{a.lg1, b.lg1}, Two{a.lg2, b.lg2}, Two{a.m1, b.m1},
          Two{a.m2, b.m2}, Two{a.J1, b.J1}, Two{a.J2, b.J2},   Two{a.d1, b.d1},   Two{a.d2, b.d2},
          Two{a.gamma1, b.gamma1}, Two{a.gamma2, b.gamma2}};
}

}  // namespace esmc::host
