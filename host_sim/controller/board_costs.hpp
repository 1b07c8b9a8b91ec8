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
  double image_flash, image_ram;  ///< bytes of an image without optional parts, at most; stack included
};
/// `ctest -R boards.image` holds the images to image_flash and image_ram.
inline constexpr Board boards[] = {
    {"nucleo_g474re", true, 170e6, 262144, 98304, 73728, 16384},
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
    {"esmc", 3071, 0},
    {"esmc_projected", 2928, 0},
    {"smc", 2870, 0},
    {"ctc", 2833, 0},
    {"pd", 2419, 0},
    {"super_twisting", 4531, 10472},
    {"implicit_coupled", 13204, 13656},
    {"momentum_observer", 2047, 3576},
    {"predictor", 4935, 3632},
    {"closure_projection", 2597, 2208},
    {"four_motors", 4316, 9512},
    // <!-- /costs mps2-an386 -->
};
inline constexpr Cost costs_double[] = {
    // <!-- costs mps2-an500 -->
    {"esmc", 5171, 0},
    {"esmc_projected", 4463, 0},
    {"smc", 3717, 0},
    {"ctc", 3672, 0},
    {"pd", 2876, 0},
    {"super_twisting", 5012, 11224},
    {"implicit_coupled", 13222, 12760},
    {"momentum_observer", 3579, 3608},
    {"predictor", 7087, 2952},
    {"closure_projection", 3075, 1928},
    {"four_motors", 4195, 9232},
    // <!-- /costs mps2-an500 -->
};

/// Why the controller of a scene exceeds 60 % of the tick or of a memory of a board; empty: it does not.
std::string budget_excess(const Scene& scene, const Board& board);

}  // namespace esmc::host
