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
constexpr double told_apart =
    0.1;  // what a payload and factors may take of each other's place, as a factor, and still be two things
constexpr double explains_better =
    10.0;  // what a payload must take of the misfit to be believed where the factors alone are possible
constexpr double near_lower = 0.5,
                 near_upper = 2.0;  // true over believed; beyond, what was believed is of another kind

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

using Factors = Eigen::Vector4d;  // on m1, m2, J1, J2: true over believed, less 1

/// Least squares A x = b, rows already divided by their deviations. What the rows hardly determine stays 0.
struct Fit {
  Factors value = Factors::Zero();
  Eigen::Matrix4d covariance = Eigen::Matrix4d::Zero();  // of unit rows
  std::array<bool, 4> told{true, true, true, true};
  double payload = 0.0, payload_variance = 0.0;  // kg, kg^2
  bool with_payload = false, payload_apart = true;
  double misfit = 1.0;  // mean square of what stays
};

Fit fit(const Eigen::MatrixXd& A, const Eigen::VectorXd& b) {
  Fit out;
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> normal(A.transpose() * A);
  const Eigen::VectorXd right = A.transpose() * b;
  for (Eigen::Index m = 0; m < 4; ++m) {
    const Eigen::VectorXd v = normal.eigenvectors().col(m);
    const double information = normal.eigenvalues()[m];
    if (!(information > 1.0 / (useless * useless))) {
      for (std::size_t f = 0; f < out.told.size(); ++f)
        out.told[f] = out.told[f] && std::abs(v[static_cast<Eigen::Index>(f)]) < 0.2;
      continue;
    }
    out.value += v * (v.dot(right) / information);
    out.covariance += v * v.transpose() / information;
  }
  const auto n = A.rows();
  out.misfit = n > 4 ? std::max(1.0, (b - A * out.value).squaredNorm() / static_cast<double>(n - 4)) : 1.0;
  return out;
}

/// The same with a payload, whose column is p (per kg). A mass at the effector of equal legs does what a mass
/// at the tip of each does: where the rows cannot tell them apart, the payload is the one that leaves the
/// factors nearest to 1.
Fit fit_with_payload(const Eigen::MatrixXd& A, const Eigen::VectorXd& b, const Eigen::VectorXd& p) {
  Fit out = fit(A, b);
  out.with_payload = true;
  const Factors g = fit(A, p).value;  // what factors make of 1 kg
  const Eigen::VectorXd apart = p - A * g;
  const double information = apart.squaredNorm();
  const auto n = A.rows();
  if (n > 4 && information > 0.0 && g.norm() / std::sqrt(information) < told_apart) {
    out.payload = apart.dot(b) / information;
    out.payload_variance = 1.0 / information;
    out.covariance += g * g.transpose() / information;
    out.value -= g * out.payload;
  } else {
    const double size = g.squaredNorm();
    if (!(size > 0.0)) return out;
    out.payload_apart = false;
    out.payload = g.dot(out.value) / size;
    out.payload_variance = g.dot(out.covariance * g) / (size * size);
    const Eigen::Matrix4d across = Eigen::Matrix4d::Identity() - g * g.transpose() / size;
    out.covariance = (across * out.covariance * across).eval();
    out.value -= g * out.payload;
  }
  const double left = (b - A * out.value - p * out.payload).squaredNorm();
  out.misfit = n > 5 ? std::max(1.0, left / static_cast<double>(n - 5)) : 1.0;
  return out;
}

double half_width(const Fit& f, Eigen::Index i, double coverage) {
  return coverage * std::sqrt(std::max(0.0, f.covariance(i, i)) * f.misfit);
}

/// The factors that are no masses or inertias of this mechanism: below 0, or far from 1 by more than is
/// uncertain. "" where none is.
std::string far_factors(const Fit& f, double coverage) {
  std::string out;
  for (std::size_t k = 0; k < factored.size(); ++k) {
    const auto i = static_cast<Eigen::Index>(k);
    const double is = 1.0 + f.value[i], half = half_width(f, i, coverage);
    if (f.told[k] && (is < 0.0 || is + half < near_lower || is - half > near_upper))
      out += fmt::format("{}{} = {:.3g}", out.empty() ? "" : ", ", factor_names[k], is);
  }
  return out;
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

UncertaintyTable uncertainty_table(const Identification& r, const IdentifyProblem& p,
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
  Eigen::VectorXd tip =
      Eigen::VectorXd::Zero(static_cast<Eigen::Index>(standard.size()));  // 1 kg at the effector
  if (p.five_bar) {
    tip[8] = 1.0;
  } else {
    const double l1 = p.l1[0], l2 = p.l2[0];
    tip.head<4>() << l1 * l1, l2 * l2, l2, l1;
  }
  const Eigen::VectorXd payload = base_values(r, tip, inertial);

  UncertaintyTable table;
  std::string& out = table.toml;
  Fit f = fit(A, b);
  const Fit with = fit_with_payload(A, b, root * payload);
  const bool possible = far_factors(with, coverage).empty();
  if (const std::string far = far_factors(f, coverage); !far.empty()) {
    if (possible && with.misfit <= 2.0 * f.misfit) {
      table.warnings.push_back(
          fmt::format("factors alone would be {} of what is believed, outside [{:g}, {:g}]: the table has a "
                      "payload of {:.3g} kg instead{}",
                      far, near_lower, near_upper, with.payload,
                      with.payload_apart ? ""
                                         : ", the one with factors nearest to 1: this mechanism's motion "
                                           "does not tell it from heavier legs"));
      f = with;
    } else {
      table.warnings.push_back(
          fmt::format("{} of what is believed lies outside [{:g}, {:g}], and a payload does not mend it: "
                      "check [mechanism] (masses, mass centres, "
                      "legs that are alike) before using the factors",
                      far, near_lower, near_upper));
    }
  } else if (possible && with.payload_apart && f.misfit >= explains_better * with.misfit) {
    table.warnings.push_back(fmt::format(
        "factors alone do not explain what was found, with a payload of {:.3g} kg they do: the table has it",
        with.payload));
    f = with;
  }
  out = "[uncertainty]                  # true over believed, both legs; mass centres as believed\n";
  Eigen::VectorXd middle = Eigen::VectorXd::Zero(n),
                  reach = Eigen::VectorXd::Zero(n);  // of the base parameters, by the table
  for (std::size_t k = 0; k < factored.size(); ++k) {
    const auto i = static_cast<Eigen::Index>(k);
    const double half = half_width(f, i, coverage), is = 1.0 + f.value[i];
    out += f.told[k] ? fmt::format("{} = {}\n", factor_names[k], interval(is - half, is + half))
                     : fmt::format("# {}: not told apart by this motion\n", factor_names[k]);
    if (!f.told[k]) continue;
    const double lower = std::max(0.0, is - half), upper = std::max(0.0, is + half);
    middle += B.col(i) * (0.5 * (lower + upper) - 1.0);
    reach += B.col(i).cwiseAbs() * (0.5 * (upper - lower));
  }
  if (f.with_payload) {
    const double half = coverage * std::sqrt(f.payload_variance * f.misfit);
    out += fmt::format("payload = [{:.6g}, {:.6g}]\n", f.payload - half, f.payload + half);
    middle += payload * f.payload;
    reach += payload.cwiseAbs() * half;
  }
  std::string missed;
  for (Eigen::Index i = 0; i < n; ++i) {
    if (std::abs(change[i] - middle[i]) <= reach[i] + coverage * std::sqrt(C(i, i))) continue;
    const BaseParameter& of = r.parameters[inertial[static_cast<std::size_t>(i)]];
    missed += (missed.empty() ? "" : ", ") + standard[static_cast<std::size_t>(of.of)].name;
  }
  if (!missed.empty())
    table.warnings.push_back(fmt::format(
        "the table does not contain what was found, of {}: factors common to both legs do not explain it",
        missed));
  for (const BaseParameter& v : r.parameters) {
    const StandardParameter& of = standard[static_cast<std::size_t>(v.of)];
    if (!of.inertial && v.value + coverage * v.sigma < 0.0)
      table.warnings.push_back(fmt::format("{} = {:.3g} {} is below 0: no friction is, the table has 0",
                                           of.name, v.value, of.unit));
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
  out += fmt::format(
      "# of the torque; what sensors lag is not in it: control.delay_ticks = {:.2f}, from {:.2f} to {:.2f}\n",
      std::max(0.0, r.delay_ticks), r.delay_ticks - coverage * r.delay_sigma,
      r.delay_ticks + coverage * r.delay_sigma);
  return table;
}

}  // namespace esmc::host
