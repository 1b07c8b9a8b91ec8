#pragma once
/// Fixed-size vectors, matrices and lists of the whole project. Nothing here or below allocates.

#include <Eigen/Core>
#include <array>
#include <utility>

/// For the bodies of unrolled loops: a call would move their operands from registers to memory.
#define ESMC_INLINE __attribute__((always_inline))

/// The controller library.
namespace esmc {

template <class S, int N>
using Vec = Eigen::Matrix<S, N, 1>;

template <class S, int Rows, int Cols>
using Mat = Eigen::Matrix<S, Rows, Cols>;

template <class S>
using Vec2 = Vec<S, 2>;

/// std::array indexed by int, so that loops over joints and legs need no casts. No index is checked.
template <class T, int N>
struct List {
  std::array<T, static_cast<std::size_t>(N)> items;
  constexpr T& operator[](int i) { return items[static_cast<unsigned>(i)]; }
  constexpr const T& operator[](int i) const { return items[static_cast<unsigned>(i)]; }
};

/// Third component of a x b: the sine of the angle from a to b when both are unit vectors.
template <class S>
[[nodiscard]] constexpr S cross(const Vec2<S>& a, const Vec2<S>& b) {
  return a.x() * b.y() - a.y() * b.x();
}

/// `a` turned by +90 degrees.
template <class S>
[[nodiscard]] Vec2<S> perp(const Vec2<S>& a) {
  return Vec2<S>(-a.y(), a.x());
}

/// k a; for where gcc, in a large file, calls Eigen's constructor from a product.
template <class S>
[[nodiscard]] ESMC_INLINE inline Vec2<S> scaled(const Vec2<S>& a, S k) {
  return Vec2<S>(a.x() * k, a.y() * k);
}

/// Scalar product that adds x before y everywhere; Eigen may reorder its own.
template <class S>
[[nodiscard]] constexpr S dot(const Vec2<S>& a, const Vec2<S>& b) {
  return a.x() * b.x() + a.y() * b.y();
}

/// A sum that begins with its first term: a compiler that keeps the sign of zeros cannot leave out 0 + x. In
/// unrolled code `empty` is a constant and costs nothing.
template <class T>
class Sum {
 public:
  ESMC_INLINE void add(const T& x) {
    value_ = plus(x);
    empty_ = false;
  }
  ESMC_INLINE void subtract(const T& x) {
    value_ = empty_ ? T(-x) : T(value_ - x);
    empty_ = false;
  }
  [[nodiscard]] ESMC_INLINE T plus(const T& x) const { return empty_ ? x : T(value_ + x); }  ///< sum + x
  [[nodiscard]] bool empty() const { return empty_; }  ///< nothing was added
  /// The sum; undefined while empty.
  [[nodiscard]] const T& value() const { return value_; }

 private:
  T value_;
  bool empty_ = true;
};

/// Calls f(integral_constant<int, 0>) .. f(integral_constant<int, N-1>): a loop whose index is a constant.
template <int N, class F>
ESMC_INLINE constexpr void unroll(F&& f) {
  [&]<int... I>(std::integer_sequence<int, I...>) ESMC_INLINE { (f(std::integral_constant<int, I>{}), ...); }
  (std::make_integer_sequence<int, N>{});
}

}  // namespace esmc
