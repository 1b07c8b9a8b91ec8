#include "host_sim/calibrate/geometry.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "host_sim/calibrate/rows.hpp"

namespace esmc::host {
namespace {

using Complex = std::complex<double>;
using Matrix = Eigen::MatrixXd;
using Vector = Eigen::VectorXd;

constexpr double weak_sigma = 5e-3;      // so well is a direction known before; worse is no calibration
constexpr double excitation_min = 10.0;  // noise in the angles alone looks like an excitation of about 1
constexpr double sigma_floor = 1e-9;     // rad; readings without noise

/// Normal equations of all rows at u, columns of `basis`: H, gradient, cost, and the same of blocks of rows.
struct Normal {
  Matrix H, H_effector;
  Vector gradient;
  double cost = 0.0, cost_effector = 0.0;
  Matrix blocks;  ///< sum over blocks of the closure's gradients, each about their mean: its outer product
                  ///< with itself
  int block_count = 0;
};

class Fit {
 public:
  Fit(const CalibrationProblem& p, double encoder_sigma) : p_(p), sigma_(encoder_sigma) {}

  /// `correct`: derivatives at the corrected angles, which a start that is far off has not got.
  [[nodiscard]] Normal normal(const Unknowns& u, const Matrix& basis, bool correct, bool with_effector,
                              bool with_blocks) const {
    const Eigen::Index k = basis.cols();
    Normal n{Matrix::Zero(k, k), Matrix::Zero(k, k), Vector::Zero(k), 0.0, 0.0, Matrix::Zero(k, k), 0};
    const std::size_t rows = p_.five_bar ? p_.angles.size() : 0;
    const std::size_t blocks = std::clamp<std::size_t>(rows / 10, 1, 60);
    std::vector<Vector> of_block(with_blocks ? blocks : 0, Vector::Zero(k));
    Eigen::Matrix<double, 2, Eigen::Dynamic> J(2, k);
    for (std::size_t i = 0; i < rows; ++i) {
      const ResidualRow r = white(closure_row, u, p_.angles[i], nullptr, correct);
      J.noalias() = r.J * basis;
      n.H.selfadjointView<Eigen::Lower>().rankUpdate(J.transpose());
      const Vector g = J.transpose() * r.residual;
      n.gradient += g;
      n.cost += r.residual.squaredNorm();
      if (with_blocks) of_block[i * blocks / rows] += g;
    }
    for (std::size_t i = 0; with_effector && i < p_.effector.size(); ++i) {
      const ResidualRow r = white(effector_row, u, p_.effector[i].angle, &p_.effector[i], correct);
      J.noalias() = r.J * basis;
      n.H_effector.selfadjointView<Eigen::Lower>().rankUpdate(J.transpose());
      n.gradient += J.transpose() * r.residual;
      n.cost_effector += r.residual.squaredNorm();
    }
    n.H_effector.triangularView<Eigen::StrictlyUpper>() = n.H_effector.transpose();
    n.H.triangularView<Eigen::StrictlyUpper>() = n.H.transpose();
    n.H += n.H_effector;
    n.cost += n.cost_effector;
    if (with_blocks && rows > 0) {
      n.block_count = static_cast<int>(blocks);
      Vector mean = Vector::Zero(k);
      for (const Vector& g : of_block) mean += g / static_cast<double>(blocks);
      for (const Vector& g : of_block) n.blocks += (g - mean) * (g - mean).transpose();
    }
    return n;
  }

  /// Levenberg-Marquardt over u = from + basis y.
  Unknowns solve(Unknowns u, const Matrix& basis, bool with_effector, bool& converged) const {
    converged = false;
    for (const bool correct : {false, true}) {
      Normal n = normal(u, basis, correct, with_effector, false);
      double damping = 1e-6;
      for (int i = 0; i < 100; ++i) {
        Matrix H = n.H;
        H.diagonal() +=
            damping * n.H.diagonal() + Vector::Constant(H.rows(), 1e-12 * n.H.diagonal().maxCoeff() + 1e-300);
        const Vector step = -H.ldlt().solve(n.gradient);
        const Unknowns next = u + basis * step;
        const bool possible = step.allFinite() && (next.head<5>().array() >= 0.0).all();
        const Normal m = possible ? normal(next, basis, correct, with_effector, false) : n;
        if (!(possible && m.cost <= n.cost)) {
          damping = std::max(10.0 * damping, 1e-6);
          if (damping > 1e8) {  // as low as rounding lets it be, or at a wall
            converged = correct && std::abs(step.dot(n.gradient)) <= 1e-6 * (1.0 + n.cost);
            break;
          }
          continue;
        }
        const bool small = step.dot(n.H * step) < 1e-10 || step.cwiseAbs().maxCoeff() < 1e-14;
        u = next;
        n = m;
        damping *= 0.1;
        if (small) {
          converged = correct;
          break;
        }
      }
    }
    return u;
  }

 private:
  template <class RowOf>
  [[nodiscard]] ResidualRow white(RowOf row_of, const Unknowns& u, const MeasuredAngles& angle,
                                  const EffectorReading* reading, bool correct) const {
    const double own = reading != nullptr ? p_.effector_sigma : 0.0;
    return whitened(row_of, u, p_.five_bar, angle, reading, sigma_, own, correct);
  }

  const CalibrationProblem& p_;
  double sigma_;
};

/// One column for each unknown that is looked for, in the units of the scaled problem.
Matrix columns_of(const std::vector<int>& estimated, double mean_length) {
  Matrix basis = Matrix::Zero(unknowns, static_cast<Eigen::Index>(estimated.size()));
  for (std::size_t i = 0; i < estimated.size(); ++i) {
    const int u = estimated[i];
    basis(u, static_cast<Eigen::Index>(i)) =
        is_length(u) || u == unknown_fx || u == unknown_fy ? mean_length : 1.0;
  }
  return basis;
}

/// The loop is linear in the complex numbers l e^{i offset}: a start that needs no nominal lengths. Empty:
/// not determined.
std::optional<Unknowns> linear_start(const CalibrationProblem& p) {
  const auto rows = static_cast<Eigen::Index>(p.five_bar ? p.angles.size() : p.effector.size());
  const Eigen::Index n = p.five_bar ? 4 : 2;
  if (rows < n) return std::nullopt;
  Eigen::MatrixXcd A(rows, n);
  Eigen::VectorXcd b(rows);
  for (Eigen::Index i = 0; i < rows; ++i) {
    const auto u = static_cast<std::size_t>(i);
    const MeasuredAngles& a = p.five_bar ? p.angles[u] : p.effector[u].angle;
    A(i, 0) = std::polar(1.0, a[0]);
    A(i, 1) = std::polar(1.0, a[0] + a[1]);
    if (p.five_bar) {
      A(i, 2) = std::polar(1.0, -a[2]);
      A(i, 3) = std::polar(1.0, -a[2] - a[3]);
      b[i] = -2.0 * p.nominal[unknown_l0];
    } else {
      b[i] = {p.effector[u].x, p.effector[u].y};
    }
  }
  const Eigen::ColPivHouseholderQR<Eigen::MatrixXcd> qr(A);
  if (std::abs(qr.matrixR()(n - 1, n - 1)) < 1e-6 * std::abs(qr.matrixR()(0, 0))) return std::nullopt;
  const Eigen::VectorXcd x = qr.solve(b);
  Unknowns u = p.nominal;
  for (Eigen::Index leg = 0; leg < n / 2; ++leg) {
    const double sign = leg == 0 ? 1.0 : -1.0;
    const Complex inner = x[2 * leg], outer = x[2 * leg + 1];
    u[unknown_l11 + 2 * leg] = std::abs(inner);
    u[unknown_l12 + 2 * leg] = std::abs(outer);
    u[unknown_o11 + 2 * leg] = sign * std::arg(inner);
    u[unknown_o12 + 2 * leg] = sign * std::arg(outer * std::conj(inner));
  }
  return u;
}

/// Scale and frame that bring the effector of `u` onto the readings.
void place(const CalibrationProblem& p, Unknowns& u) {
  if (p.effector.empty() || !p.five_bar) return;
  const auto n = static_cast<Eigen::Index>(p.effector.size());
  Eigen::MatrixXcd A(n, 2);
  Eigen::VectorXcd tip(n);
  Unknowns at_base = u;
  at_base.tail<3>().setZero();
  for (Eigen::Index i = 0; i < n; ++i) {
    EffectorReading r = p.effector[static_cast<std::size_t>(i)];
    A(i, 0) = {r.x, r.y};
    A(i, 1) = 1.0;
    r.x = r.y = 0.0;
    const Eigen::Vector2d minus = effector_row(at_base, true, r.angle, &r).residual;
    tip[i] = {-minus[0], -minus[1]};
  }
  double scale = 1.0;
  if (p.free_frame) {
    const Eigen::VectorXcd x = A.colPivHouseholderQr().solve(tip);
    scale = std::abs(x[0]);
    u[unknown_fa] = std::arg(x[0]);
    u[unknown_fx] = x[1].real() / std::max(scale, 1e-9);
    u[unknown_fy] = x[1].imag() / std::max(scale, 1e-9);
  } else {
    scale = (A.col(0).dot(tip)).real() / std::max(A.col(0).squaredNorm(), 1e-300);
  }
  if (!p.half_base_known && scale > 0.1 && scale < 10.0) u.head<5>() /= scale;
}

std::string combination(const Unknowns& along, bool five_bar, const Unknowns& value, double mean_length) {
  Unknowns scale = Unknowns::Zero();
  scale.head<5>() = value.head<5>() / mean_length;
  if (five_bar && std::abs(along.dot(scale.normalized())) > 0.98)
    return "half_base and all lengths together (the scale)";
  std::string text;
  std::vector<int> order(unknowns);
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(),
                   [&](int a, int b) { return std::abs(along[a]) > std::abs(along[b]); });
  const double sign = along[order[0]] < 0.0 ? -1.0 : 1.0;
  for (const int i : order) {
    const double c = sign * along[i];
    if (std::abs(c) < 0.2) break;
    text += fmt::format("{}{:.2f} {}", text.empty() ? "" : (c < 0.0 ? " - " : " + "), std::abs(c),
                        name_of(i, five_bar));
  }
  return text;
}

/// Covariance of the coefficients of a basis: what the blocks of the loop say of themselves, and the
/// readings' own.
Matrix covariance_of(const Normal& n, std::size_t effector_rows) {
  const Matrix inverse = n.H.completeOrthogonalDecomposition().pseudoInverse();
  const auto k = static_cast<double>(n.H.rows());
  const double blocks = n.block_count;
  Matrix meat = n.block_count > 0 ? Matrix(n.blocks * (blocks / std::max(1.0, blocks - k)))
                                  : Matrix(Matrix::Zero(n.H.rows(), n.H.rows()));
  const double free = 2.0 * static_cast<double>(effector_rows) - (n.block_count > 0 ? 1.0 : k);
  const double factor = free > 0.0 ? std::max(1.0, n.cost_effector / free) : 1.0;
  meat += factor * n.H_effector;
  return inverse * meat * inverse;
}

}  // namespace

const char* name_of(int unknown, bool five_bar) {
  static constexpr std::array five{"half_base",      "leg 1 l1",       "leg 1 l2",       "leg 2 l1",
                                   "leg 2 l2",       "offset theta11", "offset theta12", "offset theta21",
                                   "offset theta22", "frame x",        "frame y",        "frame angle"};
  static constexpr std::array arm{
      "", "l1", "l2", "", "", "offset theta1", "offset theta2", "", "", "frame x", "frame y", "frame angle"};
  return five_bar ? five[static_cast<std::size_t>(unknown)] : arm[static_cast<std::size_t>(unknown)];
}

double Calibration::sigma(int unknown) const {
  return std::sqrt(std::max(0.0, covariance(unknown, unknown)));
}

Calibration calibrate(const CalibrationProblem& p) {
  Calibration out;
  for (int u = 0; u < unknowns; ++u) {
    const bool frame = u >= unknown_fx, base = u == unknown_l0;
    const bool second = u == unknown_l21 || u == unknown_l22 || u == unknown_o21 || u == unknown_o22;
    if ((frame && !(p.free_frame && !p.effector.empty())) || (base && (p.half_base_known || !p.five_bar)) ||
        (second && !p.five_bar))
      continue;
    out.estimated.push_back(u);
  }
  const int lengths = p.five_bar ? 5 : 2;
  out.mean_length = p.nominal.head<5>().sum() / lengths;
  const auto rows = static_cast<double>(p.angles.size());

  // The shape alone first: how well the loop closes says how good the encoders are, whatever the scale.
  Unknowns start = p.nominal;
  double sigma = p.encoder_sigma;
  std::vector<Unknowns> starts{p.nominal};
  if (const auto linear = linear_start(p)) starts.push_back(*linear);
  if (p.five_bar) {
    std::vector<int> shape;
    std::copy_if(out.estimated.begin(), out.estimated.end(), std::back_inserter(shape),
                 [](int u) { return u > unknown_l0 && u < unknown_fx; });
    const Matrix basis = columns_of(shape, out.mean_length);
    const Fit fit(p, sigma);
    double best = std::numeric_limits<double>::infinity();
    for (const Unknowns& from : starts) {
      bool converged = false;
      const Unknowns u = fit.solve(from, basis, false, converged);
      const double cost = fit.normal(u, basis, true, false, false).cost;
      if (cost < best) {
        best = cost;
        start = u;
      }
    }
    sigma = std::max(sigma_floor,
                     sigma * std::sqrt(best / std::max(1.0, 2.0 * rows - static_cast<double>(shape.size()))));
    place(p, start);
  } else {
    start = starts.back();
  }
  out.encoder_sigma = sigma;

  const Fit fit(p, sigma);
  Matrix basis = columns_of(out.estimated, out.mean_length);
  out.value = fit.solve(start, basis, true, out.converged);
  Normal n = fit.normal(out.value, basis, true, true, true);
  if (!out.value.allFinite() || !n.H.allFinite() || !n.blocks.allFinite() || !std::isfinite(n.cost)) {
    out.in_numbers = false;
    return out;
  }
  Matrix covariance = covariance_of(n, p.effector.size());
  const Eigen::SelfAdjointEigenSolver<Matrix> modes(n.H);
  Matrix strong(basis.cols(), 0);
  out.covariance.setZero();
  for (Eigen::Index i = 0; i < basis.cols(); ++i) {
    const Vector v = modes.eigenvectors().col(i);
    const double of_effector = v.dot(n.H_effector * v),
                 of_loop = std::max(0.0, modes.eigenvalues()[i] - of_effector);
    const double information =
        of_effector + (of_loop >= excitation_min * excitation_min * rows ? of_loop : 0.0);
    const double s = std::max(1.0 / std::sqrt(information), std::sqrt(std::max(0.0, v.dot(covariance * v))));
    if (s <= weak_sigma) {
      strong.conservativeResize(Eigen::NoChange, strong.cols() + 1);
      strong.rightCols(1) = v;
      continue;
    }
    const Unknowns kept = basis * v;  // nominal, and whoever leans on it is no better than that
    out.covariance += kept * kept.transpose() * (weak_sigma * weak_sigma);
    WeakDirection w;
    w.along = columns_of(out.estimated, 1.0) * v;
    w.sigma = s;
    w.text = combination(w.along, p.five_bar, p.nominal, out.mean_length);
    out.weak.push_back(w);
  }
  if (strong.cols() == 0) {  // nothing is determined
    out.value = p.nominal;
  } else {
    if (!out.weak.empty()) {  // along these nothing moves away from the nominal values
      basis = basis * strong;
      out.value = fit.solve(p.nominal, basis, true, out.converged);
      n = fit.normal(out.value, basis, true, true, true);
      covariance = covariance_of(n, p.effector.size());
    }
    out.covariance += basis * covariance * basis.transpose();
  }

  const auto rms = [](double sum, double count) { return count > 0.0 ? std::sqrt(sum / count) : 0.0; };
  double now = 0.0, nominal = 0.0, tips = 0.0;
  for (std::size_t i = 0; p.five_bar && i < p.angles.size(); ++i) {
    now += closure_row(out.value, true, p.angles[i], nullptr).residual.squaredNorm();
    nominal += closure_row(p.nominal, true, p.angles[i], nullptr).residual.squaredNorm();
  }
  for (const EffectorReading& r : p.effector)
    tips += effector_row(out.value, p.five_bar, r.angle, &r).residual.squaredNorm();
  out.closure_rms = rms(now, rows);
  out.closure_rms_nominal = rms(nominal, rows);
  out.effector_rms = rms(tips, static_cast<double>(p.effector.size()));
  return out;
}

std::optional<Complex> effector_from_base(const Unknowns& u, bool five_bar, const MeasuredAngles& angle) {
  const double a1 = angle[0] + u[unknown_o11], a2 = a1 + angle[1] + u[unknown_o12];
  const Complex elbow1 = u[unknown_l0] + std::polar(u[unknown_l11], a1),
                tip1 = elbow1 + std::polar(u[unknown_l12], a2);
  if (!five_bar) return tip1 - u[unknown_l0];
  const Complex elbow2 = -u[unknown_l0] - std::polar(u[unknown_l21], -(angle[2] + u[unknown_o21]));
  const Complex w = elbow1 - elbow2;
  const double d = std::abs(w), l1 = u[unknown_l12], l2 = u[unknown_l22];
  const double along = (d * d + l2 * l2 - l1 * l1) / (2.0 * d), square = l2 * l2 - along * along;
  if (!(d > 0.0 && square >= 0.0)) return std::nullopt;
  const Complex above = elbow2 + w / d * Complex(along, std::sqrt(square)),
                below = elbow2 + w / d * Complex(along, -std::sqrt(square));
  return std::abs(above - tip1) < std::abs(below - tip1) ? above : below;
}

double effector_sigma(const Calibration& c, bool five_bar, const MeasuredAngles& angle) {
  Eigen::Matrix<double, 2, unknowns> D = Eigen::Matrix<double, 2, unknowns>::Zero();
  for (int i = 0; i < unknown_fx; ++i) {
    const double h = 1e-6 * (is_length(i) ? c.mean_length : 1.0);
    Unknowns up = c.value, down = c.value;
    up[i] += h;
    down[i] -= h;
    const auto a = effector_from_base(up, five_bar, angle), b = effector_from_base(down, five_bar, angle);
    if (!a || !b) return std::numeric_limits<double>::infinity();
    D(0, i) = (*a - *b).real() / (2.0 * h);
    D(1, i) = (*a - *b).imag() / (2.0 * h);
  }
  return std::sqrt(std::max(0.0, (D * c.covariance * D.transpose()).trace()));
}

}  // namespace esmc::host
