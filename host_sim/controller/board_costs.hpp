#pragma once
/// Share of the tick and the memory that a controller takes of boards whose clock and memory are known.

#include <string>

#include "host_sim/scene/scene.hpp"

namespace esmc::host {

/// A board and what an image without optional parts takes of it.
struct Board {
  const char* name;
  bool single_precision;
  double clock_hz;
  double flash, ram;              ///< bytes: boards/NAME/memory.ld
  double image_flash, image_ram;  ///< bytes of such an image, stack included
};
/// image_flash and image_ram are measured, and rounded up: `ctest -R boards.image` fails where an image takes
/// more than is said here. An image may grow up to the share of the memory that budget_excess() allows.
inline constexpr Board boards[] = {
    {"nucleo_g474re", true, 170e6, 262144, 98304, 90112, 49152},
    {"nucleo_h743zi2", false, 400e6, 1048576, 131072, 131072, 65536},
};

/// Cost of a law, or of an optional part beside esmc: most instructions in a tick, bytes of flash.
struct Cost {
  const char* name;
  int instructions, flash;
};
// Measured by the emulator, and written by `tests/boards/board_test.py count ... --update`.
inline constexpr Cost costs_float[] = {
    // <!-- costs mps2-an386 -->
    {"esmc", 3097, 0},
    {"esmc_projected", 2941, 0},
    {"smc", 2877, 0},
    {"ctc", 2836, 0},
    {"pd", 2425, 0},
    {"super_twisting", 2351, 2608},
    {"implicit_coupled", 11164, 5088},
    {"elbow_rotors", 244, 280},
    {"motor_map", 593, 512},
    {"momentum_observer", 1841, 3208},
    {"predictor", 4028, 3376},
    {"closure_projection", 2584, 2416},
    {"four_motors", 4345, 9736},
    // <!-- /costs mps2-an386 -->
};
inline constexpr Cost costs_double[] = {
    // <!-- costs mps2-an500 -->
    {"esmc", 4221, 0},
    {"esmc_projected", 3830, 0},
    {"smc", 3569, 0},
    {"ctc", 3524, 0},
    {"pd", 2841, 0},
    {"super_twisting", 2824, 2640},
    {"implicit_coupled", 11237, 4168},
    {"elbow_rotors", 249, 280},
    {"motor_map", 670, 680},
    {"momentum_observer", 2730, 3208},
    {"predictor", 5299, 2672},
    {"closure_projection", 3020, 1904},
    {"four_motors", 4177, 9352},
    // <!-- /costs mps2-an500 -->
};

/// Why the controller of a scene exceeds 60 % of the tick or of a memory of a board; empty: it does not.
std::string budget_excess(const Scene& scene, const Board& board);

}  // namespace esmc::host
