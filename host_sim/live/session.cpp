#include "host_sim/live/session.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "host_sim/live/loop_parts.hpp"
#include "host_sim/loop/halves.hpp"
#include "host_sim/record/recorder.hpp"

namespace esmc::host {
namespace {

constexpr double none = std::numeric_limits<double>::quiet_NaN();
constexpr int arming_patience_s = 5;

template <class World_>
class Session final : public LiveSession {
 public:
  using Plant = typename World_::Plant;
  using M = typename World_::Mechanism;
  using State_ = typename Plant::State;

  explicit Session(std::shared_ptr<const Scene> scene) : scene_(std::move(scene)) {
    build(initial_state<World_>(*scene_));
    start_ = true;
  }

  void order(const LiveOrder& o) override {
    std::visit([&](const auto& x) { take(x); }, o);
  }
  void tick() override;
  [[nodiscard]] const LiveSample& sample() const override { return sample_; }
  [[nodiscard]] std::vector<LiveEvent> take_events() override { return std::exchange(events_, {}); }
  [[nodiscard]] const Scene& scene() const override { return *scene_; }
  [[nodiscard]] bool at_rest() const override {
    const State s = supervisor().state();
    return !start_ && (s == State::disabled || s == State::fault);
  }
  [[nodiscard]] std::string digest() const override { return digest_.text(); }
  [[nodiscard]] std::uint64_t ticks() const override { return ticks_; }
  [[nodiscard]] std::uint64_t run_ticks() const override { return run_ticks_; }

 private:
  /// Everything that is made of a scene. The members refer to each other in this order.
  struct Bench {
    std::shared_ptr<const Scene> scene;
    const ProtocolTraits& words;
    ReferenceBundle<double> reference;
    AnyCycle<M> cycle;
    World<Plant> world;
    FaultyBus wire;

    Bench(std::shared_ptr<const Scene> s, const State_& at, const Hand& hand, const Injection& injection)
        : scene(std::move(s)),
          words(dialect(scene->drives.protocol)),
          reference(make_reference(*scene, Pacing::lockstep)),
          cycle(make_cycle<M>(*scene, Pacing::lockstep, reference)),
          world(make_motion<World_>(*scene, at, &hand), *scene, *scene, injection, words),
          wire(injection, words, world.nodes()) {}
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
  void say(const char* kind, std::string text) { events_.push_back({now(), kind, std::move(text)}); }
  [[nodiscard]] double now() const { return static_cast<double>(ticks_) * scene_->tick(); }

  /// Drives and controller as after power-up, the mechanism in `at`.
  void build(const State_& at) {
    fault_.clear();
    bench_ = std::make_unique<Bench>(scene_, at, hand_, fault_.injection());
    result_ = {};
    told_ = State::disabled;
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
  void take(const InjectOrder& o);
  void take(const SceneOrder& o);
  void home(const char* why) {
    next_.reset();
    diverged_ = false;
    run_ticks_ = 0;
    digest_ = {};
    build(initial_state<World_>(*scene_));
    start_ = true;
    say("order", why);
  }
  void halt() { command(supervisor().state() == State::enabling ? Command::stop : Command::halt); }

  /// What the operator's wishes mean in the state that the controller is in.
  void steer();
  void control();
  void look();

  std::shared_ptr<const Scene> scene_;
  std::optional<SceneOrder> next_;  ///< waits until the mechanism is at rest
  Hand hand_{.most = 1.0};
  LiveFault fault_;
  std::unique_ptr<Bench> bench_;
  TickResult<M> result_{};
  LiveSample sample_;
  std::vector<LiveEvent> events_;
  Digest digest_;
  std::uint64_t ticks_ = 0, run_ticks_ = 0, armed_since_ = 0;
  bool start_ = false;     ///< enable as soon as possible
  bool diverged_ = false;  ///< the state is not finite: only home helps
  State told_ = State::disabled;
};

template <class World_>
void Session<World_>::take(LiveCommand c) {
  const State s = supervisor().state();
  switch (c) {
    case LiveCommand::home:
      return home("home: everything as when the bench began");
    case LiveCommand::start:
      if (s == State::fault) return say("note", "a fault is latched: reset first");
      start_ = s == State::disabled || s == State::stopping;
      return;
    case LiveCommand::halt:
      start_ = false;
      return halt();
    case LiveCommand::stop:
      start_ = false;
      return command(Command::stop);
    case LiveCommand::reset:
      if (s != State::fault) return say("note", "no fault is latched");
      if (diverged_) return say("note", "the simulated state is not finite: home");
      say("order", "reset");
      command(Command::reset);
      start_ = true;
      return;
  }
}

template <class World_>
void Session<World_>::take(const InjectOrder& o) {
  std::string what = fault_.order(o, bench_->words, *scene_);
  if (!what.empty()) say("order", std::move(what));
}

template <class World_>
void Session<World_>::take(const SceneOrder& o) {
  const State s = supervisor().state();
  if (o.takes == RestartLevel::nothing && !next_) {
    bench_->world.go_on(make_motion<World_>(*o.scene, bench_->world.motion().state(), &hand_), *o.scene);
    scene_ = bench_->scene = o.scene;
    return say("scene", o.what + ": from now on; states of effects begin anew");
  }
  const RestartLevel before = next_ ? next_->takes : RestartLevel::nothing;
  next_ = o;
  next_->takes = std::max(before, o.takes);
  if (s == State::fault) return say("scene", o.what + ": in force after the reset");
  start_ = start_ || s != State::disabled;
  if (s != State::disabled && s != State::stopping) halt();
  say("scene", o.what + (s == State::disabled && !start_ ? ": in force" : ": halt, new controller, start"));
}

template <class World_>
void Session<World_>::steer() {
  const State s = supervisor().state();
  // Held or let down: whoever waits for a rebuild, or for a start, does not wait for that.
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
  steer();
  Bench& b = *bench_;
  const bool first = fault_.begin_tick(), active = fault_.active();
  b.wire.begin_tick(active);
  b.world.publish(b.wire, active, first);
  b.wire.inject_foreign_frames();
  control();
  b.wire.inject_foreign_frames_after_tick(fault_.foreign());
  b.world.deliver(b.wire, now() * 1e3);
  look();
  // A holding brake: closed while the controller is off, open in a fault, as in esmc hil, to show what comes
  // of it.
  const State s = supervisor().state();
  if (b.world.released() && (s == State::stopping || s == State::disabled)) {
    b.world.go_on(make_motion<World_>(*scene_, resting(), &hand_), *scene_);
    b.world.hold();
  }
  if (b.world.released()) {
    if (!diverged_) b.world.advance(static_cast<double>(run_ticks_) * scene_->tick());
    ++run_ticks_;
  }
  ++ticks_;
  fault_.end_tick();
}

template <class World_>
void Session<World_>::look() {
  const World<Plant>& world = bench_->world;
  if (world.released()) {
    const typename Plant::Output o = world.motion().output();
    digest_.add(o.q);
    digest_.add(o.qd);
  }
  LiveSample& s = sample_;
  if (!show_mechanism(s, world, hand_) && !std::exchange(diverged_, true)) {
    say("fault", "the simulated state is not finite any more: home");
  }
  s.t = now();
  s.state = esmc::name(supervisor().state());
  s.fault = esmc::name(supervisor().fault());
  const State state = supervisor().state();
  const bool desires = state == State::running || state == State::halting || state == State::holding;
  s.desired = desires ? std::array{result_.desired_effector.x(), result_.desired_effector.y()}
                      : std::array{none, none};
  s.sliding = {result_.sliding[0], result_.sliding[1]};
  s.saturated = result_.saturated;
  s.injecting = fault_.active();
  if (state == State::enabling &&
      static_cast<double>(ticks_ - armed_since_) * scene_->tick() > arming_patience_s) {
    say("note", fmt::format("the drives did not arm within {} s", arming_patience_s));
    command(Command::stop);
  }
  if (state == told_) return;
  told_ = state;
  if (state == State::fault) {
    say("fault", fmt::format("{}: torque off", s.fault));
  } else if (state == State::halting && supervisor().fault() != Fault::none) {
    say("fault", fmt::format("{}: to rest under control", s.fault));
  } else {
    say("state", s.state);
  }
}

}  // namespace

std::unique_ptr<LiveSession> make_live_session(std::shared_ptr<const Scene> scene) {
  if (scene->type == MechanismType::five_bar)
    return std::make_unique<Session<FiveBarWorld>>(std::move(scene));
  return std::make_unique<Session<RrWorld>>(std::move(scene));
}

}  // namespace esmc::host
