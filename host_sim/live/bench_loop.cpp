#include "host_sim/controller/axes_config.hpp"
#include "host_sim/live/session.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <optional>
#include <utility>

#include "host_sim/live/loop_parts.hpp"
#include "host_sim/loop/loop_scene.hpp"

namespace esmc::host {
namespace {

constexpr double none = std::numeric_limits<double>::quiet_NaN();
constexpr int arming_patience_s = 5;

template <class World_>
class Session final : public SessionParts {
 public:
  using Plant = typename World_::Plant;
  using M = typename World_::Mechanism;
  using State_ = typename Plant::State;

  explicit Session(std::shared_ptr<const Scene> scene) : SessionParts(std::move(scene)) {
    build(initial_state<World_>(*scene_));
    start_ = true;
  }

  void order(const LiveOrder& o) override {
    std::visit([&](const auto& x) { take(x); }, o);
  }
  void tick() override;
  [[nodiscard]] bool at_rest() const override {
    const State s = supervisor().state();
    return !start_ && (s == State::disabled || s == State::fault);
  }

 private:
  /// Everything that is made of a scene. The members refer to each other in this order.
  struct Bench {
    std::shared_ptr<const Scene> scene;
    const ProtocolTraits& traits;
    ReferenceBundle<double> reference;
    AnyCycle<M> cycle;
    FaultyPlant<Plant> world;
    FaultyBus wire;

    Bench(std::shared_ptr<const Scene> s, const State_& at, const Hand& hand, const Injection& injection)
        : scene(std::move(s)),
          traits(dialect(scene->drives.protocol)),
          reference(make_reference(*scene, Pacing::lockstep)),
          cycle(make_cycle<M>(*scene, Pacing::lockstep, reference)),
          world(make_motion<World_>(*scene, at, &hand), *scene, *scene, injection, traits),
          wire(injection, traits, world.nodes()) {}
  };

  template <class F>
  decltype(auto) with(F&& f) {
    return std::visit(std::forward<F>(f), bench_->cycle);
  }
  [[nodiscard]] const Supervisor& supervisor() const {
    return std::visit([](const auto& c) -> const Supervisor& { return c.supervisor(); }, bench_->cycle);
  }
  void command(Command c) {
    with([&](auto& x) { x.command(c); });
  }

  /// Drives and controller as after power-up, the mechanism in `at`.
  void build(const State_& at) {
    fault_.clear();
    bench_ = std::make_unique<Bench>(scene_, at, hand_, fault_.injection());
    result_ = {};
    reported_ = State::disabled;
    armed_since_ = ticks_;
  }
  [[nodiscard]] State_ resting() const {
    State_ s = bench_->world.motion().state();
    s.rate = {};
    return s;
  }

  void take(std::monostate) {}
  void take(const Hand& h) { hand_ = h; }
  void take(LiveCommand c);
  void take(const InjectOrder& o) { inject(o); }
  void take(const SceneOrder& o);
  void home(const char* why) {
    next_.reset();
    diverged_ = false;
    run_ticks_ = 0;
    digest_ = {};
    build(initial_state<World_>(*scene_));
    start_ = true;
    emit("order", why);
  }
  void halt() { command(supervisor().state() == State::enabling ? Command::stop : Command::halt); }

  /// Does what has been ordered and was not possible so far.
  void act_on_orders();
  void control();
  void update_sample();

  std::optional<SceneOrder> next_;  ///< waits until the mechanism is at rest
  std::unique_ptr<Bench> bench_;
  TickResult<M> result_{};
  std::uint64_t armed_since_ = 0;
  bool start_ = false;  ///< enable as soon as possible
  State reported_ = State::disabled;
};

template <class World_>
void Session<World_>::take(LiveCommand c) {
  const State s = supervisor().state();
  switch (c) {
    case LiveCommand::home:
      return home("home: everything as when the bench began");
    case LiveCommand::start:
      if (s == State::fault) return emit("note", "a fault is latched: reset first");
      start_ = s == State::disabled || s == State::stopping;
      return;
    case LiveCommand::halt:
      start_ = false;
      return halt();
    case LiveCommand::stop:
      start_ = false;
      return command(Command::stop);
    case LiveCommand::reset:
      if (s != State::fault) return emit("note", "no fault is latched");
      if (diverged_) return emit("note", "the simulated state is not finite: home");
      emit("order", "reset");
      command(Command::reset);
      start_ = true;
      return;
  }
}

template <class World_>
void Session<World_>::take(const SceneOrder& o) {
  const State s = supervisor().state();
  if (o.takes == RestartLevel::nothing && !next_) {
    bench_->world.set_motion(make_motion<World_>(*o.scene, bench_->world.motion().state(), &hand_), *o.scene);
    scene_ = bench_->scene = o.scene;
    return emit("scene", o.what + ": from now on; states of effects begin anew");
  }
  const RestartLevel before = next_ ? next_->takes : RestartLevel::nothing;
  next_ = o;
  next_->takes = std::max(before, o.takes);
  if (s == State::fault) return emit("scene", o.what + ": in force after the reset");
  start_ = start_ || s != State::disabled;
  if (s != State::disabled && s != State::stopping) halt();
  emit("scene", o.what + (s == State::disabled && !start_ ? ": in force" : ": halt, new controller, start"));
}

template <class World_>
void Session<World_>::act_on_orders() {
  const State s = supervisor().state();
  // A rebuild or a start does not wait until a mechanism that is held or lowered is at rest.
  if ((next_ || start_) && (s == State::holding || s == State::lowering)) command(Command::stop);
  if (s != State::disabled) return;
  if (next_) {
    scene_ = next_->scene;
    build(next_->takes == RestartLevel::home ? initial_state<World_>(*scene_) : resting());
    next_.reset();
  }
  if (std::exchange(start_, false)) {
    armed_since_ = ticks_;
    command(Command::enable);
  }
}

template <class World_>
void Session<World_>::control() {
  if (fault_.kind() == Injected::controller_death || fault_.kind() == Injected::controller_late) return;
  with([&](auto& c) {
    c.receive(bench_->wire);
    c.enable_input(fault_.kind() != Injected::enable_open);
    result_ = c.tick(bench_->wire);
    c.request(bench_->wire);
  });
}

template <class World_>
void Session<World_>::tick() {
  act_on_orders();
  Bench& b = *bench_;
  const bool first = fault_.begin_tick(), active = fault_.active();
  b.wire.begin_tick(active);
  b.world.publish(b.wire, active, first);
  b.wire.inject_foreign_frames();
  control();
  b.wire.inject_foreign_frames_after_tick(fault_.foreign());
  b.world.deliver(b.wire, now() * 1e3);
  update_sample();
  // A holding brake: closed while the controller is off; open in a fault, as in esmc hil, to show the fall.
  const State s = supervisor().state();
  if (b.world.released() && (s == State::stopping || s == State::disabled)) {
    b.world.set_motion(make_motion<World_>(*scene_, resting(), &hand_), *scene_);
    b.world.close_brake();
  }
  if (b.world.released()) {
    if (!diverged_) b.world.advance(static_cast<double>(run_ticks_) * scene_->tick());
    ++run_ticks_;
  }
  ++ticks_;
  fault_.end_tick();
}

template <class World_>
void Session<World_>::update_sample() {
  sample_mechanism(bench_->world);
  LiveSample& s = sample_;
  s.state = esmc::name(supervisor().state());
  s.fault = esmc::name(supervisor().fault());
  const State state = supervisor().state();
  const bool desires = state == State::running || state == State::halting || state == State::holding;
  s.desired = desires ? std::array{result_.desired_effector.x(), result_.desired_effector.y()}
                      : std::array{none, none};
  s.sliding = {result_.sliding[0], result_.sliding[1]};
  s.saturated = result_.saturated;
  if (state == State::enabling &&
      static_cast<double>(ticks_ - armed_since_) * scene_->tick() > arming_patience_s) {
    emit("note", fmt::format("the drives did not arm within {} s", arming_patience_s));
    command(Command::stop);
  }
  if (state == reported_) return;
  reported_ = state;
  if (state == State::fault) {
    emit("fault", fmt::format("{}: torque off", s.fault));
  } else if (state == State::halting && supervisor().fault() != Fault::none) {
    emit("fault", fmt::format("{}: to rest under control", s.fault));
  } else {
    emit("state", s.state);
  }
}

}  // namespace

std::unique_ptr<LiveSession> make_live_session(std::shared_ptr<const Scene> scene) {
  if (scene->type == MechanismType::five_bar)
    return std::make_unique<Session<FiveBarWorld>>(std::move(scene));
  return std::make_unique<Session<RrWorld>>(std::move(scene));
}

}  // namespace esmc::host
