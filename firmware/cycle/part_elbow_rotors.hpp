#pragma once
/// Optional part: rotors behind the gears of elbow motors, whose rates are entries of p with a mass of their
/// own.

#include "firmware/cycle/part_law.hpp"

namespace esmc::part {

template <class M>
void elbow_rotors(const ControllerConfig<M>& config, const Tracking<M>& t, PartMemory<M>& memory,
                  typename M::Channels& acceleration, typename M::Channels& sliding) {
  if (config.behind != nullptr) {
    config.behind(config, t, memory, acceleration, sliding);
  } else {
    fused_acceleration(config.law, config.mechanism, config.gains, config.reaching, t, acceleration, sliding);
  }
  config.mechanism.add_rotors(acceleration);
}

}  // namespace esmc::part
