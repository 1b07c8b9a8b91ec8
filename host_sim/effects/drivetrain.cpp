#include "host_sim/effects/drivetrain.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace esmc::host {
namespace {

using Own = std::span<const double>;
using Slope = std::span<double>;

}  // namespace

void Drivetrain::add(std::size_t states, decltype(Stage::pass) pass) {
  stages_.push_back({states, std::move(pass)});
  states_ += states;
}

void Drivetrain::add_gear(double stiffness, double damping, double inertia, double gap, const int* flank) {
  const auto transmitted = [stiffness, damping, half_gap = 0.5 * gap](double twist, double rate) {
    if (half_gap == 0.0) return stiffness * twist + damping * rate;
    const double side = twist > 0.0 ? 1.0 : -1.0, pressed = side * twist - half_gap;
    if (!(pressed > 0.0)) return 0.0;
    // Teeth push, they do not pull.
    return side * std::max(0.0, stiffness * pressed + damping * side * rate);
  };
  rotor_at_ = states_;
  has_rotor_ = true;
  play_ = {stiffness, damping, 0.5 * gap};
  if (flank != nullptr && gap > 0.0) {
    return add(2, [=, play = play_](double torque, Shaft rotor, Shaft joint, Own, Slope slope) {
      const double twist = rotor.angle - joint.angle - *flank * play.half_gap;
      const double through =
          *flank == 0 ? 0.0 : play.stiffness * twist + play.damping * (rotor.rate - joint.rate);
      slope[0] = rotor.rate;
      slope[1] = (torque - through) / inertia;
      return through;
    });
  }
  add(2, [=](double torque, Shaft rotor, Shaft joint, Own, Slope slope) {
    const double through = transmitted(rotor.angle - joint.angle, rotor.rate - joint.rate);
    slope[0] = rotor.rate;
    slope[1] = (torque - through) / inertia;
    return through;
  });
}

Drivetrain::Drivetrain(const std::vector<Effect>& effects, std::size_t motor, const int* flank) {
  if (const auto e = find_effect<TorqueLag>(effects)) {
    add(1, [per_second = 1.0 / e->time_constant](double torque, Shaft, Shaft, Own own, Slope slope) {
      slope[0] = (torque - own[0]) * per_second;
      return own[0];
    });
  }
  if (const auto e = find_effect<TorqueRipple>(effects)) {
    add(0, [e = *e](double torque, Shaft rotor, Shaft, Own, Slope) {
      return torque + e.amplitude * std::sin(e.per_turn * rotor.angle);
    });
  }
  const auto play = find_effect<Backlash>(effects);
  if (const auto e = find_effect<JointFlexibility>(effects)) {
    add_gear(e->stiffness[motor], e->damping[motor], e->rotor_inertia[motor], play ? play->gap : 0.0, flank);
  } else if (play) {
    add_gear(play->stiffness, play->damping, play->rotor_inertia, play->gap, flank);
  }
}

void Drivetrain::start(Shaft joint, std::span<double> own) const {
  if (!has_rotor_) return;
  own[rotor_at_] = joint.angle;
  own[rotor_at_ + 1] = joint.rate;
}

double Drivetrain::pass(double torque, Shaft joint, std::span<const double> own,
                        std::span<double> slope) const {
  const Shaft at_rotor = rotor(joint, own);
  for (const Stage& s : stages_) {
    torque = s.pass(torque, at_rotor, joint, own.first(s.states), slope.first(s.states));
    own = own.subspan(s.states);
    slope = slope.subspan(s.states);
  }
  return torque;
}

}  // namespace esmc::host
