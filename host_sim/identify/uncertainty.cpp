#include "host_sim/identify/uncertainty.hpp"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>

namespace esmc::host {
namespace {

constexpr std::array<double LegParams<double>::*, 4> factored{&LegParams<double>::m1, &LegParams<double>::m2,
                                                              &LegParams<double>::J1, &LegParams<double>::J2};
constexpr std::array factor_names{"m1", "m2", "J1", "J2"};
constexpr double useless = 1.0;  // an uncertainty of 100 %

/// Of the base parameters, the inertial ones.
Eigen::VectorXd base_values(const Identification& r, const Eigen::VectorXd& standard,
                            const std::vector<std::size_t>& which) {
  Eigen::VectorXd out(static_cast<Eigen::Index>(which.size()));
  for (std::size_t i = 0; i < which.size(); ++i) {
    double sum = 0.0;
    const auto& share = r.parameters[which[i]].share;
    for (std::size_t k = 0; k < share.size(); ++k) sum += share[k] * standard[static_cast<Eigen::Index>(k)];
    out[static_cast<Eigen::Index>(i)] = sum;
  }
  return out;
}

std::string interval(double lower, double upper) {
  return fmt::format("[{:.6g}, {:.6g}]", std::max(0.0, lower), std::max(0.0, upper));
}

}  // namespace

Eigen::VectorXd standard_values(const FiveBarParams<double>& p, bool five_bar) {
  const int legs = five_bar ? 2 : 1, inertial = five_bar ? 9 : 4;
  Eigen::VectorXd out = Eigen::VectorXd::Zero(inertial + 4 * legs);
  for (int leg = 0; leg < legs; ++leg) {
    const LegParams<double>& l = p.legs[static_cast<std::size_t>(leg)];
    out.segment<4>(4 * leg) << l.J1 + l.m1 * l.lg1 * l.lg1 + l.m2 * l.l1 * l.l1, l.J2 + l.m2 * l.lg2 * l.lg2,
        l.m2 * l.lg2, l.m1 * l.lg1 + l.m2 * l.l1;
    out.segment<2>(inertial + 2 * leg) << l.d1, l.d2;
    out.segment<2>(inertial + 2 * legs + 2 * leg) << l.gamma1, l.gamma2;
  }
  if (five_bar) out[8] = p.m0;
  return out;
}

std::string uncertainty_snippet(const Identification& r, const IdentifyProblem& p,
                                const FiveBarParams<double>& believed, double coverage) {
  const auto standard = standard_parameters(p.five_bar);
  std::vector<std::size_t> inertial;
  for (std::size_t i = 0; i < r.parameters.size(); ++i) {
    if (standard[static_cast<std::size_t>(r.parameters[i].of)].inertial) inertial.push_back(i);
  }
  const auto n = static_cast<Eigen::Index>(inertial.size());
  Eigen::MatrixXd B(n, 4), C(n, n);
  for (std::size_t f = 0; f < factored.size(); ++f) {  // linear in each of them
    FiveBarParams<double> without = believed;
    for (auto& leg : without.legs) leg.*factored[f] = 0.0;
    B.col(static_cast<Eigen::Index>(f)) = base_values(
        r, standard_values(believed, p.five_bar) - standard_values(without, p.five_bar), inertial);
  }
  Eigen::VectorXd change(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const BaseParameter& b = r.parameters[inertial[static_cast<std::size_t>(i)]];
    change[i] = b.value - b.nominal;
    for (Eigen::Index k = 0; k < n; ++k) {
      C(i, k) = r.covariance(static_cast<Eigen::Index>(inertial[static_cast<std::size_t>(i)]),
                             static_cast<Eigen::Index>(inertial[static_cast<std::size_t>(k)]));
    }
  }
  // Weighted by what is known of each; the legs may differ more than that, and then the intervals are as
  // wide.
  const Eigen::VectorXd size =
      C.diagonal().cwiseSqrt().cwiseMax(1e-9 * B.cwiseAbs().rowwise().maxCoeff()).cwiseMax(1e-15);
  const Eigen::MatrixXd white = size.cwiseInverse().asDiagonal() * C * size.cwiseInverse().asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> modes(white);
  const Eigen::MatrixXd root = modes.eigenvalues().cwiseMax(1e-9).cwiseSqrt().cwiseInverse().asDiagonal() *
                               modes.eigenvectors().transpose() * size.cwiseInverse().asDiagonal();
  const Eigen::MatrixXd A = root * B;
  const Eigen::VectorXd b = root * change;
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> normal(A.transpose() * A);
  Eigen::VectorXd factor = Eigen::VectorXd::Zero(4), variance = Eigen::VectorXd::Zero(4);
  std::array<bool, 4> told{true, true, true, true};
  const Eigen::VectorXd right = A.transpose() * b;
  for (Eigen::Index m = 0; m < 4; ++m) {
    const Eigen::VectorXd v = normal.eigenvectors().col(m);
    const double information = normal.eigenvalues()[m];
    if (!(information > 1.0 / (useless * useless))) {
      for (std::size_t f = 0; f < told.size(); ++f)
        told[f] = told[f] && std::abs(v[static_cast<Eigen::Index>(f)]) < 0.2;
      continue;
    }
    factor += v * (v.dot(right) / information);
    variance += v.cwiseAbs2() / information;
  }
  const double misfit = n > 4 ? (b - A * factor).squaredNorm() / static_cast<double>(n - 4) : 1.0;
  variance *= std::max(1.0, misfit);

  std::string out =
      "[uncertainty]                  # true over believed, both legs; mass centres as believed\n";
  for (std::size_t f = 0; f < factored.size(); ++f) {
    const auto i = static_cast<Eigen::Index>(f);
    const double half = coverage * std::sqrt(variance[i]);
    const std::string line =
        fmt::format("{} = {}", factor_names[f], interval(1.0 + factor[i] - half, 1.0 + factor[i] + half));
    out += told[f] ? line + "\n" : fmt::format("# {}: not told apart by this motion\n", factor_names[f]);
  }
  for (const char* kind : {"viscous", "coulomb"}) {
    std::string list;
    for (const BaseParameter& v : r.parameters) {
      if (!standard[static_cast<std::size_t>(v.of)].name.starts_with(kind)) continue;
      list +=
          (list.empty() ? "" : ", ") + interval(v.value - coverage * v.sigma, v.value + coverage * v.sigma);
    }
    if (!list.empty()) out += fmt::format("{} = [{}]\n", kind, list);
  }
  out += fmt::format("# torque delay: control.delay_ticks = {:.2f}, from {:.2f} to {:.2f}\n", r.delay_ticks,
                     r.delay_ticks - coverage * r.delay_sigma, r.delay_ticks + coverage * r.delay_sigma);
  return out;
}

}  // namespace esmc::host
