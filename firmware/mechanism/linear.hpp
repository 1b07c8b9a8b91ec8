#pragma once
/// Small dense systems, of a size fixed at compile time.

#include <cmath>

#include "firmware/types.hpp"

namespace esmc {

/// Solves A x = b by elimination with row pivoting; x replaces b. The smallest pivot, or 0 where one vanishes
/// or is not a number: then b is of no use.
template <class S, int N>
[[nodiscard]] S solve(Mat<S, N, N> A, Vec<S, N>& b) {
  S smallest = S(0);
  for (int k = 0; k < N; ++k) {
    int best = k;
    for (int i = k + 1; i < N; ++i) {
      if (std::fabs(A(i, k)) > std::fabs(A(best, k))) best = i;
    }
    const S pivot = std::fabs(A(best, k));
    if (!(pivot > S(0))) return S(0);
    if (k == 0 || pivot < smallest) smallest = pivot;
    for (int j = k; j < N; ++j) {
      const S moved = A(k, j);
      A(k, j) = A(best, j);
      A(best, j) = moved;
    }
    const S right = b[k];
    b[k] = b[best];
    b[best] = right;
    for (int i = k + 1; i < N; ++i) {
      const S f = A(i, k) / A(k, k);
      for (int j = k + 1; j < N; ++j) A(i, j) -= f * A(k, j);
      b[i] -= f * b[k];
    }
  }
  for (int k = N - 1; k >= 0; --k) {
    for (int j = k + 1; j < N; ++j) b[k] -= A(k, j) * b[j];
    b[k] /= A(k, k);
  }
  return smallest;
}

}  // namespace esmc
