#pragma once
/// Inertia, friction and torque delay of a mechanism, from the angles that its base encoders have said and
/// the torques that its controller has asked for. The equations are linear in the parameters and are taken in
/// momentum form, under smooth windows: no acceleration appears. Equations of its own: nothing of the
/// controller's model is used.

#include <cstddef>
#include <vector>

#include "host_sim/identify/identification.hpp"

namespace esmc::host {

/// All standard parameters in their order, leg by leg and joint by joint. RR: those of one leg, without m0.
[[nodiscard]] std::vector<StandardParameter> standard_parameters(bool five_bar);

/// Least number of ticks that a log must have for the windows of p.
[[nodiscard]] std::size_t ticks_needed(const IdentifyProblem& p);

/// Least squares with the delay as one more unknown. The covariance is that of the estimator for residuals
/// that are correlated in time. p.angle and p.torque have the same length, ticks_needed(p) at least (not
/// checked). Throws InputError where base angles fit no closed mechanism.
[[nodiscard]] Identification identify(const IdentifyProblem& p);

}  // namespace esmc::host
