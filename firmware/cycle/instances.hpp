#pragma once
/// The controllers that exist: every mechanism in both scalar types, compiled once into the control archive.

#include "firmware/cycle/cycle.hpp"
#include "firmware/cycle/four_motors.hpp"
#include "firmware/drive/cia402_axis.hpp"
#include "firmware/drive/mit_axis.hpp"
#include "firmware/drive/odrive_axis.hpp"

namespace esmc {

template <class M>
using OdriveCycle = Cycle<M, drive::OdriveAxis>;
template <class M>
using Cia402Cycle = Cycle<M, drive::Cia402Axis>;
template <class M>
using MitCycle = Cycle<M, drive::MitAxis>;

extern template class Controller<FiveBar<double>>;
extern template class Controller<FiveBar<float>>;
extern template class Controller<Rr<double>>;
extern template class Controller<Rr<float>>;
extern template class Cycle<FiveBar<double>, drive::OdriveAxis>;
extern template class Cycle<FiveBar<float>, drive::OdriveAxis>;
extern template class Cycle<Rr<double>, drive::OdriveAxis>;
extern template class Cycle<Rr<float>, drive::OdriveAxis>;
extern template class Cycle<FiveBar<double>, drive::Cia402Axis>;
extern template class Cycle<FiveBar<float>, drive::Cia402Axis>;
extern template class Cycle<Rr<double>, drive::Cia402Axis>;
extern template class Cycle<Rr<float>, drive::Cia402Axis>;
extern template class Cycle<FiveBar<double>, drive::MitAxis>;
extern template class Cycle<FiveBar<float>, drive::MitAxis>;
extern template class Cycle<Rr<double>, drive::MitAxis>;
extern template class Cycle<Rr<float>, drive::MitAxis>;
/// @cond
extern template bool part::four_motors(const ControllerConfig<FiveBar<double>>&, const FiveBar<double>::Pose&,
                                       const FiveBar<double>::Channels&, Vec<double, 4>&);
extern template bool part::four_motors(const ControllerConfig<FiveBar<float>>&, const FiveBar<float>::Pose&,
                                       const FiveBar<float>::Channels&, Vec<float, 4>&);
/// @endcond

}  // namespace esmc
