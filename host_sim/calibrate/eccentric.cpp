#include <algorithm>
#include <cmath>

#include "host_sim/calibrate/geometry.hpp"

namespace esmc::host {

std::vector<EccentricEncoder> name_eccentric(const CalibrationProblem& p, Calibration& c) {
  std::vector<EccentricEncoder> out;
  if (!p.five_bar) return out;
  const auto rows = 2 * static_cast<Eigen::Index>(p.angles.size()),
             blocks = std::min<Eigen::Index>(rows / 20, 60);
  Matrix A(rows, static_cast<Eigen::Index>(c.estimated.size()));
  Vector r(rows);
  std::vector<Matrix> by_encoder(4, Matrix(rows, 2));
  for (std::size_t i = 0; i < p.angles.size(); ++i) {
    const auto at = 2 * static_cast<Eigen::Index>(i);
    const Row row = whitened([&](const MeasuredAngles& a) { return closure_row(c.value, a); }, p.angles[i],
                             c.encoder_sigma, 0.0, true);
    const auto put = [&](auto&& column, const std::complex<double>& z) {
      column[at] = z.real();
      column[at + 1] = z.imag();
    };
    put(r, -row.residual);
    for (std::size_t k = 0; k < c.estimated.size(); ++k)
      put(A.col(static_cast<Eigen::Index>(k)), row.J[static_cast<std::size_t>(c.estimated[k])]);
    for (std::size_t joint = 0; joint < 4; ++joint) {
      put(by_encoder[joint].col(0), row.J[unknown_o11 + joint] * std::sin(p.angles[i][joint]));
      put(by_encoder[joint].col(1), row.J[unknown_o11 + joint] * std::cos(p.angles[i][joint]));
    }
  }
  while (out.size() < 4) {
    EccentricEncoder best;
    MoreUnknowns of_best;
    for (int joint = 0; joint < 4; ++joint) {
      if (std::ranges::any_of(out, [&](const EccentricEncoder& e) { return e.joint == joint; })) continue;
      MoreUnknowns m = more_unknowns(A, r, by_encoder[static_cast<std::size_t>(joint)], blocks);
      double shift = 0.0;
      for (std::size_t k = 0; k < c.estimated.size(); ++k)
        shift = std::max(shift, std::abs(m.shift[static_cast<Eigen::Index>(k)]) /
                                    std::max(1e-12, c.sigma(c.estimated[k])));
      if (!(m.statistic > 2.0 * clear_per_unknown && shift > shift_told && m.statistic > of_best.statistic))
        continue;
      best = {joint, m.value.norm(), std::sqrt(m.covariance.diagonal().maxCoeff())};
      of_best = std::move(m);
    }
    if (!(of_best.statistic > 0.0)) return out;
    out.push_back(best);
    Unknowns shift = Unknowns::Zero(unknowns);
    for (std::size_t k = 0; k < c.estimated.size(); ++k)
      shift[c.estimated[k]] = of_best.shift[static_cast<Eigen::Index>(k)];
    c.covariance += gram(shift.transpose());
    const Matrix& Z = by_encoder[static_cast<std::size_t>(best.joint)];
    A.conservativeResize(Eigen::NoChange, A.cols() + 2);
    A.rightCols(2) = Z;
    r -= apply(A, least_squares(A, r));
  }
  return out;
}

}  // namespace esmc::host
