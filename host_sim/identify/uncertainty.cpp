#include "host_sim/identify/uncertainty.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace esmc::host {
namespace {

constexpr std::array<double LegParams<double>::*, 4> factored{&LegParams<double>::m1, &LegParams<double>::m2,
                                                              &LegParams<double>::J1, &LegParams<double>::J2};
constexpr std::array factor_names{"m1", "m2", "J1", "J2"};
constexpr double useless = 1.0;  // an uncertainty of 100 %
// A payload and factors are told apart where 1 kg of payload, expressed in factors, is below this.
constexpr double told_apart = 0.1;
// A payload is believed where factors alone are possible if it divides the misfit by this.
constexpr double explains_better = 10.0;
constexpr double near_lower = 0.5, near_upper = 2.0;  // true over believed; beyond, the belief is wrong

std::string interval(double lower, double upper) {
  return fmt::format("[{:.6g}, {:.6g}]", std::max(0.0, lower), std::max(0.0, upper));
}

/// The inertial base parameters: what was found of them, and what factors and a payload make of them.
struct Changes {
  std::vector<const BaseParameter*> of;
  Vector found;       ///< less what is believed
  Matrix covariance;  ///< of found
  Matrix by_factor;   ///< 4 columns, per unit of a factor
  Vector by_payload;  ///< per kg

  /// Values of the base parameters that these values of the standard parameters give.
  [[nodiscard]] Vector from_standard(const Vector& standard) const {
    Vector out = Vector::Zero(static_cast<Eigen::Index>(of.size()));
    for (std::size_t i = 0; i < of.size(); ++i)
      for (Eigen::Index k = 0; k < standard.size(); ++k)
        out[static_cast<Eigen::Index>(i)] += of[i]->share[k] * standard[k];
    return out;
  }
};

Changes changes_of(const Identification& r, const IdentifyProblem& p, const FiveBarParams<double>& believed) {
  Changes c;
  std::vector<Eigen::Index> at;
  for (std::size_t i = 0; i < r.parameters.size(); ++i) {
    if (!r.parameters[i].of.inertial) continue;
    c.of.push_back(&r.parameters[i]);
    at.push_back(static_cast<Eigen::Index>(i));
  }
  const auto n = static_cast<Eigen::Index>(at.size());
  c.found.resize(n);
  for (std::size_t i = 0; i < at.size(); ++i) c.found[static_cast<Eigen::Index>(i)] = c.of[i]->value;
  c.found -= c.from_standard(standard_values(believed, p.five_bar));
  c.covariance = r.covariance(at, at);
  c.by_factor.resize(n, 4);
  for (std::size_t f = 0; f < factored.size(); ++f) {  // linear in each of them
    FiveBarParams<double> without = believed;
    for (auto& leg : without.legs) leg.*factored[f] = 0.0;
    c.by_factor.col(static_cast<Eigen::Index>(f)) =
        c.from_standard(standard_values(believed, p.five_bar) - standard_values(without, p.five_bar));
  }
  FiveBarParams<double> heavier{};  // 1 kg at the effector
  heavier.m0 = 1.0;
  if (!p.five_bar) {
    heavier.legs[0].l1 = p.l1[0];
    heavier.legs[0].lg2 = p.l2[0];
    heavier.legs[0].m2 = 1.0;
  }
  c.by_payload = c.from_standard(standard_values(heavier, p.five_bar));
  return c;
}

/// Makes the covariance of what was found the unit matrix. The legs may differ by more than that, and then
/// the intervals are as wide.
Matrix whitening(const Changes& c) {
  const Vector size = c.covariance.diagonal()
                          .cwiseSqrt()
                          .cwiseMax(1e-9 * c.by_factor.cwiseAbs().rowwise().maxCoeff())
                          .cwiseMax(1e-15);
  const Matrix scale = size.cwiseInverse().asDiagonal();
  const Modes modes = symmetric_modes(congruent(scale, c.covariance));
  const Matrix shrink = modes.value.cwiseMax(1e-9).cwiseSqrt().cwiseInverse().asDiagonal();
  return product(shrink, product(modes.vector.transpose(), scale));
}

/// Least squares A x = b for the factors, rows already divided by their deviations.
struct FactorFit {
  Vector value = Vector::Zero(4);                    ///< of m1, m2, J1, J2: true over believed, less 1
  Matrix covariance = Matrix::Zero(4, 4);            ///< of unit rows
  std::array<bool, 4> told{true, true, true, true};  ///< others are hardly determined and stay 0
  double payload = 0.0, payload_variance = 0.0;      ///< kg, kg^2
  bool with_payload = false, payload_apart = true;
  double misfit = 1.0;  ///< mean square of the residual
};

/// At least 1; `free`: rows less unknowns.
double misfit_of(const Vector& residual, Eigen::Index free) {
  return free > 0 ? std::max(1.0, residual.squaredNorm() / static_cast<double>(free)) : 1.0;
}

FactorFit fit(const Matrix& A, const Vector& b) {
  FactorFit out;
  const Modes normal = symmetric_modes(gram(A));
  const Vector right = apply(A.transpose(), b);
  for (Eigen::Index m = 0; m < 4; ++m) {
    const Vector v = normal.vector.col(m);
    const double information = normal.value[m];
    if (!(information > 1.0 / (useless * useless))) {
      for (std::size_t f = 0; f < out.told.size(); ++f)
        out.told[f] = out.told[f] && std::abs(v[static_cast<Eigen::Index>(f)]) < 0.2;
      continue;
    }
    out.value += v * (v.dot(right) / information);
    out.covariance += gram(v.transpose()) / information;
  }
  out.misfit = misfit_of(b - apply(A, out.value), A.rows() - 4);
  return out;
}

/// Factors and a payload, whose column is p (per kg). A mass at the effector of equal legs does what a mass
/// at the tip of each does: where the rows cannot tell them apart, the payload is the one that leaves the
/// factors nearest to 1.
FactorFit fit_with_payload(const Matrix& A, const Vector& b, const Vector& p) {
  FactorFit out = fit(A, b);
  out.with_payload = true;
  const Vector g = fit(A, p).value;  // what factors make of 1 kg
  const Vector apart = p - apply(A, g);
  const double information = apart.squaredNorm(), size = g.squaredNorm();
  if (A.rows() > 4 && information > 0.0 && g.norm() / std::sqrt(information) < told_apart) {
    out.payload = apart.dot(b) / information;
    out.payload_variance = 1.0 / information;
    out.covariance += gram(g.transpose()) / information;
  } else {
    if (!(size > 0.0)) return out;
    out.payload_apart = false;
    out.payload = g.dot(out.value) / size;
    out.payload_variance = quadratic(out.covariance, g) / (size * size);
    out.covariance = congruent(Matrix::Identity(4, 4) - gram(g.transpose()) / size, out.covariance);
  }
  out.value -= g * out.payload;
  out.misfit = misfit_of(b - apply(A, out.value) - p * out.payload, A.rows() - 5);
  return out;
}

double half_width(const FactorFit& f, Eigen::Index i, double coverage) {
  return coverage * std::sqrt(std::max(0.0, f.covariance(i, i)) * f.misfit);
}

/// The factors that are no masses or inertias of this mechanism: below 0, or far from 1 by more than is
/// uncertain. "" where none is.
std::string far_factors(const FactorFit& f, double coverage) {
  std::string out;
  for (std::size_t k = 0; k < factored.size(); ++k) {
    const auto i = static_cast<Eigen::Index>(k);
    const double is = 1.0 + f.value[i], half = half_width(f, i, coverage);
    if (f.told[k] && (is < 0.0 || is + half < near_lower || is - half > near_upper))
      out += fmt::format("{}{} = {:.3g}", out.empty() ? "" : ", ", factor_names[k], is);
  }
  return out;
}

/// Factors alone, or with a payload where that explains better what was found; and what is to be said of it.
FactorFit choose_fit(const Changes& c, double coverage, std::vector<std::string>& warnings) {
  const Matrix root = whitening(c), A = product(root, c.by_factor);
  const Vector b = apply(root, c.found);
  const FactorFit alone = fit(A, b), with = fit_with_payload(A, b, apply(root, c.by_payload));
  const std::string far = far_factors(alone, coverage);
  const bool possible = far_factors(with, coverage).empty();
  if (far.empty()) {
    if (!possible || !with.payload_apart || alone.misfit < explains_better * with.misfit) return alone;
    warnings.push_back(fmt::format(
        "factors alone do not explain what was found, with a payload of {:.3g} kg they do: the table has it",
        with.payload));
    return with;
  }
  if (possible && with.misfit <= 2.0 * alone.misfit) {
    warnings.push_back(fmt::format(
        "factors alone would be {} of what is believed, outside [{:g}, {:g}]: the table has a payload of "
        "{:.3g} "
        "kg instead{}",
        far, near_lower, near_upper, with.payload,
        with.payload_apart ? ""
                           : ", the one with factors nearest to 1: this mechanism's motion does not tell it "
                             "from heavier legs"));
    return with;
  }
  warnings.push_back(fmt::format(
      "{} of what is believed lies outside [{:g}, {:g}], and a payload does not mend it: check [mechanism] "
      "(masses, mass centres, legs that are alike) before using the factors",
      far, near_lower, near_upper));
  return alone;
}

/// Lines for factors and payload. Warns of base parameters whose value found is outside what the lines allow.
std::string factor_lines(const Changes& c, const FactorFit& f, double coverage,
                         std::vector<std::string>& warnings) {
  std::string out;
  Vector middle = Vector::Zero(c.found.size()), reach = middle;  // of the base parameters, by the table
  const auto add = [&](const Vector& column, double lower, double upper) {
    middle += column * (0.5 * (lower + upper));
    reach += column.cwiseAbs() * (0.5 * (upper - lower));
  };
  for (std::size_t k = 0; k < factored.size(); ++k) {
    const auto i = static_cast<Eigen::Index>(k);
    if (!f.told[k]) {
      out += fmt::format("# {}: not determined by this motion\n", factor_names[k]);
      continue;
    }
    const double half = half_width(f, i, coverage), is = 1.0 + f.value[i];
    const double lower = std::max(0.0, is - half), upper = std::max(0.0, is + half);
    out += fmt::format("{} = {}\n", factor_names[k], interval(lower, upper));
    add(c.by_factor.col(i), lower - 1.0, upper - 1.0);
  }
  if (f.with_payload) {
    const double half = coverage * std::sqrt(f.payload_variance * f.misfit);
    out += fmt::format("payload = [{:.6g}, {:.6g}]\n", f.payload - half, f.payload + half);
    add(c.by_payload, f.payload - half, f.payload + half);
  }
  std::string missed;
  for (std::size_t k = 0; k < c.of.size(); ++k) {
    const auto i = static_cast<Eigen::Index>(k);
    if (std::abs(c.found[i] - middle[i]) <= reach[i] + coverage * std::sqrt(c.covariance(i, i))) continue;
    missed += (missed.empty() ? "" : ", ") + c.of[k]->of.name;
  }
  if (!missed.empty())
    warnings.push_back(fmt::format(
        "the table does not contain what was found, of {}: factors common to both legs do not explain it",
        missed));
  return out;
}

std::string friction_lines(const Identification& r, double coverage, std::vector<std::string>& warnings) {
  std::string out;
  for (const BaseParameter& v : r.parameters) {
    const StandardParameter& of = v.of;
    if (!of.inertial && v.value + coverage * v.sigma < 0.0)
      warnings.push_back(fmt::format("{} = {:.3g} {} is below 0: no friction is, the table has 0", of.name,
                                     v.value, of.unit));
  }
  for (const char* kind : {"viscous", "coulomb"}) {
    std::string list;
    for (const BaseParameter& v : r.parameters) {
      if (!v.of.name.starts_with(kind)) continue;
      list +=
          (list.empty() ? "" : ", ") + interval(v.value - coverage * v.sigma, v.value + coverage * v.sigma);
    }
    if (!list.empty()) out += fmt::format("{} = [{}]\n", kind, list);
  }
  return out;
}

/// Adds a point mass at the effector.
void add_payload(FiveBarParams<double>& p, double mass, bool five_bar) {
  if (five_bar) {
    p.m0 = std::max(0.0, p.m0 + mass);
    return;
  }
  LegParams<double>& leg = p.legs[0];
  const double whole = leg.m2 + mass;
  if (!(whole > 0.0)) return;
  leg.J2 = std::max(0.0, leg.J2 + leg.m2 * mass / whole * std::pow(leg.l2 - leg.lg2, 2));
  leg.lg2 = (leg.m2 * leg.lg2 + mass * leg.l2) / whole;
  leg.m2 = whole;
}

/// The masses and inertias of each leg for themselves, and the effector's mass: as near to `p` as what was
/// found allows. `usual`: the size of each, which its change is compared with.
void match_each(FiveBarParams<double>& p, const Identification& r, const IdentifyProblem& problem) {
  constexpr double likely = 0.1;  // change of each, unless the log says otherwise
  std::vector<double*> value;
  std::vector<double> usual;
  for (std::size_t leg = 0; leg < (problem.five_bar ? 2U : 1U); ++leg) {
    LegParams<double>& l = p.legs[leg];
    for (double LegParams<double>::*key : factored) value.push_back(&(l.*key));
    const double both = 0.1 * (l.m1 + l.m2);
    for (const double x : {l.m1 + both, l.m2 + both, l.J1 + both * l.l1 * l.l1, l.J2 + both * l.l2 * l.l2})
      usual.push_back(x);
  }
  if (problem.five_bar) {
    value.push_back(&p.m0);
    usual.push_back(p.m0 + 0.1 * (p.legs[0].m2 + p.legs[1].m2));
  }
  const auto n = static_cast<Eigen::Index>(value.size());
  std::vector<bool> at_zero(value.size(), false);
  for (std::size_t pass = 0; pass <= value.size(); ++pass) {  // negative values are set to 0
    const FiveBarParams<double> centre = p;
    const Changes c = changes_of(r, problem, centre);
    const Matrix root = whitening(c);
    Matrix A = Matrix::Zero(c.found.size() + n, n);
    Vector b = Vector::Zero(A.rows());
    b.head(c.found.size()) = apply(root, c.found);
    for (std::size_t k = 0; k < value.size(); ++k) {
      const auto i = static_cast<Eigen::Index>(k);
      A(c.found.size() + i, i) = 1.0;
      if (at_zero[k]) continue;
      const double was = *value[k];
      *value[k] = was + likely * usual[k];
      A.col(i).head(c.found.size()) = apply(root, c.from_standard(standard_values(p, problem.five_bar) -
                                                                  standard_values(centre, problem.five_bar)));
      *value[k] = was;
    }
    const Vector x = least_squares(A, b);
    bool possible = true;
    for (std::size_t k = 0; k < value.size(); ++k) {
      if (*value[k] + likely * usual[k] * x[static_cast<Eigen::Index>(k)] >= 0.0) continue;
      *value[k] = 0.0;
      at_zero[k] = true;
      possible = false;
    }
    if (!possible) continue;
    for (std::size_t k = 0; k < value.size(); ++k)
      *value[k] += likely * usual[k] * x[static_cast<Eigen::Index>(k)];
    return;
  }
}

}  // namespace

FiveBarParams<double> identified_mechanism(const Identification& r, const IdentifyProblem& p,
                                           FiveBarParams<double> believed, double coverage) {
  std::vector<std::string> told;
  const FactorFit f = choose_fit(changes_of(r, p, believed), coverage, told);
  for (std::size_t leg = 0; leg < (p.five_bar ? 2U : 1U); ++leg) {
    LegParams<double>& l = believed.legs[leg];
    for (std::size_t k = 0; k < factored.size(); ++k)
      l.*factored[k] *= std::max(0.0, 1.0 + f.value[static_cast<Eigen::Index>(k)]);
  }
  add_payload(believed, f.payload, p.five_bar);
  match_each(believed, r, p);
  double LegParams<double>::*const friction[] = {&LegParams<double>::d1, &LegParams<double>::d2,
                                                 &LegParams<double>::gamma1, &LegParams<double>::gamma2};
  for (const BaseParameter& b : r.parameters) {
    if (b.of.inertial) continue;
    const auto joint = static_cast<std::size_t>(b.of.name.back() - '1'),
               leg = p.five_bar ? static_cast<std::size_t>(b.of.name[b.of.name.size() - 2] - '1') : 0U;
    const bool dry = b.of.name.starts_with("coulomb");
    believed.legs[leg].*friction[joint + (dry ? 2U : 0U)] = std::max(0.0, b.value);
  }
  for (const Defect& d : r.defects) {
    LegParams<double>& leg = believed.legs[static_cast<std::size_t>(d.joint / 2)];
    if (d.kind == DefectKind::rotor) leg.rotor2 = std::max(0.0, leg.rotor2 + d.amount);
    if (d.kind == DefectKind::direction) (d.joint % 2 == 0 ? leg.asymmetry1 : leg.asymmetry2) += d.amount;
  }
  for (LegParams<double>& leg : believed.legs) {  // friction only brakes
    leg.asymmetry1 = std::clamp(leg.asymmetry1, -leg.gamma1, leg.gamma1);
    leg.asymmetry2 = std::clamp(leg.asymmetry2, -leg.gamma2, leg.gamma2);
  }
  return believed;
}

Vector standard_values(const FiveBarParams<double>& p, bool five_bar) {
  const int legs = five_bar ? 2 : 1, inertial = five_bar ? 9 : 4;
  Vector out = Vector::Zero(inertial + 4 * legs);
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
  const Changes c = changes_of(r, p, believed);
  UncertaintyTable table;
  const FactorFit f = choose_fit(c, coverage, table.warnings);
  table.toml = "[uncertainty]                  # true over believed, both legs; mass centres as believed\n";
  table.toml += factor_lines(c, f, coverage, table.warnings);
  table.toml += friction_lines(r, coverage, table.warnings);
  table.toml += fmt::format(
      "# of the torque, with delays that the log does not tell apart from it, not the drives' observers: "
      "control.delay_ticks = {:.2f}, from {:.2f} to {:.2f}\n",
      std::max(0.0, r.delay_ticks), r.delay_ticks - coverage * r.delay_sigma,
      r.delay_ticks + coverage * r.delay_sigma);
  return table;
}

}  // namespace esmc::host
