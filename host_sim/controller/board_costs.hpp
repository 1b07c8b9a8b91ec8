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
    {"esmc", 3085, 0},
    {"esmc_projected", 2929, 0},
    {"smc", 2863, 0},
    {"ctc", 2822, 0},
    {"pd", 2410, 0},
    {"super_twisting", 2338, 3224},
    {"implicit_coupled", 11255, 5936},
    {"elbow_rotors", 198, 280},
    {"momentum_observer", 1850, 3592},
    {"predictor", 4197, 3744},
    {"closure_projection", 2569, 2432},
    {"four_motors", 4296, 9632},
    // <!-- /costs mps2-an386 -->
};
inline constexpr Cost costs_double[] = {
    // <!-- costs mps2-an500 -->
    {"esmc", 4458, 0},
    {"esmc_projected", 3842, 0},
    {"smc", 3454, 0},
    {"ctc", 3409, 0},
    {"pd", 2810, 0},
    {"super_twisting", 3318, 3504},
    {"implicit_coupled", 11642, 5152},
    {"elbow_rotors", 202, 280},
    {"momentum_observer", 2890, 3584},
    {"predictor", 5990, 3040},
    {"closure_projection", 2993, 1912},
    {"four_motors", 4148, 9232},
    // <!-- /costs mps2-an500 -->
};

/// Why the controller of a scene exceeds 60 % of the tick or of a memory of a board; empty: it does not.
std::string budget_excess(const Scene& scene, const Board& board);

}  // namespace esmc::host
