#pragma once
/// N doubles side by side as one scalar type: the templates of firmware and plant compute N mechanisms at
/// once, each with the bits it has alone, as only operations that IEEE 754 rounds exactly are used, in the
/// same order.
///
/// `Tag` is a type of the file that is compiled for some instruction set, so that no two files define the
/// same function for the linker to choose from.
///
/// An `if` on a comparison of lanes is never taken. The lanes in which it should have been are noted in
/// `stray`; the computation goes on, and its results in those lanes are invalid.

#include <array>
#include <bit>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <type_traits>

#include "firmware/numeric/elementary.hpp"

#if defined(__AVX512F__) || defined(__AVX2__)
#include <immintrin.h>
#endif

namespace esmc::host {

/// Functions that are taken lane by lane where they need their rare branches, or always.
enum class EachLane { arc_tangent2, angle_of_unit, wrap_to_pi, hyperbolic_tangent };
/// Calls f for n lanes: out[i] = f(a[i], b[i]), or f(a[i]). Compiled for every processor.
void each_lane(EachLane f, const double* a, const double* b, double* out, int n);

/// N numbers as vectors of gcc and clang.
template <int N>
struct LaneVectors {
  using Reals [[gnu::vector_size(8 * N)]] = double;
  using Masks [[gnu::vector_size(8 * N)]] = std::int64_t;
  using Bits [[gnu::vector_size(8 * N)]] = std::uint64_t;
};

template <int N, class Tag>
struct LaneBits {
  using V = typename LaneVectors<N>::Bits;
  V v;
  LaneBits() = default;
  LaneBits(V x) : v(x) {}                    // NOLINT(google-explicit-constructor)
  LaneBits(std::uint64_t x) : v(V{} + x) {}  // NOLINT(google-explicit-constructor)
  friend LaneBits operator^(LaneBits a, LaneBits b) { return V(a.v ^ b.v); }
  friend LaneBits operator&(LaneBits a, LaneBits b) { return V(a.v & b.v); }
  friend LaneBits operator|(LaneBits a, LaneBits b) { return V(a.v | b.v); }
  friend LaneBits operator+(LaneBits a, LaneBits b) { return V(a.v + b.v); }
  friend LaneBits operator-(LaneBits a, LaneBits b) { return V(a.v - b.v); }
  friend LaneBits operator<<(LaneBits a, int n) { return V(a.v << static_cast<std::uint64_t>(n)); }
  friend LaneBits operator>>(LaneBits a, int n) { return V(a.v >> static_cast<std::uint64_t>(n)); }
};

/// Whether masks of N lanes are the bits of a mask register, which makes their logic nearly free; else all
/// bits of a lane, or none, say so.
template <int N>
inline constexpr bool mask_register =
#ifdef __AVX512DQ__
    N == 8;
#else
    false;
#endif

/// A truth per lane.
template <int N, class Tag>
struct LaneMask {
  using V = std::conditional_t<mask_register<N>, std::uint8_t, typename LaneVectors<N>::Masks>;
  V v;
  LaneMask() = default;
  template <std::same_as<V> T>  // and no bool
  LaneMask(T x) : v(x) {}       // NOLINT(google-explicit-constructor)
  explicit LaneMask(bool all) : v(V(V{} - (all ? 1 : 0))) {}
  friend LaneMask operator!(LaneMask a) { return V(~a.v); }
  friend LaneMask operator&&(LaneMask a, LaneMask b) { return V(a.v & b.v); }
  friend LaneMask operator||(LaneMask a, LaneMask b) { return V(a.v | b.v); }
  /// Whether the mask is false in every lane; marks no lane as stray.
  friend bool none(LaneMask a) {
    if constexpr (mask_register<N>) {
      return a.v == 0;
    } else {
#ifdef __AVX2__
      if constexpr (N == 4) return _mm256_testz_si256((__m256i)a.v, (__m256i)a.v) != 0;
#endif
      std::int64_t some = 0;
      for (int i = 0; i < N; ++i) some |= a.v[i];
      return some == 0;
    }
  }
  [[nodiscard]] bool operator[](int i) const {
    if constexpr (mask_register<N>) {
      return (v >> i & 1) != 0;
    } else {
      return v[i] != 0;
    }
  }

  /// Lanes in which an `if` should have been taken since this was last cleared.
  static inline thread_local constinit V stray{};
  explicit operator bool() const {
    stray = V(stray | v);
    return false;
  }
};

template <int N, class Tag>
struct Lanes {
  using V = typename LaneVectors<N>::Reals;
  using Mask = LaneMask<N, Tag>;
  using Bits = LaneBits<N, Tag>;
  static constexpr int count = N;
  static constexpr std::size_t size = N;
  V v;

  Lanes() = default;
  Lanes(V x) : v(x) {}             // NOLINT(google-explicit-constructor)
  Lanes(double x) : v(x - V{}) {}  // NOLINT(google-explicit-constructor): x - 0 is x, that of -0 included
  explicit Lanes(Mask m) : v(choose(m, Lanes(1.0), Lanes(0.0)).v) {}
  /// Reads (store: writes) N doubles, one per lane; any alignment.
  [[nodiscard]] static Lanes load(const double* from) {
    Lanes out;
    for (int i = 0; i < N; ++i) out.v[i] = from[i];
    return out;
  }
  void store(double* to) const {
    for (int i = 0; i < N; ++i) to[i] = v[i];
  }
  [[nodiscard]] double operator[](int i) const { return v[i]; }

  friend Lanes operator-(Lanes a) { return V(-a.v); }
  friend Lanes operator+(Lanes a, Lanes b) { return V(a.v + b.v); }
  friend Lanes operator-(Lanes a, Lanes b) { return V(a.v - b.v); }
  friend Lanes operator*(Lanes a, Lanes b) { return V(a.v * b.v); }
  friend Lanes operator/(Lanes a, Lanes b) { return V(a.v / b.v); }
  Lanes& operator+=(Lanes b) { return *this = *this + b; }
  Lanes& operator-=(Lanes b) { return *this = *this - b; }
  Lanes& operator*=(Lanes b) { return *this = *this * b; }
  Lanes& operator/=(Lanes b) { return *this = *this / b; }
  friend Mask operator<(Lanes a, Lanes b) { return mask<less>(a, b, a.v < b.v); }
  friend Mask operator<=(Lanes a, Lanes b) { return mask<less_equal>(a, b, a.v <= b.v); }
  friend Mask operator>(Lanes a, Lanes b) { return mask<greater>(a, b, a.v > b.v); }
  friend Mask operator>=(Lanes a, Lanes b) { return mask<greater_equal>(a, b, a.v >= b.v); }
  friend Mask operator==(Lanes a, Lanes b) { return mask<equal>(a, b, a.v == b.v); }
  friend Mask operator!=(Lanes a, Lanes b) { return mask<unequal>(a, b, a.v != b.v); }
  /// Value of lane 0; for numbers that are the same in all lanes.
  explicit operator std::uint32_t() const { return static_cast<std::uint32_t>(v[0]); }

  friend Lanes choose(Mask c, Lanes yes, Lanes no) {
#ifdef __AVX512DQ__
    if constexpr (mask_register<N>)
      return V(_mm512_mask_blend_pd(c.v, (__m512d)no.v, (__m512d)yes.v));
    else
#endif
    {
      using B = typename Mask::V;
      return std::bit_cast<V>(B((std::bit_cast<B>(yes.v) & c.v) | (std::bit_cast<B>(no.v) & ~c.v)));
    }
  }
  friend Lanes magnitude(Lanes a) { return from(bits_of(a) & ~sign_bit); }
  friend Lanes abs(Lanes a) { return magnitude(a); }
  /// The larger one; a for a NaN in either: that makes its lane stray elsewhere.
  friend Lanes larger(Lanes a, Lanes b) { return choose(b > a, b, a); }
  friend Lanes square_root(Lanes a) {
#ifdef __AVX512F__
    if constexpr (N == 8) return V(_mm512_mask_sqrt_pd((__m512d)a.v, 0xFF, (__m512d)a.v));
#endif
#ifdef __AVX2__
    if constexpr (N == 4) return V(_mm256_sqrt_pd((__m256d)a.v));
#endif
    Lanes out;
    for (int i = 0; i < N; ++i) out.v[i] = __builtin_sqrt(a.v[i]);
    return out;
  }

  // ---- firmware/numeric, for several: the same operations, and selections where there are branches ----
  friend SinCos<Lanes> sin_cos(Lanes angle) {
    (void)static_cast<bool>(!(magnitude(angle) <= Lanes(ieee::Constants<double>::kLargestAngle)));
    return ieee::sin_cos_in_range(angle);
  }
  friend Lanes arc_tangent2(Lanes y, Lanes x) {
    using C = ieee::Constants<double>;
    const Bits ay = bits_of(y) & ~sign_bit, ax = bits_of(x) & ~sign_bit;
    const Bits steep = (ax - ay) & Bits(sign_bit);  // ay > ax: neither has the bit
    const Mask is_steep = sign_mask(steep);
    const Lanes large = choose(is_steep, from(ay), from(ax)), small = choose(is_steep, from(ax), from(ay));
    if (!none(!(large >= Lanes(1.0 / C::kSafe) && large <= Lanes(C::kSafe)))) [[unlikely]]
      return each(EachLane::arc_tangent2, y, x);
    const Mask one = small > 0.71875 * large, half = small > 0.2578125 * large;
    const Lanes above = choose(one, small - large, choose(half, small - 0.5 * large, small));
    const Lanes below = choose(one, large + small, choose(half, large + 0.5 * small, large));
    const Lanes t = above / below;
    const Lanes z = t * t;
    const Lanes turn = t - t * z * ieee::horner(z, C::kAtan);
    const Bits left = bits_of(x) & Bits(sign_bit);
    // The row of C::kAtanCentre: 0 to 2 for the centre, 3 more where it is steep, 6 more to the left.
    const Bits row = ones(one) + ones(half) + ((steep >> 63) + ((steep >> 62) & Bits(2))) +
                     ((left >> 62) & Bits(2)) + ((left >> 61) & Bits(4));
    const Lanes angle = entry(heads, row) + (entry(tails, row) + from(bits_of(turn) ^ left ^ steep));
    return from(bits_of(angle) ^ (bits_of(y) & Bits(sign_bit)));
  }
  friend Lanes angle_of_unit(Lanes y, Lanes x) {
    const Mask near = magnitude(y) <= Lanes(ieee::Constants<double>::kAsinReach), ahead = x > Lanes(0.0);
    if (none(!near) && none(!ahead)) [[likely]]
      return ieee::arc_sine_in_reach(y);
    return each(EachLane::angle_of_unit, y, x);
  }
  struct SinCosPair {
    std::array<Lanes, 2> sin, cos;
  };
  friend SinCosPair sin_cos(const std::array<Lanes, 2>& angle) {
    const SinCos<Lanes> a = sin_cos(angle[0]), b = sin_cos(angle[1]);
    return {{a.sin, b.sin}, {a.cos, b.cos}};
  }
  friend Lanes wrap_to_pi(Lanes angle) {
    constexpr double pi = ieee::Constants<double>::kPi.head;
    if (none(!(angle > Lanes(-pi) && angle <= Lanes(pi)))) [[likely]]
      return angle;
    return each(EachLane::wrap_to_pi, angle, angle);
  }
  friend Lanes hyperbolic_tangent(Lanes x) { return each(EachLane::hyperbolic_tangent, x, x); }

  // ---- firmware/control/reaching.hpp ----
  friend Lanes sign_of(Lanes s) {
    return choose(s > Lanes(0.0), Lanes(1.0), choose(s < Lanes(0.0), Lanes(-1.0), s));
  }
  friend Lanes saturated(Lanes s, Lanes layer) {
    return choose(s > layer, Lanes(1.0), choose(s < -layer, Lanes(-1.0), s / layer));
  }

 private:
  static constexpr std::uint64_t sign_bit = std::uint64_t{1} << 63U;
  enum Comparison { equal = 0, less = 1, less_equal = 2, unequal = 4, greater_equal = 13, greater = 14 };
  template <Comparison c, class Vectors>
  static Mask mask([[maybe_unused]] Lanes a, [[maybe_unused]] Lanes b, [[maybe_unused]] Vectors compared) {
#ifdef __AVX512DQ__
    if constexpr (mask_register<N>)
      return _mm512_cmp_pd_mask((__m512d)a.v, (__m512d)b.v, c);
    else
#endif
      return std::bit_cast<typename Mask::V>(compared);
  }
  /// Where the sign bit is set; `b` has no other.
  static Mask sign_mask(Bits b) {
#ifdef __AVX512DQ__
    if constexpr (mask_register<N>)
      return _mm512_movepi64_mask((__m512i)b.v);
    else
#endif
      return std::bit_cast<typename Mask::V>(b.v != 0U);
  }
  /// 1 where m is true, else 0.
  static Bits ones(Mask m) {
#ifdef __AVX512DQ__
    if constexpr (mask_register<N>)
      return typename Bits::V(_mm512_maskz_set1_epi64(m.v, 1));
    else
#endif
      return std::bit_cast<typename Bits::V>(-m.v);
  }
  /// C::kAtanCentre, its heads and its tails.
  static constexpr std::size_t rows = 16;
  template <double ieee::Split<double>::*part>
  static constexpr std::array<double, rows> column() {
    std::array<double, rows> out{};
    for (std::size_t i = 0; i < ieee::Constants<double>::kAtanCentre.size(); ++i)
      out[i] = ieee::Constants<double>::kAtanCentre[i].*part;
    return out;
  }
  alignas(64) static constexpr std::array<double, rows> heads = column<&ieee::Split<double>::head>();
  alignas(64) static constexpr std::array<double, rows> tails = column<&ieee::Split<double>::tail>();
  static Lanes entry(const std::array<double, rows>& table, Bits row) {
#ifdef __AVX512F__
    if constexpr (N == 8) {
      const __m512d low = _mm512_load_pd(&table[0]), high = _mm512_load_pd(&table[8]);
      return V(_mm512_permutex2var_pd(low, (__m512i)row.v, high));
    }
#endif
#ifdef __AVX2__
    if constexpr (N == 4) return V(_mm256_i64gather_pd(&table[0], (__m256i)row.v, 8));
#endif
    Lanes out;
    for (int i = 0; i < N; ++i) out.v[i] = table[static_cast<std::size_t>(row.v[i])];
    return out;
  }
  [[gnu::noinline]] static Lanes each(EachLane f, Lanes a, Lanes b) {
    std::array<double, size> first{}, second{};
    a.store(first.data());
    b.store(second.data());
    each_lane(f, first.data(), second.data(), first.data(), N);
    return load(first.data());
  }
  static Bits bits_of(Lanes a) { return std::bit_cast<typename Bits::V>(a.v); }
  static Lanes from(Bits b) { return std::bit_cast<V>(b.v); }
};

/// The two legs of N mechanisms: [0] and [1].
template <class L>
struct BothLegs {
  L leg[2];  // NOLINT(*-avoid-c-arrays): braces around it would be wanted everywhere
  [[nodiscard]] const L& operator[](int i) const { return leg[i]; }

  friend BothLegs operator-(const BothLegs& a) { return {-a[0], -a[1]}; }
  friend BothLegs operator+(const BothLegs& a, const BothLegs& b) { return {a[0] + b[0], a[1] + b[1]}; }
  friend BothLegs operator-(const BothLegs& a, const BothLegs& b) { return {a[0] - b[0], a[1] - b[1]}; }
  friend BothLegs operator*(const BothLegs& a, const BothLegs& b) { return {a[0] * b[0], a[1] * b[1]}; }
  friend BothLegs operator+(const BothLegs& a, L b) { return {a[0] + b, a[1] + b}; }
  friend BothLegs operator*(L a, const BothLegs& b) { return {a * b[0], a * b[1]}; }
  friend BothLegs operator*(const BothLegs& a, L b) { return {a[0] * b, a[1] * b}; }
  friend BothLegs operator/(L a, const BothLegs& b) { return {a / b[0], a / b[1]}; }
  friend SinCos<BothLegs> direction(const BothLegs& angle) {
    const SinCos<L> a = sin_cos(angle[0]), b = sin_cos(angle[1]);
    return {{a.sin, b.sin}, {a.cos, b.cos}};
  }
};

}  // namespace esmc::host

template <int N, class Tag>
struct esmc::ieee::Constants<esmc::host::Lanes<N, Tag>> : esmc::ieee::Constants<double> {
  using Bits = esmc::host::LaneBits<N, Tag>;
};
