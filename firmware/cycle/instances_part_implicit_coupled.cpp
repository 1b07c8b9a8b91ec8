#include "firmware/cycle/part_implicit_coupled.hpp"

namespace esmc::part {

template void implicit_coupled(const ControllerConfig<FiveBar<double>>&, const Tracking<FiveBar<double>>&, PartMemory<FiveBar<double>>&,
                               FiveBar<double>::Channels&, FiveBar<double>::Channels&);
template void implicit_coupled(const ControllerConfig<FiveBar<float>>&, const Tracking<FiveBar<float>>&, PartMemory<FiveBar<float>>&,
                               FiveBar<float>::Channels&, FiveBar<float>::Channels&);
template void implicit_coupled(const ControllerConfig<Rr<double>>&, const Tracking<Rr<double>>&, PartMemory<Rr<double>>&,
                               Rr<double>::Channels&, Rr<double>::Channels&);
template void implicit_coupled(const ControllerConfig<Rr<float>>&, const Tracking<Rr<float>>&, PartMemory<Rr<float>>&,
                               Rr<float>::Channels&, Rr<float>::Channels&);

}  // namespace esmc::part
