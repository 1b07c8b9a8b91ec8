#include "host_sim/plant/five_bar_plant.hpp"

namespace esmc::host {

template class FiveBarPlantOf<Double2, double>;

}  // namespace esmc::host
