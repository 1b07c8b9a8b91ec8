#include "firmware/cycle/instances.hpp"

namespace esmc {

template class Controller<FiveBar<double>>;
template class Controller<FiveBar<float>>;
template class Controller<Rr<double>>;
template class Controller<Rr<float>>;
template class Cycle<FiveBar<double>, drive::OdriveAxis>;
template class Cycle<FiveBar<float>, drive::OdriveAxis>;
template class Cycle<Rr<double>, drive::OdriveAxis>;
template class Cycle<Rr<float>, drive::OdriveAxis>;
template class Cycle<FiveBar<double>, drive::Cia402Axis>;
template class Cycle<FiveBar<float>, drive::Cia402Axis>;
template class Cycle<Rr<double>, drive::Cia402Axis>;
template class Cycle<Rr<float>, drive::Cia402Axis>;
template class Cycle<FiveBar<double>, drive::MitAxis>;
template class Cycle<FiveBar<float>, drive::MitAxis>;
template class Cycle<Rr<double>, drive::MitAxis>;
template class Cycle<Rr<float>, drive::MitAxis>;

}  // namespace esmc
