#pragma once
/// Inertia, friction and torque delay of a mechanism, from the angles that its base encoders have said and
/// the torques that its controller has asked for. The equations are linear in the parameters and are taken in
/// momentum form, under smooth windows: no acceleration appears. Equations of its own: nothing of the
/// controller's model is used.

#include <array>
#include <string>
#include <vector>

#include "host_sim/identify/problem.hpp"

namespace esmc::host {

/// A combination of standard parameters that the motion of this mechanism depends on: `of` + sum of `share` *
/// others.
struct BaseParameter {
  StandardParameter of;  ///< that it is named after
  int column = 0;        ///< index of that one
  Vector share;          ///< of every standard parameter: 1 for `of`, 0 for those that stand alone
  std::string text;      ///< "a1 + 0.0144 m0"
  double nominal = 0.0, value = 0.0, sigma = 0.0;
};

struct Identification {
  std::vector<BaseParameter> parameters;
  Matrix covariance;  ///< of parameters, then the delay
  double delay_ticks = 0.0, delay_sigma = 0.0;
  std::array<double, 2> residual{};  ///< N m rms, of the window means, per equation (base joint)
  std::array<double, 2> effort{};    ///< N m rms of the torque itself, likewise
  int windows = 0;
  /// Combinations of parameters that the motion does not determine; then nothing else counts.
  std::vector<std::string> weak;
};

/// Least number of ticks that a log must have for the windows of p.
[[nodiscard]] std::size_t ticks_needed(const IdentifyProblem& p);

/// Least squares with the delay as one more unknown. The covariance is that of the estimator for residuals
/// that are correlated in time. Throws InputError where base angles fit no closed mechanism.
[[nodiscard]] Identification identify(const IdentifyProblem& p);

}  // namespace esmc::host
