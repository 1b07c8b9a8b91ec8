#pragma once
/// Engines of all methods, and the choice among them.

#include <memory>
#include <utility>

#include "host_sim/effects/effects.hpp"
#include "host_sim/integrate/dopri5.hpp"
#include "host_sim/integrate/dopri8.hpp"
#include "host_sim/integrate/fixed_step.hpp"
#include "host_sim/plant/engine_base.hpp"
#include "host_sim/plant/moreau_jean.hpp"
#include "host_sim/plant/system.hpp"

namespace esmc::host {

template <class Plant, class Sys, class Stepper>
class EngineOf final : public SystemEngine<Plant, Sys> {
 public:
  /// `make_stepper(system)` returns the method, which may keep the system.
  template <class MakeStepper>
  EngineOf(const Plant& plant, std::unique_ptr<Attachments> attached, Method method,
           const typename Plant::State& initial, const MakeStepper& make_stepper)
      : SystemEngine<Plant, Sys>(plant, std::move(attached), initial),
        stepper_(make_stepper(this->system_)),
        method_(method) {}

  void run(double t, double step, int steps, const MotorTorques<typename Plant::Joints>& torque) override {
    this->system_.set_torques(torque);
    this->attached_->loads.begin(t + 0.5 * step * steps);
    for (int i = 0; i < steps; ++i) stepper_.step(t + i * step, step, this->y_);
  }
  [[nodiscard]] Method method() const override { return method_; }

 private:
  Stepper stepper_;
  Method method_;
};

/// What the effects add to the mechanism. `by_event`: an integration that locates events has the stops, and
/// says which flank of a gear presses.
[[nodiscard]] inline std::unique_ptr<Attachments> attach(const std::vector<Effect>& effects,
                                                         const std::vector<std::size_t>& motor_joint,
                                                         const Hand* hand, bool by_event) {
  auto attached = std::make_unique<Attachments>();
  std::vector<Effect> loads = effects;
  if (by_event) std::erase_if(loads, [](const Effect& e) { return std::holds_alternative<EndStops>(e); });
  attached->loads = make_loads(loads);
  if (hand != nullptr) attached->loads.effector.push_back({[hand](V2 p, V2 v) { return hand->force(p, v); }});
  attached->motor_joint = motor_joint;
  for (std::size_t m = 0; m < motor_joint.size(); ++m) {
    Drivetrain d(effects, m, by_event ? &attached->flank[m] : nullptr);
    if (d.empty()) break;  // the effects of a drivetrain are the same for every motor
    attached->drivetrain.push_back(d);
  }
  return attached;
}

/// An engine of event_driven: event_engine.cpp. `attached` by attach(..., true).
template <class Plant>
std::unique_ptr<Engine<Plant>> make_event_engine(const Plant& plant, std::unique_ptr<Attachments> attached,
                                                 const std::vector<Effect>& effects, const Resolution& r,
                                                 const typename Plant::State& initial);

/// An engine of radau5 at fixed steps: event_engine.cpp.
template <class Plant, class Sys>
std::unique_ptr<Engine<Plant>> make_radau_engine(const Plant& plant, std::unique_ptr<Attachments> attached,
                                                 const typename Plant::State& initial);

/// Makes an engine for the effects of a scene: bare where none of them touches the right-hand side. `plant`
/// and `hand` must outlive it. Set-valued effects replace `method` by moreau_jean, if it is not event_driven.
template <class Plant>
std::unique_ptr<Engine<Plant>> make_engine(const Plant& plant, const std::vector<Effect>& effects,
                                           const std::vector<std::size_t>& motor_joint, Method method,
                                           const Resolution& resolution, const typename Plant::State& initial,
                                           const Hand* hand = nullptr) {
  // Fixed steps of a motion without events need nothing of event_driven but its choice of method.
  const bool smooth =
      method == Method::event_driven && !may_have_events(effects) && !(resolution.tolerance > 0.0);
  auto attached = attach(effects, motor_joint, hand, method == Method::event_driven && !smooth);
  if (method == Method::event_driven && !smooth)
    return make_event_engine<Plant>(plant, std::move(attached), effects, resolution, initial);
  const auto with = [&]<class Sys, class Stepper>(auto... more) -> std::unique_ptr<Engine<Plant>> {
    return std::make_unique<EngineOf<Plant, Sys, Stepper>>(plant, std::move(attached), method, initial,
                                                           [&](const Sys& s) { return Stepper(s, more...); });
  };
  if (set_valued(effects) || method == Method::moreau_jean) {
    using Sys = LoadedSystem<Plant>;
    method = Method::moreau_jean;
    return with.template operator()<Sys, MoreauJean<Sys, Plant>>(
        SetValued{find_effect<CoulombFriction>(effects), find_effect<EndStops>(effects)});
  }
  const auto of = [&]<class Sys>() -> std::unique_ptr<Engine<Plant>> {
    if (smooth && resolution.between == Between::midpoint)
      return with.template operator()<Sys, ChainedStages<Sys, 2>>();
    if (smooth && resolution.between == Between::heun3)
      return with.template operator()<Sys, ChainedStages<Sys, 3>>();
    if (smooth) method = *from_name<Method>(name(resolution.between));
    switch (method) {
      case Method::semi_implicit_euler:
        return with.template operator()<Sys, SemiImplicitEuler<Sys>>();
      case Method::dopri5:
        return with.template operator()<Sys, Dopri5<Sys>>();
      case Method::dopri8:
        return with.template operator()<Sys, Dopri8<Sys>>();
      case Method::radau5:
        return make_radau_engine<Plant, Sys>(plant, std::move(attached), initial);
      case Method::rk4:
      case Method::moreau_jean:
      case Method::event_driven:
        break;
    }
    return with.template operator()<Sys, Rk4<Sys>>();
  };
  return attached->none() ? of.template operator()<BareSystem<Plant>>()
                          : of.template operator()<LoadedSystem<Plant>>();
}

}  // namespace esmc::host
