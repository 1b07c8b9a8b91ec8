#pragma once
/// Result of a tick of the controller.

#include <cstdint>

#include "firmware/mechanism/five_bar.hpp"
#include "firmware/safety/faults.hpp"
#include "firmware/safety/guards.hpp"
#include "firmware/safety/supervisor.hpp"

namespace esmc {

/// Output of a tick. Torques are zero unless `state` is testing, running, halting, holding or lowering.
template <class M>
struct TickResult {
  using S = typename M::Scalar;
  State state = State::disabled;
  Fault fault = Fault::none;
  std::uint64_t running_tick = 0;      ///< ticks since running began; 0 in the first one
  Truth<S> saturated{};                ///< a torque was clamped
  bool stage_done = false;             ///< see Supervisor::begin_tick(), for its next tick
  Vec<S, M::joints> torque;            ///< N m at the joints, zero where there is no motor
  Vec2<S> effector;                    ///< estimate, m; zero without one
  Vec2<S> desired_effector;            ///< m; zero, as the next two, without a desired motion
  List<Vec2<S>, 2> desired_direction;  ///< cosine and sine of the base joints
  typename M::Channels sliding;        ///< s of every channel, unit of the channel / s; zero without the law

  struct Unset {};
  /// A tick without torque, estimate and desired motion, in `disabled`.
  TickResult() : TickResult(Unset{}) {
    clear_estimate();
    clear_desired();
    sliding.setZero();
  }
  /// Zero torque; the caller must set effector, desired_effector, desired_direction and sliding.
  explicit TickResult(Unset) {
    unroll<M::joints>([&](auto i) ESMC_INLINE { torque[i] = S(0); });
  }
  void clear_estimate() { effector.setZero(); }  ///< sets the estimate to zero: there is none in this tick
  /// Sets the desired effector and directions to zero: there is no desired motion in this tick.
  void clear_desired() {
    desired_effector.setZero();
    for (auto& d : desired_direction.items) d.setZero();
  }

  /// Desired angles of the base joints, rad, in [-pi, pi]. Not computed in the tick: no torque needs them.
  [[nodiscard]] Vec2<S> desired_base() const { return angles_of(desired_direction); }
};

}  // namespace esmc
