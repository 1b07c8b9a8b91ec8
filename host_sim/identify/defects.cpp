#include "host_sim/identify/defects.hpp"

#include <algorithm>
#include <cmath>

namespace esmc::host {
namespace {

// Residuals are not white: stiction, rates that are smoothed. So a defect is named that is five standard
// uncertainties beyond 0 and moves a parameter by all of its usual interval; or eight, and half of it.
constexpr double five_sigma = 25.0, whole_interval = 3.0, eight_over_five = 64.0 / 25.0;
constexpr double handicap = 4.0;  // of cogging, which may have any number of periods
constexpr int periods_max = 100;  // per turn of a joint; windows smooth more away

/// What the parameters explain of the torque, less that torque.
Vector unexplained(const Equations& e, const Identification& at) {
  Vector out = -e.torque(at.delay_ticks);
  for (const BaseParameter& b : at.parameters) out += b.value * e.W.col(b.column);
  return out;
}

/// All defects that a log can tell.
std::vector<Defect> candidates(const IdentifyProblem& p) {
  std::vector<Defect> out;
  const auto has_motor = [&](int joint) { return std::ranges::find(p.motors, joint) != p.motors.end(); };
  for (int joint = 0; joint < joints_of(p.five_bar); ++joint) {
    out.push_back({DefectKind::direction, joint});
    if (!has_motor(joint)) continue;
    if (joint % 2 == 1) out.push_back({DefectKind::rotor, joint});
    if (joint != p.motors.front()) out.push_back({DefectKind::torque_constant, joint});
    for (int k = 1; k <= periods_max; ++k)
      out.push_back({DefectKind::cogging, joint, static_cast<double>(k)});
  }
  for (const int joint : {0, p.five_bar ? 2 : 1}) {
    out.push_back({DefectKind::eccentric, joint});
    out.push_back({DefectKind::spring, joint});
  }
  return out;
}

}  // namespace

Matrix columns_of(const Defect& d, const Equations& e, const IdentifyProblem& p, const Identification& at) {
  const Eigen::Index j = d.joint;
  const auto torque = [&](const auto& at_angle) {
    return e.windowed([&](const Tick& t, double share, double) -> Eigen::Vector2d {
      return share * at_angle(t.angle[j]) * t.joint.row(j).transpose();
    });
  };
  // By a change of the angles: little times `by` of a tick and its angle, of about 1.
  const auto turned = [&](const auto& by) -> Vector {
    constexpr double little = 1e-4;
    IdentifyProblem other = p;
    std::vector<double>& angle = other.angle[d.joint == 0 ? 0 : 1];
    for (std::size_t n = 0; n < angle.size(); ++n) angle[n] += little * by(n, angle[n]);
    return (unexplained(Equations(other), at) - unexplained(e, at)) / little;
  };
  switch (d.kind) {
    case DefectKind::direction:
      return torque([](double) { return 1.0; });
    case DefectKind::rotor:
      return e.windowed([&](const Tick& t, double share, double slope) -> Eigen::Vector2d {
        return t.relative[j] * (slope * t.joint.row(j) - share * t.joint_dot.row(j)).transpose();
      });
    case DefectKind::torque_constant:
      return -e.torque(at.delay_ticks, d.joint);
    case DefectKind::cogging: {
      Matrix out(e.W.rows(), 2);
      out << -torque([&](double a) { return std::sin(d.periods * a); }),
          -torque([&](double a) { return std::cos(d.periods * a); });
      return out;
    }
    case DefectKind::eccentric: {
      Matrix out(e.W.rows(), 2);
      out << turned([](std::size_t, double a) { return std::sin(a); }),
          turned([](std::size_t, double a) { return std::cos(a); });
      return out;
    }
    case DefectKind::spring: {  // between the encoder and the joint, turned by the torque that acts
      const auto ago = static_cast<std::size_t>(std::max(0L, std::lround(at.delay_ticks)));
      const auto acts = [&](std::size_t n) { return p.torque[n][static_cast<std::size_t>(d.joint)]; };
      double most = 0.0;  // N m: 1e-8 or 1e5, as the mechanism is
      for (std::size_t n = 0; n < p.torque.size(); ++n) most = std::max(most, std::abs(acts(n)));
      if (most == 0.0) return Vector::Zero(e.W.rows());
      return most * turned([&](std::size_t n, double) { return n < ago ? 0.0 : -acts(n - ago) / most; });
    }
  }
  return {};
}

std::optional<Defect> find_defect(const std::vector<Explained>& views, const Identification& at) {
  std::vector<Equations> equations;
  equations.reserve(views.size());
  for (const Explained& v : views) equations.emplace_back(v.problem);
  const auto in_view = [&](const Defect& d, std::size_t v) {
    const Solution& s = views[v].solution;
    Matrix Z = columns_of(d, equations[v], views[v].problem, at);
    for (Eigen::Index i = 0; i < Z.rows(); ++i) Z.row(i) *= s.weight[static_cast<std::size_t>(i % 2)];
    return more_unknowns(s.A, s.residual, Z, correlation_blocks(Z.rows(), hops_per_window));
  };
  std::optional<Defect> best;
  for (Defect d : candidates(views.front().problem)) {
    const MoreUnknowns m = in_view(d, 0);
    if (d.kind == DefectKind::spring && m.value[0] <= 0.0) continue;  // no gear turns against its torque
    const double needed =
        five_sigma * static_cast<double>(m.value.size()) * (d.kind == DefectKind::cogging ? handicap : 1.0);
    d.statistic = m.statistic / needed;
    d.amount = m.value.size() == 1 ? m.value[0] : m.value.norm();
    if (d.kind == DefectKind::cogging) d.phase = std::atan2(m.value[1], m.value[0]);
    d.sigma = std::sqrt(m.covariance.diagonal().maxCoeff());
    const auto n = static_cast<Eigen::Index>(at.parameters.size());
    d.shift = std::abs(m.shift[n]) / at.delay_sigma;
    for (Eigen::Index i = 0; i < n; ++i)
      d.shift = std::max(d.shift, std::abs(m.shift[i]) / at.parameters[static_cast<std::size_t>(i)].sigma);
    const auto told = [&] {
      const bool much = d.shift > whole_interval || (d.shift > shift_told && d.statistic > eight_over_five);
      return d.statistic > 1.0 && much && !(best && best->statistic > d.statistic);
    };
    if (!told()) continue;
    if (views.size() > 1) {  // the lag is anything between none and all of it
      const Vector range = in_view(d, 2).value - in_view(d, 1).value;
      const Matrix covariance = m.covariance + gram(range.transpose()) / 12.0;
      d.statistic = quadratic(pseudo_inverse(covariance), m.value) / needed;
      d.sigma = std::sqrt(covariance.diagonal().maxCoeff());
      if (!told()) continue;
    }
    best = d;
  }
  return best;
}

}  // namespace esmc::host
