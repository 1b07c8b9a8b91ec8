#pragma once
/// An identification as the table [uncertainty] of a scene.

#include <string>
#include <vector>

#include "firmware/mechanism/params.hpp"
#include "host_sim/identify/inertia.hpp"

namespace esmc::host {

/// The standard parameters of a mechanism, in the order of standard_parameters().
Vector standard_values(const FiveBarParams<double>& p, bool five_bar);

/// A table [uncertainty] and what is to be said about it, one line each.
struct UncertaintyTable {
  std::string toml;
  std::vector<std::string> warnings;
};

/// Factors on m1, m2, J1, J2 of both legs that would explain what was identified, with mass centres as
/// believed; frictions. Where a factor is below 0, or beyond [0.5, 2] by more than is uncertain, a payload is
/// tried as one more unknown. What the motion does not tell apart is left out and said so. `coverage`:
/// standard uncertainties to either side, > 0.
UncertaintyTable uncertainty_table(const Identification& r, const IdentifyProblem& p,
                                   const FiveBarParams<double>& believed, double coverage);

}  // namespace esmc::host
