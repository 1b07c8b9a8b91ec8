#include "firmware/cycle/closure_projection.hpp"

namespace esmc::part {

template std::uint8_t closure_projection(const ControllerConfig<FiveBar<double>>&, const Vec<double, 4>&, const Vec<double, 4>&,
                                         Estimate<FiveBar<double>>&);
template std::uint8_t closure_projection(const ControllerConfig<FiveBar<float>>&, const Vec<float, 4>&, const Vec<float, 4>&,
                                         Estimate<FiveBar<float>>&);

}  // namespace esmc::part
