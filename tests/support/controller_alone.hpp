#pragma once
/// A controller without a bus: a test is its encoders, its operator and its drives, which are always ready.

#include <array>
#include <cmath>
#include <optional>

#include "firmware/cycle/instances.hpp"
#include "tests/support/cycle_setup.hpp"

namespace esmc::test {

/// Leaves numbers where the next call has its variables: what a tick does not set is not zero by chance.
[[gnu::noinline]] inline void soil() {
  std::array<volatile double, 4096> dirt;
  for (auto& d : dirt) d = 1e3;
}

template <class M>
struct Alone {
  using S = typename M::Scalar;
  Alone() {
    const auto s = setup<M>();
    config = s.controller;
    for (int j = 0; j < M::joints; ++j) now.angle[j] = static_cast<S>(s.angle[static_cast<unsigned>(j)]);
  }
  TickResult<M> tick(Command command = Command::none) {
    if (!controller) {
      controller.emplace(config);
      supervisor.emplace(controller->supervision());
      homing.emplace(approach, config.sample_time, config.halt_ticks);
    }
    supervisor->begin_tick(command, {true, true}, done);
    soil();
    const auto r = supervisor->homing() ? controller->home(now, *supervisor, *homing)
                                        : controller->tick(now, *supervisor);
    done = r.stage_done;
    return r;
  }
  /// The first tick with torque.
  TickResult<M> start() {
    tick(Command::enable);
    return tick();
  }
  /// The other base joint.
  static constexpr int second = M::joints / 2;

  ControllerConfig<M> config;
  HomingConfig<S> approach;
  Sample<M> now;
  std::optional<Controller<M>> controller;
  std::optional<Supervisor> supervisor;
  std::optional<Homing<S>> homing;
  bool done = false;
};

/// Torque that holds the arm: of its masses, at the distances of their centres.
inline Vec2<double> weight_of_the_arm(const Vec2<float>& q) {
  const Vec2<double> angle = q.cast<double>();
  const double first = std::cos(angle[0]), both = std::cos(angle[0] + angle[1]);
  const double elbow = 9.8 * 0.3 * 0.07 * both;
  return {9.8 * (0.4 * 0.09 + 0.3 * 0.2) * first + elbow, elbow};
}

/// Acceleration of the arm's joints, rad/s2, by torque beyond that weight, from rest.
inline Vec2<double> answer_of_the_arm(const Vec2<float>& q, const Vec2<double>& torque) {
  const double coupled = 0.3 * 0.2 * 0.07 * std::cos(static_cast<double>(q[1]));
  const double outer = 1e-3 + 0.3 * 0.07 * 0.07, both = outer + coupled;
  const double whole = 2e-3 + 0.4 * 0.09 * 0.09 + 0.3 * 0.2 * 0.2 + outer + 2 * coupled;
  return Vec2<double>(outer * torque[0] - both * torque[1], whole * torque[1] - both * torque[0]) /
         (whole * outer - both * both);
}

}  // namespace esmc::test
