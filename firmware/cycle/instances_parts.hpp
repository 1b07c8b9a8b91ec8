#pragma once
/// The optional parts of the controller, compiled once for each mechanism and scalar type into the control archive.

#include "firmware/cycle/closure_projection.hpp"
#include "firmware/cycle/part_four_motors.hpp"
#include "firmware/cycle/part_implicit_coupled.hpp"
#include "firmware/cycle/part_momentum_observer.hpp"
#include "firmware/cycle/part_predictor.hpp"
#include "firmware/cycle/part_super_twisting.hpp"

/// Parts of every mechanism, and of those whose joints all have encoders or motors. For namespace esmc::part.
#define ESMC_PARTS(M)                                                                                                                  \
  template void super_twisting(const ControllerConfig<M>&, const Tracking<M>&, PartMemory<M>&, M::Channels&, M::Channels&);            \
  template void implicit_coupled(const ControllerConfig<M>&, const Tracking<M>&, PartMemory<M>&, M::Channels&, M::Channels&);          \
  template void momentum_observer(const ControllerConfig<M>&, const Tracking<M>&, PartMemory<M>&);                                     \
  template void predictor(const ControllerConfig<M>&, const PartMemory<M>&, Tracking<M>&)
#define ESMC_REDUNDANT_PARTS(M)                                                                                                        \
  template bool four_motors(const ControllerConfig<M>&, const M::Pose&, const M::Channels&, Vec<M::Scalar, M::joints>&);               \
  template std::uint8_t closure_projection(const ControllerConfig<M>&, const Vec<M::Scalar, M::joints>&,                               \
                                           const Vec<M::Scalar, M::joints>&, Estimate<M>&)
