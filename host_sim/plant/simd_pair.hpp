#pragma once
/// Two doubles side by side: one instruction for both legs of a 5R (SSE2, NEON), with the bits of a double.

#include <array>
#include <cmath>
#include <cstdint>

#include "firmware/mechanism/params.hpp"
#include "firmware/numeric/elementary.hpp"

namespace esmc::host {
using Double2 = double __attribute__((vector_size(16)));
}  // namespace esmc::host

namespace esmc::ieee {
/// Defined in simd_pair.cpp: gcc would load one half of a known constant and double it at every use.
/// Hidden: position-independent code would look for their addresses in a table.
template <>
struct [[gnu::visibility("hidden")]] Constants<host::Double2> {
  using Real = double;
  using Bits = std::uint64_t __attribute__((vector_size(16)));
  static const host::Double2 kToInteger, kQuadrantsPerRadian;
  static const std::array<host::Double2, 3> kHalfPi;
  static const std::array<host::Double2, 6> kSine, kCosine;
};
}  // namespace esmc::ieee

namespace esmc::host {

/// Sine and cosine of an angle of any size, rad, by the C library; direction() takes the faster way within
/// the range of firmware/numeric (a day of turning). NaN where the angle is not finite.
[[nodiscard]] SinCos<double> sin_cos_any_range(double angle);
[[nodiscard]] SinCos<Double2> sin_cos_any_range(Double2 angle);

[[nodiscard]] inline SinCos<double> direction(double angle) {
  return std::fabs(angle) <= ieee::Constants<double>::kLargestAngle ? ieee::sin_cos_in_range(angle)
                                                                    : sin_cos_any_range(angle);
}
[[nodiscard]] inline SinCos<Double2> direction(Double2 angle) {
  constexpr double most = ieee::Constants<double>::kLargestAngle;
  const bool near = (std::fabs(angle[0]) <= most) & (std::fabs(angle[1]) <= most);
  return near ? ieee::sin_cos_in_range(angle) : sin_cos_any_range(angle);
}

/// Packs the parameters of legs a and b as [0] and [1] of each number. Both: Double2, or the like of another
/// S.
template <class Both, class S>
[[nodiscard]] LegParams<Both> side_by_side(const LegParams<S>& a, const LegParams<S>& b) {
  return {Both{a.l1, b.l1}, Both{a.l2, b.l2}, Both{a.lg1, b.lg1},       Both{a.lg2, b.lg2},
          Both{a.m1, b.m1}, Both{a.m2, b.m2}, Both{a.J1, b.J1},         Both{a.J2, b.J2},
          Both{a.d1, b.d1}, Both{a.d2, b.d2}, Both{a.gamma1, b.gamma1}, Both{a.gamma2, b.gamma2},
          Both{},           Both{},           Both{a.rotor2, b.rotor2}};
}

}  // namespace esmc::host
