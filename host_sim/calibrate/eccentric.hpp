#pragma once
/// Encoders that are off the centre of their shafts: a sine of their own angle in the readings, which lengths
/// and offsets would take up.

#include <vector>

#include "host_sim/calibrate/geometry.hpp"

namespace esmc::host {

struct EccentricEncoder {
  int joint = 0;                     ///< in the order of the model
  double amount = 0.0, sigma = 0.0;  ///< rad
};

/// The encoders of a five-bar for whose eccentricity what `c` leaves of the loop speaks clearly, and which
/// shifts a value by more than 1.5 standard uncertainties. The shifts are added to the covariance of `c`.
std::vector<EccentricEncoder> name_eccentric(const CalibrationProblem& p, Calibration& c);

}  // namespace esmc::host
