#pragma once
/// Drives that say what a test wants, and that note what the cycle asks of them: which axis the cycle looks
/// at, and which it leaves alone, without the frames of a protocol.

#include <array>
#include <cstdint>
#include <cstring>
#include <optional>

#include "firmware/cycle/cycle.hpp"
#include "firmware/cycle/four_motors.hpp"
#include "tests/support/cycle_setup.hpp"
#include "tests/support/fake_bus.hpp"
#include "tests/support/link_bytes.hpp"

namespace esmc::test {

/// One drive under the hand of a test. Identifiers: `id` is its report; a sample comes with it if `samples`.
struct Script {
  std::uint32_t id = 0;
  bool samples = true, ready = true, idle = true, error = false, closed_loop = true, must_be_released = false,
       emergency = false, mismatch = false, suspended = false, sets_up = false;
  std::uint32_t error_code = 0, sample_age = drive::age_max, heartbeat_age = drive::age_max;
  double angle = 0, rate = 0;
  float carries = 1e4F;
  std::optional<float> observed{};
  // what it was asked
  int begun = 0, acknowledged = 0, enabled = 0, disabled = 0, asked_again = 0, torques = 0;
  std::array<bool, 2> known{};
  float torque = 0;
};

/// Every axis that a test has not configured is this one.
inline Script stranger;

class ToldDrive {
 public:
  /// One frame per request, and one per end of a tick.
  struct Line {
    static constexpr std::uint32_t request_id = 0x700, end_id = 0x701;
    template <class Send>
    void request(Send&& send) {
      send(hal::CanFrame{.id = request_id});
    }
    template <class Send>
    void end_tick(Send&& send, bool good) {
      if (good) send(hal::CanFrame{.id = end_id});
    }
  };
  ToldDrive() = default;
  explicit ToldDrive(Script& script) : script_(&script) {}

  void add_filters(hal::IdFilters& filters) const { filters.add({script_->id, 0x7FF, false}); }
  void begin_tick() {
    ++script_->begun;
    if (script_->sample_age != drive::age_max) ++script_->sample_age;
    if (script_->heartbeat_age != drive::age_max) ++script_->heartbeat_age;
  }
  drive::Received receive(const hal::CanFrame& f) {
    if (f.id != script_->id) return drive::Received::not_mine;
    if (f.size == 0) return drive::Received::malformed;
    if (f.remote) return drive::Received::foreign_command;
    script_->heartbeat_age = 0;
    if (script_->samples) script_->sample_age = 0;
    return drive::Received::accepted;
  }
  [[nodiscard]] bool heard_this_tick() const { return script_->heartbeat_age == 0; }
  [[nodiscard]] std::uint32_t sample_age_ticks() const { return script_->sample_age; }
  [[nodiscard]] bool brought_sample() const { return script_->samples; }
  [[nodiscard]] std::uint32_t heartbeat_age_ticks() const { return script_->heartbeat_age; }
  [[nodiscard]] bool ready() const { return script_->ready; }
  [[nodiscard]] bool idle() const { return script_->idle; }
  [[nodiscard]] bool alive() const { return script_->heartbeat_age != drive::age_max; }
  [[nodiscard]] bool error() const { return script_->error; }
  [[nodiscard]] std::uint32_t error_code() const { return script_->error_code; }
  [[nodiscard]] bool closed_loop() const { return script_->closed_loop; }
  [[nodiscard]] bool must_be_released() const { return script_->must_be_released; }
  [[nodiscard]] bool emergency_stopped() const { return script_->emergency; }
  [[nodiscard]] bool config_mismatch() const { return script_->mismatch; }
  [[nodiscard]] bool tx_suspended() const { return script_->suspended; }
  [[nodiscard]] bool setting_up() const { return script_->sets_up; }
  [[nodiscard]] std::optional<float> observed_torque() const { return script_->observed; }
  void know_errors(bool within_age, bool just_now) { script_->known = {within_age, just_now}; }
  void acknowledge() { ++script_->acknowledged; }
  void ask_again() { ++script_->asked_again; }
  template <class Send>
  void enable(Send&&) {
    ++script_->enabled;
  }
  template <class Send>
  void disable(Send&&) {
    ++script_->disabled;
  }
  template <class S>
  [[nodiscard]] bool can_carry(S torque) const {
    return __builtin_fabsf(static_cast<float>(torque)) <= script_->carries;
  }
  template <class S>
  void put_torque(hal::CanFrame& out, S torque) const {
    out.id = 0x500 + script_->id % 0x100;
    out.size = 4;
    ++script_->torques;
    script_->torque = static_cast<float>(torque);
  }
  template <class S>
  [[nodiscard]] drive::JointSample<S> sample() const {
    return {static_cast<S>(script_->angle), static_cast<S>(script_->rate)};
  }

 private:
  Script* script_ = &stranger;
};
static_assert(drive::Drive<ToldDrive>);

inline constexpr std::uint32_t silence_max = 20;  ///< ticks

/// Two base motors; encoders there or on all joints. Axis 0 and, with four axes, 2 have the motors.
struct ToldBench {
  using Five = FiveBar<double>;
  using C = Cycle<Five, ToldDrive>;
  explicit ToldBench(Sensors sensors = Sensors::base, Motors motors = Motors::base) {
    stranger = Script{.id = 0x7FE};
    const auto s = setup<Five>();
    config.controller = s.controller;
    config.controller.sensors = sensors;
    config.controller.motors = motors;
    config.controller.allocate = allocation_for<Five>(motors);
    config.axis_count = sensors == Sensors::all || motors == Motors::all ? 4 : 2;
    config.heartbeat_age_ticks_max = silence_max;
    for (unsigned i = 0; i < axes(); ++i) {
      drive[i].id = 0x100 + i;
      drive[i].angle = s.angle[i * (4 / axes())];
      config.axes[i] = ToldDrive(drive[i]);
    }
  }
  [[nodiscard]] unsigned axes() const { return static_cast<unsigned>(config.axis_count); }
  void build() { cycle.emplace(config); }
  /// A tick in which every drive reports but those that are `quiet`.
  TickResult<Five> tick(Command c = Command::none, bool answer = true) {
    if (!cycle) build();
    for (unsigned i = 0; i < axes(); ++i) {
      if (!quiet[i]) bus.push({.id = drive[i].id, .size = 8});
    }
    bus.clear();
    cycle->receive(bus);
    cycle->command(c);
    const auto r = cycle->tick(bus, answer);
    for (const auto& f : bus.sent()) desk.hear(f);
    return r;
  }
  bool start() {
    tick();
    tick(Command::enable);
    for (int i = 0; i < 5 && state() != State::running; ++i) tick();
    return state() == State::running;
  }
  [[nodiscard]] State state() const { return cycle->supervisor().state(); }
  [[nodiscard]] Fault fault() const { return cycle->supervisor().fault(); }
  [[nodiscard]] int sent(std::uint32_t id) const {
    int n = 0;
    for (const auto& f : bus.sent()) n += f.id == id ? 1 : 0;
    return n;
  }

  C::Config config;
  std::array<Script, 4> drive{};
  std::array<bool, 4> quiet{};
  std::optional<C> cycle;
  TimedBus bus;
  Desk desk;
};

}  // namespace esmc::test
