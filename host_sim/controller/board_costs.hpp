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
    {"esmc", 3095, 0},
    {"esmc_projected", 2951, 0},
    {"smc", 2883, 0},
    {"ctc", 2854, 0},
    {"pd", 2427, 0},
    {"super_twisting", 2333, 8552},
    {"implicit_coupled", 12231, 10168},
    {"momentum_observer", 1915, 2976},
    {"predictor", 4266, 3648},
    {"closure_projection", 2601, 2232},
    {"four_motors", 4440, 9792},
    // <!-- /costs mps2-an386 -->
};
inline constexpr Cost costs_double[] = {
    // <!-- costs mps2-an500 -->
    {"esmc", 4369, 0},
    {"esmc_projected", 3867, 0},
    {"smc", 3415, 0},
    {"ctc", 3380, 0},
    {"pd", 2865, 0},
    {"super_twisting", 2636, 10232},
    {"implicit_coupled", 11854, 12176},
    {"momentum_observer", 2684, 2840},
    {"predictor", 5181, 2496},
    {"closure_projection", 3079, 2008},
    {"four_motors", 4382, 9392},
    // <!-- /costs mps2-an500 -->
};

/// Why the controller of a scene exceeds 60 % of the tick or of a memory of a board; empty: it does not.
std::string budget_excess(const Scene& scene, const Board& board);

}  // namespace esmc::host
