#include <limits>
#include <memory>

#include "host_sim/live/loop_parts.hpp"
#include "host_sim/live/session.hpp"
#include "host_sim/loop/halves.hpp"
#include "host_sim/record/recorder.hpp"

namespace esmc::host {
namespace {

/// As esmc plant --realtime: a torque acts from the part of the tick in which it arrives. The campaign's wire
/// stands between the drives and the bus.
template <class World_>
class PlantSession final : public LiveSession {
 public:
  using Plant = typename World_::Plant;

  PlantSession(std::shared_ptr<const Scene> scene, HostBus& bus) : scene_(std::move(scene)), bus_(bus) {
    build();
  }

  void order(const LiveOrder& o) override {
    std::visit([&](const auto& x) { take(x); }, o);
  }
  void tick() override;
  [[nodiscard]] const LiveSample& sample() const override { return sample_; }
  [[nodiscard]] std::vector<LiveEvent> take_events() override { return std::exchange(events_, {}); }
  [[nodiscard]] const Scene& scene() const override { return *scene_; }
  [[nodiscard]] bool at_rest() const override { return true; }
  [[nodiscard]] std::string digest() const override { return digest_.text(); }
  [[nodiscard]] std::uint64_t ticks() const override { return ticks_; }
  [[nodiscard]] std::uint64_t run_ticks() const override { return run_ticks_; }
  [[nodiscard]] double period() const override { return scene_->tick() / parts; }

 private:
  static constexpr int parts = 4, frames_at_once = 4096;

  void say(const char* kind, std::string text) { events_.push_back({now(), kind, std::move(text)}); }
  [[nodiscard]] double now() const {
    return (static_cast<double>(ticks_) + static_cast<double>(part_) / parts) * scene_->tick();
  }
  [[nodiscard]] const ProtocolTraits& words() const { return dialect(scene_->drives.protocol); }

  void build() {
    fault_.clear();
    world_ =
        std::make_unique<World<Plant>>(make_motion<World_>(*scene_, initial_state<World_>(*scene_), &hand_),
                                       *scene_, *scene_, fault_.injection(), words(), false);
    wire_ = std::make_unique<FaultyBus>(fault_.injection(), words(), world_->nodes());
    run_ticks_ = 0;
    diverged_ = false;
  }
  void take(std::monostate) {}
  void take(const Hand& h) { hand_ = h; }
  void take(LiveCommand c) {
    if (c == LiveCommand::stop) return;  // of this program: there is nothing to stop here
    if (c != LiveCommand::home)
      return say("note", "the controller is on the bus and takes its orders elsewhere");
    build();
    say("order", "home: mechanism and drives as when the bench began");
  }
  void take(const InjectOrder& o) {
    std::string what = fault_.order(o, words(), *scene_);
    if (!what.empty()) say("order", std::move(what));
  }
  void take(const SceneOrder& o) {
    if (o.takes != RestartLevel::nothing)
      return say("note", o.what + ": the controller is on the bus and keeps its scene");
    world_->go_on(make_motion<World_>(*o.scene, world_->motion().state(), &hand_), *o.scene);
    scene_ = o.scene;
    say("scene", o.what + ": from now on; states of effects begin anew");
  }

  void begin() {
    const bool first = fault_.begin_tick();
    wire_->begin_tick(fault_.active());
    world_->publish(*wire_, fault_.active(), first);
    wire_->inject_foreign_frames();
    wire_->inject_foreign_frames_after_tick(fault_.foreign());
    look();
  }
  /// What has come goes to the drives, what they say goes out.
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
  void look();

  std::shared_ptr<const Scene> scene_;
  HostBus& bus_;
  Hand hand_{.most = 1.0};
  LiveFault fault_;
  std::unique_ptr<World<Plant>> world_;
  std::unique_ptr<FaultyBus> wire_;
  LiveSample sample_;
  std::vector<LiveEvent> events_;
  Digest digest_;
  std::uint64_t ticks_ = 0, run_ticks_ = 0;
  int part_ = 0;
  bool diverged_ = false;
  const char* told_ = "";
};

template <class World_>
void PlantSession<World_>::tick() {
  if (part_ == 0) begin();
  exchange();
  if (world_->released() && !diverged_) {
    const double length = period();
    world_->advance(static_cast<double>(run_ticks_) * scene_->tick() + part_ * length, length);
  }
  if (++part_ < parts) return;
  part_ = 0;
  if (world_->released()) ++run_ticks_;
  ++ticks_;
  fault_.end_tick();
}

template <class World_>
void PlantSession<World_>::look() {
  const bool armed = world_->closed_loop();
  // Let go of in an orderly way: the brake closes, and the next controller finds the mechanism at rest.
  if (world_->released() && !armed && !world_->failed()) {
    auto at = world_->motion().state();
    at.rate = {};
    world_->go_on(make_motion<World_>(*scene_, at, &hand_), *scene_);
    world_->hold();
  }
  if (world_->released()) {
    const typename Plant::Output o = world_->motion().output();
    digest_.add(o.q);
    digest_.add(o.qd);
  }
  LiveSample& s = sample_;
  if (!show_mechanism(s, *world_, hand_) && !std::exchange(diverged_, true)) {
    say("fault", "the simulated state is not finite any more: home");
  }
  s.t = now();
  s.desired.fill(std::numeric_limits<double>::quiet_NaN());
  s.injecting = fault_.active();
  s.state = !world_->released() ? "waiting" : (armed ? "armed" : "disarmed");
  s.fault = world_->failed() ? "drive_error" : "none";
  if (s.state == told_) return;
  told_ = s.state;
  say(world_->failed() ? "fault" : "state",
      world_->failed() ? std::string("drive_error: drives off") : s.state);
}

}  // namespace

std::unique_ptr<LiveSession> make_live_plant(std::shared_ptr<const Scene> scene, HostBus& bus) {
  if (scene->type == MechanismType::five_bar)
    return std::make_unique<PlantSession<FiveBarWorld>>(std::move(scene), bus);
  return std::make_unique<PlantSession<RrWorld>>(std::move(scene), bus);
}

}  // namespace esmc::host
