#pragma once
/// Least squares for the estimations: Eigen's decompositions, compiled once for all of them, and the
/// covariance of an estimate whose residuals are correlated in time.

#include <Eigen/Core>
#include <algorithm>

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
/// Inverse of a symmetric matrix with a positive diagonal; of a singular one that of the matrix with ones on
/// its diagonal, where eigenvalues that are negative or 0 but for rounding count as 0: units do not decide.
[[nodiscard]] Matrix pseudo_inverse(const Matrix& S);

/// Covariance of the gradient A^T r at the minimum of |r| = |A x - b|. Equations stand in pairs of rows, in
/// the order of time. Residuals are correlated in time, so it is taken from how the gradients of consecutive
/// blocks of equations scatter: `blocks` >= 1 of them, better more than A has columns. One block gives 0.
[[nodiscard]] Matrix gradient_covariance(const Matrix& A, const Vector& r, Eigen::Index blocks);

/// Blocks for that: windows of equations overlap `hops` times.
[[nodiscard]] inline Eigen::Index correlation_blocks(Eigen::Index rows, Eigen::Index hops) {
  return std::clamp<Eigen::Index>(rows / 2 / hops, 1, 60);
}

/// What more unknowns would find in the residual r of min |A x - b|: Z, a column each, of rows like A.
struct MoreUnknowns {
  Vector value;
  Matrix covariance;       ///< for residuals that are correlated in time
  double statistic = 0.0;  ///< value^T covariance^-1 value; 0: A leaves nothing of Z
  Vector shift;            ///< of x, without them
};
[[nodiscard]] MoreUnknowns more_unknowns(const Matrix& A, const Vector& r, const Matrix& Z,
                                         Eigen::Index blocks);
/// A misfit is named where the statistic is beyond `clear_per_unknown` (four standard deviations) for each
/// unknown and an entry of `shift` beyond `shift_told` standard uncertainties (half of the usual interval).
inline constexpr double clear_per_unknown = 16.0, shift_told = 1.5;

}  // namespace esmc::host
