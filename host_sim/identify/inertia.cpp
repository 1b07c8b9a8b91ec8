#include "host_sim/identify/inertia.hpp"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>

#include "host_sim/identify/equations.hpp"
#include "host_sim/record/derivatives.hpp"

namespace esmc::host {
namespace {

using namespace momentum;

constexpr double dependent = 1e-7;  // of a column's length: what is left of one that others make up
constexpr double weak_sigma = 0.5;  // an uncertainty of half of everything there is

/// Which columns stand for themselves, and what the others add to them: QR in the order of the columns.
std::vector<BaseParameter> independent_columns(const Matrix& W,
                                               const std::vector<StandardParameter>& standard) {
  std::vector<BaseParameter> out;
  Matrix Q(W.rows(), 0);
  std::vector<int> basis;
  const auto count = static_cast<std::size_t>(W.cols());
  std::vector<std::pair<int, Vector>> made_up;  // column, coefficients on the basis so far
  for (int c = 0; c < W.cols(); ++c) {
    Vector v = W.col(c);
    const double length = v.norm();
    for (int pass = 0; pass < 2; ++pass) v -= Q * (Q.transpose() * v);
    if (!(length > 1e-12)) continue;  // nothing depends on it: no gravity, no motion
    if (v.norm() > dependent * length) {
      Q.conservativeResize(Eigen::NoChange, Q.cols() + 1);
      Q.rightCols(1) = v.normalized();
      basis.push_back(c);
    } else {
      Matrix B(W.rows(), static_cast<Eigen::Index>(basis.size()));
      for (std::size_t i = 0; i < basis.size(); ++i) B.col(static_cast<Eigen::Index>(i)) = W.col(basis[i]);
      made_up.emplace_back(c, B.colPivHouseholderQr().solve(W.col(c)));
    }
  }
  for (std::size_t i = 0; i < basis.size(); ++i) {
    BaseParameter b{basis[i],
                    std::vector<double>(count, 0.0),
                    standard[static_cast<std::size_t>(basis[i])].name,
                    0.0,
                    0.0,
                    0.0};
    b.share[static_cast<std::size_t>(basis[i])] = 1.0;
    for (const auto& [column, coefficients] : made_up) {
      if (static_cast<Eigen::Index>(i) >= coefficients.size()) continue;
      const double x = coefficients[static_cast<Eigen::Index>(i)];
      if (std::abs(x) < 1e-6) continue;
      b.share[static_cast<std::size_t>(column)] = x;
      b.text += fmt::format(" {} {:.6g} {}", x < 0.0 ? "-" : "+", std::abs(x),
                            standard[static_cast<std::size_t>(column)].name);
    }
    out.push_back(b);
  }
  return out;
}

/// Least squares for parameters and delay about a delay, rows weighted.
struct Step {
  Vector x, residual;
  Matrix A;
};
Step solve(const Equations& e, const Matrix& W, const Eigen::Vector2d& weight, double delay) {
  constexpr double h = 0.25;
  const Vector b = e.torque(delay), by_delay = (e.torque(delay + h) - e.torque(delay - h)) / (2.0 * h);
  Step s;
  s.A.resize(W.rows(), W.cols() + 1 + e.reversal.cols());
  s.A << W, -by_delay, e.reversal;
  Vector rhs = b;
  for (Eigen::Index i = 0; i < W.rows(); ++i) {
    s.A.row(i) *= weight[i % 2];
    rhs[i] *= weight[i % 2];
  }
  s.x = s.A.colPivHouseholderQr().solve(rhs);
  s.residual = rhs - s.A * s.x;
  return s;
}

Matrix covariance_of(const Step& s) {
  const Eigen::Index k = s.A.cols(), rows = s.A.rows(), windows = rows / 2;
  const Eigen::Index blocks = std::clamp<Eigen::Index>(windows / hops_per_window, 1, 60);
  Matrix gradients = Matrix::Zero(k, blocks);
  for (Eigen::Index i = 0; i < rows; ++i)
    gradients.col((i / 2) * blocks / windows) += s.A.row(i).transpose() * s.residual[i];
  gradients.colwise() -= gradients.rowwise().mean().eval();
  const Matrix inverse = (s.A.transpose() * s.A).completeOrthogonalDecomposition().pseudoInverse();
  const auto B = static_cast<double>(blocks);
  return inverse * (B / std::max(1.0, B - static_cast<double>(k)) * gradients * gradients.transpose()) *
         inverse;
}

/// Combinations whose uncertainty is as large as what is there, in units of the nominal values.
std::vector<std::string> weak_directions(const std::vector<BaseParameter>& parameters,
                                         const Matrix& covariance, const Vector& scale,
                                         const std::vector<StandardParameter>& standard) {
  std::vector<int> inertial;
  for (std::size_t i = 0; i < parameters.size(); ++i) {
    if (standard[static_cast<std::size_t>(parameters[i].of)].inertial)
      inertial.push_back(static_cast<int>(i));
  }
  const auto n = static_cast<Eigen::Index>(inertial.size());
  Matrix C(n, n);
  for (Eigen::Index a = 0; a < n; ++a) {
    for (Eigen::Index b = 0; b < n; ++b) {
      const int i = inertial[static_cast<std::size_t>(a)], j = inertial[static_cast<std::size_t>(b)];
      C(a, b) = covariance(i, j) / (scale[i] * scale[j]);
    }
  }
  std::vector<std::string> out;
  const Eigen::SelfAdjointEigenSolver<Matrix> modes(C);
  for (Eigen::Index m = n - 1; m >= 0; --m) {
    if (std::sqrt(std::max(0.0, modes.eigenvalues()[m])) <= weak_sigma) break;
    const Vector v = modes.eigenvectors().col(m);
    std::string text;
    for (Eigen::Index a = 0; a < n; ++a) {
      if (std::abs(v[a]) < 0.3) continue;
      const std::string& name =
          standard[static_cast<std::size_t>(
                       parameters[static_cast<std::size_t>(inertial[static_cast<std::size_t>(a)])].of)]
              .name;
      text += (text.empty() ? "" : ", ") + name;
    }
    out.push_back(text);
  }
  return out;
}

}  // namespace

std::vector<StandardParameter> standard_parameters(bool five_bar) {
  std::vector<StandardParameter> out;
  const int legs = five_bar ? 2 : 1;
  const auto joint = [&](int leg, int k) {
    return five_bar ? fmt::format("{}{}", leg + 1, k + 1) : fmt::format("{}", k + 1);
  };
  for (int leg = 0; leg < legs; ++leg) {
    const std::string index = five_bar ? fmt::format("{}", leg + 1) : "";
    out.push_back({"a" + index, "kg m2", true});
    out.push_back({"c" + index, "kg m2", true});
    out.push_back({"h" + index, "kg m", true});
    out.push_back({"s" + index, "kg m", true});
  }
  if (five_bar) out.push_back({"m0", "kg", true});
  for (const auto& [name, unit] : {std::pair("viscous", "N m s/rad"), std::pair("coulomb", "N m")}) {
    for (int leg = 0; leg < legs; ++leg) {
      for (int k = 0; k < 2; ++k)
        out.push_back({fmt::format("{} theta{}", name, joint(leg, k)), unit, false});
    }
  }
  return out;
}

std::size_t ticks_needed(const IdentifyProblem& p) {
  const double length = std::round(p.window / p.tick);  // twenty windows side by side, and the margins
  return static_cast<std::size_t>(20.0 * length + 2.0 * std::min(delay_max, 0.5 * length)) + 2 * rate_half +
         2;
}

namespace {

/// With the angles as they are.
Identification fit(const IdentifyProblem& p) {
  const auto standard = standard_parameters(p.five_bar);
  const Equations e(p);
  Identification out;
  out.windows = e.windows();
  out.parameters = independent_columns(e.W, standard);
  // A mass may be moved between the tips and to the effector; without gravity nothing depends on s. Whatever
  // else is missing has not been moved.
  const std::size_t expected = (p.five_bar ? 7U : 4U) - (p.gravity > 0.0 ? 0U : (p.five_bar ? 2U : 1U)) +
                               2U * static_cast<std::size_t>(joints_of(p.five_bar));
  if (out.parameters.size() < expected) {
    out.weak.push_back(
        fmt::format("{} of {} combinations at all", expected - out.parameters.size(), expected));
    return out;
  }
  const auto n = static_cast<Eigen::Index>(out.parameters.size());
  Matrix W(e.W.rows(), n);
  Vector scale(n);
  double size[2] = {0.0, 0.0};  // of what there is, where a nominal value is 0
  for (Eigen::Index i = 0; i < n; ++i) {
    BaseParameter& b = out.parameters[static_cast<std::size_t>(i)];
    W.col(i) = e.W.col(b.of);
    for (std::size_t k = 0; k < b.share.size(); ++k)
      b.nominal += b.share[k] * p.nominal[static_cast<Eigen::Index>(k)];
    const int moment = b.of % per_leg < 2 ? 0 : 1;
    if (standard[static_cast<std::size_t>(b.of)].inertial)
      size[moment] = std::max(size[moment], std::abs(b.nominal));
  }
  for (Eigen::Index i = 0; i < n; ++i)
    scale[i] = std::max(1e-12, size[out.parameters[static_cast<std::size_t>(i)].of % per_leg < 2 ? 0 : 1]);

  Eigen::Vector2d weight = Eigen::Vector2d::Ones();
  Step s;
  for (int pass = 0; pass < 2; ++pass) {
    // From the best of a coarse grid.
    double least = -1.0;
    for (double d = -2.0; d <= 10.0 && pass == 0; d += 1.0) {
      const Step at = solve(e, W, weight, d);
      Vector plain = at.residual;  // with the delay as it is
      plain += at.A.col(n) * at.x[n];
      const double cost = plain.squaredNorm();
      if (least < 0.0 || cost < least) {
        least = cost;
        out.delay_ticks = d;
      }
    }
    for (int i = 0; i < 30; ++i) {
      s = solve(e, W, weight, out.delay_ticks);
      const double step = std::clamp(s.x[n], -1.0, 1.0);
      out.delay_ticks = std::clamp(out.delay_ticks + step, delay_min, delay_max);
      if (std::abs(step) < 1e-9) break;
    }
    const Vector torque = e.torque(out.delay_ticks);
    for (int j = 0; j < 2; ++j) {
      double square = 0.0, effort = 0.0;
      for (Eigen::Index i = j; i < s.residual.size(); i += 2) {
        square += std::pow(s.residual[i] / weight[j], 2);
        effort += torque[i] * torque[i];
      }
      out.residual[static_cast<std::size_t>(j)] = std::sqrt(square / out.windows);
      out.effort[static_cast<std::size_t>(j)] = std::sqrt(effort / out.windows);
    }
    for (int j = 0; j < 2; ++j) {
      const auto u = static_cast<std::size_t>(j);
      weight[j] = 1.0 / std::max(out.residual[u], 1e-9 * (out.effort[0] + out.effort[1]) + 1e-300);
    }
  }
  s = solve(e, W, weight, out.delay_ticks);
  out.covariance = covariance_of(s).topLeftCorner(n + 1, n + 1);
  for (Eigen::Index i = 0; i < n; ++i) {
    out.parameters[static_cast<std::size_t>(i)].value = s.x[i];
    out.parameters[static_cast<std::size_t>(i)].sigma = std::sqrt(std::max(0.0, out.covariance(i, i)));
  }
  out.delay_sigma = std::sqrt(std::max(0.0, out.covariance(n, n)));
  out.weak = weak_directions(out.parameters, out.covariance, scale, standard);
  return out;
}

/// The angles that a critically damped observer of this bandwidth has followed: it is late by acceleration /
/// bandwidth^2.
IdentifyProblem before_observer(const IdentifyProblem& p, double share) {
  IdentifyProblem out = p;
  const auto weights = curvature_weights();
  const double scale = share / std::pow(p.observer_bandwidth * p.tick, 2);
  for (std::size_t n = 0; n < p.angle.size(); ++n) {
    for (std::size_t j = 0; j < 2; ++j)
      out.angle[n][j] +=
          scale * curvature(weights, p.angle.size(), n, [&](std::size_t row) { return p.angle[row][j]; });
  }
  return out;
}

}  // namespace

Identification identify(const IdentifyProblem& p) {
  if (!(p.observer_bandwidth > 0.0)) return fit(p);
  Identification out = fit(before_observer(p, 0.5));
  if (!out.weak.empty()) return out;
  const Identification none = fit(p), whole = fit(before_observer(p, 1.0));
  const auto n = static_cast<Eigen::Index>(out.parameters.size());
  if (none.parameters.size() != out.parameters.size() || whole.parameters.size() != out.parameters.size())
    return out;
  Vector range(n + 1);
  for (Eigen::Index i = 0; i < n; ++i)
    range[i] = whole.parameters[static_cast<std::size_t>(i)].value -
               none.parameters[static_cast<std::size_t>(i)].value;
  range[n] = whole.delay_ticks - none.delay_ticks;
  out.covariance += range * range.transpose() / 12.0;  // evenly distributed between none and all of it
  for (Eigen::Index i = 0; i < n; ++i)
    out.parameters[static_cast<std::size_t>(i)].sigma = std::sqrt(std::max(0.0, out.covariance(i, i)));
  out.delay_sigma = std::sqrt(std::max(0.0, out.covariance(n, n)));
  return out;
}

}  // namespace esmc::host
