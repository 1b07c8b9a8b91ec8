#pragma once
/// Sine, cosine, arc sine, arc tangent and hyperbolic tangent in float and double, the same bits on every
/// target.
///
/// The C library's versions differ between host and boards. These use only operations that IEEE 754 rounds
/// exactly (+ - * / sqrt) and bit moves, so gcc, clang, x86 and ARM agree bit for bit, except in the bits of
/// a NaN. Build with -ffp-contract=off and without fast-math; the FPU must round to nearest and keep
/// subnormals.
///
/// Largest errors in ulp of the exact result, asserted by tests/unit/elementary_test.cpp:
///   sin_cos 0.9; wrap_to_pi 0.6, and 1.3 where the result is pi because no number is closer to -pi;
///   in float both have 2^-53 |angle| more, which shows only next to the zeros of the result;
///   arc_tangent2 1.7; angle_of_unit 2.4; hyperbolic_tangent 1.8.
///
/// The functions take float and double only. Templates over other scalar types call them unqualified, so that
/// such a type can bring its own.
///
/// Every fitted or split constant below is printed by tests/symbolic/elementary_coefficients.py.

#include <array>
#include <bit>
#include <cfloat>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <limits>

static_assert(FLT_EVAL_METHOD == 0 || FLT_EVAL_METHOD == 16, "float and double need their own precision");
#ifdef __FAST_MATH__
#error "elementary.hpp depends on the order of floating-point operations"
#endif

namespace esmc {

/// Scalars that the functions below take.
template <class S>
concept BinaryFloat = std::same_as<S, float> || std::same_as<S, double>;

/// Sine and cosine of one angle.
template <class S>
struct SinCos {
  S sin, cos;
};

namespace ieee {

/// c0 + z (c1 + z (c2 + ...)). Overlapping shorter chains took longer on x86, and rounded worse. V may be a
/// SIMD type.
template <std::size_t I = 0, class V, class S, std::size_t N>
[[nodiscard]] constexpr auto horner(V z, const std::array<S, N>& c) {
  if constexpr (I + 1 == N) {
    return c[I];
  } else {
    return c[I] + z * horner<I + 1>(z, c);
  }
}

/// An exact constant as the sum of two numbers.
template <class S>
struct Split {
  S head, tail;
};

/// Coefficients and limits of the functions below in the type S. Real: the type of one number; Bits: the
/// unsigned integer of its size. Specialised for float and double here, for SIMD types on the host.
template <class S>
struct Constants;

/// For float.
template <>
struct Constants<float> {
  using Real = float;
  using Bits = std::uint32_t;
  static constexpr float kToInteger = 0x1.8p23F;  // adding it leaves a rounded integer in the low bits

  static constexpr float kLargestAngle = 1e3F;  // at most 637 quadrants: 10 bits, and 14 in each part
  static constexpr float kQuadrantsPerRadian = 0x1.45f306p-1F;
  static constexpr std::array<float, 3> kHalfPi{0x1.9218p+0F, 0x1.ed5p-14F, 0x1.10b462p-30F};
  static constexpr Split<float> kPi{0x1.921fb6p+1F, -0x1.777a5cp-24F};

  static constexpr float kTanhIsOne = 10.0F;  // at most 29 steps of ln2 / 2: 5 bits, and 16 in the head
  static constexpr float kHalfOctavesPerUnit = 0x1.715476p+1F;
  static constexpr Split<float> kHalfLn2{0x1.62e4p-2F, 0x1.7f7d1cp-21F};

  static constexpr float kSafe = 0x1p+80F;  // numbers from 1 / kSafe to kSafe may be added and divided
  // clang-format off
  static constexpr std::array<Split<float>, 12> kAtanCentre{{
      {0.0F, 0.0F}, {0x1.dac67p-2F, 0x1.586ed4p-28F}, {0x1.921fb6p-1F, -0x1.777a5cp-26F},
      {0x1.921fb6p+0F, -0x1.777a5cp-25F}, {0x1.1b6e1ap+0F, -0x1.a28838p-25F}, {0x1.921fb6p-1F, -0x1.777a5cp-26F},
      {0x1.921fb6p+1F, -0x1.777a5cp-24F}, {0x1.56c6e8p+1F, -0x1.8d014ap-24F}, {0x1.2d97c8p+1F, -0x1.99bc5cp-28F},
      {0x1.921fb6p+0F, -0x1.777a5cp-25F}, {0x1.0468a8p+1F, 0x1.59c9bep-24F}, {0x1.2d97c8p+1F, -0x1.99bc5cp-28F}}};
  // clang-format on

  static constexpr std::array<float, 3> kSine{0x1.55554ep-3F, -0x1.110a74p-7F, 0x1.9a3f3ep-13F};
  static constexpr std::array<float, 3> kCosine{0x1.555552p-5F, -0x1.6c1174p-10F, 0x1.9b69a8p-16F};
  static constexpr std::array<float, 2> kTanh{0x1.55553cp-2F, -0x1.6af1c4p-6F};
  static constexpr std::array<float, 4> kAtan{0x1.555552p-2F, -0x1.999416p-3F, 0x1.2360ccp-3F,
                                              -0x1.94da74p-4F};
  static constexpr float kAsinReach = 0.7072F;  // beyond it the other component of a unit vector is within
  static constexpr std::array<float, 7> kAsin{0x1.55565ap-3F, 0x1.32dbp-4F,    0x1.78ce6ap-5F, 0x1.44b8cp-6F,
                                              0x1.0d2044p-4F, -0x1.328e92p-4F, 0x1.9bb344p-4F};
};

/// For double.
template <>
struct Constants<double> {
  using Real = double;
  using Bits = std::uint64_t;
  static constexpr double kToInteger = 0x1.8p52;

  static constexpr double kLargestAngle = 1e4;  // at most 6368 quadrants: 13 bits, and 40 in each part
  static constexpr double kQuadrantsPerRadian = 0x1.45f306dc9c883p-1;
  static constexpr std::array<double, 3> kHalfPi{0x1.921fb54442p+0, 0x1.a308d31318p-41,
                                                 0x1.8a2e03707344ap-81};
  static constexpr Split<double> kPi{0x1.921fb54442d18p+1, 0x1.1a62633145c07p-53};

  static constexpr double kTanhIsOne = 20.0;  // at most 58 steps of ln2 / 2: 6 bits, and 44 in the head
  static constexpr double kHalfOctavesPerUnit = 0x1.71547652b82fep+1;
  static constexpr Split<double> kHalfLn2{0x1.62e42fefa38p-2, 0x1.ef35793c7673p-46};

  static constexpr double kSafe = 0x1p+400;  // numbers from 1 / kSafe to kSafe may be added and divided
  // clang-format off
  static constexpr std::array<Split<double>, 12> kAtanCentre{{
      {0.0, 0.0}, {0x1.dac670561bb4fp-2, 0x1.a2b7f222f65e2p-56},
      {0x1.921fb54442d18p-1, 0x1.1a62633145c07p-55}, {0x1.921fb54442d18p+0, 0x1.1a62633145c07p-54},
      {0x1.1b6e192ebbe44p+0, 0x1.b1b466a88828ep-54}, {0x1.921fb54442d18p-1, 0x1.1a62633145c07p-55},
      {0x1.921fb54442d18p+1, 0x1.1a62633145c07p-53}, {0x1.56c6e7397f5aep+1, 0x1.660b64ece6f4bp-53},
      {0x1.2d97c7f3321d2p+1, 0x1.a79394c9e8a0ap-54}, {0x1.921fb54442d18p+0, 0x1.1a62633145c07p-54},
      {0x1.0468a8ace4df6p+1, 0x1.0620bf7406affp-55}, {0x1.2d97c7f3321d2p+1, 0x1.a79394c9e8a0ap-54}}};
  // clang-format on

  static constexpr std::array<double, 6> kSine{0x1.555555555554bp-3,  -0x1.111111110fdc3p-7,
                                               0x1.a01a019ccf433p-13, -0x1.71de362375954p-19,
                                               0x1.ae5eee577f3acp-26, -0x1.5dba5124b5baap-33};
  static constexpr std::array<double, 6> kCosine{0x1.5555555555553p-5,  -0x1.6c16c16c1626ep-10,
                                                 0x1.a01a019e744c8p-16, -0x1.27e4f95e26f22p-22,
                                                 0x1.1eeada74159e4p-29, -0x1.902cc893dc62p-37};
  static constexpr std::array<double, 5> kTanh{0x1.5555555555547p-2, -0x1.6c16c16bf8f65p-6,
                                               0x1.1566ab1fc457ap-9, -0x1.bbd493ed1fae2p-13,
                                               0x1.63abd4cabc72ep-16};
  static constexpr std::array<double, 8> kAtan{
      0x1.55555555553fcp-2, -0x1.9999999959456p-3, 0x1.249248ff018e8p-3, -0x1.c71c5b1a56a98p-4,
      0x1.74592b57356dfp-4, -0x1.3aac4aba54a16p-4, 0x1.0ac5675944ea1p-4, -0x1.75263223d0a69p-5};
  static constexpr double kAsinReach = 0.26;  // ahead only: so many terms as kAtan, and no division
  static constexpr std::array<double, 8> kAsin{
      0x1.555555555545fp-3, 0x1.33333333602fep-4, 0x1.6db6db3a6d9bdp-5, 0x1.f1c73a8b068aep-6,
      0x1.6e869b35c4e28p-6, 0x1.1ccd957f19f7ap-6, 0x1.bb22f3b3146e7p-7, 0x1.e9af2594f46a4p-7};
};

template <class S>
using BitsOf = typename Constants<S>::Bits;

/// The sign bit.
template <class S>
inline constexpr BitsOf<S> kSign = BitsOf<S>{1} << (sizeof(S) * 8 - 1);

/// Bit pattern of a number, sign first (IEEE 754); from_bits: the number of a pattern.
template <class S>
[[nodiscard]] constexpr BitsOf<S> bits(S value) {
  return std::bit_cast<BitsOf<S>>(value);
}

template <class S>
[[nodiscard]] constexpr S from_bits(BitsOf<S> pattern) {
  return std::bit_cast<S>(pattern);
}

/// angle - quadrants * pi / 2 as head - tail, the tail below the last place of the head. The products with
/// the first two parts of pi / 2 and the first subtraction are exact within kLargestAngle; the tail recovers
/// the rounding errors of the other steps, so the head may cancel down to its last bits.
template <class S>
[[nodiscard]] constexpr Split<S> minus_quadrants(S angle, S quadrants) {
  const auto& half_pi = Constants<S>::kHalfPi;
  const S first = angle - quadrants * half_pi[0];
  const S second = quadrants * half_pi[1];
  const S third = quadrants * half_pi[2];
  const S head = first - (second + third);
  return {head, third - ((first - head) - second)};
}

}  // namespace ieee

/// The square root, correctly rounded; NaN of a NaN and below zero.
template <BinaryFloat S>
[[nodiscard]] inline S square_root(S value) {
  return std::sqrt(value);
}
/// |value|, for any ordered scalar; NaN for a NaN.
template <class S>
[[nodiscard]] inline S magnitude(S value) {
  if constexpr (BinaryFloat<S>) {
    return std::fabs(value);
  } else {
    return value < S(0) ? -value : value;
  }
}

namespace ieee {

/// Sine and cosine of |angle| <= kLargestAngle, without a branch, so that several can share vector registers.
template <class S>
[[nodiscard]] inline SinCos<S> sin_cos_in_range(S angle) {
  using C = Constants<S>;
  using Real = typename C::Real;
  using Bits = BitsOf<Real>;
  const S shifted = angle * C::kQuadrantsPerRadian + C::kToInteger;
  const auto quadrant = bits(shifted);  // modulo 4; the constant added is a multiple of it
  const auto [r, tail] = minus_quadrants(angle, shifted - C::kToInteger);

  const S z = r * r;
  const S half = Real(0.5) * z;
  const S rough = Real(1) - half;
  // sin(r - tail) = r - r^3 (1/6 - ...) - tail cos r
  // cos(r - tail) = 1 - r^2 / 2 + r^4 (1/24 - ...) + tail sin r, r standing for sin r
  const S sine = r - (tail * rough + r * z * horner(z, C::kSine));
  // (1 - rough) - half is what rounding took from `rough`.
  const S cosine = rough + (((Real(1) - rough) - half) + (z * z * horner(z, C::kCosine) + r * tail));

  const auto s = bits(sine);
  const auto c = bits(cosine);
  const auto swap = (s ^ c) & (Bits{0} - (quadrant & Bits{1}));  // odd quadrants exchange the two
  constexpr int kToSign = static_cast<int>(sizeof(Real)) * 8 - 2;
  const auto sine_sign = (quadrant << kToSign) & kSign<Real>;
  const auto cosine_sign = ((quadrant + Bits{1}) << kToSign) & kSign<Real>;
  return {from_bits<S>(s ^ swap ^ sine_sign), from_bits<S>(c ^ swap ^ cosine_sign)};
}

}  // namespace ieee

/// Sine and cosine of `angle`, rad. Both NaN when |angle| > 1e4 (double), > 1e3 (float), or not finite.
template <BinaryFloat S>
[[nodiscard]] inline SinCos<S> sin_cos(S angle) {
  if (!(std::fabs(angle) <= ieee::Constants<S>::kLargestAngle)) {
    return {std::numeric_limits<S>::quiet_NaN(), std::numeric_limits<S>::quiet_NaN()};
  }
  return ieee::sin_cos_in_range(angle);
}

/// Sines and cosines of several angles, in the order of the angles.
template <BinaryFloat S, std::size_t N>
struct SinCosLanes {
  std::array<S, N> sin, cos;
};
/// sin_cos of every angle (rad): the same bits in less time. An angle out of range gives NaN for itself only.
template <BinaryFloat S, std::size_t N>
[[nodiscard]] inline SinCosLanes<S, N> sin_cos(const std::array<S, N>& angle) {
  SinCosLanes<S, N> out;
  for (std::size_t i = 0; i < N; ++i) {
    const SinCos<S> t = ieee::sin_cos_in_range(angle[i]);
    out.sin[i] = t.sin;
    out.cos[i] = t.cos;
  }
  for (std::size_t i = 0; i < N; ++i) {  // after all of them, so that those above share vector registers
    if (!(std::fabs(angle[i]) <= ieee::Constants<S>::kLargestAngle))
      out.sin[i] = out.cos[i] = std::numeric_limits<S>::quiet_NaN();
  }
  return out;
}

/// Direction of the vector (x, y), rad in [-pi, pi]; zeros and infinities as in C's atan2. NaN for a NaN.
template <BinaryFloat S>
[[nodiscard]] inline S arc_tangent2(S y, S x) {
  using C = ieee::Constants<S>;
  using Bits = ieee::BitsOf<S>;
  // Magnitudes compare as their patterns do; a NaN is the largest of them.
  constexpr Bits kMagnitude = static_cast<Bits>(~ieee::kSign<S>);
  const Bits ay = ieee::bits(y) & kMagnitude, ax = ieee::bits(x) & kMagnitude;
  const Bits steep = (ax - ay) & ieee::kSign<S>;  // ay > ax: neither has the bit
  const Bits most = steep != 0U ? ay : ax;
  S large = ieee::from_bits<S>(most);
  S small = ieee::from_bits<S>(steep != 0U ? ax : ay);
  constexpr Bits kFrom = ieee::bits(S(1) / C::kSafe), kTo = ieee::bits(C::kSafe);
  if (static_cast<Bits>(most - kFrom) > kTo - kFrom) {  // rare: keep the sums below in range
    if (large == S(0)) {
      large = S(1);
    } else if (large > std::numeric_limits<S>::max()) {
      small = small > std::numeric_limits<S>::max() ? S(1) : small * S(0);
      large = S(1);
    } else {
      const S factor = large < S(1) ? C::kSafe : S(1) / C::kSafe;
      large *= factor;
      small *= factor;
    }
  }
  // Less the arc tangent of a centre 0, 1/2 or 1, which leaves |t| < 0.258; `small - centre * large` is
  // exact, as the two are within a factor of two of each other. The first bound lies just beyond tan(1/4):
  // the sum below that cancels most then has a result twice as coarse.
  Bits row = 0;
  S t;
  if (small > S(0.71875) * large) {
    t = (small - large) / (large + small);
    row = 2;
  } else if (small > S(0.2578125) * large) {
    t = (small - S(0.5) * large) / (large + S(0.5) * small);
    row = 1;
  } else {
    t = small / large;
  }
  const S z = t * t;
  const S turn = t - t * z * ieee::horner(z, C::kAtan);

  // atan t is added to, or if mirrored subtracted from, the direction of the centre: rows 0 to 2 for x > 0, 3
  // to 5 from the y axis, 6 to 11 the same for x < 0.
  const Bits left = ieee::bits(x) & ieee::kSign<S>;
  constexpr int kTop = sizeof(S) * 8 - 1;
  row += (steep >> kTop) * 3U + (left >> kTop) * 6U;
  const ieee::Split<S>& centre = C::kAtanCentre[static_cast<std::size_t>(row)];
  const S angle = centre.head + (centre.tail + ieee::from_bits<S>(ieee::bits(turn) ^ left ^ steep));
  return ieee::from_bits<S>(ieee::bits(angle) ^ (ieee::bits(y) & ieee::kSign<S>));
}

namespace ieee {
/// Arc sine, rad, of |sine| <= kAsinReach, which is not checked. S may be a SIMD type.
template <class S>
[[nodiscard]] inline S arc_sine_in_reach(S sine) {
  const S z = sine * sine;
  return sine + sine * z * horner(z, Constants<S>::kAsin);
}
/// arc_tangent2, not inline: for the rare case.
template <class S>
[[nodiscard, gnu::noinline, gnu::cold]] S arc_tangent2_apart(S y, S x) {
  return arc_tangent2(y, x);
}
}  // namespace ieee

/// Direction of a unit vector (x, y), rad in [-pi, pi], in fewer operations than arc_tangent2 and without a
/// division: in float everywhere, in double within 15 degrees ahead. A relative error of the length is one of
/// the result. NaN when either is NaN.
template <BinaryFloat S>
[[nodiscard]] inline S angle_of_unit(S y, S x) {
  using C = ieee::Constants<S>;
  constexpr bool all_around = C::kAsinReach * C::kAsinReach > S(0.5);
  if (std::fabs(y) <= C::kAsinReach) {
    if (x > S(0)) return ieee::arc_sine_in_reach(y);
    if constexpr (all_around) {
      if (x < S(0)) return std::copysign(C::kPi.head, y) - ieee::arc_sine_in_reach(y);
    }
  } else if constexpr (all_around) {
    if (std::fabs(x) <= C::kAsinReach) {
      const S off = ieee::arc_sine_in_reach(x);
      if (y > S(0)) return S(0.5) * C::kPi.head - off;
      if (y < S(0)) return off - S(0.5) * C::kPi.head;
    }
  }
  return ieee::arc_tangent2_apart(y, x);
}

/// tanh x: odd, NaN for NaN, exactly +-1 from |x| = 19.1 (double) or 9.1 (float) on.
template <BinaryFloat S>
[[nodiscard]] inline S hyperbolic_tangent(S x) {
  using C = ieee::Constants<S>;
  using Bits = ieee::BitsOf<S>;
  using Limits = std::numeric_limits<S>;
  S a = std::fabs(x);
  a = a > C::kTanhIsOne ? C::kTanhIsOne : a;  // keeps NaN
  const S shifted = a * C::kHalfOctavesPerUnit + C::kToInteger;
  const S octaves = shifted - C::kToInteger;
  const S power = ieee::from_bits<S>((ieee::bits(shifted) + Bits{Limits::max_exponent - 1})
                                     << (Limits::digits - 1));  // 2^octaves

  // a = octaves * ln2 / 2 + r + lost: the first product is exact, `lost` is what the difference rounds off.
  // With h = r coth r - 1 the addition theorem gives
  //   tanh a = ((power - 1) (1 + h) + (power + 1) r) / ((power + 1) (1 + h) + (power - 1) r).
  // Taking `guess` out of the fraction, exactly, leaves a small one whose rounding errors hardly count.
  const S first = a - octaves * C::kHalfLn2.head;
  const S second = octaves * C::kHalfLn2.tail;
  const S r = first - second;
  const S lost = (first - r) - second;
  const S z = r * r;
  const S h = z * ieee::horner(z, C::kTanh);
  const S guess = S(0.25) * (octaves < S(4) ? octaves : S(4));
  const S grown = (S(1) - guess) * power;
  const S less = grown - (S(1) + guess);
  const S more = grown + (S(1) + guess);
  const S above = power + S(1);
  const S below = power - S(1);
  return std::copysign(
      guess + (less + (more * r + (more * lost + less * h))) / (above + (below * r + above * h)), x);
}

/// angle (rad) modulo a turn, in (-pi, pi], pi rounded to S; unchanged if it lies there. NaN when |angle| >
/// 1e4 (double), > 1e3 (float), or when it is not finite.
template <BinaryFloat S>
[[nodiscard]] inline S wrap_to_pi(S angle) {
  using C = ieee::Constants<S>;
  constexpr S kPi = C::kPi.head;
  if (angle > -kPi && angle <= kPi) {
    return angle;
  }
  if (!(std::fabs(angle) <= C::kLargestAngle)) {
    return std::numeric_limits<S>::quiet_NaN();
  }
  const S turns = (S(0.25) * C::kQuadrantsPerRadian * angle + C::kToInteger) - C::kToInteger;
  ieee::Split<S> rest = ieee::minus_quadrants(angle, S(4) * turns);
  if (std::fabs(rest.head - rest.tail) > kPi) {  // `turns` was rounded to the other side of the cut
    rest = ieee::minus_quadrants(angle, S(4) * (turns + std::copysign(S(1), rest.head)));
  }
  const S wrapped = rest.head - rest.tail;
  return wrapped > -kPi ? wrapped : kPi;
}

}  // namespace esmc
