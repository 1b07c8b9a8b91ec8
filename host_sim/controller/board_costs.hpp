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
    {"esmc", 3080, 0},
    {"esmc_projected", 2923, 0},
    {"smc", 2858, 0},
    {"ctc", 2817, 0},
    {"pd", 2403, 0},
    {"super_twisting", 2333, 3208},
    {"implicit_coupled", 11251, 5904},
    {"momentum_observer", 1851, 3576},
    {"predictor", 4150, 3632},
    {"closure_projection", 2570, 2440},
    {"four_motors", 4305, 9632},
    // <!-- /costs mps2-an386 -->
};
inline constexpr Cost costs_double[] = {
    // <!-- costs mps2-an500 -->
    {"esmc", 4535, 0},
    {"esmc_projected", 3896, 0},
    {"smc", 3465, 0},
    {"ctc", 3420, 0},
    {"pd", 2814, 0},
    {"super_twisting", 3276, 3424},
    {"implicit_coupled", 11600, 5136},
    {"momentum_observer", 2847, 3600},
    {"predictor", 5876, 2968},
    {"closure_projection", 2991, 1912},
    {"four_motors", 4158, 9232},
    // <!-- /costs mps2-an500 -->
};

/// Why the controller of a scene exceeds 60 % of the tick or of a memory of a board; empty: it does not.
std::string budget_excess(const Scene& scene, const Board& board);

}  // namespace esmc::host
