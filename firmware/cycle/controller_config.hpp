#pragma once
/// What a controller is told before its first tick.

#include <cstdint>

#include "firmware/control/law.hpp"
#include "firmware/control/reference.hpp"
#include "firmware/cycle/part_fusion.hpp"
#include "firmware/cycle/parts.hpp"
#include "firmware/cycle/stop_trajectory.hpp"
#include "firmware/safety/guards.hpp"
#include "firmware/safety/supervisor.hpp"

namespace esmc {

/// Which joints have a motor.
enum class Motors : std::uint8_t { base, all };  ///< all (5R only): motors on the passive joints too
/// Which joints have an encoder.
enum class Sensors : std::uint8_t { base, all };  ///< all (5R only): encoders on the passive joints too

/// Everything that decides what the controller does. The mechanism is what the controller believes.
template <class M>
struct ControllerConfig {
  using S = typename M::Scalar;
  M mechanism{};
  typename M::Mode mode{};
  LawKind law = LawKind::esmc;
  Reaching reaching = Reaching::implicit;
  Gains<M> gains{};
  Reference<S> reference{};
  Limits<S> limits{};
  Vec<S, M::joints> torque_limit = Vec<S, M::joints>::Zero();   ///< N m at the joint, >= 0
  Vec<S, M::joints> torque_weight = Vec<S, M::joints>::Ones();  ///< W of [F26], > 0; four motors only
  S sample_time{};                                              ///< s, > 0
  S torque_lead{};               ///< s, >= 0: from the instant of a tick to the one at which its torque acts
  std::uint32_t join_ticks = 0;  ///< time to join the reference from the measured pose; 0: at once
  std::uint32_t ramp_ticks = 0;  ///< over which the torque rises to what the law asks for; 0: at once
  S sign_test_move{};  ///< rad that each base joint must move in the sign test; 0: no test. Two motors only
  std::uint32_t halt_ticks = 0;   ///< time to come to rest after a halt; 0: a halt takes the torque away
  std::uint32_t lower_ticks = 0;  ///< time to let the weight down
  AfterHalt after_halt = AfterHalt::release;
  std::uint32_t enabling_ticks_max = Supervisor::Config{}.enabling_ticks_max;  ///< see Supervisor::Config
  std::uint32_t stopping_ticks_max = Supervisor::Config{}.stopping_ticks_max;
  S guide_speed{1},
      guide_acceleration{1};  ///< > 0, of each coordinate of the reference's space: for set points
  Motors motors = Motors::base;
  Sensors sensors = Sensors::base;
  Vec<S, M::joints> preload =
      Vec<S, M::joints>::Zero();  ///< N m, |preload| <= torque_limit; four motors only: see allocate_within
  /// Optional part, part::four_motors: forces on the channels to torques of all motors, true where they are
  /// less than asked. Null: what the law asks for comes from the base motors, also where others are.
  bool (*allocate)(const ControllerConfig&, const typename M::Pose&, const typename M::Channels&,
                   Vec<S, M::joints>&) = nullptr;
  Vec<S, M::joints> encoder_variance =
      Vec<S, M::joints>::Ones();       ///< > 0, relative to each other: for `fuse`
  FusionPart<M> fuse = nullptr;        ///< sensors = all: how four encoders become a state
  S delay_ticks{};                     ///< >= 0, whole: of the torque, as known, for the parts
  S lag_ticks{};                       ///< >= 0: of what is measured, as known, for the parts
  S observer_bandwidth{};              ///< 1/s, >= 0
  ReachingPart<M> reach = nullptr;     ///< in place of `reaching`
  ObserverPart<M> observer = nullptr;  ///< what it observes is compensated
  PredictorPart<M> predict =
      nullptr;  ///< the law acts on what it predicts, towards the reference of that instant

  [[nodiscard]] constexpr int motor_count() const { return motors == Motors::base ? 2 : M::joints; }
  [[nodiscard]] constexpr int sensor_count() const { return sensors == Sensors::base ? 2 : M::joints; }
  /// Joint that motor or sensor i of n sits on: base joints are every second one of a 5R with two.
  [[nodiscard]] static constexpr int joint_of(int i, int n) {
    return n == M::joints ? i : i * (M::joints / 2);
  }
};

}  // namespace esmc
