#pragma once
/// The closed loop of `esmc sim` for several five-bars side by side, each with the bits it has alone:
/// sensors, controller and plant without effects. What the code does once for all lanes is in lane_loop.hpp;
/// it is compiled for several instruction sets, and the widest that this machine has is taken.

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "firmware/control/law.hpp"
#include "firmware/mechanism/params.hpp"

namespace esmc::host {

struct Scene;

/// The same in all lanes.
struct LaneSettings {
  LawKind law{};
  Reaching reaching{};
  std::array<int, 2> working_mode{};
  int assembly_mode = 0;
  std::uint32_t ticks = 0, settled_from = 0;  ///< settled_from: the first tick that counts as settled
  int steps = 1;                              ///< of the integrator per tick
  double tick = 0.0, step = 0.0;              ///< s
  bool true_lengths = true;                   ///< what the controller believes
  bool base_errors = true;                    ///< wanted
  bool one_reference = true;                  ///< for all lanes

  friend bool operator==(const LaneSettings&, const LaneSettings&) = default;
};

/// Of one lane.
struct LaneCase {
  static constexpr std::size_t channels = 18;
  FiveBarParams<double> believed, plant;
  std::array<double, channels> lambda{}, k{}, layer{};
  std::array<double, 5> independent{};  ///< lambda, k, layer, kp, kd
  double type1 = 0.0, type2 = 0.0, joint_speed = 0.0, feedback_jump = 0.0, lead = 0.0;
  std::array<std::array<double, 2>, 2> workspace{}, joint_angle{};  ///< lower, upper
  std::array<double, 2> torque_limit{};
  std::array<double, 4> angle{}, rate{};  ///< of the plant's bars at t = 0, closed
};

struct LaneScore {
  bool ok = false;  ///< else something happened that lanes do not cover; the case is to be run alone
  double square = 0.0, largest = 0.0, settled_square = 0.0, settled_largest = 0.0;  ///< effector error, m
  double base_square = 0.0, base_largest = 0.0, base_settled_square = 0.0, base_settled_largest = 0.0;
  double torque_max = 0.0, delta_sum = 0.0, power_sum = 0.0, saturated = 0.0;
};

/// Position, velocity, acceleration of the effector's reference: out[tick * 6 + coordinate] with one for all
/// lanes, else out[(tick * 6 + coordinate) * lanes + lane].
class LaneReference {
 public:
  virtual ~LaneReference() = default;
  virtual void fill(std::uint32_t first, std::uint32_t count, double* out) const = 0;

 protected:
  LaneReference() = default;
  LaneReference(const LaneReference&) = default;
  LaneReference& operator=(const LaneReference&) = default;
};

struct LaneKernel {
  const char* name;  ///< "AVX-512", ...
  int lanes;
  void (*run)(const LaneSettings&, const LaneCase* cases, const LaneReference& reference, LaneScore* out);
};

// Each in a file of its own, lane_kernel_*.cpp.
[[nodiscard]] LaneKernel lane_kernel_baseline();
[[nodiscard]] LaneKernel lane_kernel_v3();  // x86 alone
[[nodiscard]] LaneKernel lane_kernel_v4();
/// Those that this machine can run, the fastest first.
[[nodiscard]] const std::vector<LaneKernel>& lane_kernels();

}  // namespace esmc::host
