#include "firmware/cycle/instances.hpp"

namespace esmc {

template class Controller<FiveBar<float>>;
template class Cycle<FiveBar<float>, drive::OdriveAxis>;
template class Cycle<FiveBar<float>, drive::Cia402Axis>;
template class Cycle<FiveBar<float>, drive::MitAxis>;

}  // namespace esmc
