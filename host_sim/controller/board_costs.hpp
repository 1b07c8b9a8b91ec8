#pragma once
/// What a controller takes of boards whose clock and memory are known.

#include <string>

#include "host_sim/scene/scene.hpp"

namespace esmc::host {

struct Board {
  const char* name;
  bool single_precision;
  double clock_hz;
  double flash, ram;              ///< bytes: boards/NAME/memory.ld
  double image_flash, image_ram;  ///< bytes that an image without optional parts takes; stack included
};
/// image_flash and image_ram are measured, and rounded up: `ctest -R boards.image` fails where an image takes
/// more than is said here. An image may grow up to the share of the memory that budget_excess() allows.
inline constexpr Board boards[] = {
    {"nucleo_g474re", true, 170e6, 262144, 98304, 90112, 49152},
    {"nucleo_h743zi2", false, 400e6, 1048576, 131072, 131072, 65536},
};

/// Worst instructions of a tick and bytes of flash: of a law; of an optional part in addition to those of
/// esmc.
struct Cost {
  const char* name;
  int instructions, flash;
};
// Measured by the emulator, and written by `tests/boards/board_test.py count ... --update`.
inline constexpr Cost costs_float[] = {
    // <!-- costs mps2-an386 -->
    {"esmc", 3086, 0},
    {"esmc_projected", 2933, 0},
    {"smc", 2868, 0},
    {"ctc", 2827, 0},
    {"pd", 2416, 0},
    {"super_twisting", 2297, 3264},
    {"implicit_coupled", 11114, 5800},
    {"elbow_rotors", 199, 288},
    {"momentum_observer", 1796, 3592},
    {"predictor", 3980, 3760},
    {"closure_projection", 2585, 2432},
    {"four_motors", 4320, 9632},
    // <!-- /costs mps2-an386 -->
};
inline constexpr Cost costs_double[] = {
    // <!-- costs mps2-an500 -->
    {"esmc", 4113, 0},
    {"esmc_projected", 3686, 0},
    {"smc", 3462, 0},
    {"ctc", 3417, 0},
    {"pd", 2812, 0},
    {"super_twisting", 2799, 3216},
    {"implicit_coupled", 11215, 4968},
    {"elbow_rotors", 203, 280},
    {"momentum_observer", 2710, 3584},
    {"predictor", 5302, 3048},
    {"closure_projection", 2995, 1912},
    {"four_motors", 4151, 9232},
    // <!-- /costs mps2-an500 -->
};

/// Why the controller of a scene exceeds 60 % of the tick or of a memory of a board; empty: it does not.
std::string budget_excess(const Scene& scene, const Board& board);

}  // namespace esmc::host
