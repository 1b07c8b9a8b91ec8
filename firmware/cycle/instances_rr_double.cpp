#include "firmware/cycle/instances.hpp"

namespace esmc {

template class Controller<Rr<double>>;
template class Cycle<Rr<double>, drive::OdriveAxis>;
template class Cycle<Rr<double>, drive::Cia402Axis>;
template class Cycle<Rr<double>, drive::MitAxis>;

}  // namespace esmc
