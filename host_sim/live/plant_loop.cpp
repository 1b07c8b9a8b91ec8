#include <limits>
#include <memory>

#include "host_sim/live/loop_parts.hpp"
#include "host_sim/live/session.hpp"
#include "host_sim/loop/loop_scene.hpp"
#include "host_sim/loop/waiting.hpp"

namespace esmc::host {
namespace {

/// As esmc plant --realtime: a torque acts from the part of the tick in which it arrives. The campaign's
/// faulty bus stands between the drives and the real one.
template <class World_>
class PlantSession final : public SessionParts {
 public:
  using Plant = typename World_::Plant;

  PlantSession(std::shared_ptr<const Scene> scene, HostBus& bus) : SessionParts(std::move(scene)), bus_(bus) {
    build();
  }

  void order(const LiveOrder& o) override {
    std::visit([&](const auto& x) { take(x); }, o);
  }
  void tick() override;
  [[nodiscard]] bool at_rest() const override { return true; }
  [[nodiscard]] double period() const override { return scene_->tick() / parts; }

 private:
  static constexpr int parts = 4, frames_at_once = 4096;

  void build() {
    fault_.clear();
    world_ = std::make_unique<FaultyPlant<Plant>>(
        make_motion<World_>(*scene_, initial_state<World_>(*scene_), &hand_), *scene_, *scene_,
        fault_.injection(), traits(), false);
    wire_ = std::make_unique<FaultyBus>(fault_.injection(), traits(), world_->nodes());
    run_ticks_ = 0;
    diverged_ = false;
  }
  void take(std::monostate) {}
  void take(const Hand& h) { hand_ = h; }
  void take(LiveCommand c) {
    if (c == LiveCommand::stop) return;  // of this program: there is nothing to stop here
    if (c != LiveCommand::home)
      return emit("note", "the controller is on the bus and takes its orders elsewhere");
    build();
    emit("order", "home: mechanism and drives as when the bench began");
  }
  void take(const InjectOrder& o) { inject(o); }
  void take(const SceneOrder& o) {
    if (o.takes != RestartLevel::nothing)
      return emit("note", o.what + ": the controller is on the bus and keeps its scene");
    world_->set_motion(make_motion<World_>(*o.scene, world_->motion().state(), &hand_), *o.scene);
    scene_ = o.scene;
    emit("scene", o.what + ": from now on; states of effects begin anew");
  }

  void begin() {
    const bool first = fault_.begin_tick();
    wire_->begin_tick(fault_.active());
    world_->publish(*wire_, fault_.active(), first);
    wire_->inject_foreign_frames();
    wire_->inject_foreign_frames_after_tick(fault_.foreign());
    update_sample();
  }
  /// Received frames go to the drives, their frames go out.
  void exchange() {
    hal::CanFrame f;
    for (int n = 0; n < frames_at_once && bus_.try_receive(f); ++n) {
      require_same_scene(*scene_, f);
      (void)wire_->try_send(f);
    }
    world_->deliver(*wire_, now() * 1e3);
    wire_->taken();
    while (wire_->try_receive(f)) (void)bus_.try_send(f);  // what does not fit is lost, as on any bus
    bus_.flush();
    if (is_gone(bus_)) throw RunError(gone_text);
  }
  void update_sample();

  HostBus& bus_;
  std::unique_ptr<FaultyPlant<Plant>> world_;
  std::unique_ptr<FaultyBus> wire_;
  const char* reported_ = "";
};

template <class World_>
void PlantSession<World_>::tick() {
  if (part_ == 0.0) begin();
  exchange();
  if (world_->released() && !diverged_)
    world_->advance(static_cast<double>(run_ticks_) * scene_->tick() + part_ * scene_->tick(), period());
  part_ += 1.0 / parts;
  if (part_ < 1.0) return;
  part_ = 0.0;
  if (world_->released()) ++run_ticks_;
  ++ticks_;
  fault_.end_tick();
}

template <class World_>
void PlantSession<World_>::update_sample() {
  const bool armed = world_->closed_loop();
  // Let go of in an orderly way: the brake closes, and the next controller finds the mechanism at rest.
  if (world_->released() && !armed && !world_->failed()) {
    auto at = world_->motion().state();
    at.rate = {};
    world_->set_motion(make_motion<World_>(*scene_, at, &hand_), *scene_);
    world_->close_brake();
  }
  sample_mechanism(*world_);
  LiveSample& s = sample_;
  s.desired.fill(std::numeric_limits<double>::quiet_NaN());
  s.state = !world_->released() ? "waiting" : (armed ? "armed" : "disarmed");
  s.fault = world_->failed() ? "drive_error" : "none";
  if (s.state == reported_) return;
  reported_ = s.state;
  emit(world_->failed() ? "fault" : "state",
       world_->failed() ? std::string("drive_error: drives off") : s.state);
}

}  // namespace

std::unique_ptr<LiveSession> make_live_plant(std::shared_ptr<const Scene> scene, HostBus& bus) {
  if (scene->type == MechanismType::five_bar)
    return std::make_unique<PlantSession<FiveBarWorld>>(std::move(scene), bus);
  return std::make_unique<PlantSession<RrWorld>>(std::move(scene), bus);
}

}  // namespace esmc::host
