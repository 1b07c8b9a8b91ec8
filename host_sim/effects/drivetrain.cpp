#include "host_sim/effects/drivetrain.hpp"

#include <algorithm>
#include <cmath>

namespace esmc::host {
namespace {

class Lag final : public DrivetrainStage {
 public:
  explicit Lag(const TorqueLag& e) : per_second_(1.0 / e.time_constant) {}
  [[nodiscard]] int states() const override { return 1; }
  void start(Shaft, std::span<double> own) const override { own[0] = 0.0; }
  double pass(double torque, Shaft, Shaft, std::span<const double> own,
              std::span<double> slope) const override {
    slope[0] = (torque - own[0]) * per_second_;
    return own[0];
  }

 private:
  double per_second_;
};

class Ripple final : public DrivetrainStage {
 public:
  explicit Ripple(const TorqueRipple& e) : e_(e) {}
  double pass(double torque, Shaft rotor, Shaft, std::span<const double>, std::span<double>) const override {
    return torque + e_.amplitude * std::sin(e_.per_turn * rotor.angle);
  }

 private:
  TorqueRipple e_;
};

/// Spring, damper and play between rotor and joint.
class Gear final : public DrivetrainStage {
 public:
  Gear(double stiffness, double damping, double inertia, double gap)
      : stiffness_(stiffness), damping_(damping), inertia_(inertia), half_gap_(0.5 * gap) {}
  [[nodiscard]] int states() const override { return 2; }
  [[nodiscard]] bool has_rotor() const override { return true; }
  void start(Shaft joint, std::span<double> own) const override {
    own[0] = joint.angle;
    own[1] = joint.rate;
  }
  double pass(double torque, Shaft rotor, Shaft joint, std::span<const double>,
              std::span<double> slope) const override {
    const double through = transmitted(rotor.angle - joint.angle, rotor.rate - joint.rate);
    slope[0] = rotor.rate;
    slope[1] = (torque - through) / inertia_;
    return through;
  }

 private:
  [[nodiscard]] double transmitted(double twist, double rate) const {
    if (half_gap_ == 0.0) return stiffness_ * twist + damping_ * rate;
    const double side = twist > 0.0 ? 1.0 : -1.0, pressed = side * twist - half_gap_;
    if (!(pressed > 0.0)) return 0.0;
    return side *
           std::max(0.0, stiffness_ * pressed + damping_ * side * rate);  // teeth push, they do not pull
  }
  double stiffness_, damping_, inertia_, half_gap_;
};

}  // namespace

Drivetrain::Drivetrain(const std::vector<Effect>& effects, std::size_t motor) {
  if (const auto e = find_effect<TorqueLag>(effects)) stages_.push_back(std::make_unique<Lag>(*e));
  if (const auto e = find_effect<TorqueRipple>(effects)) stages_.push_back(std::make_unique<Ripple>(*e));
  const auto play = find_effect<Backlash>(effects);
  if (const auto e = find_effect<JointFlexibility>(effects)) {
    stages_.push_back(std::make_unique<Gear>(e->stiffness[motor], e->damping[motor], e->rotor_inertia[motor],
                                             play ? play->gap : 0.0));
  } else if (play) {
    stages_.push_back(std::make_unique<Gear>(play->stiffness, play->damping, play->rotor_inertia, play->gap));
  }
  for (const auto& s : stages_) {
    if (s->has_rotor()) rotor_at_ = static_cast<int>(states_);
    states_ += static_cast<std::size_t>(s->states());
  }
}

void Drivetrain::start(Shaft joint, std::span<double> own) const {
  for (const auto& s : stages_) {
    const auto n = static_cast<std::size_t>(s->states());
    s->start(joint, own.first(n));
    own = own.subspan(n);
  }
}

double Drivetrain::pass(double torque, Shaft joint, std::span<const double> own,
                        std::span<double> slope) const {
  const Shaft at_rotor = rotor(joint, own);
  for (const auto& s : stages_) {
    const auto n = static_cast<std::size_t>(s->states());
    torque = s->pass(torque, at_rotor, joint, own.first(n), slope.first(n));
    own = own.subspan(n);
    slope = slope.subspan(n);
  }
  return torque;
}

}  // namespace esmc::host
