#pragma once
/// Forward-mode differentiation by dual numbers, and dense elimination: the tools of the oracle in
/// lagrange.hpp. Nothing here or there includes or uses firmware/.

#include <array>
#include <cmath>
#include <cstddef>
#include <type_traits>
#include <utility>

namespace esmc::test {

using Real = long double;

/// v + d eps, eps^2 = 0. Nest it for higher derivatives: Dual<Dual<Real>> holds two directions and their
/// mixed second derivative in d.d.
template <class T>
struct Dual {
  T v{};
  T d{};

  Dual() = default;
  Dual(const T& value, const T& derivative) : v(value), d(derivative) {}
  template <class C>
  requires std::is_arithmetic_v<C> Dual(C constant) : v(static_cast<Real>(constant)), d(Real(0)) {}

  friend Dual operator-(const Dual& a) { return {-a.v, -a.d}; }
  friend Dual operator+(const Dual& a, const Dual& b) { return {a.v + b.v, a.d + b.d}; }
  friend Dual operator-(const Dual& a, const Dual& b) { return {a.v - b.v, a.d - b.d}; }
  friend Dual operator*(const Dual& a, const Dual& b) { return {a.v * b.v, a.v * b.d + a.d * b.v}; }
  Dual& operator+=(const Dual& b) { return *this = *this + b; }
};

inline Real sine(Real x) { return std::sin(x); }
inline Real cosine(Real x) { return std::cos(x); }
template <class T>
Dual<T> sine(const Dual<T>& x);
template <class T>
Dual<T> cosine(const Dual<T>& x) {
  return {cosine(x.v), -(sine(x.v) * x.d)};
}
template <class T>
Dual<T> sine(const Dual<T>& x) {
  return {sine(x.v), cosine(x.v) * x.d};
}

template <std::size_t N>
using Row = std::array<Real, N>;
template <std::size_t N>
using Square = std::array<Row<N>, N>;

/// q + eps qd, and q + eps1 qd + eps2 qd + eps1 eps2 qdd: the second differentiates twice along a motion.
template <class T, std::size_t N>
std::array<Dual<T>, N> along(const std::array<T, N>& q, const std::array<T, N>& qd) {
  std::array<Dual<T>, N> out;
  for (std::size_t i = 0; i < N; ++i) out[i] = {q[i], qd[i]};
  return out;
}
template <std::size_t N>
std::array<Dual<Dual<Real>>, N> along(const Row<N>& q, const Row<N>& a, const Row<N>& b, const Row<N>& ab) {
  std::array<Dual<Dual<Real>>, N> out;
  for (std::size_t i = 0; i < N; ++i) out[i] = {{q[i], b[i]}, {a[i], ab[i]}};
  return out;
}

/// A x = b by Gaussian elimination with scaled partial pivoting.
template <std::size_t N>
Row<N> eliminate(Square<N> A, Row<N> b) {
  Row<N> scale{};
  for (std::size_t i = 0; i < N; ++i) {
    for (std::size_t j = 0; j < N; ++j) scale[i] = std::fmax(scale[i], std::fabs(A[i][j]));
  }
  for (std::size_t k = 0; k < N; ++k) {
    std::size_t best = k;
    for (std::size_t i = k + 1; i < N; ++i) {
      if (std::fabs(A[i][k]) * scale[best] > std::fabs(A[best][k]) * scale[i]) best = i;
    }
    std::swap(A[k], A[best]);
    std::swap(b[k], b[best]);
    std::swap(scale[k], scale[best]);
    for (std::size_t i = k + 1; i < N; ++i) {
      const Real f = A[i][k] / A[k][k];
      for (std::size_t j = k; j < N; ++j) A[i][j] -= f * A[k][j];
      b[i] -= f * b[k];
    }
  }
  for (std::size_t k = N; k-- > 0;) {
    for (std::size_t j = k + 1; j < N; ++j) b[k] -= A[k][j] * b[j];
    b[k] /= A[k][k];
  }
  return b;
}

}  // namespace esmc::test
