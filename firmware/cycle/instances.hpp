#pragma once
/// The controllers of the control archive: every mechanism in both scalar types, compiled once.

#include "firmware/cycle/cycle.hpp"
#include "firmware/cycle/four_motors.hpp"
#include "firmware/drive/cia402_axis.hpp"
#include "firmware/drive/mit_axis.hpp"
#include "firmware/drive/moteus_axis.hpp"
#include "firmware/drive/odrive_axis.hpp"

namespace esmc {

template <class M>
using OdriveCycle = Cycle<M, drive::OdriveAxis>;
template <class M>
using Cia402Cycle = Cycle<M, drive::Cia402Axis>;
template <class M>
using MitCycle = Cycle<M, drive::MitAxis>;
template <class M>
using MoteusCycle = Cycle<M, drive::MoteusAxis>;

/// @cond
#define ESMC_CONTROLLER(TEMPLATE, M)          \
  TEMPLATE class Controller<M>;               \
  TEMPLATE class Cycle<M, drive::OdriveAxis>; \
  TEMPLATE class Cycle<M, drive::Cia402Axis>; \
  TEMPLATE class Cycle<M, drive::MitAxis>;    \
  TEMPLATE class Cycle<M, drive::MoteusAxis>
ESMC_CONTROLLER(extern template, FiveBar<double>);
ESMC_CONTROLLER(extern template, FiveBar<float>);
ESMC_CONTROLLER(extern template, Rr<double>);
ESMC_CONTROLLER(extern template, Rr<float>);
extern template bool part::four_motors(const ControllerConfig<FiveBar<double>>&, const FiveBar<double>::Pose&,
                                       const FiveBar<double>::Channels&, Vec<double, 4>&);
extern template bool part::four_motors(const ControllerConfig<FiveBar<float>>&, const FiveBar<float>::Pose&,
                                       const FiveBar<float>::Channels&, Vec<float, 4>&);
/// @endcond

}  // namespace esmc
