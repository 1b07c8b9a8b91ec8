#include "host_sim/least_squares.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <algorithm>
#include <limits>

namespace esmc::host {

namespace {
/// Of the columns, 1 where there is nothing: what is measured in small units counts as much as the rest.
Vector scales_of(const Vector& size) { return (size.array() > 0.0).select(size, 1.0).cwiseInverse(); }
Matrix solved(const Matrix& A, const Matrix& B) {
  const Vector scale = scales_of(A.colwise().norm());
  return scale.asDiagonal() * (A * scale.asDiagonal()).colPivHouseholderQr().solve(B).eval();
}
}  // namespace

Vector least_squares(const Matrix& A, const Vector& b) { return solved(A, b); }

Modes symmetric_modes(const Matrix& S) {
  const Eigen::SelfAdjointEigenSolver<Matrix> solver(S);
  return {solver.eigenvalues(), solver.eigenvectors()};
}

Matrix product(const Matrix& A, const Matrix& B) { return A * B; }
Vector apply(const Matrix& A, const Vector& x) { return A * x; }
double quadratic(const Matrix& S, const Vector& x) { return x.dot(apply(S, x)); }
Matrix gram(const Matrix& A) { return A.transpose() * A; }
Matrix congruent(const Matrix& T, const Matrix& S) { return product(product(T, S), T.transpose()); }

Matrix pseudo_inverse(const Matrix& S) {
  const Vector scale = scales_of(S.diagonal().cwiseMax(0.0).cwiseSqrt());
  const Modes m = symmetric_modes(scale.asDiagonal() * S * scale.asDiagonal());
  const double least = std::numeric_limits<double>::epsilon() * static_cast<double>(S.rows()) *
                       std::max(0.0, m.value.maxCoeff());
  Vector inverse = Vector::Zero(S.rows());
  for (Eigen::Index i = 0; i < S.rows(); ++i)
    if (m.value[i] > least) inverse[i] = 1.0 / m.value[i];
  return congruent(scale.asDiagonal() * m.vector, inverse.asDiagonal());
}

Matrix gradient_covariance(const Matrix& A, const Vector& r, Eigen::Index blocks) {
  const Eigen::Index equations = A.rows() / 2;
  Matrix gradients = Matrix::Zero(A.cols(), blocks);
  for (Eigen::Index i = 0; i < A.rows(); ++i)
    gradients.col((i / 2) * blocks / equations) += A.row(i).transpose() * r[i];
  gradients.colwise() -= gradients.rowwise().mean().eval();
  const auto count = static_cast<double>(blocks), free = count - static_cast<double>(A.cols());
  return count / std::max(1.0, free) * gram(gradients.transpose());
}

MoreUnknowns more_unknowns(const Matrix& A, const Vector& r, const Matrix& Z, Eigen::Index blocks) {
  constexpr double left_over = 1e-3;  // of a column of Z; less than that is rounding and noise of A
  const Matrix G = solved(A, Z), own = Z - A * G;
  MoreUnknowns out{Vector::Zero(Z.cols()), Matrix::Identity(Z.cols(), Z.cols()), 0.0, Vector::Zero(A.cols())};
  for (Eigen::Index c = 0; c < Z.cols(); ++c)
    if (!(own.col(c).norm() > left_over * Z.col(c).norm())) return out;
  const Matrix inverse = pseudo_inverse(gram(own));
  out.value = inverse * (own.transpose() * r);
  out.covariance = congruent(inverse, gradient_covariance(own, r - own * out.value, blocks));
  out.statistic = quadratic(pseudo_inverse(out.covariance), out.value);
  out.shift = G * out.value;
  return out;
}

}  // namespace esmc::host
