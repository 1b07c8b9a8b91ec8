#include "host_sim/effects/drivetrain.hpp"

#include <algorithm>
#include <cmath>

namespace esmc::host {

Drivetrain::Drivetrain(const std::vector<Effect>& effects, std::size_t motor, const int* flank)
    : ripple_(find_effect<TorqueRipple>(effects)), flank_(flank) {
  if (const auto e = find_effect<TorqueLag>(effects)) lag_ = 1.0 / e->time_constant;
  const auto play = find_effect<Backlash>(effects);
  const double half_gap = play ? 0.5 * play->gap : 0.0;
  if (const auto e = find_effect<JointFlexibility>(effects)) {
    gear_ = {e->stiffness[motor], e->damping[motor], e->rotor_inertia[motor], half_gap};
  } else if (play) {
    gear_ = {play->stiffness, play->damping, play->rotor_inertia, half_gap};
  }
}

void Drivetrain::start(Shaft joint, std::span<double> own) const {
  if (!gear_) return;
  own[rotor_at()] = joint.angle;
  own[rotor_at() + 1] = joint.rate;
}

double Drivetrain::transmitted(double twist, double rate) const {
  const auto& [stiffness, damping, inertia, half_gap] = *gear_;
  if (half_gap == 0.0) return stiffness * twist + damping * rate;
  if (flank_ != nullptr)
    return *flank_ == 0 ? 0.0 : stiffness * (twist - *flank_ * half_gap) + damping * rate;
  const double side = twist > 0.0 ? 1.0 : -1.0, pressed = side * twist - half_gap;
  if (!(pressed > 0.0)) return 0.0;
  // Teeth push, they do not pull.
  return side * std::max(0.0, stiffness * pressed + damping * side * rate);
}

double Drivetrain::pass(double torque, Shaft joint, std::span<const double> own,
                        std::span<double> slope) const {
  const Shaft at = rotor(joint, own);
  if (lag_) {
    slope[0] = (torque - own[0]) * *lag_;
    torque = own[0];
  }
  if (ripple_) torque += ripple_->amplitude * std::sin(ripple_->per_turn * at.angle);
  if (!gear_) return torque;
  const double through = transmitted(at.angle - joint.angle, at.rate - joint.rate);
  slope[rotor_at()] = at.rate;
  slope[rotor_at() + 1] = (torque - through) / gear_->inertia;
  return through;
}

}  // namespace esmc::host
