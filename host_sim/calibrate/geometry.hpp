#pragma once
/// Lengths and encoder zeros of a mechanism, from what redundant encoders have measured and, where there is
/// any, from measured positions of the effector. Equations of its own, in complex numbers: nothing of the
/// controller's model is used.

#include <optional>
#include <string>
#include <vector>

#include "host_sim/calibrate/rows.hpp"

namespace esmc::host {

struct CalibrationProblem {
  bool five_bar = true;
  /// Where the fit starts, and the value kept along directions that nothing determines.
  Unknowns nominal = Unknowns::Zero(unknowns);
  std::vector<MeasuredAngles> angles;  ///< five-bar: each closes the loop
  std::vector<EffectorReading> effector;
  double effector_sigma = 1e-4;  ///< m, > 0, of each coordinate of a reading
  double encoder_sigma = 3e-5;   ///< rad, > 0; a five-bar's is taken from how well the loop closes instead
  bool half_base_known = false;  ///< `nominal` has it exactly
  bool free_frame = false;       ///< position readings are in a frame of their own
};

/// A combination of unknowns that the data do not determine.
struct WeakDirection {
  double sigma = 0.0;  ///< standard uncertainty as a part of a length, or rad; may be infinite
  std::string text;    ///< "half_base and all lengths together: the scale", "0.7 leg 1 l1 - 0.7 leg 2 l1"
};

struct Calibration {
  Unknowns value = Unknowns::Zero(unknowns);
  Matrix covariance = Matrix::Zero(unknowns, unknowns);
  std::vector<int> estimated;        ///< which of the unknowns; the others are nominal, or not there
  std::vector<WeakDirection> weak;   ///< along these `value` is nominal, and the covariance that of nominal
                                     ///< values: 0.5 % of mean_length, 5 mrad
  double mean_length = 1.0;          ///< m
  double encoder_sigma = 0.0;        ///< rad, of one reading, as the residuals have it
  double closure_rms = 0.0;          ///< m
  double closure_rms_nominal = 0.0;  ///< m, with the unknowns as they were
  double effector_rms = 0.0;         ///< m, of the position readings
  bool converged = false;
  bool in_numbers = true;  ///< false: far from any mechanism; only `value` is set

  [[nodiscard]] double sigma(int unknown) const;  ///< standard uncertainty, m or rad
};

/// Least squares in which angles and positions carry the errors (a Gauss-Helmert model): the correction of
/// all readings by as little as makes the loop close, weighted by their standard deviations. The covariance
/// is that of the estimator for residuals that are correlated in time (blocks of consecutive rows), not that
/// of white noise. Where the data determine nothing at all, every direction is weak and `value` nominal.
[[nodiscard]] Calibration calibrate(const CalibrationProblem& problem);

/// Effector x + i y, m, in the base frame from the base encoders (RR: both) of a row: the solution next to
/// the one that the passive encoders tell. Empty: these lengths cannot be closed.
[[nodiscard]] std::optional<std::complex<double>> effector_from_base(const Unknowns& u, bool five_bar,
                                                                     const MeasuredAngles& angle);

/// Standard uncertainty of the effector in that row, m (root of the sum of both variances), that follows from
/// the one of the calibration.
[[nodiscard]] double effector_sigma(const Calibration& c, bool five_bar, const MeasuredAngles& angle);

}  // namespace esmc::host
