#pragma once
/// Least squares for the estimations: Eigen's decompositions, compiled once for all of them, and the
/// covariance of an estimate whose residuals are correlated in time.

#include <Eigen/Core>

namespace esmc::host {

using Matrix = Eigen::MatrixXd;
using Vector = Eigen::VectorXd;

/// x that minimises |A x - b| (QR with column pivoting). Columns that depend on others get 0.
[[nodiscard]] Vector least_squares(const Matrix& A, const Vector& b);

/// Eigenvalues, ascending, and eigenvectors (columns, of length 1) of a symmetric matrix.
struct Modes {
  Vector value;
  Matrix vector;
};
[[nodiscard]] Modes symmetric_modes(const Matrix& S);

[[nodiscard]] Matrix product(const Matrix& A, const Matrix& B);  ///< A B
[[nodiscard]] Vector apply(const Matrix& A, const Vector& x);    ///< A x
/// x^T S x.
[[nodiscard]] double quadratic(const Matrix& S, const Vector& x);
/// A^T A.
[[nodiscard]] Matrix gram(const Matrix& A);
/// T S T^T, e.g. the covariance of T x.
[[nodiscard]] Matrix congruent(const Matrix& T, const Matrix& S);
/// Pseudo-inverse of a symmetric matrix; eigenvalues that are negative or 0 but for rounding count as 0.
[[nodiscard]] Matrix pseudo_inverse(const Matrix& S);

/// Covariance of the gradient A^T r at the minimum of |r| = |A x - b|. Equations stand in pairs of rows, in
/// the order of time. Residuals are correlated in time, so it is taken from how the gradients of consecutive
/// blocks of equations scatter: `blocks` >= 1 of them, better more than A has columns. One block gives 0.
[[nodiscard]] Matrix gradient_covariance(const Matrix& A, const Vector& r, Eigen::Index blocks);

}  // namespace esmc::host
