#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>

#include "host_sim/campaign/faulty_plant.hpp"
#include "host_sim/live/session.hpp"
#include "host_sim/record/recorder.hpp"

namespace esmc::host {

/// A session with its mechanism and drives behind a faulty bus, wherever the controller is.
template <class Traits>
class PlantOnBus : public LiveSession {
 protected:
  using Plant = typename Traits::Plant;
  using PlantState = typename Plant::State;
  using LiveSession::LiveSession;

  /// Drives as after power-up, the mechanism in `at`.
  void build(const PlantState& at, bool lockstep) {
    fault_ = {};
    plant_ = std::make_unique<FaultyPlant<Plant>>(make_motion<Traits>(*scene_, at, &hand_), *scene_, *scene_,
                                                  fault_.injection(), traits(), lockstep);
    bus_ = std::make_unique<FaultyBus>(fault_.injection(), traits(), plant_->nodes());
  }
  [[nodiscard]] PlantState resting() const {
    PlantState at = plant_->motion().state();
    at.rate = {};
    return at;
  }
  /// The brake closes; the mechanism is at rest under it.
  void close_brake() {
    plant_->set_motion(make_motion<Traits>(*scene_, resting(), &hand_), *scene_);
    plant_->close_brake();
  }
  /// The mechanism goes on with other effects.
  void change_effects(const SceneOrder& o) {
    plant_->set_motion(make_motion<Traits>(*o.scene, plant_->motion().state(), &hand_), *o.scene);
    use(o.scene);
    emit("scene", o.what + ": from now on; states of effects begin anew");
  }
  /// The drives' reports and the frames of other nodes.
  void publish() {
    const bool first = fault_.begin_tick();
    bus_->begin_tick(fault_.active());
    plant_->publish(*bus_, fault_.active(), first);
    bus_->inject_foreign_frames();
  }
  /// Moves the mechanism over `seconds` from the part of the tick that has begun.
  void advance(double seconds) {
    if (plant_->released() && !diverged_) plant_->advance(run_time() + part_ * scene_->tick(), seconds);
  }
  void end_tick() {
    if (plant_->released()) ++run_ticks_;
    ++ticks_;
    fault_.end_tick();
  }
  /// Mechanism, drives, hand and fault into sample and digest.
  void sample_mechanism() {
    const typename Plant::Output o = plant_->motion().output();
    if (plant_->released()) {
      digest_.add(o.q);
      digest_.add(o.qd);
    }
    LiveSample& s = sample_;
    std::copy(o.q.begin(), o.q.end(), s.q.begin());
    s.effector = {o.effector.x, o.effector.y};
    for (std::size_t i = 0; i < plant_->motors(); ++i) s.torque[i] = plant_->motor(i).torque;
    const V2 f = hand_.force(o.effector, o.effector_rate);
    s.force = {f.x, f.y};
    s.anchor = {hand_.anchor.x, hand_.anchor.y};
    s.holding = hand_.holding;
    s.brake = !plant_->released();
    s.t = now();
    s.injecting = fault_.active() ? fault_.injection().row->name : std::string_view();
    if (!std::ranges::all_of(o.q, [](double v) { return std::isfinite(v); }) &&
        !std::exchange(diverged_, true)) {
      emit("fault", "the simulated state is not finite any more: home");
    }
  }

  std::unique_ptr<FaultyPlant<Plant>> plant_;
  std::unique_ptr<FaultyBus> bus_;
};

}  // namespace esmc::host
