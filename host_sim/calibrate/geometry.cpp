#include "host_sim/calibrate/geometry.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace esmc::host {
namespace {

using Complex = std::complex<double>;

constexpr double weak_sigma = 5e-3;      // so well is a direction known before; worse is no calibration
constexpr double excitation_min = 10.0;  // noise in the angles alone looks like an excitation of about 1
constexpr double sigma_floor = 1e-9;     // rad; readings without noise

/// Whitened rows: J y + r, y the coefficients of a basis.
struct Rows {
  Matrix J;
  Vector r;
};

/// Normal equations of all rows.
struct Normal {
  Matrix H, H_effector;
  Vector gradient;
  double cost, cost_effector;
};

class GeometryFit {
 public:
  GeometryFit(const CalibrationProblem& p, double encoder_sigma) : p_(p), sigma_(encoder_sigma) {}

  /// `correct`: derivatives at the corrected angles, which a start that is far off has not got.
  [[nodiscard]] Rows closure(const Unknowns& u, const Matrix& basis, bool correct) const {
    return rows(p_.five_bar ? p_.angles.size() : 0, basis, [&](std::size_t i) {
      return whitened([&](const MeasuredAngles& a) { return closure_row(u, a); }, p_.angles[i], sigma_, 0.0,
                      correct);
    });
  }
  [[nodiscard]] Normal normal(const Unknowns& u, const Matrix& basis, bool correct,
                              bool with_effector) const {
    return normal(u, basis, correct, with_effector, closure(u, basis, correct));
  }
  [[nodiscard]] Normal normal(const Unknowns& u, const Matrix& basis, bool correct, bool with_effector,
                              const Rows& loop) const {
    const Rows effector = rows(with_effector ? p_.effector.size() : 0, basis, [&](std::size_t i) {
      const EffectorReading& reading = p_.effector[i];
      return whitened([&](const MeasuredAngles& a) { return effector_row(u, p_.five_bar, reading, a); },
                      reading.angle, sigma_, p_.effector_sigma, correct);
    });
    Normal n{gram(loop.J), gram(effector.J), apply(loop.J.transpose(), loop.r), loop.r.squaredNorm(),
             effector.r.squaredNorm()};
    n.H += n.H_effector;
    n.gradient += apply(effector.J.transpose(), effector.r);
    n.cost += n.cost_effector;
    return n;
  }

  /// Levenberg-Marquardt over u = from + basis y.
  Unknowns solve(Unknowns u, const Matrix& basis, bool with_effector, bool& converged) const {
    converged = false;
    for (const bool correct : {false, true}) {
      Normal n = normal(u, basis, correct, with_effector);
      double damping = 1e-6;
      for (int i = 0; i < 100; ++i) {
        Matrix H = n.H;
        for (Eigen::Index k = 0; k < H.rows(); ++k)
          H(k, k) += damping * n.H(k, k) + 1e-12 * n.H.diagonal().maxCoeff() + 1e-300;
        const Vector step = -least_squares(H, n.gradient);
        const Unknowns next = u + apply(basis, step);
        const bool possible = step.allFinite() && next.head(unknown_o11).minCoeff() >= 0.0;
        const Normal m = possible ? normal(next, basis, correct, with_effector) : n;
        if (!(possible && m.cost <= n.cost)) {
          damping = std::max(10.0 * damping, 1e-6);
          if (damping > 1e8) {  // as low as rounding lets it be, or at a wall
            converged = correct && std::abs(step.dot(n.gradient)) <= 1e-6 * (1.0 + n.cost);
            break;
          }
          continue;
        }
        const bool small = quadratic(n.H, step) < 1e-10 || step.cwiseAbs().maxCoeff() < 1e-14;
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
  template <class RowAt>
  static Rows rows(std::size_t count, const Matrix& basis, RowAt row_at) {
    Matrix J(2 * count, unknowns);
    Vector r(2 * count);
    for (std::size_t i = 0; i < count; ++i) {
      const Row row = row_at(i);
      const auto at = 2 * static_cast<Eigen::Index>(i);
      r[at] = row.residual.real();
      r[at + 1] = row.residual.imag();
      for (int k = 0; k < unknowns; ++k) {
        J(at, k) = row.J[static_cast<std::size_t>(k)].real();
        J(at + 1, k) = row.J[static_cast<std::size_t>(k)].imag();
      }
    }
    return {product(J, basis), r};
  }

  const CalibrationProblem& p_;
  double sigma_;
};

/// The unknowns that the problem has.
std::vector<int> estimated_of(const CalibrationProblem& p) {
  std::vector<int> out;
  const auto add = [&](std::initializer_list<int> list) { out.insert(out.end(), list); };
  if (p.five_bar && !p.half_base_known) add({unknown_l0});
  add({unknown_l11, unknown_l12});
  if (p.five_bar) add({unknown_l21, unknown_l22});
  add({unknown_o11, unknown_o12});
  if (p.five_bar) add({unknown_o21, unknown_o22});
  if (p.free_frame && !p.effector.empty()) add({unknown_fx, unknown_fy, unknown_fa});
  return out;
}

/// One column for each unknown that is looked for, in the units of the scaled problem.
Matrix columns_of(const std::vector<int>& estimated, double mean_length) {
  Matrix basis = Matrix::Zero(unknowns, static_cast<Eigen::Index>(estimated.size()));
  for (std::size_t i = 0; i < estimated.size(); ++i)
    basis(estimated[i], static_cast<Eigen::Index>(i)) = unit_of(estimated[i])[0] == 'm' ? mean_length : 1.0;
  return basis;
}

/// The loop is linear in the complex numbers l e^{i offset}: a start that needs no nominal lengths. Empty:
/// not determined.
std::optional<Unknowns> linear_start(const CalibrationProblem& p) {
  const auto rows = static_cast<Eigen::Index>(p.five_bar ? p.angles.size() : p.effector.size());
  const Eigen::Index n = p.five_bar ? 4 : 2;
  if (rows < n) return std::nullopt;
  Matrix A(2 * rows, 2 * n);  // z = a + i b in two rows and columns: a, -b; b, a
  Vector b(2 * rows);
  for (Eigen::Index i = 0; i < rows; ++i) {
    const auto row = static_cast<std::size_t>(i);
    const MeasuredAngles& a = p.five_bar ? p.angles[row] : p.effector[row].angle;
    const std::array angle{a[0], a[0] + a[1], -a[2], -a[2] - a[3]};
    for (Eigen::Index k = 0; k < n; ++k) {
      const Complex z = std::polar(1.0, angle[static_cast<std::size_t>(k)]);
      A(2 * i, 2 * k) = A(2 * i + 1, 2 * k + 1) = z.real();
      A(2 * i, 2 * k + 1) = -z.imag();
      A(2 * i + 1, 2 * k) = z.imag();
    }
    b[2 * i] = p.five_bar ? -2.0 * p.nominal[unknown_l0] : p.effector[row].x;
    b[2 * i + 1] = p.five_bar ? 0.0 : p.effector[row].y;
  }
  const Vector size = symmetric_modes(gram(A)).value;
  if (!(size[0] >= 1e-12 * size[2 * n - 1])) return std::nullopt;
  const Vector x = least_squares(A, b);
  Unknowns u = p.nominal;
  for (Eigen::Index leg = 0; leg < n / 2; ++leg) {
    const double sign = leg == 0 ? 1.0 : -1.0;
    const Complex inner(x[4 * leg], x[4 * leg + 1]), outer(x[4 * leg + 2], x[4 * leg + 3]);
    u[unknown_l11 + 2 * leg] = std::abs(inner);
    u[unknown_l12 + 2 * leg] = std::abs(outer);
    u[unknown_o11 + 2 * leg] = sign * std::arg(inner);
    u[unknown_o12 + 2 * leg] = sign * std::arg(outer * std::conj(inner));
  }
  return u;
}

/// Scale and frame that bring the effector of `u` onto the readings: tip = scale turn reading + origin.
void place(const CalibrationProblem& p, Unknowns& u) {
  if (p.effector.empty() || !p.five_bar) return;
  Unknowns at_base = u;
  at_base.tail(3).setZero();
  std::vector<Complex> reading, tip;
  for (const EffectorReading& r : p.effector) {
    reading.emplace_back(r.x, r.y);
    tip.push_back(-effector_row(at_base, true, {r.angle, 0.0, 0.0}, r.angle).residual);
  }
  const auto mean = [](const std::vector<Complex>& list) {
    return std::accumulate(list.begin(), list.end(), Complex()) / static_cast<double>(list.size());
  };
  const Complex middle = p.free_frame ? mean(reading) : Complex(),
                centre = p.free_frame ? mean(tip) : Complex();
  Complex product;
  double square = 1e-300;
  for (std::size_t i = 0; i < tip.size(); ++i) {
    product += std::conj(reading[i] - middle) * (tip[i] - centre);
    square += std::norm(reading[i] - middle);
  }
  const Complex turn = product / square;
  const double scale = p.free_frame ? std::abs(turn) : turn.real();
  if (p.free_frame) {
    const Complex origin = (centre - turn * middle) / std::max(scale, 1e-9);
    u[unknown_fa] = std::arg(turn);
    u[unknown_fx] = origin.real();
    u[unknown_fy] = origin.imag();
  }
  if (!p.half_base_known && scale > 0.1 && scale < 10.0) u.head(unknown_o11) /= scale;
}

std::string combination(const Unknowns& along, bool five_bar, const Unknowns& value, double mean_length) {
  Unknowns scale = Unknowns::Zero(unknowns);
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

/// Covariance of the coefficients of a basis about the minimum at `u`.
Matrix covariance_of(const Normal& n, const Rows& loop, std::size_t effector_rows) {
  const Eigen::Index rows = loop.r.size() / 2;
  const auto k = static_cast<double>(n.H.rows());
  const double free = 2.0 * static_cast<double>(effector_rows) - (rows > 0 ? 1.0 : k);
  Matrix gradient = (free > 0.0 ? std::max(1.0, n.cost_effector / free) : 1.0) * n.H_effector;
  if (rows > 0) gradient += gradient_covariance(loop.J, loop.r, std::clamp<Eigen::Index>(rows / 10, 1, 60));
  return congruent(pseudo_inverse(n.H), gradient);
}

/// A five-bar's shape alone, with the scale as it is: the best of the fits from `starts`. How well its loop
/// closes says how good the encoders are: `sigma`, rad, in and out.
Unknowns fit_shape(const CalibrationProblem& p, const std::vector<Unknowns>& starts,
                   const std::vector<int>& estimated, double mean_length, double& sigma) {
  std::vector<int> shape;
  std::copy_if(estimated.begin(), estimated.end(), std::back_inserter(shape),
               [](int u) { return u > unknown_l0 && u < unknown_fx; });
  const Matrix basis = columns_of(shape, mean_length);
  const GeometryFit fit(p, sigma);
  Unknowns out = p.nominal;
  double best = std::numeric_limits<double>::infinity();
  for (const Unknowns& from : starts) {
    bool converged = false;
    const Unknowns u = fit.solve(from, basis, false, converged);
    const double cost = fit.normal(u, basis, true, false).cost;
    if (cost < best) {
      best = cost;
      out = u;
    }
  }
  const double free = 2.0 * static_cast<double>(p.angles.size()) - static_cast<double>(shape.size());
  sigma = std::max(sigma_floor, sigma * std::sqrt(best / std::max(1.0, free)));
  return out;
}

/// The directions of `basis` that the data determine, as columns; the others become `out.weak` and are as
/// uncertain as nominal values.
Matrix strong_directions(const CalibrationProblem& p, const Matrix& basis, const Normal& n,
                         const Matrix& covariance, Calibration& out) {
  const Modes modes = symmetric_modes(n.H);
  const double least = excitation_min * excitation_min * static_cast<double>(p.angles.size());
  Matrix strong(basis.cols(), basis.cols());
  Eigen::Index count = 0;
  for (Eigen::Index i = 0; i < basis.cols(); ++i) {
    const Vector v = modes.vector.col(i);
    const double of_effector = quadratic(n.H_effector, v),
                 of_loop = std::max(0.0, modes.value[i] - of_effector);
    const double information = of_effector + (of_loop >= least ? of_loop : 0.0);
    const double s =
        std::max(1.0 / std::sqrt(information), std::sqrt(std::max(0.0, quadratic(covariance, v))));
    if (s <= weak_sigma) {
      strong.col(count++) = v;
      continue;
    }
    const Unknowns kept = apply(basis, v);
    out.covariance += gram(kept.transpose()) * (weak_sigma * weak_sigma);
    const Unknowns along = apply(columns_of(out.estimated, 1.0), v);
    out.weak.push_back({s, combination(along, p.five_bar, p.nominal, out.mean_length)});
  }
  return strong.leftCols(count);
}

void measure_residuals(const CalibrationProblem& p, Calibration& out) {
  const auto rms = [](double sum, std::size_t count) {
    return count > 0 ? std::sqrt(sum / static_cast<double>(count)) : 0.0;
  };
  double now = 0.0, nominal = 0.0, tips = 0.0;
  for (std::size_t i = 0; p.five_bar && i < p.angles.size(); ++i) {
    now += std::norm(closure_row(out.value, p.angles[i]).residual);
    nominal += std::norm(closure_row(p.nominal, p.angles[i]).residual);
  }
  for (const EffectorReading& r : p.effector)
    tips += std::norm(effector_row(out.value, p.five_bar, r, r.angle).residual);
  out.closure_rms = rms(now, p.angles.size());
  out.closure_rms_nominal = rms(nominal, p.angles.size());
  out.effector_rms = rms(tips, p.effector.size());
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

Calibration calibrate(const CalibrationProblem& p) {
  Calibration out;
  out.estimated = estimated_of(p);
  out.mean_length = p.nominal.head(unknown_o11).sum() / (p.five_bar ? 5.0 : 2.0);
  out.encoder_sigma = p.encoder_sigma;
  std::vector<Unknowns> starts{p.nominal};
  if (const auto linear = linear_start(p)) starts.push_back(*linear);
  Unknowns start = starts.back();
  if (p.five_bar) {
    start = fit_shape(p, starts, out.estimated, out.mean_length, out.encoder_sigma);
    place(p, start);
  }

  const GeometryFit fit(p, out.encoder_sigma);
  Matrix basis = columns_of(out.estimated, out.mean_length);
  out.value = fit.solve(start, basis, true, out.converged);
  Rows loop = fit.closure(out.value, basis, true);
  Normal n = fit.normal(out.value, basis, true, true, loop);
  if (!out.value.allFinite() || !n.H.allFinite() || !std::isfinite(n.cost)) {
    out.in_numbers = false;
    return out;
  }
  Matrix covariance = covariance_of(n, loop, p.effector.size());
  const Matrix strong = strong_directions(p, basis, n, covariance, out);
  if (strong.cols() == 0) {  // nothing is determined
    out.value = p.nominal;
  } else {
    if (!out.weak.empty()) {  // along these nothing moves away from the nominal values
      basis = product(basis, strong);
      out.value = fit.solve(p.nominal, basis, true, out.converged);
      loop = fit.closure(out.value, basis, true);
      n = fit.normal(out.value, basis, true, true, loop);
      covariance = covariance_of(n, loop, p.effector.size());
    }
    out.covariance += congruent(basis, covariance);
  }
  measure_residuals(p, out);
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
  Matrix D = Matrix::Zero(2, unknowns);
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
  return std::sqrt(std::max(0.0, congruent(D, c.covariance).trace()));
}

}  // namespace esmc::host
