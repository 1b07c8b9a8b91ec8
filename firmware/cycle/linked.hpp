#pragma once
/// Between the command interface and the controller: requests in, telemetry out.

#include "firmware/cycle/controller.hpp"
#include "firmware/link/command_link.hpp"

namespace esmc {

/// Applies gains, path rate and set points of the link to the controller, and returns the command for the
/// next Supervisor::begin_tick(). delay_ticks: see set_gains.
template <class M>
Command apply_requests(link::CommandLink& link, Controller<M>& controller, typename M::Scalar delay_ticks) {
  using S = typename M::Scalar;
  const link::Request r = link.take();
  const auto vec = [](const std::array<float, 2>& a) { return Vec2<S>(S(a[0]), S(a[1])); };
  SetpointGenerator<S>& setpoints = controller.setpoints();
  setpoints.activate(r.source != link::Source::reference);
  if (r.has_gains) controller.set_gains(link.parameters(), delay_ticks);
  if (r.has_rate) controller.path_rate().want(r.percent);
  if (r.hold) setpoints.hold();
  if (r.has_sample) setpoints.follow(vec(r.position), vec(r.velocity));
  if (r.has_point) setpoints.go_to(vec(r.position));
  return r.command;
}

/// Telemetry of a tick, SI units. `error`: desired minus actual effector, 0 except in running. The caller
/// adds a drive's axis and error code.
template <class M>
[[nodiscard]] link::Report report_of(const Controller<M>& controller, const TickResult<M>& t,
                                     const Sample<M>& sample) {
  link::Report r;
  const auto& c = controller.config();
  r.joints = static_cast<std::uint8_t>(c.motor_count());
  for (int i = 0; i < c.motor_count(); ++i) {
    const int joint = ControllerConfig<M>::joint_of(i, c.motor_count());
    r.angle[static_cast<unsigned>(i)] = static_cast<float>(sample.angle[joint]);
    r.torque[static_cast<unsigned>(i)] = static_cast<float>(t.torque[joint]);
  }
  // Encoders are counted as drives: motors first, base joints before passive ones.
  if (t.fault == Fault::loop_not_closed && controller.odd_encoder() != 0) {
    const int joint = controller.odd_encoder() - 1, step = M::joints / c.motor_count();
    r.encoder = static_cast<std::uint8_t>(joint % step == 0 ? joint / step : c.motor_count() + joint / step);
  }
  for (int i = 0; i < 2; ++i) {
    r.effector[static_cast<unsigned>(i)] = static_cast<float>(t.effector[i]);
    if (t.state == State::running) {
      r.error[static_cast<unsigned>(i)] = static_cast<float>(t.desired_effector[i] - t.effector[i]);
    }
  }
  return r;
}

}  // namespace esmc
