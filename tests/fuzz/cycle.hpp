#pragma once
/// The whole cycle: drives made of bytes that obey, a supervisor computer, and in every tick what the input does to them:
/// frames of any kind, silence, floods, ages, a bus that refuses, pins, commands. What leaves is read with the
/// tests' own layouts and judged by the table of states of docs/safety.md, written out below.

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <vector>

#include "firmware/cycle/cycle.hpp"
#include "firmware/cycle/part_four_motors.hpp"
#include "tests/fuzz/bytes.hpp"
#include "tests/support/cycle_setup.hpp"
#include "tests/support/link_bytes.hpp"

namespace esmc::fuzz {

using test::Desk;

/// What a protocol has to say. Kind of a frame that goes to a drive, and the torque in it.
struct Said {
  enum class Kind { torque, enabling, releasing, line, unknown } kind = Kind::unknown;
  std::size_t axis = 0;
  double shaft = 0;  ///< N m
};

/// Which states there are torques in; and which state may follow which from one tick's end to the next.
inline bool has_torque(State s) {
  return s == State::testing || s == State::running || s == State::halting || s == State::holding || s == State::lowering;
}
inline bool may_follow(State before, State after, bool enabled, bool reset) {
  if (before == after) return true;
  switch (after) {
    case State::disabled: return before == State::stopping || (before == State::fault && reset);
    case State::enabling: return before == State::disabled && enabled;
    case State::testing: return before == State::enabling;
    case State::running: return before == State::enabling || before == State::testing;
    case State::halting: return before == State::running || before == State::enabling || before == State::testing;
    case State::holding:
    case State::lowering: return before == State::halting;
    case State::stopping: return before != State::disabled && before != State::fault;
    case State::fault: return before != State::disabled || enabled;
  }
  return false;
}

template <class M, class P>
class CycleRun {
 public:
  using S = typename M::Scalar;
  using Axis = typename P::Axis;
  static constexpr std::size_t joints = static_cast<std::size_t>(M::joints);

  static constexpr unsigned choices = 12;
  explicit CycleRun(unsigned choice) : setup_(chosen(choice)), axes_(all() ? joints : 2), cycle_(config(choice)) {
    for (std::size_t i = 0; i < axes_; ++i) drives_[i] = P::drive(i, choice);
    angle_ = setup_.angle;
    desk_.session = 77;
  }

  /// Enabled and under torque. CiA 402 drives are heard only once they were enabled, so their zero takes two attempts.
  void start() {
    for (int i = 0; i < 300 && !has_torque(cycle_.supervisor().state()); ++i) {
      const State state = cycle_.supervisor().state();
      const bool unconfirmed = cycle_.supervisor().fault() == Fault::zero_not_confirmed;
      command_ = state == State::disabled      ? (i % 4 == 3 ? Command::enable : Command::confirm_zero)
                 : state == State::fault && unconfirmed ? Command::reset
                                                        : Command::none;
      speak(0);
      end(true);
    }
    require(has_torque(cycle_.supervisor().state()), "obedient drives bring it to torque");
  }

  void go(Bytes& in) {
    for (int ticks = 0; !in.empty() && ticks < ticks_max; ++ticks) {
      const unsigned what = in.u8();
      if ((what & 0x80U) != 0) disturb(in);
      speak(what & 0x07U);
      for (unsigned n = (what >> 3U) & 3U; n > 0; --n) inject(in);
      if ((what & 0x20U) != 0) command(in);
      if ((what & 0x40U) != 0) move(in);
      end((what & 0x98U) != 0x98U);
    }
  }

 private:
  static constexpr int ticks_max = 60;
  static constexpr unsigned link_base = 0x780;

  // ---- configurations ----------------------------------------------------------------------------------------------

  static test::Setup<M> chosen(unsigned choice) {
    auto s = test::setup<M>();
    auto& c = s.controller;
    c.halt_ticks = choice % 2 != 0 ? 3 : 0;
    c.after_halt = choice % 3 == 0 ? AfterHalt::hold : choice % 3 == 1 ? AfterHalt::lower : AfterHalt::release;
    c.lower_ticks = 4;
    c.join_ticks = choice % 4 == 1 ? 500 : 0;
    c.ramp_ticks = choice % 4 == 2 ? 5 : 0;
    c.law = static_cast<LawKind>(choice % 5);
    c.reaching = static_cast<Reaching>(choice * 5 / 4 % 4);
    if (choice == 0) c.reference.kind = ReferenceKind::hold_start;
    if (choice == 3) {  // up and down on a straight line
      static const std::array<PathSegment<S>, 2> way{segment(0, c.reference.centre, S(0.02F)), segment(40, c.reference.centre, S(-0.02F))};
      c.reference.kind = ReferenceKind::path;
      c.reference.path = way;
    }
    c.torque_lead = choice % 4 == 3 ? S(1e-3F) : S(0);
    if (choice % 4 == 3) c.limits.feedback_jump = S(0.1F);
    if (choice == 5 || choice == 11) c.sign_test_move = S(1e-3F);
    if (choice == 7) {  // no limit but the torque's: everything that can overflow does
      c.limits.joint_speed = std::numeric_limits<S>::max();
      c.limits.joint_angle = {};
      c.limits.workspace_x = c.limits.workspace_y = {};
      c.limits.min_abs_sin_type1 = S(0);
      c.reaching = Reaching::sign;
      c.gains.k.setConstant(S(1e30F));
    }
    if (choice >= 8 && joints == 4) {
      c.sensors = Sensors::all;
      if (choice >= 10 || !P::passive_encoders) c.motors = Motors::all;
      c.allocate = allocation_for<M>(c.motors);
    }
    return s;
  }
  static PathSegment<S> segment(std::uint32_t start, const Vec2<S>& from, S far) {
    const Vec2<S> still = Vec2<S>::Zero();
    return {start, S(0), Quintic<S>::between({from, still, still}, {from + Vec2<S>(S(0), far), still, still}, S(0.04F))};
  }
  [[nodiscard]] bool all() const {
    return setup_.controller.motors == Motors::all || setup_.controller.sensors == Sensors::all;
  }
  typename Cycle<M, Axis>::Config config(unsigned choice) const {
    typename Cycle<M, Axis>::Config c;
    c.controller = setup_.controller;
    for (std::size_t i = 0; i < axes_; ++i) c.axes[i] = P::axis(i, choice);
    c.line = P::line();
    c.axis_count = static_cast<int>(axes_);
    c.heartbeat_age_ticks_max = 6;
    c.samples_timed = choice % 2 == 0;
    c.zero_absolute = choice != 6;
    for (std::size_t j = 0; j < joints; ++j) c.zero_pose[static_cast<int>(j)] = static_cast<S>(setup_.angle[j]);
    c.torque_mismatch = choice % 5 == 4 ? S(0.5F) : S(0);
    c.torque_time = S(2e-3F);
    if (choice % 3 != 2) c.link = link_config(choice);
    return c;
  }
  static link::LinkConfig link_config(unsigned choice) {
    using link::Bounds;
    link::LinkConfig c;
    c.base_id = link_base;
    c.session = 77;
    c.counter_jump_max = 2;
    c.command_age_ticks_max = 50;
    c.status_ticks = 2;
    c.telemetry_ticks = 9;
    c.period_ns = 1'000'000;
    c.source = choice % 2 == 0 ? link::Source::stream : link::Source::reference;
    c.space = joints == 4 ? link::Space::effector : link::Space::base_joints;
    c.position = {Bounds{-3.0F, 3.0F}, Bounds{-3.0F, 3.0F}};
    c.parameters = link::Parameters({20, 20, 8, 8, 1e-3F, 2, 2, 50, 1.0F, 10.0F, 3, choice == 4 ? 20.0F : 0.0F},
                                    {Bounds{1, 80}, Bounds{1, 80}, Bounds{0, 200}, Bounds{0, 200}});
    return c;
  }

  // ---- what comes in -----------------------------------------------------------------------------------------------

  [[nodiscard]] std::size_t joint_of(std::size_t axis) const { return axis * (joints / axes_); }
  void push(const hal::CanFrame& f) {
    silent_ = false;
    if (f.id == link_base && f.size >= 3) {
      ordered_enable_ = ordered_enable_ || f.data[2] == Desk::arm;
      ordered_reset_ = ordered_reset_ || f.data[2] == Desk::reset;
    }
    if (P::is_torque_command(f)) impostor_ = true;
    bus_.waiting.push_back(f);
  }
  /// The frames of a tick. `without`: bit 0, 1: first or second axis says nothing; bit 2: no heartbeats.
  void speak(unsigned without) {
    for (std::size_t i = 0; i < axes_; ++i) {
      if (i < 2 && ((without >> i) & 1U) != 0) continue;
      const auto& m = P::mountings[i];
      const double shaft = m.direction * m.gear;
      drives_[i].speak((angle_[joint_of(i)] - m.offset) * shaft, rate_[joint_of(i)] * shaft, (without & 4U) == 0,
                       [&](const hal::CanFrame& f) { push(f); });
    }
  }
  void inject(Bytes& in) {
    switch (in.below(8)) {
      case 0: push(in.frame()); break;
      case 1: push(P::addressed(in)); break;
      case 2: push(in.frame(link_base + in.below(32))); break;
      case 3: {
        hal::CanFrame f = in.frame(link_base + in.below(6));
        const unsigned message = f.id - link_base;
        desk_.counter[message] = (desk_.counter[message] + 1) & 15;
        f.data[1] = static_cast<std::uint8_t>((f.data[1] & 0xF0U) | desk_.counter[message]);
        push(desk_.seal(f, in.below(8) == 7 ? 0U : desk_.session));
        break;
      }
      case 4: push(desk_.order(in.below(9))); break;
      case 5: {
        const auto x = static_cast<std::int16_t>(in.u16()), y = static_cast<std::int16_t>(in.u16());
        push(desk_.pair(in.yes() ? Desk::point : Desk::position, x * 64, y * 64, joints == 4 ? 0 : 1));
        push(desk_.pair(Desk::velocity, x * 4, y * 4, joints == 4 ? 0 : 1));
        break;
      }
      case 6: {
        const std::size_t i = in.below(static_cast<unsigned>(axes_));
        drives_[i].defect(in, [&](const hal::CanFrame& f) { push(f); });
        break;
      }
      default: {
        const hal::CanFrame f = in.frame();
        for (unsigned n = in.u8() * 8U; n > 0; --n) push(f);
        break;
      }
    }
  }
  void command(Bytes& in) {
    const auto c = static_cast<Command>(in.below(6));
    command_ = c;
  }
  void move(Bytes& in) {
    const std::size_t i = in.below(static_cast<unsigned>(joints));
    if (in.yes()) {
      angle_[i] += static_cast<std::int8_t>(in.u8()) * 1e-3;
      rate_[i] = static_cast<std::int8_t>(in.u8()) * 0.01;
    } else {
      angle_[i] = static_cast<double>(in.f32());
      rate_[i] = static_cast<double>(in.f32());
    }
  }
  void disturb(Bytes& in) {
    switch (in.below(8)) {
      case 0: bus_.status = static_cast<hal::SendStatus>(in.below(4)); break;
      case 1: bus_.age_us = in.u32(); break;
      case 2: cycle_.enable_input(closed_ = in.yes()); break;
      case 3: cycle_.ask_again(); break;
      case 4: in.yes() ? cycle_.request(bus_) : cycle_.tick_late(); break;
      case 5: in.yes() ? cycle_.receive(bus_) : void(yields_ = static_cast<std::int8_t>(in.u8()) * 0.02); break;
      case 6:
        if (!bus_.unread().empty()) impostor_ = false;  // it may never have been heard
        bus_ = {};
        rate_ = {};
        angle_ = setup_.angle;
        cycle_.enable_input(closed_ = true);
        break;
      default: obey_ = in.yes(); break;
    }
  }

  // ---- a tick, and what must be true of it ---------------------------------------------------------------------------

  void end(bool answer) {
    const State before = cycle_.supervisor().state();
    const Fault fault_before = cycle_.supervisor().fault();
    const bool drive_enable_before = cycle_.drive_enable();
    cycle_.receive(bus_);
    if (command_ != Command::none) cycle_.command(command_);
    asked_enable_ = ordered_enable_ || command_ == Command::enable || (kept_ == Command::enable);
    asked_reset_ = ordered_reset_ || command_ == Command::reset;
    command_ = Command::none;
    kept_ = Command::none;
    bus_.clear();
    const TickResult<M> r = cycle_.tick(bus_, answer);
    for (std::size_t j = 0; j < joints && r.state == State::testing; ++j) {  // joints give way to a torque, or turn against it
      rate_[j] += static_cast<double>(r.torque[static_cast<int>(j)]) * yields_;
      angle_[j] += rate_[j] * 1e-3;
    }
    require(drive_enable_before == (before != State::disabled && before != State::fault), "drive_enable as the table has it");
    judge(r, before, fault_before, answer);
    for (const auto& f : bus_.sent) {
      desk_.hear(f);
      for (std::size_t i = 0; i < axes_ && obey_; ++i) drives_[i].hear(f);
    }
    desk_.heard.clear();
    if (bus_.waiting.empty()) {  // else a flood: the rest comes in the next ticks
      silent_ = true;
      ordered_enable_ = ordered_reset_ = false;
    }
    impostor_ = std::ranges::any_of(bus_.unread(), P::is_torque_command);
    refused_off_ = bus_.refused && bus_.status == hal::SendStatus::bus_off;
  }

  void judge(const TickResult<M>& r, State before, Fault fault_before, bool answer) {
    const Supervisor& s = cycle_.supervisor();
    require(r.state == s.state() && r.fault == s.fault(), "the result says what the supervisor says");
    const bool allowed = may_follow(before, r.state, asked_enable_, asked_reset_);
    if (!allowed) std::fprintf(stderr, "%s -> %s (%s)\n", name(before), name(r.state), name(r.fault));
    require(allowed, "a transition that the table has");
    if (r.state == State::fault) require(r.fault != Fault::none, "a fault has a name");
    if (before == State::fault && r.state == State::fault) require(r.fault == fault_before, "the first fault keeps its name");
    if (before == State::fault && !asked_reset_) require(r.state == State::fault, "a fault stays until the operator's reset");
    if (fault_before != Fault::none && r.fault == Fault::none) require(asked_reset_ && r.state == State::disabled, "faults are cleared by reset only");
    require(cycle_.good(), "every tick is a good one, or memory is broken");
    require(cycle_.release_brake() == has_torque(r.state), "the brake is open under torque only");
    require(cycle_.drive_enable() == (r.state != State::disabled && r.state != State::fault), "drive_enable as the table has it");
    if (!has_torque(r.state)) require(r.torque.isZero(0), "no torque in this state");

    const bool off = r.state == State::fault || r.state == State::disabled;
    if (!closed_) require(off, "an open enable input ends it at once");
    if (refused_off_) require(off, "a bus that was left ends it in the next tick");
    if (impostor_) require(off, "so does somebody else's torque");
    quiet_ticks_ = silent_ ? quiet_ticks_ + 1 : 0;
    if (quiet_ticks_ > 2) require(!has_torque(r.state), "no torque without samples");
    frames(r, answer);
  }

  void frames(const TickResult<M>& r, bool answer) {
    std::array<int, joints> torques{};
    for (const auto& f : bus_.sent) {
      if (f.id >= link_base && f.id < link_base + 32) {
        require(f.id >= link_base + 16 && f.size == 8, "telemetry only");
        continue;
      }
      const Said said = P::read(f, axes_);
      switch (said.kind) {
        case Said::Kind::torque: torque(r, said, ++torques[said.axis]); break;
        case Said::Kind::enabling: require(r.state == State::enabling, "drives are enabled while enabling only"); break;
        case Said::Kind::releasing: require(!has_torque(r.state), "drives are not released under torque"); break;
        case Said::Kind::line: break;
        case Said::Kind::unknown: require(false, "a frame that the controller does not send");
      }
    }
    for (std::size_t i = 0; i < axes_; ++i) {
      const std::size_t motor = motor_of(i);
      const bool wanted = answer && motor < 4 && bus_.status == hal::SendStatus::ok && !cycle_.axis(static_cast<int>(i)).muted();
      require(torques[i] == (wanted ? 1 : 0), "one torque command for each motor");
    }
  }
  /// 4: no motor.
  [[nodiscard]] std::size_t motor_of(std::size_t axis) const {
    const auto motors = static_cast<std::size_t>(setup_.controller.motor_count());
    const std::size_t each = axes_ / motors;
    return axis % each == 0 ? axis / each : 4;
  }
  void torque(const TickResult<M>& r, const Said& said, int count) {
    require(count == 1 && motor_of(said.axis) < 4, "one torque command for each motor");
    const auto& m = P::mountings[said.axis];
    const auto joint = static_cast<int>(joint_of(said.axis));
    const double told = said.shaft * m.direction * m.gear, step = P::step * m.gear;
    const auto most = static_cast<double>(setup_.controller.torque_limit[joint]);
    require(std::isfinite(told), "a torque is a number");
    require(std::fabs(told) <= (has_torque(r.state) ? most * (1 + 1e-6) : 0) + step, "a torque within its limit, none where none may be");
    if (P::step == 0 && !has_torque(r.state)) require(said.shaft == 0, "no torque is zero");
    require(std::fabs(told - static_cast<double>(r.torque[joint])) <= 1e-6 * most + step || P::unscaled(drives_[said.axis]),
            "the torque of the log is that of the frame");
  }

  test::Setup<M> setup_;
  std::size_t axes_;
  Cycle<M, Axis> cycle_;
  std::array<typename P::Drive, joints> drives_{};
  std::array<double, joints> angle_{}, rate_{};
  Bus bus_;
  Desk desk_;
  Command command_ = Command::none, kept_ = Command::none;
  bool closed_ = true, obey_ = true, silent_ = true, impostor_ = false, refused_off_ = false;
  bool ordered_enable_ = false, ordered_reset_ = false, asked_enable_ = false, asked_reset_ = false;
  unsigned quiet_ticks_ = 0;
  double yields_ = 1;  ///< in the sign test: rad/s of a joint for each N m and tick
};

/// From power-up, or from a copy of a cycle that runs.
template <class M, class P>
void fuzz_cycle(Bytes& in, unsigned choice, bool runs) {
  using Run = CycleRun<M, P>;
  static const std::vector<Run> running = [] {
    std::vector<Run> v;
    for (unsigned i = 0; i < Run::choices; ++i) {
      v.emplace_back(i);
      v.back().start();
    }
    return v;
  }();
  choice %= Run::choices;
  Run run = runs ? running[choice] : Run(choice);
  run.go(in);
}
template <class P>
int fuzz_cycle(const std::uint8_t* data, std::size_t size) {
  Bytes in(data, size);
  const unsigned how = in.u8();
  const bool runs = (how & 1U) == 0;
  if ((how & 2U) == 0) {
    fuzz_cycle<FiveBar<double>, P>(in, how >> 2U, runs);
  } else {
    fuzz_cycle<Rr<float>, P>(in, how >> 2U, runs);
  }
  return 0;
}

}  // namespace esmc::fuzz
