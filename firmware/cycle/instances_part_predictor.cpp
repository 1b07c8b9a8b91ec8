#include "firmware/cycle/part_predictor.hpp"

namespace esmc::part {

template void predictor(const ControllerConfig<FiveBar<double>>&, const PartMemory<FiveBar<double>>&, Tracking<FiveBar<double>>&);
template void predictor(const ControllerConfig<FiveBar<float>>&, const PartMemory<FiveBar<float>>&, Tracking<FiveBar<float>>&);
template void predictor(const ControllerConfig<Rr<double>>&, const PartMemory<Rr<double>>&, Tracking<Rr<double>>&);
template void predictor(const ControllerConfig<Rr<float>>&, const PartMemory<Rr<float>>&, Tracking<Rr<float>>&);

}  // namespace esmc::part
