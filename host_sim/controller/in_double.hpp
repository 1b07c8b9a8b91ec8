#pragma once
/// Samples and results of a controller in single precision as doubles, for records.

#include <cstddef>

#include "firmware/cycle/controller.hpp"
#include "firmware/cycle/sample.hpp"

namespace esmc::host {

/// M and C: the same mechanism in double and in the controller's scalar type.
template <class M, class C>
TickResult<M> in_double(const TickResult<C>& r) {
  TickResult<M> out;
  out.state = r.state;
  out.fault = r.fault;
  out.running_tick = r.running_tick;
  out.saturated = r.saturated;
  out.stage_done = r.stage_done;
  out.torque = r.torque.template cast<double>();
  out.effector = r.effector.template cast<double>();
  out.desired_effector = r.desired_effector.template cast<double>();
  for (int i = 0; i < 2; ++i) out.desired_direction[i] = r.desired_direction[i].template cast<double>();
  out.sliding = r.sliding.template cast<double>();
  return out;
}

template <class M, class C>
Sample<M> in_double(const Sample<C>& s) {
  Sample<M> out;
  out.angle = s.angle.template cast<double>();
  out.rate = s.rate.template cast<double>();
  out.age_ticks = s.age_ticks;
  for (std::size_t i = 0; i < out.phase.size(); ++i) out.phase[i] = static_cast<double>(s.phase[i]);
  return out;
}

}  // namespace esmc::host
