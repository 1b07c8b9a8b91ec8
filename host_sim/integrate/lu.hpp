#pragma once
/// LU decomposition with partial pivoting in fixed storage. Not Eigen's PartialPivLU: with four solutions
/// each, 15 x 15 takes that 3.7 us and this 2.8 us (27 x 27: 14 and 11), and the digests of radau5 would
/// change.

#include <array>
#include <cmath>
#include <cstddef>
#include <utility>

namespace esmc::host {

template <std::size_t capacity>
class Lu {
 public:
  using Matrix = std::array<std::array<double, capacity>, capacity>;
  using Vector = std::array<double, capacity>;

  [[nodiscard]] Matrix& matrix() { return m_; }  ///< to be set before factor()

  /// Factors the leading n x n block, n <= capacity, in place. False: a pivot, or 1 / pivot, is 0 or not
  /// finite; solve must then not be used. Another entry that is not finite may remain unnoticed.
  [[nodiscard]] bool factor(std::size_t n) {
    for (std::size_t k = 0; k < n; ++k) {
      std::size_t best = k;
      for (std::size_t i = k + 1; i < n; ++i) {
        if (std::abs(m_[i][k]) > std::abs(m_[best][k])) best = i;
      }
      pivot_[k] = best;
      if (best != k) std::swap(m_[k], m_[best]);
      const double inverse = 1.0 / m_[k][k];
      if (!(std::isfinite(inverse) && inverse != 0.0)) return false;
      for (std::size_t i = k + 1; i < n; ++i) {
        const double f = m_[i][k] *= inverse;
        if (f == 0.0) continue;
        for (std::size_t j = k + 1; j < n; ++j) m_[i][j] -= f * m_[k][j];
      }
    }
    return true;
  }

  /// Replaces the right-hand side in x by the solution; n as in factor(), which must have returned true.
  void solve(std::size_t n, Vector& x) const {
    for (std::size_t k = 0; k < n; ++k) std::swap(x[k], x[pivot_[k]]);
    for (std::size_t i = 1; i < n; ++i) {
      for (std::size_t j = 0; j < i; ++j) x[i] -= m_[i][j] * x[j];
    }
    for (std::size_t i = n; i-- > 0;) {
      for (std::size_t j = i + 1; j < n; ++j) x[i] -= m_[i][j] * x[j];
      x[i] /= m_[i][i];
    }
  }

 private:
  Matrix m_{};
  std::array<std::size_t, capacity> pivot_{};
};

}  // namespace esmc::host
