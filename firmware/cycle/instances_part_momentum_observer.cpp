#include "firmware/cycle/part_momentum_observer.hpp"

namespace esmc::part {

template void momentum_observer(const ControllerConfig<FiveBar<double>>&, const Tracking<FiveBar<double>>&, PartMemory<FiveBar<double>>&);
template void momentum_observer(const ControllerConfig<FiveBar<float>>&, const Tracking<FiveBar<float>>&, PartMemory<FiveBar<float>>&);
template void momentum_observer(const ControllerConfig<Rr<double>>&, const Tracking<Rr<double>>&, PartMemory<Rr<double>>&);
template void momentum_observer(const ControllerConfig<Rr<float>>&, const Tracking<Rr<float>>&, PartMemory<Rr<float>>&);

}  // namespace esmc::part
