#include "host_sim/identify/inertia.hpp"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "host_sim/error.hpp"
#include "host_sim/identify/motion_at.hpp"
#include "host_sim/recorded/derivatives.hpp"

namespace esmc::host {
namespace {

using Matrix = Eigen::MatrixXd;
using Vector = Eigen::VectorXd;

constexpr auto rate_half = derivative_half;
constexpr int hops_per_window = 4;
constexpr double dependent = 1e-7;       // of a column's length: what is left of one that others make up
constexpr double weak_sigma = 0.5;       // an uncertainty of half of everything there is
constexpr double delay_min = -5.0, delay_max = 50.0;  // ticks

/// Columns of one leg: a, c, h, s.
constexpr int per_leg = 4;

int inertial_columns(bool five_bar) { return five_bar ? 2 * per_leg + 1 : per_leg; }
int joints_of(bool five_bar) { return five_bar ? 4 : 2; }

/// The regressor of one tick: momentum, and what acts on it, per base joint (2 rows) and parameter.
struct Tick {
  Matrix momentum;  ///< D^T p
  Matrix force;     ///< what changes it beside the torque: -(D_dot^T p + D^T dT/dq) + weight + friction
  Eigen::Matrix<double, 4, 2> joint;  ///< rates of the joints per rate of the base joints
  Matrix reversal;  ///< torque of a Coulomb friction of 1 N m that turns round one tick too early, per joint
  Eigen::Vector4d relative = Eigen::Vector4d::Zero();  ///< rates of the joints, rad/s
};

double sign(double v) { return v > 0.0 ? 1.0 : (v < 0.0 ? -1.0 : 0.0); }

Tick tick_of(const IdentifyProblem& p, const MotionAt& m) {
  const int inertial = inertial_columns(p.five_bar), joints = joints_of(p.five_bar);
  Tick t{Matrix::Zero(2, inertial + 2 * joints), Matrix::Zero(2, inertial + 2 * joints), {}, Matrix::Zero(2, joints)};
  const auto rate = [&](int bar) { return m.rate[static_cast<std::size_t>(bar)]; };
  const auto angle = [&](int bar) { return m.angle[static_cast<std::size_t>(bar)]; };
  for (int leg = 0; leg < joints / 2; ++leg) {
    const int one = 2 * leg, two = one + 1, column = per_leg * leg;
    const Eigen::Vector2d D1 = m.D.row(one), D2 = m.D.row(two), E1 = m.D_dot.row(one), E2 = m.D_dot.row(two);
    const double between = angle(two) - angle(one), l1 = p.l1[static_cast<std::size_t>(leg)];
    const double c = l1 * std::cos(between), s = l1 * std::sin(between);
    // T = a w1^2 / 2 + c w2^2 / 2 + h l1 cos(phi2 - phi1) w1 w2; V = g (s sin phi1 + h sin phi2)
    t.momentum.col(column) = D1 * rate(one);
    t.force.col(column) = -E1 * rate(one);
    t.momentum.col(column + 1) = D2 * rate(two);
    t.force.col(column + 1) = -E2 * rate(two);
    t.momentum.col(column + 2) = c * (D1 * rate(two) + D2 * rate(one));
    t.force.col(column + 2) = -c * (E1 * rate(two) + E2 * rate(one)) - s * rate(one) * rate(two) * (D1 - D2) +
                              p.gravity * std::cos(angle(two)) * D2;
    t.force.col(column + 3) = p.gravity * std::cos(angle(one)) * D1;
    if (leg == 0 && p.five_bar) {  // a mass at the tip of leg 1
      const double l2 = p.l2[0], w1 = rate(one), w2 = rate(two);
      const Eigen::Vector2d q1 = l1 * l1 * D1, q2 = l2 * l2 * D2;
      t.momentum.col(2 * per_leg) = q1 * w1 + q2 * w2 + l2 * t.momentum.col(column + 2);
      t.force.col(2 * per_leg) = -l1 * l1 * E1 * w1 - l2 * l2 * E2 * w2 + l2 * t.force.col(column + 2) + l1 * t.force.col(column + 3);
    }
    t.joint.row(one) = D1.transpose();
    t.joint.row(two) = (D2 - D1).transpose();
    const double relative[2] = {rate(one), rate(two) - rate(one)};
    for (int k = 0; k < 2; ++k) {
      const Eigen::Vector2d J = t.joint.row(one + k);
      t.relative[one + k] = relative[k];
      t.force.col(inertial + one + k) = J * relative[k];
      t.force.col(inertial + joints + one + k) = J * sign(relative[k]);
    }
  }
  if (!p.five_bar) t.joint.bottomRows<2>().setZero();
  return t;
}

/// Smooth windows over ticks: sin^4, zero with three derivatives at both ends. `u` in ticks from the beginning.
struct Window {
  double length;
  [[nodiscard]] double value(double u) const { return u <= 0.0 || u >= length ? 0.0 : std::pow(std::sin(std::numbers::pi * u / length), 4); }
  [[nodiscard]] double slope(double u) const {
    if (u <= 0.0 || u >= length) return 0.0;
    const double x = std::numbers::pi * u / length, s = std::sin(x);
    return 4.0 * s * s * s * std::cos(x) * std::numbers::pi / length;
  }
  /// From 0 to u.
  [[nodiscard]] double integral(double u) const {
    const double x = std::clamp(u, 0.0, length) * std::numbers::pi / length;
    return (3.0 * x / 8.0 - std::sin(2.0 * x) / 4.0 + std::sin(4.0 * x) / 32.0) * length / std::numbers::pi;
  }
};

/// All equations: W parameters = torque(delay), in N m: means under the windows.
class Equations {
 public:
  explicit Equations(const IdentifyProblem& p) : p_(p), window_{std::round(p.window / p.tick)} {
    const auto slope = slope_weights();
    ticks_.reserve(p.angle.size());
    for (std::size_t n = rate_half; n + rate_half < p.angle.size(); ++n) {
      std::array<double, 2> rate{};
      for (std::size_t k = 0; k < slope.size(); ++k) {
        for (std::size_t j = 0; j < 2; ++j) rate[j] += slope[k] * p.angle[n + k - rate_half][j] / p.tick;
      }
      MotionAt m;
      if (!motion_at(p, p.angle[n], rate, m)) {
        throw InputError("", fmt::format("row {}: the measured base angles fit no closed mechanism with the scene's lengths: calibrate "
                                         "them first", n + 1));
      }
      ticks_.push_back(tick_of(p, m));
    }
    // A rate is smoothed over some ticks, and the kink that friction makes of it where it turns round shifts that instant. How far is
    // one unknown per joint more; nobody is told.
    for (std::size_t n = 1; n < ticks_.size(); ++n) {
      for (Eigen::Index k = 0; k < ticks_[n].reversal.cols(); ++k) {
        const double turned = sign(ticks_[n].relative[k]) - sign(ticks_[n - 1].relative[k]);
        ticks_[n].reversal.col(k) = turned * ticks_[n].joint.row(k).transpose();
      }
    }
    const auto length = static_cast<std::size_t>(window_.length), hop = std::max<std::size_t>(1, length / hops_per_window);
    // The torque of a window may have been asked before it: `margin` ticks of it stay free at either end.
    const std::size_t margin = static_cast<std::size_t>(std::min(delay_max, 0.5 * window_.length));
    for (std::size_t first = margin; first + length + margin < ticks_.size(); first += hop) first_.push_back(first);
    W = Matrix::Zero(2 * static_cast<Eigen::Index>(first_.size()), ticks_.front().momentum.cols());
    reversal = Matrix::Zero(W.rows(), ticks_.front().reversal.cols());
    const double mean = 1.0 / (p.tick * window_.integral(window_.length));
    for (std::size_t k = 0; k < first_.size(); ++k) {
      auto rows = W.middleRows<2>(2 * static_cast<Eigen::Index>(k));
      for (std::size_t i = 1; i < length; ++i) {
        const Tick& t = ticks_[first_[k] + i];
        const auto u = static_cast<double>(i);
        reversal.middleRows<2>(2 * static_cast<Eigen::Index>(k)) += p.tick * mean * window_.value(u) * t.reversal;
        rows += p.tick * mean * (window_.value(u) * t.force - window_.slope(u) / p.tick * t.momentum);
      }
    }
  }

  /// The right-hand side: torques act `delay` ticks after they were asked for, each until the next.
  [[nodiscard]] Vector torque(double delay) const {
    Vector out = Vector::Zero(W.rows());
    const double whole = window_.integral(window_.length);
    const auto length = static_cast<std::ptrdiff_t>(window_.length);
    const auto reach = static_cast<std::ptrdiff_t>(std::ceil(std::abs(delay))) + 2;
    for (std::size_t k = 0; k < first_.size(); ++k) {
      const auto first = static_cast<std::ptrdiff_t>(first_[k]);
      for (std::ptrdiff_t i = -reach; i < length + reach; ++i) {
        const double u = static_cast<double>(i) + delay;  // where this tick's torque begins to act
        const double share = window_.integral(u + 1.0) - window_.integral(u);
        const std::ptrdiff_t asked = first + i + static_cast<std::ptrdiff_t>(rate_half);
        if (share == 0.0 || asked < 0 || asked >= static_cast<std::ptrdiff_t>(p_.torque.size())) continue;
        // Gathered on the base joints where the mechanism is when it acts.
        const auto at = std::clamp<std::ptrdiff_t>(first + static_cast<std::ptrdiff_t>(std::lround(u + 0.5)), 0,
                                                   static_cast<std::ptrdiff_t>(ticks_.size()) - 1);
        const auto& tau = p_.torque[static_cast<std::size_t>(asked)];
        const Eigen::Vector4d joint(tau[0], tau[1], tau[2], tau[3]);
        out.segment<2>(2 * static_cast<Eigen::Index>(k)) += share / whole * ticks_[static_cast<std::size_t>(at)].joint.transpose() * joint;
      }
    }
    return out;
  }

  Matrix W, reversal;
  [[nodiscard]] int windows() const { return static_cast<int>(first_.size()); }

 private:
  const IdentifyProblem& p_;
  Window window_;
  std::vector<Tick> ticks_;
  std::vector<std::size_t> first_;
};

/// Which columns stand for themselves, and what the others add to them: QR in the order of the columns.
std::vector<BaseParameter> independent_columns(const Matrix& W, const std::vector<StandardParameter>& standard) {
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
    BaseParameter b{basis[i], std::vector<double>(count, 0.0), standard[static_cast<std::size_t>(basis[i])].name, 0.0, 0.0, 0.0};
    b.share[static_cast<std::size_t>(basis[i])] = 1.0;
    for (const auto& [column, coefficients] : made_up) {
      if (static_cast<Eigen::Index>(i) >= coefficients.size()) continue;
      const double x = coefficients[static_cast<Eigen::Index>(i)];
      if (std::abs(x) < 1e-6) continue;
      b.share[static_cast<std::size_t>(column)] = x;
      b.text += fmt::format(" {} {:.6g} {}", x < 0.0 ? "-" : "+", std::abs(x), standard[static_cast<std::size_t>(column)].name);
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
  for (Eigen::Index i = 0; i < rows; ++i) gradients.col((i / 2) * blocks / windows) += s.A.row(i).transpose() * s.residual[i];
  gradients.colwise() -= gradients.rowwise().mean().eval();
  const Matrix inverse = (s.A.transpose() * s.A).completeOrthogonalDecomposition().pseudoInverse();
  const auto B = static_cast<double>(blocks);
  return inverse * (B / std::max(1.0, B - static_cast<double>(k)) * gradients * gradients.transpose()) * inverse;
}

/// Combinations whose uncertainty is as large as what is there, in units of the nominal values.
std::vector<std::string> weak_directions(const std::vector<BaseParameter>& parameters, const Matrix& covariance, const Vector& scale,
                                         const std::vector<StandardParameter>& standard) {
  std::vector<int> inertial;
  for (std::size_t i = 0; i < parameters.size(); ++i) {
    if (standard[static_cast<std::size_t>(parameters[i].of)].inertial) inertial.push_back(static_cast<int>(i));
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
      const std::string& name = standard[static_cast<std::size_t>(parameters[static_cast<std::size_t>(inertial[static_cast<std::size_t>(a)])].of)].name;
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
  const auto joint = [&](int leg, int k) { return five_bar ? fmt::format("{}{}", leg + 1, k + 1) : fmt::format("{}", k + 1); };
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
      for (int k = 0; k < 2; ++k) out.push_back({fmt::format("{} theta{}", name, joint(leg, k)), unit, false});
    }
  }
  return out;
}

std::size_t ticks_needed(const IdentifyProblem& p) {
  const double length = std::round(p.window / p.tick);  // twenty windows side by side, and the margins
  return static_cast<std::size_t>(20.0 * length + 2.0 * std::min(delay_max, 0.5 * length)) + 2 * rate_half + 2;
}

namespace {

/// With the angles as they are.
Identification fit(const IdentifyProblem& p) {
  const auto standard = standard_parameters(p.five_bar);
  const Equations e(p);
  Identification out;
  out.windows = e.windows();
  out.parameters = independent_columns(e.W, standard);
  // A mass may be moved between the tips and to the effector; without gravity nothing depends on s. Whatever else is missing has not
  // been moved.
  const std::size_t expected = (p.five_bar ? 7U : 4U) - (p.gravity > 0.0 ? 0U : (p.five_bar ? 2U : 1U)) +
                               2U * static_cast<std::size_t>(joints_of(p.five_bar));
  if (out.parameters.size() < expected) {
    out.weak.push_back(fmt::format("{} of {} combinations at all", expected - out.parameters.size(), expected));
    return out;
  }
  const auto n = static_cast<Eigen::Index>(out.parameters.size());
  Matrix W(e.W.rows(), n);
  Vector scale(n);
  double size[2] = {0.0, 0.0};  // of what there is, where a nominal value is 0
  for (Eigen::Index i = 0; i < n; ++i) {
    BaseParameter& b = out.parameters[static_cast<std::size_t>(i)];
    W.col(i) = e.W.col(b.of);
    for (std::size_t k = 0; k < b.share.size(); ++k) b.nominal += b.share[k] * p.nominal[static_cast<Eigen::Index>(k)];
    const int moment = b.of % per_leg < 2 ? 0 : 1;
    if (standard[static_cast<std::size_t>(b.of)].inertial) size[moment] = std::max(size[moment], std::abs(b.nominal));
  }
  for (Eigen::Index i = 0; i < n; ++i) scale[i] = std::max(1e-12, size[out.parameters[static_cast<std::size_t>(i)].of % per_leg < 2 ? 0 : 1]);

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

/// The angles that a critically damped observer of this bandwidth has followed: it is late by acceleration / bandwidth^2.
IdentifyProblem before_observer(const IdentifyProblem& p, double share) {
  IdentifyProblem out = p;
  const auto weights = curvature_weights();
  const double scale = share / std::pow(p.observer_bandwidth * p.tick, 2);
  for (std::size_t n = 0; n < p.angle.size(); ++n) {
    for (std::size_t j = 0; j < 2; ++j)
      out.angle[n][j] += scale * curvature(weights, p.angle.size(), n, [&](std::size_t row) { return p.angle[row][j]; });
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
  if (none.parameters.size() != out.parameters.size() || whole.parameters.size() != out.parameters.size()) return out;
  Vector range(n + 1);
  for (Eigen::Index i = 0; i < n; ++i)
    range[i] = whole.parameters[static_cast<std::size_t>(i)].value - none.parameters[static_cast<std::size_t>(i)].value;
  range[n] = whole.delay_ticks - none.delay_ticks;
  out.covariance += range * range.transpose() / 12.0;  // evenly distributed between none and all of it
  for (Eigen::Index i = 0; i < n; ++i) out.parameters[static_cast<std::size_t>(i)].sigma = std::sqrt(std::max(0.0, out.covariance(i, i)));
  out.delay_sigma = std::sqrt(std::max(0.0, out.covariance(n, n)));
  return out;
}

}  // namespace esmc::host
