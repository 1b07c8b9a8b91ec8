#pragma once
/// Factors of a small symmetric positive definite matrix, unrolled. Not Eigen's LLT: with two solutions each,
/// 2 x 2 takes that 15 ns and this 4 ns, 4 x 4 258 and 46, 6 x 6 464 and 179.

#include "firmware/types.hpp"

namespace esmc::host {

/// L D L^T of an N x N matrix, of which the lower triangle is read.
template <int N>
class Ldlt {
 public:
  using Matrix = Mat<double, N, N>;
  using Vector = Vec<double, N>;

  Ldlt() = default;
  explicit Ldlt(const Matrix& s) {
    unroll<N>([&](auto j) {
      double pivot = s.coeff(j, j);
      Vector scaled;  // row j of L times D
      unroll<j>([&](auto k) {
        scaled[k] = l_[j][k] * d_[k];
        pivot -= scaled[k] * l_[j][k];
      });
      d_[j] = pivot;
      inverse_[j] = 1.0 / pivot;
      unroll<N - 1 - j>([&](auto below) {
        constexpr int i = j + 1 + below;
        double v = s.coeff(i, j);
        unroll<j>([&](auto k) { v -= l_[i][k] * scaled[k]; });
        l_[i][j] = v * inverse_[j];
      });
    });
  }

  /// Entry i of D: the diagonal entry less its share in the rows before. Not positive or NaN: singular.
  [[nodiscard]] double pivot(int i) const { return d_[i]; }

  /// x of S x = b; not finite where a pivot is 0.
  [[nodiscard]] Vector solve(Vector b) const {
    unroll<N>([&](auto i) { unroll<i>([&](auto k) { b[i] -= l_[i][k] * b[k]; }); });
    unroll<N>([&](auto i) { b[i] *= inverse_[i]; });
    unroll<N>([&](auto up) {
      constexpr int i = N - 1 - up;
      unroll<up>([&](auto k) { b[i] -= l_[i + 1 + k][i] * b[i + 1 + k]; });
    });
    return b;
  }

 private:
  List<List<double, N>, N> l_{};  // below the diagonal
  Vector d_, inverse_;
};

}  // namespace esmc::host
