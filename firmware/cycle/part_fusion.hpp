#pragma once
/// Optional part: projects the readings of four encoders onto the closure manifold. Without it the effector
/// is the mean of both leg tips, and the readings are used unchanged.

#include <cstdint>

#include "firmware/cycle/estimate.hpp"

namespace esmc {

template <class M>
struct ControllerConfig;

/// Type of ControllerConfig::fuse: from angles (rad) and rates (rad/s) of all joints to a closed pose and
/// consistent rates; `out.closure`: measured distance of the leg tips, m. Returns 1 + the joint whose encoder
/// alone explains a gap above limits.closure, or 0.
template <class M>
using FusionPart = std::uint8_t (*)(const ControllerConfig<M>& config,
                                    const Vec<typename M::Scalar, M::joints>& angle,
                                    const Vec<typename M::Scalar, M::joints>& rate, Estimate<M>& out);

namespace part {

/// FusionPart by weighted least squares: the smallest corrections of the angles, relative to the standard
/// deviations of the encoders, that close the loop; the rates are corrected as well. Regular unless the tip
/// velocities of all four joints are parallel, hence at type 2. Two Gauss-Newton steps: from 5 mm to below
/// 1e-6 m, with bars of 0.1 m.
template <class M>
std::uint8_t closure_projection(const ControllerConfig<M>& config,
                                const Vec<typename M::Scalar, M::joints>& angle,
                                const Vec<typename M::Scalar, M::joints>& rate, Estimate<M>& out);

}  // namespace part
}  // namespace esmc
