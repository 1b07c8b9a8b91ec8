#include "firmware/cycle/instances.hpp"

namespace esmc {

template class Controller<FiveBar<double>>;
template class Cycle<FiveBar<double>, drive::OdriveAxis>;
template class Cycle<FiveBar<double>, drive::Cia402Axis>;
template class Cycle<FiveBar<double>, drive::MitAxis>;

}  // namespace esmc
