#pragma once
/// Four encoders on a mechanism of two degrees of freedom: their readings are brought onto the closure
/// manifold. An optional part; without it the effector is the mean of both leg tips, and all readings are
/// taken as they are.

#include <cstdint>

#include "firmware/cycle/estimate.hpp"

namespace esmc {

template <class M>
struct ControllerConfig;

/// A closed pose and rates that close, from angles (rad) and rates (rad/s) of all joints; `out.closure` is
/// the gap as measured. Returns 1 + the joint whose encoder alone explains a gap above limits.closure,
/// however far off it is; 0 where the gap is within the limit, no single joint explains it, or more than one
/// nearly does.
template <class M>
using FusionPart = std::uint8_t (*)(const ControllerConfig<M>& config,
                                    const Vec<typename M::Scalar, M::joints>& angle,
                                    const Vec<typename M::Scalar, M::joints>& rate, Estimate<M>& out);

namespace part {

/// Weighted least squares: the corrections of the angles that close the loop and are smallest, each over its
/// encoder's standard deviation; the same for the rates, on the tangent. Regular at type 2, and wherever the
/// tip velocities of the four joints are not all parallel. Two steps of Gauss and Newton: from 5 mm apart to
/// about 1e-8 m.
template <class M>
std::uint8_t closure_projection(const ControllerConfig<M>& config,
                                const Vec<typename M::Scalar, M::joints>& angle,
                                const Vec<typename M::Scalar, M::joints>& rate, Estimate<M>& out);

}  // namespace part
}  // namespace esmc
