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
    {"esmc", 3051, 0},
    {"esmc_projected", 2906, 0},
    {"smc", 2841, 0},
    {"ctc", 2800, 0},
    {"pd", 2386, 0},
    {"super_twisting", 2334, 3200},
    {"implicit_coupled", 11250, 5896},
    {"momentum_observer", 1849, 3576},
    {"predictor", 4150, 3632},
    {"closure_projection", 2615, 2440},
    {"four_motors", 4309, 9632},
    // <!-- /costs mps2-an386 -->
};
inline constexpr Cost costs_double[] = {
    // <!-- costs mps2-an500 -->
    {"esmc", 4228, 0},
    {"esmc_projected", 3785, 0},
    {"smc", 3413, 0},
    {"ctc", 3368, 0},
    {"pd", 2762, 0},
    {"super_twisting", 3277, 3432},
    {"implicit_coupled", 11600, 5144},
    {"momentum_observer", 2847, 3608},
    {"predictor", 5876, 2976},
    {"closure_projection", 3043, 1912},
    {"four_motors", 4165, 9232},
    // <!-- /costs mps2-an500 -->
};

/// Why the controller of a scene exceeds 60 % of the tick or of a memory of a board; empty: it does not.
std::string budget_excess(const Scene& scene, const Board& board);

}  // namespace esmc::host
