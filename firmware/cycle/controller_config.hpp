#pragma once
/// Configuration of a controller.

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

/// Everything that determines the controller. `mechanism` is its model. A null part is not used.
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
  S torque_lead{};               ///< s, >= 0: delay from the instant of a tick to the effect of its torque
  std::uint32_t join_ticks = 0;  ///< duration of joining the reference from the measured pose; 0: at once
  std::uint32_t ramp_ticks = 0;  ///< duration of the torque ramp; 0: none
  S sign_test_move{};  ///< rad that each base joint moves in the sign test; 0: none. Two motors only
  std::uint32_t halt_ticks = 0;   ///< duration of the stop trajectory; 0: a halt takes the torque away
  std::uint32_t lower_ticks = 0;  ///< duration of lowering
  AfterHalt after_halt = AfterHalt::release;
  std::uint32_t enabling_ticks_max = Supervisor::Config{}.enabling_ticks_max;  ///< see Supervisor::Config
  std::uint32_t stopping_ticks_max = Supervisor::Config{}.stopping_ticks_max;
  S setpoint_speed{1},
      setpoint_acceleration{1};           ///< > 0, of set points, each coordinate of the reference's space
  std::uint32_t setpoint_jerk_ticks = 0;  ///< length of MovingAverage for set points; 0: none
  Motors motors = Motors::base;
  Sensors sensors = Sensors::base;
  /// N m, |preload| <= torque_given(); four motors only: see allocate_within.
  Vec<S, M::joints> preload = Vec<S, M::joints>::Zero();
  /// Optional part, part::four_motors: forces on the channels to torques of all motors; true: limited. Null:
  /// the base motors give all torque.
  bool (*allocate)(const ControllerConfig&, const typename M::Pose&, const typename M::Channels&,
                   Vec<S, M::joints>&) = nullptr;
  /// > 0, relative to each other: for `fuse`.
  Vec<S, M::joints> encoder_variance = Vec<S, M::joints>::Ones();
  FusionPart<M> fuse = nullptr;     ///< sensors = all: from four encoders to a state
  S delay_ticks{};                  ///< >= 0, whole: known delay of the torque, for optional parts
  S lag_ticks{};                    ///< >= 0: known delay of the measurement, for optional parts
  S observer_bandwidth{};           ///< of `observer`, 1/s, >= 0
  ReachingPart<M> reach = nullptr;  ///< takes the place of `law` with `reaching`
  ReachingPart<M> behind =
      nullptr;  ///< the part that part::elbow_rotors, then `reach`, calls first; null: the law
  ObserverPart<M> observer = nullptr;  ///< its disturbance is compensated
  PredictorPart<M> predict =
      nullptr;  ///< the law acts on the predicted state and the reference at its instant
  MotorMap<S, M::joints> motor_map{};
  MotorPart<M> correct = nullptr;  ///< part::motor_map; null: motors give the commanded torque

  /// Largest torque, N m at the joint, that each motor gives within torque_limit, as the model has it.
  [[nodiscard]] Vec<S, M::joints> torque_given() const {
    Vec<S, M::joints> out;
    for (int i = 0; i < M::joints; ++i)
      out[i] = torque_limit[i] * motor_map.factor[i] - magnitude(motor_map.amplitude[i]);
    return out;
  }
  /// Number of joints with a motor; sensor_count(): with an encoder.
  [[nodiscard]] constexpr int motor_count() const { return motors == Motors::base ? 2 : M::joints; }
  [[nodiscard]] constexpr int sensor_count() const { return sensors == Sensors::base ? 2 : M::joints; }
  /// Index of the joint of motor or sensor i of n: i, or with two on a 5R every second joint. Not checked.
  [[nodiscard]] static constexpr int joint_of(int i, int n) {
    return n == M::joints ? i : i * (M::joints / 2);
  }
};

}  // namespace esmc
