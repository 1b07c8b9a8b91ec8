#pragma once
/// The closed loop of `esmc sim` for several five-bars side by side, each with the bits it has alone, without
/// effects. The loop (loop.hpp) is compiled for several instruction sets; the widest of this machine is used.

#include <array>
#include <cstdint>
#include <vector>

#include "firmware/cycle/controller_config.hpp"
#include "firmware/mechanism/five_bar.hpp"
#include "host_sim/record/run_sums.hpp"

namespace esmc::host {

struct Scene;

/// Settings that are the same in all lanes.
struct LaneSettings {
  LawKind law{};
  Reaching reaching{};
  std::array<int, 2> working_mode{};
  int assembly_mode = 0;
  std::uint32_t ticks = 0;
  int steps = 1;                  ///< of the integrator per tick
  double tick = 0.0, step = 0.0;  ///< s
  bool true_lengths = true;       ///< what the controller believes
  bool base_errors = true;        ///< wanted
  bool one_reference = true;      ///< for all lanes
  const double* track =
      nullptr;              ///< its rows of all ticks, see fill_references; null: each group computes them
  bool driven = false;      ///< by given torques: no controller, reference and sums
  std::uint32_t every = 0;  ///< driven: states are kept every so many ticks from the start on, 0: none
  bool (*stopped)() = nullptr;  ///< once true, all lanes end, not ok

  friend bool operator==(const LaneSettings&, const LaneSettings&) = default;
};

/// Of one lane.
struct LaneCase {
  ControllerConfig<FiveBar<double>> controller;
  JoinedReference<double> reference;  ///< looks into the bundle of its job
  FiveBarParams<double> believed, plant;
  std::array<double, 4> angle{}, rate{};  ///< of the plant's bars at t = 0, closed
  // Driven:
  const double* torque = nullptr;  ///< of the two base motors, tick by tick, N m
  double* states = nullptr;        ///< takes q and qd of final_state: those kept, then the end
};

struct LaneScore {
  bool ok = false;  ///< else something happened that lanes do not cover; the case is to be run alone
  RunSums<double> sums;
};

/// Position, velocity, acceleration of the effector's reference at `count` ticks from `first` on:
/// out[tick * 6 + coordinate] with one for all lanes, else out[(tick * 6 + coordinate) * lanes + lane].
void fill_references(const LaneSettings& settings, const LaneCase* cases, int lanes, std::uint32_t first,
                     std::uint32_t count, double* out);

struct LaneKernel {
  const char* name;  ///< "AVX-512", ...
  int lanes;
  void (*run)(const LaneSettings&, const LaneCase* cases, LaneScore* out);
};

// loop.cpp, compiled for two lanes on any processor, for four with AVX2 and for eight with AVX-512. `cases`
// and `out` have an entry per lane. Call a wide one only where lane_kernels() lists it.
void lane_kernel_baseline(const LaneSettings& settings, const LaneCase* cases, LaneScore* out);
void lane_kernel_avx2(const LaneSettings& settings, const LaneCase* cases, LaneScore* out);
void lane_kernel_avx512(const LaneSettings& settings, const LaneCase* cases, LaneScore* out);
/// Those that this machine can run, the fastest first.
[[nodiscard]] const std::vector<LaneKernel>& lane_kernels();

}  // namespace esmc::host
