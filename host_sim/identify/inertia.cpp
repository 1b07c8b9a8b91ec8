#include "host_sim/identify/inertia.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <numbers>

#include "host_sim/error.hpp"
#include "host_sim/record/derivatives.hpp"

namespace esmc::host {
namespace {

// ---- equations: bars of the mechanism from its base joints, regressors of every tick, smooth windows

/// Bars 1, 2 of leg 1, then of leg 2, angles in the leg's own frame. An RR arm has the first two.
struct MotionAt {
  std::array<double, 4> angle{}, rate{};  ///< rad, rad/s, of the bars
  /// Rates of the bars per rate of the base joints, and the derivative of that along the motion, 1/s.
  Eigen::Matrix<double, 4, 2> D = Eigen::Matrix<double, 4, 2>::Zero(), D_dot = D;
};

/// False where the base angles fit no closed mechanism.
bool motion_at(const IdentifyProblem& p, const std::array<double, 2>& base,
               const std::array<double, 2>& base_rate, MotionAt& m) {
  using Complex = std::complex<double>;
  const Eigen::Vector2d w(base_rate[0], base_rate[1]);
  if (!p.five_bar) {
    m.angle = {base[0], base[0] + base[1], 0.0, 0.0};
    m.D << 1, 0, 1, 1, 0, 0, 0, 0;
  } else {
    const Complex elbow1 = p.l0 + std::polar(p.l1[0], base[0]),
                  elbow2 = -p.l0 - std::polar(p.l1[1], -base[1]);
    const Complex between = elbow1 - elbow2;
    const double d = std::abs(between), along = (d * d + p.l2[1] * p.l2[1] - p.l2[0] * p.l2[0]) / (2.0 * d);
    const double square = p.l2[1] * p.l2[1] - along * along;
    if (!(d > 0.0 && square > 0.0)) return false;
    const double side = std::sqrt(square);
    for (const double s : {side, -side}) {
      const Complex tip = elbow2 + between / d * Complex(along, s);
      m.angle = {base[0], std::arg(tip - elbow1), base[1], -std::arg(elbow2 - tip)};
      if (std::sin(m.angle[1] + m.angle[3]) * p.assembly > 0.0) break;
    }
    // Derivative of the closed loop: U (rates of the distal bars) = V (rates of the base joints).
    const auto column = [](const Complex& z) { return Eigen::Vector2d(z.real(), z.imag()); };
    const auto i = Complex(0.0, 1.0);
    const Complex bar[4] = {std::polar(p.l1[0], m.angle[0]), std::polar(p.l2[0], m.angle[1]),
                            std::polar(p.l1[1], -m.angle[2]), std::polar(p.l2[1], -m.angle[3])};
    Eigen::Matrix2d U, V, U_dot, V_dot;
    U << column(i * bar[1]), column(-i * bar[3]);
    V << column(-i * bar[0]), column(i * bar[2]);
    Eigen::Matrix2d inverse;
    inverse << U(1, 1), -U(0, 1), -U(1, 0), U(0, 0);
    inverse *= 1.0 / (U(0, 0) * U(1, 1) - U(0, 1) * U(1, 0));
    const Eigen::Matrix2d G = inverse * V;
    const Eigen::Vector2d outer = G * w;
    U_dot << column(-bar[1] * outer[0]), column(-bar[3] * outer[1]);
    V_dot << column(bar[0] * w[0]), column(bar[2] * w[1]);
    const Eigen::Matrix2d G_dot = inverse * (V_dot - U_dot * G);
    m.D << 1.0, 0.0, G(0, 0), G(0, 1), 0.0, 1.0, G(1, 0), G(1, 1);
    m.D_dot << 0.0, 0.0, G_dot(0, 0), G_dot(0, 1), 0.0, 0.0, G_dot(1, 0), G_dot(1, 1);
  }
  const Eigen::Vector4d rate = m.D * w;
  for (int k = 0; k < 4; ++k) m.rate[static_cast<std::size_t>(k)] = rate[k];
  return rate.allFinite() && m.D_dot.allFinite();
}

constexpr auto rate_half = derivative_half;
constexpr int hops_per_window = 4;
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
  Tick t{Matrix::Zero(2, inertial + 2 * joints),
         Matrix::Zero(2, inertial + 2 * joints),
         {},
         Matrix::Zero(2, joints)};
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
      t.force.col(2 * per_leg) = -l1 * l1 * E1 * w1 - l2 * l2 * E2 * w2 + l2 * t.force.col(column + 2) +
                                 l1 * t.force.col(column + 3);
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

/// Smooth windows over ticks: sin^4, zero with three derivatives at both ends. `u` in ticks from the
/// beginning.
struct Window {
  double length;
  [[nodiscard]] double value(double u) const {
    return u <= 0.0 || u >= length ? 0.0 : std::pow(std::sin(std::numbers::pi * u / length), 4);
  }
  [[nodiscard]] double slope(double u) const {
    if (u <= 0.0 || u >= length) return 0.0;
    const double x = std::numbers::pi * u / length, s = std::sin(x);
    return 4.0 * s * s * s * std::cos(x) * std::numbers::pi / length;
  }
  /// Integral of the window from 0 to u, ticks.
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
    ticks_.reserve(p.torque.size());
    for (std::size_t n = rate_half; n + rate_half < p.torque.size(); ++n) {
      std::array<double, 2> rate{};
      for (std::size_t k = 0; k < slope.size(); ++k) {
        for (std::size_t j = 0; j < 2; ++j) rate[j] += slope[k] * p.angle[j][n + k - rate_half] / p.tick;
      }
      MotionAt m;
      if (!motion_at(p, {p.angle[0][n], p.angle[1][n]}, rate, m))
        refuse(
            "row {}: the measured base angles fit no closed mechanism with the scene's lengths: calibrate "
            "them first",
            n + 1);
      ticks_.push_back(tick_of(p, m));
    }
    // A rate is smoothed over some ticks, and the kink that friction makes of it where it turns round shifts
    // that instant. By how much is one more unknown per joint, which is not reported.
    for (std::size_t n = 1; n < ticks_.size(); ++n) {
      for (Eigen::Index k = 0; k < ticks_[n].reversal.cols(); ++k) {
        const double turned = sign(ticks_[n].relative[k]) - sign(ticks_[n - 1].relative[k]);
        ticks_[n].reversal.col(k) = turned * ticks_[n].joint.row(k).transpose();
      }
    }
    const auto length = static_cast<std::size_t>(window_.length),
               hop = std::max<std::size_t>(1, length / hops_per_window);
    // The torque of a window may have been asked before it: `margin` ticks of it stay free at either end.
    const std::size_t margin = static_cast<std::size_t>(std::min(delay_max, 0.5 * window_.length));
    for (std::size_t first = margin; first + length + margin < ticks_.size(); first += hop)
      first_.push_back(first);
    W = Matrix::Zero(2 * static_cast<Eigen::Index>(first_.size()), ticks_.front().momentum.cols());
    reversal = Matrix::Zero(W.rows(), ticks_.front().reversal.cols());
    const double mean = 1.0 / (p.tick * window_.integral(window_.length));
    for (std::size_t k = 0; k < first_.size(); ++k) {
      auto rows = W.middleRows<2>(2 * static_cast<Eigen::Index>(k));
      for (std::size_t i = 1; i < length; ++i) {
        const Tick& t = ticks_[first_[k] + i];
        const auto u = static_cast<double>(i);
        reversal.middleRows<2>(2 * static_cast<Eigen::Index>(k)) +=
            p.tick * mean * window_.value(u) * t.reversal;
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
        const auto at = std::clamp<std::ptrdiff_t>(first + static_cast<std::ptrdiff_t>(std::lround(u + 0.5)),
                                                   0, static_cast<std::ptrdiff_t>(ticks_.size()) - 1);
        const auto& tau = p_.torque[static_cast<std::size_t>(asked)];
        const Eigen::Vector4d joint(tau[0], tau[1], tau[2], tau[3]);
        out.segment<2>(2 * static_cast<Eigen::Index>(k)) +=
            share / whole * ticks_[static_cast<std::size_t>(at)].joint.transpose() * joint;
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

// ---- their solution

constexpr double dependent = 1e-7;        // of a column's length: what is left of one that others make up
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
    const Vector coefficients = least_squares(columns_of(W, out), W.col(c));
    for (std::size_t i = 0; i < out.size(); ++i) {
      const double x = coefficients[static_cast<Eigen::Index>(i)];
      if (std::abs(x) < 1e-6) continue;
      out[i].share[c] = x;
      out[i].text += fmt::format(" {} {:.6g} {}", x < 0.0 ? "-" : "+", std::abs(x), of.name);
    }
  }
  return out;
}

/// Least squares for parameters and delay about a delay, rows weighted. x: base parameters, then the step of
/// the delay, then the shifts of the reversals.
struct Step {
  Vector x, residual;
  Matrix A;
};
Step solve(const Equations& e, const Matrix& W, const std::array<double, 2>& weight, double delay) {
  constexpr double h = 0.25;
  Vector b = e.torque(delay);
  Step s;
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
Matrix covariance_of(const Step& s, Eigen::Index count) {
  const Eigen::Index blocks = std::clamp<Eigen::Index>(s.A.rows() / 2 / hops_per_window, 1, 60);
  const Matrix gradient = gradient_covariance(s.A, s.residual, blocks);
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
    const Step at = solve(e, W, weight, delay);
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

/// With the angles as they are.
Identification fit(const IdentifyProblem& p) {
  const Equations e(p);
  Identification out;
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
    Step s;
    double step = 1.0;
    for (int i = 0; i < 30 && std::abs(step) >= 1e-9; ++i) {
      s = solve(e, W, weight, out.delay_ticks);
      step = std::clamp(s.x[n], -1.0, 1.0);
      out.delay_ticks = std::clamp(out.delay_ticks + step, delay_min, delay_max);
    }
    weigh(s.residual, e.torque(out.delay_ticks), weight, out);
  }
  const Step s = solve(e, W, weight, out.delay_ticks);
  set_covariance(out, covariance_of(s, n + 1));
  for (Eigen::Index i = 0; i < n; ++i) out.parameters[static_cast<std::size_t>(i)].value = s.x[i];
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
  return static_cast<std::size_t>(20.0 * length + 2.0 * std::min(delay_max, 0.5 * length)) + 2 * rate_half +
         2;
}

Identification identify(const IdentifyProblem& p) {
  if (!(p.observer_bandwidth > 0.0)) return fit(p);
  Identification out = fit(without_lag(p, 0.5));
  if (!out.weak.empty()) return out;
  const auto values = [](const Identification& r) {
    Vector all(static_cast<Eigen::Index>(r.parameters.size()) + 1);
    Eigen::Index i = 0;
    for (const BaseParameter& b : r.parameters) all[i++] = b.value;
    all[i] = r.delay_ticks;
    return all;
  };
  const Vector none = values(fit(p)), whole = values(fit(without_lag(p, 1.0)));
  if (none.size() != out.covariance.rows() || whole.size() != none.size()) return out;
  const Vector range = whole - none;
  set_covariance(out, out.covariance + gram(range.transpose()) / 12.0);  // evenly between none and all of it
  return out;
}

}  // namespace esmc::host
