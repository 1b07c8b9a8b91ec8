#include <limits>
#include <memory>
#include <utility>

#include "host_sim/live/loop_parts.hpp"
#include "host_sim/loop/run.hpp"
#include "host_sim/loop/waiting.hpp"

namespace esmc::host {
namespace {

/// As esmc plant --realtime: a torque acts from the part of the tick in which it arrives. The campaign's
/// faulty bus stands between the drives and the real one.
template <class Traits>
class PlantSession final : public PlantOnBus<Traits> {
 public:
  using Base = PlantOnBus<Traits>;

  PlantSession(std::shared_ptr<const Scene> scene, HostBus& real) : Base(std::move(scene)), real_(real) {
    home();
  }
  void tick() override {
    if (part_ == 0.0) {
      this->publish();
      bus_->inject_foreign_frames_after_tick(fault_.foreign());
      update_sample();
    }
    exchange();
    this->advance(period());
    part_ += 1.0 / parts;
    if (part_ < 1.0) return;
    part_ = 0.0;
    this->end_tick();
  }
  [[nodiscard]] double period() const override { return scene_->tick() / parts; }

 private:
  using Base::part_, Base::scene_, Base::bus_, Base::plant_, Base::fault_;
  static constexpr int parts = 4, frames_at_once = 4096;

  void home() {
    this->build(initial_state<Traits>(*scene_), false);
    this->restart_run_time();
    this->diverged_ = false;
  }
  void take(LiveCommand c) override {
    if (c == LiveCommand::stop) return;  // of this program: there is nothing to stop here
    if (c != LiveCommand::home)
      return this->emit("note", "the controller is on the bus and takes its orders elsewhere");
    home();
    this->emit("order", "home: mechanism and drives as when the bench began");
  }
  void take(const SceneOrder& o) override {
    if (o.takes == RestartLevel::nothing) return this->change_effects(o);
    this->emit("note", o.what + ": the controller is on the bus and keeps its scene");
  }
  /// Received frames go to the drives, their frames go out.
  void exchange() {
    hal::CanFrame f;
    for (int n = 0; n < frames_at_once && real_.try_receive(f); ++n) {
      require_same_scene(*scene_, f);
      (void)bus_->try_send(f);
    }
    plant_->deliver(*bus_, this->now() * 1e3);
    bus_->taken();
    while (bus_->try_receive(f)) (void)real_.try_send(f);  // what does not fit is lost, as on any bus
    real_.flush();
    if (is_gone(real_)) throw BusGone();
  }
  void update_sample() {
    const bool armed = plant_->closed_loop(), failed = plant_->failed();
    // The controller has disarmed the drives in order: the next one finds the mechanism at rest.
    if (plant_->released() && !armed && !failed) this->close_brake();
    this->sample_mechanism();
    LiveSample& s = this->sample_;
    s.desired.fill(std::numeric_limits<double>::quiet_NaN());
    s.state = !plant_->released() ? "waiting" : (armed ? "armed" : "disarmed");
    s.fault = failed ? "drive_error" : "none";
    if (s.state == std::exchange(reported_, s.state)) return;
    this->emit(failed ? "fault" : "state", failed ? "drive_error: drives off" : s.state);
  }

  HostBus& real_;
  const char* reported_ = "";
};

}  // namespace

std::unique_ptr<LiveSession> make_live_plant(std::shared_ptr<const Scene> scene, HostBus& bus) {
  if (scene->type == MechanismType::five_bar)
    return std::make_unique<PlantSession<FiveBarTraits>>(std::move(scene), bus);
  return std::make_unique<PlantSession<RrTraits>>(std::move(scene), bus);
}

}  // namespace esmc::host
