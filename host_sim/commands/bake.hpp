#pragma once
#include <cstdint>
#include <string>

#include "host_sim/commands/controller_config.hpp"
#include "host_sim/commands/run.hpp"

namespace esmc::host {

/// CRC-32 of all that `esmc bake` writes in double precision: scenes that differ in nothing that a controller is made of have
/// the same. A controller with a command interface announces it.
std::uint32_t identity_of(Scene scene, Pacing pacing);

/// `esmc bake`: a scene as constants of a board's image, printed or written to o.out (a file). A scene that `esmc check`
/// refuses, or that a bus cannot run, is refused. `pacing`: what the image's loop waits for.
int run_bake(const RunOptions& o);

}  // namespace esmc::host
