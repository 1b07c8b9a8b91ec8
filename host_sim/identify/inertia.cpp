#include "host_sim/identify/identification.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "host_sim/error.hpp"
#include "host_sim/identify/defects.hpp"
#include "host_sim/identify/equations.hpp"
#include "host_sim/record/derivatives.hpp"

namespace esmc::host {
namespace {

constexpr double dependent = 1e-7;        // of a column's length: what is left of one that others make up
constexpr std::size_t defects_max = 3;    // that are looked for
constexpr double weak_uncertainty = 0.5;  // an uncertainty of half of everything there is

/// The columns of the standard parameters that base parameters are named after.
Matrix columns_of(const Matrix& W, const std::vector<BaseParameter>& parameters) {
  Matrix out(W.rows(), static_cast<Eigen::Index>(parameters.size()));
  for (std::size_t i = 0; i < parameters.size(); ++i)
    out.col(static_cast<Eigen::Index>(i)) = W.col(parameters[i].column);
  return out;
}

/// Which columns stand for themselves, and what the others add to them: Gram-Schmidt in the order of the
/// columns.
std::vector<BaseParameter> independent_columns(const Matrix& W,
                                               const std::vector<StandardParameter>& standard) {
  std::vector<BaseParameter> out;
  std::vector<Vector> orthonormal;
  for (int c = 0; c < W.cols(); ++c) {
    Vector v = W.col(c);
    const double length = v.norm();
    for (int pass = 0; pass < 2; ++pass)
      for (const Vector& q : orthonormal) v -= q * q.dot(v);
    if (!(length > 1e-12)) continue;  // nothing depends on it: no gravity, no motion
    const StandardParameter& of = standard[static_cast<std::size_t>(c)];
    if (v.norm() > dependent * length) {
      orthonormal.push_back(v.normalized());
      out.push_back({of, c, Vector::Unit(W.cols(), c), of.name, 0.0, 0.0, 0.0});
      continue;
    }
    const Matrix columns = columns_of(W, out);
    const Vector coefficients = least_squares(columns, W.col(c));
    for (std::size_t i = 0; i < out.size(); ++i) {
      const auto k = static_cast<Eigen::Index>(i);
      const double x = coefficients[k];
      if (std::abs(x) * columns.col(k).norm() < 1e-6 * W.col(c).norm()) continue;
      out[i].share[c] = x;
      out[i].text += fmt::format(" {} {:.6g} {}", x < 0.0 ? "-" : "+", std::abs(x), of.name);
    }
  }
  return out;
}

/// Least squares for parameters and delay about a delay.
Solution solve(const Equations& e, const Matrix& W, const std::array<double, 2>& weight, double delay) {
  constexpr double h = 0.25;
  Vector b = e.torque(delay);
  Solution s;
  s.weight = weight;
  s.A.resize(W.rows(), W.cols() + 1 + e.reversal.cols());
  s.A.leftCols(W.cols()) = W;
  s.A.col(W.cols()) = (e.torque(delay - h) - e.torque(delay + h)) / (2.0 * h);
  s.A.rightCols(e.reversal.cols()) = e.reversal;
  for (Eigen::Index i = 0; i < W.rows(); ++i) {
    s.A.row(i) *= weight[static_cast<std::size_t>(i % 2)];
    b[i] *= weight[static_cast<std::size_t>(i % 2)];
  }
  s.x = least_squares(s.A, b);
  s.residual = b - apply(s.A, s.x);
  return s;
}

/// Of parameters and delay.
Matrix covariance_of(const Solution& s, Eigen::Index count) {
  const Matrix gradient =
      gradient_covariance(s.A, s.residual, correlation_blocks(s.A.rows(), hops_per_window));
  return congruent(pseudo_inverse(gram(s.A)), gradient).topLeftCorner(count, count);
}

/// Combinations whose uncertainty is as large as what is there, in units of the nominal values.
std::vector<std::string> weak_directions(const std::vector<BaseParameter>& parameters,
                                         const Matrix& covariance, const Vector& scale) {
  std::vector<Eigen::Index> at;  // of the inertial ones
  std::vector<std::string> name;
  for (std::size_t i = 0; i < parameters.size(); ++i) {
    if (!parameters[i].of.inertial) continue;
    at.push_back(static_cast<Eigen::Index>(i));
    name.push_back(parameters[i].of.name);
  }
  const Vector size = scale(at);
  const Modes modes = symmetric_modes(covariance(at, at).cwiseQuotient(size * size.transpose()));
  std::vector<std::string> out;
  for (Eigen::Index m = size.size() - 1; m >= 0; --m) {
    if (std::sqrt(std::max(0.0, modes.value[m])) <= weak_uncertainty) break;
    std::vector<std::string> parts;
    for (std::size_t a = 0; a < name.size(); ++a) {
      if (std::abs(modes.vector(static_cast<Eigen::Index>(a), m)) >= 0.3) parts.push_back(name[a]);
    }
    out.push_back(fmt::format("{}", fmt::join(parts, ", ")));
  }
  return out;
}

/// Sets the nominal values of the base parameters. Returns what an uncertainty of each is compared with: the
/// largest nominal value of its kind, moment of inertia or mass moment, as many of them may be 0.
Vector set_nominal(std::vector<BaseParameter>& parameters, const IdentifyProblem& p) {
  const auto kind = [](const BaseParameter& b) { return b.column % per_leg < 2 ? 0 : 1; };
  double size[2] = {0.0, 0.0};
  for (BaseParameter& b : parameters) {
    for (Eigen::Index k = 0; k < b.share.size(); ++k) b.nominal += b.share[k] * p.nominal[k];
    if (b.of.inertial) size[kind(b)] = std::max(size[kind(b)], std::abs(b.nominal));
  }
  Vector scale(static_cast<Eigen::Index>(parameters.size()));
  for (std::size_t i = 0; i < parameters.size(); ++i)
    scale[static_cast<Eigen::Index>(i)] = std::max(1e-12, size[kind(parameters[i])]);
  return scale;
}

/// The best delay of a coarse grid, ticks: the least residual with the delay as it is.
double coarse_delay(const Equations& e, const Matrix& W, const std::array<double, 2>& weight) {
  double best = 0.0, least = std::numeric_limits<double>::infinity();
  for (double delay = -2.0; delay <= 10.0; delay += 1.0) {
    const Solution at = solve(e, W, weight, delay);
    const double cost = (at.residual + at.A.col(W.cols()) * at.x[W.cols()]).squaredNorm();
    if (cost < least) {
      least = cost;
      best = delay;
    }
  }
  return best;
}

/// Residual and effort per base joint, and weights from them.
void weigh(const Vector& residual, const Vector& torque, std::array<double, 2>& weight, Identification& out) {
  for (std::size_t j = 0; j < 2; ++j) {
    double square = 0.0, effort = 0.0;
    for (auto i = static_cast<Eigen::Index>(j); i < residual.size(); i += 2) {
      square += std::pow(residual[i] / weight[j], 2);
      effort += torque[i] * torque[i];
    }
    out.residual[j] = std::sqrt(square / out.windows);
    out.effort[j] = std::sqrt(effort / out.windows);
  }
  const double least = 1e-9 * (out.effort[0] + out.effort[1]) + 1e-300;
  for (std::size_t j = 0; j < 2; ++j) weight[j] = 1.0 / std::max(out.residual[j], least);
}

void set_covariance(Identification& out, const Matrix& covariance) {
  out.covariance = covariance;
  const Vector sigma = covariance.diagonal().cwiseMax(0.0).cwiseSqrt();
  for (std::size_t i = 0; i < out.parameters.size(); ++i)
    out.parameters[i].sigma = sigma[static_cast<Eigen::Index>(i)];
  out.delay_sigma = sigma[sigma.size() - 1];
}

/// With the angles as they are, and the defects of `at` as more unknowns.
Identification fit(const IdentifyProblem& p, const Identification& at, Solution& solution) {
  Equations e(p);
  for (const Defect& d : at.defects) {
    const Matrix columns = columns_of(d, e, p, at);
    e.reversal.conservativeResize(Eigen::NoChange, e.reversal.cols() + columns.cols());
    e.reversal.rightCols(columns.cols()) = columns;
  }
  Identification out;
  out.defects = at.defects;
  out.windows = e.windows();
  out.parameters = independent_columns(e.W, standard_parameters(p.five_bar));
  // A mass may be moved between the tips and to the effector; without gravity nothing depends on s. Whatever
  // else is missing has not been moved.
  const std::size_t expected = (p.five_bar ? 7U : 4U) - (p.gravity > 0.0 ? 0U : (p.five_bar ? 2U : 1U)) +
                               2U * static_cast<std::size_t>(joints_of(p.five_bar));
  if (out.parameters.size() < expected) {
    out.weak.push_back(
        fmt::format("{} of {} combinations at all", expected - out.parameters.size(), expected));
    return out;
  }
  const Matrix W = columns_of(e.W, out.parameters);
  const Vector scale = set_nominal(out.parameters, p);
  const Eigen::Index n = W.cols();
  std::array weight{1.0, 1.0};
  out.delay_ticks = coarse_delay(e, W, weight);
  for (int pass = 0; pass < 2; ++pass) {
    double step = 1.0;
    for (int i = 0; i < 30 && std::abs(step) >= 1e-9; ++i) {
      solution = solve(e, W, weight, out.delay_ticks);
      step = std::clamp(solution.x[n], -1.0, 1.0);
      out.delay_ticks = std::clamp(out.delay_ticks + step, delay_min, delay_max);
    }
    weigh(solution.residual, e.torque(out.delay_ticks), weight, out);
  }
  solution = solve(e, W, weight, out.delay_ticks);
  set_covariance(out, covariance_of(solution, n + 1));
  for (Eigen::Index i = 0; i < n; ++i) out.parameters[static_cast<std::size_t>(i)].value = solution.x[i];
  out.weak = weak_directions(out.parameters, out.covariance, scale);
  return out;
}

/// `share` of the lag of the drives' observers taken back.
IdentifyProblem without_lag(IdentifyProblem p, double share) {
  for (auto& angle : p.angle) angle = before_observer(angle, p.observer_bandwidth * p.tick, share);
  return p;
}

}  // namespace

std::vector<StandardParameter> standard_parameters(bool five_bar) {
  std::vector<StandardParameter> out;
  const std::vector<std::string> legs =
      five_bar ? std::vector<std::string>{"1", "2"} : std::vector<std::string>{""};
  for (const std::string& leg : legs) {
    for (const char* moment : {"a", "c"}) out.push_back({moment + leg, "kg m2", true});
    for (const char* moment : {"h", "s"}) out.push_back({moment + leg, "kg m", true});
  }
  if (five_bar) out.push_back({"m0", "kg", true});
  for (const auto& [name, unit] : {std::pair("viscous", "N m s/rad"), std::pair("coulomb", "N m")}) {
    for (const std::string& leg : legs) {
      for (const char* joint : {"1", "2"})
        out.push_back({fmt::format("{} theta{}{}", name, leg, joint), unit, false});
    }
  }
  return out;
}

std::size_t ticks_needed(const IdentifyProblem& p) {
  const double length = std::round(p.window / p.tick);  // twenty windows side by side, and the margins
  return static_cast<std::size_t>(20.0 * length + 2.0 * std::min(delay_max, 0.5 * length)) +
         2 * derivative_half + 2;
}

namespace {

/// With the defects of `at` as more unknowns, and the observers' lag as uncertain as it is. One more defect
/// is added where the rest speaks for it.
Identification identify_with(const IdentifyProblem& p, const Identification& at) {
  const bool late = p.observer_bandwidth > 0.0;
  std::vector<Explained> views;
  std::vector<Identification> fits;
  for (const double share : late ? std::vector{0.5, 0.0, 1.0} : std::vector{0.0}) {
    views.push_back({late ? without_lag(p, share) : p, {}});
    fits.push_back(fit(views.back().problem, at, views.back().solution));
    if (!fits.front().weak.empty()) return fits.front();
  }
  Identification out = fits.front();
  const auto values = [](const Identification& r) {
    Vector all(static_cast<Eigen::Index>(r.parameters.size()) + 1);
    Eigen::Index i = 0;
    for (const BaseParameter& b : r.parameters) all[i++] = b.value;
    all[i] = r.delay_ticks;
    return all;
  };
  if (late && fits[1].parameters.size() == out.parameters.size() &&
      fits[2].parameters.size() == out.parameters.size()) {
    const Vector range = values(fits[2]) - values(fits[1]);
    set_covariance(out,
                   out.covariance + gram(range.transpose()) / 12.0);  // evenly between none and all of it
  }
  if (out.defects.size() < defects_max) {
    if (const auto one_more = find_defect(views, out)) out.defects.push_back(*one_more);
  }
  return out;
}

}  // namespace

Identification identify(const IdentifyProblem& p) {
  Identification out;
  for (std::size_t taken = 0;; taken = out.defects.size()) {
    out = identify_with(p, out);
    if (out.defects.size() == taken) return out;
  }
}

}  // namespace esmc::host
