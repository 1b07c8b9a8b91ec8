#include "firmware/cycle/instances.hpp"

namespace esmc {

template class Controller<Rr<float>>;
template class Cycle<Rr<float>, drive::OdriveAxis>;
template class Cycle<Rr<float>, drive::Cia402Axis>;
template class Cycle<Rr<float>, drive::MitAxis>;

}  // namespace esmc
