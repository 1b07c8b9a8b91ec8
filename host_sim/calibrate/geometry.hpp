#pragma once
/// Lengths and encoder zeros of a mechanism, from what redundant encoders have measured and, where there is
/// any, from measured positions of the effector. Equations of its own, in complex numbers: nothing of the
/// controller's model is used.

#include <Eigen/Core>
#include <array>
#include <complex>
#include <optional>
#include <string>
#include <vector>

namespace esmc::host {

/// What is looked for. Entry i of a vector of unknowns; an RR arm has neither the half base nor leg 2.
enum Unknown : int {
  unknown_l0,
  unknown_l11,
  unknown_l12,
  unknown_l21,
  unknown_l22,  // m
  unknown_o11,
  unknown_o12,
  unknown_o21,
  unknown_o22,  // rad, to be added to what the encoders say
  unknown_fx,
  unknown_fy,
  unknown_fa,  // frame of the position readings: origin in the base frame, m, and angle, rad
  unknowns
};
using Unknowns = Eigen::Matrix<double, unknowns, 1>;
/// "half_base", "leg 1 l1", "offset theta11", ...
[[nodiscard]] const char* name_of(int unknown, bool five_bar);
[[nodiscard]] constexpr bool is_length(int unknown) { return unknown <= unknown_l22; }

/// theta11, theta12, theta21, theta22 as measured, rad; RR: the first two.
using MeasuredAngles = std::array<double, 4>;
/// The effector, measured by something else, when the encoders said this.
struct EffectorReading {
  MeasuredAngles angle{};
  double x = 0.0, y = 0.0;  ///< m
};

struct CalibrationProblem {
  bool five_bar = true;
  Unknowns nominal =
      Unknowns::Zero();  ///< where it starts, and what is kept of a direction that nothing determines
  std::vector<MeasuredAngles> angles;  ///< five-bar: each closes the loop
  std::vector<EffectorReading> effector;
  double effector_sigma = 1e-4;  ///< m, > 0, of each coordinate of a reading
  double encoder_sigma = 3e-5;   ///< rad, > 0; a five-bar's is taken from how well the loop closes instead
  bool half_base_known = false;  ///< `nominal` has it exactly
  bool free_frame = false;       ///< position readings are in a frame of their own
};

/// A combination of unknowns that the data do not determine.
struct WeakDirection {
  Unknowns along = Unknowns::Zero();  ///< of length 1, lengths over mean_length
  double sigma =
      0.0;  ///< standard uncertainty along it as a part of 1 (100 % of a length, 1 rad); may be infinite
  std::string text;  ///< "half_base and all lengths together: the scale", "0.7 leg 1 l1 - 0.7 leg 2 l1"
};

struct Calibration {
  Unknowns value = Unknowns::Zero();
  Eigen::Matrix<double, unknowns, unknowns> covariance = Eigen::Matrix<double, unknowns, unknowns>::Zero();
  std::vector<int> estimated;        ///< which of the unknowns; the others are nominal, or not there
  std::vector<WeakDirection> weak;   ///< along these `value` is nominal, and the covariance that of nominal
                                     ///< values: 0.5 % of mean_length, 5 mrad
  double mean_length = 1.0;          ///< m
  double encoder_sigma = 0.0;        ///< rad, of one reading, as the residuals have it
  double closure_rms = 0.0;          ///< m
  double closure_rms_nominal = 0.0;  ///< m, with the unknowns as they were
  double effector_rms = 0.0;         ///< m, of the position readings
  bool converged = false;
  bool in_numbers =
      true;  ///< false: the readings are so far from any mechanism that there is nothing but `value`

  [[nodiscard]] double sigma(int unknown) const;
};

/// Least squares in which angles and positions carry the errors (a Gauss-Helmert model): the correction of
/// all readings by as little as makes the loop close, weighted by their standard deviations. The covariance
/// is that of the estimator for residuals that are correlated in time (blocks of consecutive rows), not that
/// of white noise. Where the data determine nothing at all, every direction is weak and `value` nominal.
[[nodiscard]] Calibration calibrate(const CalibrationProblem& problem);

/// Effector from the base encoders (RR: both) of a row: the solution next to the one that the passive
/// encoders tell. Empty: these lengths cannot be closed.
[[nodiscard]] std::optional<std::complex<double>> effector_from_base(const Unknowns& u, bool five_bar,
                                                                     const MeasuredAngles& angle);

/// What the uncertainty of a calibration makes of the effector in that row: standard uncertainty, m (root of
/// the sum of both variances).
[[nodiscard]] double effector_sigma(const Calibration& c, bool five_bar, const MeasuredAngles& angle);

}  // namespace esmc::host
