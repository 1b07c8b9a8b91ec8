#pragma once
/// What was identified, in the words of a scene.

#include <string>

#include "firmware/mechanism/params.hpp"
#include "host_sim/identify/inertia.hpp"

namespace esmc::host {

/// The standard parameters of a mechanism, in the order of standard_parameters().
Eigen::VectorXd standard_values(const FiveBarParams<double>& p, bool five_bar);

/// A table [uncertainty]: factors on m1, m2, J1, J2 of both legs that would explain what was identified, with
/// mass centres as believed; frictions. What the motion does not tell apart is left out and said so.
std::string uncertainty_snippet(const Identification& r, const IdentifyProblem& p,
                                const FiveBarParams<double>& believed, double coverage);

}  // namespace esmc::host
