#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <optional>
#include <utility>

#include "host_sim/controller/axes_config.hpp"
#include "host_sim/live/loop_parts.hpp"

namespace esmc::host {
namespace {

constexpr double none = std::numeric_limits<double>::quiet_NaN();
constexpr int arming_patience_s = 5;

template <class Traits>
class Session final : public PlantOnBus<Traits> {
 public:
  using Base = PlantOnBus<Traits>;
  using M = typename Traits::Mechanism;

  explicit Session(std::shared_ptr<const Scene> scene) : Base(std::move(scene)) {
    build(initial_state<Traits>(*scene_));
    start_ = true;
  }
  void tick() override {
    act_on_orders();
    this->publish();
    control();
    bus_->inject_foreign_frames_after_tick(fault_.foreign());
    plant_->deliver(*bus_, this->now() * 1e3);
    update_sample();
    // A holding brake: closed while the controller is off; open in a fault, as in esmc hil, to show the fall.
    const State s = supervisor().state();
    if (plant_->released() && (s == State::stopping || s == State::disabled)) this->close_brake();
    this->advance(scene_->tick());
    this->end_tick();
  }
  [[nodiscard]] bool at_rest() const override {
    const State s = supervisor().state();
    return !start_ && (s == State::disabled || s == State::fault);
  }

 private:
  using Base::scene_, Base::bus_, Base::plant_, Base::fault_, Base::ticks_, Base::emit;

  /// Reference and cycle, which refers to it.
  struct ControllerEnd {
    ReferenceBundle<double> reference;
    AnyCycle<M> cycle;
    explicit ControllerEnd(const Scene& scene)
        : reference(make_reference(scene, Pacing::lockstep)),
          cycle(make_cycle<M>(scene, Pacing::lockstep, reference)) {}
  };

  [[nodiscard]] const Supervisor& supervisor() const {
    return std::visit([](const auto& c) -> const Supervisor& { return c.supervisor(); }, controller_->cycle);
  }
  void command(Command c) {
    std::visit([&](auto& x) { x.command(c); }, controller_->cycle);
  }

  /// Drives and controller as after power-up, the mechanism in `at`.
  void build(const typename Base::PlantState& at) {
    Base::build(at, true);
    controller_ = std::make_unique<ControllerEnd>(*scene_);
    result_ = {};
    reported_ = State::disabled;
    armed_since_ = ticks_;
  }
  void take(LiveCommand c) override {
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
        if (this->diverged_) return emit("note", "the simulated state is not finite: home");
        emit("order", "reset");
        command(Command::reset);
        start_ = true;
        return;
    }
  }
  void take(const SceneOrder& o) override {
    const State s = supervisor().state();
    if (o.takes == RestartLevel::nothing && !next_) return this->change_effects(o);
    const RestartLevel before = next_ ? next_->takes : RestartLevel::nothing;
    next_ = o;
    next_->takes = std::max(before, o.takes);
    if (s == State::fault) return emit("scene", o.what + ": in force after the reset");
    start_ = start_ || s != State::disabled;
    if (s != State::disabled && s != State::stopping) halt();
    emit("scene",
         o.what + (s == State::disabled && !start_ ? ": in force" : ": halt, new controller, start"));
  }
  void home(const char* why) {
    if (next_) this->use(next_->scene);
    next_.reset();
    this->diverged_ = false;
    this->restart_run_time();
    this->digest_ = {};
    build(initial_state<Traits>(*scene_));
    start_ = true;
    emit("order", why);
  }
  void halt() { command(supervisor().state() == State::enabling ? Command::stop : Command::halt); }

  /// Does what has been ordered and was not possible so far.
  void act_on_orders() {
    const State s = supervisor().state();
    // A rebuild or a start does not wait until a mechanism that is held or lowered is at rest.
    if ((next_ || start_) && (s == State::holding || s == State::lowering)) command(Command::stop);
    if (s != State::disabled) return;
    if (next_) {
      this->use(next_->scene);
      build(next_->takes == RestartLevel::home ? initial_state<Traits>(*scene_) : this->resting());
      next_.reset();
    }
    if (std::exchange(start_, false)) {
      armed_since_ = ticks_;
      command(Command::enable);
    }
  }
  void control() {
    if (fault_.kind() == Injected::controller_death || fault_.kind() == Injected::controller_late) return;
    const auto tick = [&](auto& c) {
      c.receive(*bus_);
      c.enable_input(fault_.kind() != Injected::enable_open);
      result_ = c.tick(*bus_);
      c.request(*bus_);
    };
    std::visit(tick, controller_->cycle);
  }
  void update_sample() {
    this->sample_mechanism();
    LiveSample& s = this->sample_;
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

  std::optional<SceneOrder> next_;  ///< waits until the mechanism is at rest
  std::unique_ptr<ControllerEnd> controller_;
  TickResult<M> result_{};
  std::uint64_t armed_since_ = 0;
  bool start_ = false;  ///< enable as soon as possible
  State reported_ = State::disabled;
};

}  // namespace

std::unique_ptr<LiveSession> make_live_session(std::shared_ptr<const Scene> scene) {
  if (scene->type == MechanismType::five_bar)
    return std::make_unique<Session<FiveBarTraits>>(std::move(scene));
  return std::make_unique<Session<RrTraits>>(std::move(scene));
}

}  // namespace esmc::host
