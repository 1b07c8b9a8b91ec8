#pragma once
/// An identification as the table [uncertainty] of a scene.

#include <string>
#include <vector>

#include "firmware/mechanism/params.hpp"
#include "host_sim/identify/identification.hpp"

namespace esmc::host {

/// Values of the standard parameters, in the order of standard_parameters(). RR: `p` is read in legs[0].
Vector standard_values(const FiveBarParams<double>& p, bool five_bar);

/// The mechanism, with its friction, that explains what was identified and is near to the believed one:
/// lengths and mass centres as believed (a payload of an arm moves that of its distal bar), and nothing below
/// 0. r.weak must be empty.
FiveBarParams<double> identified_mechanism(const Identification& r, const IdentifyProblem& p,
                                           FiveBarParams<double> believed, double coverage);

/// A table [uncertainty] and what is to be said about it, one line each.
struct UncertaintyTable {
  std::string toml;
  std::vector<std::string> warnings;
};

/// Intervals of four factors on m1, m2, J1, J2, common to both legs, that explain the identified parameters,
/// with mass centres as believed; and of the frictions. Where a factor is below 0, or outside [0.5, 2] by
/// more than its uncertainty, a payload (kg) is fitted too. A factor that the motion does not determine
/// becomes a comment. r.weak must be empty. `coverage`: half widths in standard uncertainties, > 0.
UncertaintyTable uncertainty_table(const Identification& r, const IdentifyProblem& p,
                                   const FiveBarParams<double>& believed, double coverage);

}  // namespace esmc::host
