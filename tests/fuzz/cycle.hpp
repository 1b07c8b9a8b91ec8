#pragma once
/// The whole cycle: drives made of bytes that obey, a supervisor computer, and in every tick what the input
/// does to them: frames of any kind, silence, floods, ages, a bus that refuses, pins, commands. What leaves
/// is read with the tests' own layouts and judged by the table of states of docs/safety.md, written out in
/// cycle_table.hpp.

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <optional>
#include <vector>

#include "firmware/cycle/cycle.hpp"
#include "tests/fuzz/bytes.hpp"
#include "tests/fuzz/cycle_shape.hpp"
#include "tests/fuzz/cycle_table.hpp"
#include "tests/fuzz/plant.hpp"
#include "tests/support/link_bytes.hpp"

namespace esmc::fuzz {

using test::Desk;

template <class M, class P>
class CycleRun {
 public:
  using S = typename M::Scalar;
  using Axis = typename P::Axis;
  static constexpr std::size_t joints = static_cast<std::size_t>(M::joints);

  explicit CycleRun(const Shape& shape)
      : setup_(setup_of<M>(shape, P::passive_encoders)),
        drive_(shape.drive()),
        axes_(all() ? joints : 2),
        cycle_(config(shape)) {
    for (std::size_t i = 0; i < axes_; ++i) drives_[i] = P::drive(i, shape.drive());
    angle_ = setup_.angle;
    desk_.session = cycle_.link().session();
    if (has_store(shape)) cycle_.link().store_status({.state = link::StoreState::idle});
  }

  /// Enabled and under torque, as far as it lets itself and in at most so many ticks; returns how many it
  /// were. `through` the sign test, as a machine that moves. CiA 402 drives are heard only once they were
  /// enabled, so their zero takes two attempts.
  int start(int most, bool through) {
    moves_ = through;
    int i = 0;
    for (; i < most && !(through ? cycle_.supervisor().running() : started()); ++i) {
      const State state = cycle_.supervisor().state();
      const bool unconfirmed = cycle_.supervisor().fault() == Fault::zero_not_confirmed;
      command_ = state == State::disabled ? (i % 4 == 3 ? Command::enable : Command::confirm_zero)
                 : state == State::fault && unconfirmed ? Command::reset
                                                        : Command::none;
      if (cycle_.link().active()) push(desk_.order(Desk::none));  // the computer is there
      speak(0);
      end(true);
    }
    return i;
  }
  [[nodiscard]] bool started() const { return has_torque(cycle_.supervisor().state()); }

  void go(Bytes& in) {
    ticks_ = 0;
    for (int steps = 0; !in.empty() && steps < steps_max; ++steps) {
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
  static constexpr int steps_max = 60, ticks_max = 1100;

  // ---- configuration
  // -----------------------------------------------------------------------------------------------

  [[nodiscard]] bool all() const {
    return setup_.controller.motors == Motors::all || setup_.controller.sensors == Sensors::all;
  }
  [[nodiscard]] bool at_effector() const {
    return setup_.controller.reference.space == ReferenceSpace::effector;
  }
  typename Cycle<M, Axis>::Config config(const Shape& shape) const {
    typename Cycle<M, Axis>::Config c;
    c.controller = setup_.controller;
    for (std::size_t i = 0; i < axes_; ++i) c.axes[i] = P::axis(i, shape.drive());
    c.line = P::line();
    c.axis_count = static_cast<int>(axes_);
    for (std::size_t j = 0; j < joints; ++j)
      c.zero_pose[static_cast<int>(j)] = static_cast<S>(setup_.angle[j]);
    turn_cycle(c, shape, at_effector());
    if (!c.zero_absolute)
      c.homing = {
          {S(0.5F), S(-0.5F)}, {S(0.2F), S(0.2F)}, {S(0.05F), S(0.05F)}, S(0.1F), S(0.001F), S(0.05F)};
    if constexpr (requires { P::kind(0U).old; }) {
      if (P::kind(shape.drive()).old)
        c.torque_mismatch = {};  // it does not say its torque, and the host refuses that
    }
    return c;
  }

  // ---- what comes in
  // -----------------------------------------------------------------------------------------------

  [[nodiscard]] std::size_t joint_of(std::size_t axis) const { return axis * (joints / axes_); }
  /// What only the controller may send to one of its drives.
  [[nodiscard]] bool commands(const hal::CanFrame& f) const {
    bool any = false;
    for (std::size_t i = 0; i < axes_; ++i) any = any || P::is_torque_command(f, i, drive_);
    return any;
  }
  void push(const hal::CanFrame& f) {
    silent_ = false;
    order(f, cycle_.link().session());
    if (commands(f)) foreign_command_ = true;
    last_ = f;
    bus_.waiting.push_back(f);
  }
  /// An order that may count: sealed with the session that the controller has when it comes. Its age and
  /// counter: the target `link`.
  void order(const hal::CanFrame& f, unsigned session) {
    const bool enables = (f.data[2] == Desk::arm || f.data[2] == Desk::home) && !ordered_enable_,
               resets = f.data[2] == Desk::reset && !ordered_reset_;
    if (!(enables || resets) || f.id != link_base || f.size != 8 || f.fd || f.remote || f.extended) return;
    if (desk_.seal(f, session).data[0] != f.data[0]) return;
    (enables ? ordered_enable_ : ordered_reset_) = true;
  }
  /// The frames of a tick. `without`: bit 0, 1: first or second axis says nothing; bit 2: no heartbeats.
  void speak(unsigned without) {
    for (std::size_t i = 0; i < axes_; ++i) {
      if (i < 2 && ((without >> i) & 1U) != 0) continue;
      const auto& m = P::mountings[i];
      const double shaft = m.direction * m.gear;
      heard_of_[i] = true;
      drives_[i].speak((angle_[joint_of(i)] - m.offset) * shaft, rate_[joint_of(i)] * shaft,
                       (without & 4U) == 0, [&](const hal::CanFrame& f) { push(f); });
    }
  }
  void inject(Bytes& in) {
    heard_of_.fill(true);  // it may be of anybody
    in.one_of(
        16, [&] { push(in.frame()); }, [&] { push(P::addressed(in)); },
        [&] { push(in.frame(link_base + in.below(32))); },
        [&] {
          hal::CanFrame f = in.frame(link_base + in.below(6));
          const unsigned message = f.id - link_base;
          desk_.counter[message] = (desk_.counter[message] + 1) & 15;
          f.data[1] = static_cast<std::uint8_t>((f.data[1] & 0xF0U) | desk_.counter[message]);
          push(desk_.seal(f, in.below(8) == 7 ? 0U : desk_.session));
        },
        [&] {
          const unsigned what = in.u8();
          hal::CanFrame f = desk_.order(what % 12);
          if (what >= 240) f.data[0] ^= 0x10U;
          push(f);
        },
        [&] {
          const auto x = static_cast<std::int16_t>(in.u16()), y = static_cast<std::int16_t>(in.u16());
          push(desk_.pair(in.yes() ? Desk::point : Desk::position, x * 64, y * 64, space()));
          push(desk_.pair(Desk::velocity, x * 4, y * 4, space()));
        },
        [&] {
          const std::size_t i = in.below(static_cast<unsigned>(axes_));
          drives_[i].defect(in, [&](const hal::CanFrame& f) { push(f); });
        },
        [&] {
          const hal::CanFrame f = in.frame();
          const unsigned many = in.u8();
          for (unsigned n = many == 255 ? 70'000 : many * 8; n > 0; --n) push(f);
        },
        [&] { push(desk_.set_gain(in.below(16), in.yes() ? in.f32() : static_cast<float>(in.u8()))); },
        [&] { push(desk_.ask(in.below(4), in.below(16))); },
        [&] {  // near where it is, and slow
          const auto of = [&](double v) {
            return static_cast<int>(std::lround(v * 1e6)) + static_cast<std::int8_t>(in.u8()) * 256;
          };
          const int x = of(near_[0]), y = of(near_[1]), v = static_cast<std::int8_t>(in.u8()) * 64;
          push(desk_.pair(in.yes() ? Desk::point : Desk::position, x, y, space()));
          push(desk_.pair(Desk::velocity, v, -v, in.below(8) == 7 ? 1 - space() : space()));
        },
        [&] { push(desk_.pair(1 + in.below(3), in.u16(), in.u16(), in.below(4))); },
        [&] {
          hal::CanFrame f = desk_.order(in.below(12));
          f.data[4] = static_cast<std::uint8_t>(f.data[4] - in.u8());  // as old as that
          push(desk_.seal(f, desk_.session));
        },
        [&] { push(last_); }, [&] { drives_[in.below(static_cast<unsigned>(axes_))].tamper(in); });
  }
  [[nodiscard]] unsigned space() const { return at_effector() ? 0U : 1U; }
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
    in.one_of(
        16, [&] { bus_.status = static_cast<hal::SendStatus>(in.below(4)); }, [&] { bus_.age_us = in.u32(); },
        [&] { cycle_.enable_input(closed_ = in.yes()); }, [&] { cycle_.ask_again(); },
        [&] {
          if (!in.yes()) {
            cycle_.tick_late();
            return;
          }
          cycle_.request(bus_);
        },
        [&] { in.yes() ? cycle_.receive(bus_) : void(yields_ = static_cast<std::int8_t>(in.u8()) * 0.02); },
        [&] {
          if (!bus_.unread().empty()) foreign_command_ = false;  // it may never have been heard
          bus_ = {};
          rate_ = {};
          angle_ = setup_.angle;
          cycle_.enable_input(closed_ = true);
        },
        [&] { obey_ = in.yes(); },
        [&] {
          const unsigned without = in.below(8);
          for (unsigned n = in.u8(); n > 0 && ticks_ < ticks_max; --n) {
            speak(without);
            end(true);
          }
        },
        [&] { store(in); }, [&] { stand(in); }, [&] { follows_ = static_cast<std::int8_t>(in.u8()) * 0.02; },
        [&] { bus_.room = in.below(32); }, [&] { moves_ = in.yes(); }, [&] { bus_.age_us = in.u8() * 1000U; },
        [&] {
          cycle_.receive(bus_);
          cycle_.request(bus_);
        });
  }
  /// What a board does with its store of parameters, between ticks; or a word that it would not say.
  void store(Bytes& in) {
    const link::StoreRequest wish = cycle_.link().take_store_request();
    link::StoreStatus s{.state = static_cast<link::StoreState>(in.below(5)), .sequence = in.u8()};
    if (wish != link::StoreRequest::none) s.state = link::StoreState::idle;
    cycle_.link().store_status(s);
  }
  /// At rest in another pose that closes.
  void stand(Bytes& in) {
    rate_ = {};
    const double x = static_cast<std::int8_t>(in.u8()) * 2.5e-3,
                 y = static_cast<std::int8_t>(in.u8()) * 2.2e-3;
    if constexpr (joints == 4) {
      const unsigned modes = in.u8();
      const auto there = test::five_bar_angles(x, y, (modes & 1U) != 0 ? -1 : 1, (modes & 2U) != 0 ? -1 : 1);
      if (std::ranges::all_of(there, [](double a) { return std::isfinite(a); })) angle_ = there;
    } else {
      angle_ = {x * 10, y * 10};
    }
  }

  // ---- a tick, and what must be true of it
  // ---------------------------------------------------------------------------

  void end(bool answer) {
    const State before = cycle_.supervisor().state();
    const Fault fault_before = cycle_.supervisor().fault();
    const bool drive_enable_before = cycle_.drive_enable();
    cycle_.receive(bus_);
    if (cycle_.complete()) require(!silent_ && cycle_.heard(), "a set is complete when frames have come");
    if (command_ != Command::none) cycle_.command(command_);
    asked_enable_ = ordered_enable_ || command_ == Command::enable;
    asked_reset_ = ordered_reset_ || command_ == Command::reset;
    command_ = Command::none;
    for (const auto& f : bus_.tried)
      require(P::read(f, axes_, drive_).kind == Said::Kind::asking,
              "between ticks samples are asked for, and no more");
    if (refused_off()) refused_off_ = true;
    bus_.clear();
    const TickResult<M> r = cycle_.tick(bus_, answer);
    ++ticks_;
    give(r);
    for (std::size_t i = 0; i < 2; ++i) {
      near_[i] =
          at_effector() ? static_cast<double>(r.effector[static_cast<int>(i)]) : angle_[i * joints / 2];
      if (!(std::fabs(near_[i]) < 8)) near_[i] = 0;
    }
    require(drive_enable_before == (before != State::disabled && before != State::fault),
            "drive_enable as the table has it");
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
    foreign_command_ =
        std::ranges::any_of(bus_.unread(), [&](const hal::CanFrame& f) { return commands(f); });
    refused_off_ = refused_off();
    bus_.clear();
  }

  [[nodiscard]] bool refused_off() const {
    return bus_.sent.size() != bus_.tried.size() && bus_.status == hal::SendStatus::bus_off;
  }

  /// Joints move as the machine would; or they give way to a torque, or turn against it.
  void give(const TickResult<M>& r) {
    if (moves_) {
      std::array<double, joints> torque;
      for (std::size_t j = 0; j < joints; ++j) torque[j] = static_cast<double>(r.torque[static_cast<int>(j)]);
      if (!has_torque(r.state)) return;
      if constexpr (joints == 4) {
        move_five_bar(angle_, rate_, torque);
      } else {
        move_rr(angle_, rate_, torque);
      }
      return;
    }
    const double gives = r.state == State::testing ? yields_ : follows_;
    for (std::size_t j = 0; j < joints && gives != 0; ++j) {
      rate_[j] += static_cast<double>(r.torque[static_cast<int>(j)]) * gives;
      angle_[j] += rate_[j] * 1e-3;
    }
  }

  void judge(const TickResult<M>& r, State before, Fault fault_before, bool answer) {
    const Supervisor& s = cycle_.supervisor();
    require(r.state == s.state() && r.fault == s.fault(), "the result says what the supervisor says");
    const bool allowed = may_follow(before, r.state, asked_enable_, asked_reset_);
    if (!allowed) std::fprintf(stderr, "%s -> %s (%s)\n", name(before), name(r.state), name(r.fault));
    require(allowed, "a transition that the table has");
    if (r.state == State::fault) require(r.fault != Fault::none, "a fault has a name");
    if (before == State::fault && r.state == State::fault)
      require(r.fault == fault_before, "the first fault keeps its name");
    if (before == State::fault && !asked_reset_)
      require(r.state == State::fault, "a fault stays until the operator's reset");
    if (fault_before != Fault::none && r.fault == Fault::none)
      require(asked_reset_ && r.state == State::disabled, "faults are cleared by reset only");
    require(cycle_.output_ok(), "every tick is a good one, or memory is broken");
    require(cycle_.release_brake() == has_torque(r.state), "the brake is open under torque only");
    require(cycle_.drive_enable() == (r.state != State::disabled && r.state != State::fault),
            "drive_enable as the table has it");
    if (!has_torque(r.state)) require(r.torque.isZero(0), "no torque in this state");
    if (!cycle_.heard()) require(!has_torque(r.state), "no torque for drives that have sent no frame");

    const bool off = r.state == State::fault || r.state == State::disabled;
    if (!closed_) require(off, "an open enable input ends it at once");
    if (refused_off_) require(off, "a bus that was left ends it in the next tick");
    if (foreign_command_) require(off, "so does a foreign torque");
    quiet_ticks_ = silent_ ? quiet_ticks_ + 1 : 0;
    if (quiet_ticks_ > 2) require(!has_torque(r.state), "no torque without samples");
    for (std::size_t i = 0; i < axes_; ++i) {  // nor without those of one encoder alone
      quiet_of_[i] = heard_of_[i] || !bus_.waiting.empty() ? 0 : quiet_of_[i] + 1;
      heard_of_[i] = false;
      const bool senses = axes_ == 2 || setup_.controller.sensors == Sensors::all || i % 2 == 0;
      if (senses && quiet_of_[i] > 2)
        require(!has_torque(r.state), "no torque without the samples of each encoder");
    }
    frames(r, answer);
  }

  /// What it sent, and what the bus did not take: one that is refused now may be taken in the next run.
  void frames(const TickResult<M>& r, bool answer) {
    enabled_once_ = enabled_once_ || r.state == State::enabling;
    std::array<int, joints> torques{};
    for (const auto& f : bus_.tried) {
      if (f.id >= link_base && f.id < link_base + 32) {
        require(f.id >= link_base + 16 && f.size == 8, "telemetry only");
        continue;
      }
      const Said said = P::read(f, axes_, drive_);
      if (said.enables)
        require(r.state == State::enabling || has_torque(r.state), "no word that enables in any other state");
      switch (said.kind) {
        case Said::Kind::torque:
          torque(r, said, ++torques[said.axis]);
          break;
        case Said::Kind::enabling:
          require(r.state == State::enabling, "drives are enabled while enabling only");
          break;
        case Said::Kind::releasing:
          require(!has_torque(r.state), "drives are not released under torque");
          break;
        case Said::Kind::alive:
          require(r.state != State::fault, "a controller with a fault keeps no drive alive");
          require(enabled_once_, "nor does one that has never enabled it");
          break;
        case Said::Kind::asking:
        case Said::Kind::unknown:
          require(false, "a frame that the controller does not send");
      }
    }
    for (std::size_t i = 0; i < axes_; ++i) {
      const std::size_t motor = motor_of(i);
      const bool tx_suspended = cycle_.axis(static_cast<int>(i)).tx_suspended();
      require(!tx_suspended || !has_torque(r.state), "no watchdog test under torque");
      require(torques[i] == (answer && motor < 4 && !tx_suspended ? 1 : 0),
              "one torque command for each motor");
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
    const double told = said.shaft * m.direction * m.gear, step = P::step(drive_) * m.gear,
                 range = P::torque_most(drive_) * m.gear;
    const auto most = static_cast<double>(setup_.controller.torque_limit[joint]);
    const double meant = std::clamp(static_cast<double>(r.torque[joint]), -range, range);
    require(std::isfinite(told), "a torque is a number");
    require(std::fabs(told) <= (has_torque(r.state) ? most * (1 + P::slack) : 0) + step,
            "a torque within its limit, none where none may be");
    if (step == 0 && !has_torque(r.state)) require(said.shaft == 0, "no torque is zero");
    constexpr double nothing = 1e-30;  // N m: what a float rounds coarsely
    require(std::fabs(told - meant) <= P::slack * std::fabs(meant) + step + nothing,
            "the torque of the log is that of the frame");
  }

  test::Setup<M> setup_;
  unsigned drive_;
  std::size_t axes_;
  Cycle<M, Axis> cycle_;
  std::array<typename P::Drive, joints> drives_{};
  std::array<double, joints> angle_{}, rate_{};
  Bus bus_;
  Desk desk_;
  Command command_ = Command::none;
  bool closed_ = true, obey_ = true, silent_ = true, foreign_command_ = false, refused_off_ = false;
  bool enabled_once_ = false;  ///< enabling, once
  bool ordered_enable_ = false, ordered_reset_ = false, asked_enable_ = false, asked_reset_ = false;
  unsigned quiet_ticks_ = 0;
  std::array<bool, joints> heard_of_{};
  std::array<unsigned, joints> quiet_of_{};
  int ticks_ = 0;
  std::array<double, 2> near_{};  ///< where it is, in the coordinates of set points
  hal::CanFrame last_{};
  double yields_ = 1;   ///< in the sign test: rad/s of a joint for each N m and tick
  double follows_ = 0;  ///< likewise elsewhere
  bool moves_ = false;  ///< as the machine would
};

/// From power-up, from a copy of a cycle that was brought to torque, or of one that was on its way to it.
template <class M, class P>
void fuzz_cycle(Bytes& in, const Shape& shape, bool runs, bool on_its_way, bool through) {
  using Run = CycleRun<M, P>;
  using Which = std::pair<Shape, bool>;
  static std::map<std::pair<Which, int>, Run> kept;
  static std::map<Which, int> needs;  // ticks to torque
  constexpr int most = 300;
  const Which which{shape, through};
  if (!runs) {
    Run(shape).go(in);
    return;
  }
  if (!needs.contains(which)) {
    if (needs.size() > 2000) needs.clear();
    Run run(shape);
    needs[which] = run.start(most, through);
    require(shape.free() || run.started(), "obedient drives bring it to torque");
  }
  const int ticks = on_its_way ? std::max(0, needs[which] - 1 - static_cast<int>(in.u8())) : needs[which];
  if (kept.size() > 500) kept.clear();
  auto at = kept.find({which, ticks});
  if (at == kept.end()) {
    at = kept.emplace(std::pair(which, ticks), shape).first;
    at->second.start(ticks, through);
  }
  Run run = at->second;
  run.go(in);
}
template <class P>
int fuzz_cycle(const std::uint8_t* data, std::size_t size) {
  Bytes in(data, size);
  const unsigned how = in.u8();
  const bool runs = (how & 1U) == 0;
  const Shape shape = Shape::of(how >> 2U, in);
  const bool on_its_way = (how & 0x40U) != 0, through = (how & 0x80U) != 0;
  if ((how & 2U) == 0) {
    fuzz_cycle<FiveBar<double>, P>(in, shape, runs, on_its_way, through);
  } else {
    fuzz_cycle<Rr<float>, P>(in, shape, runs, on_its_way, through);
  }
  return 0;
}

}  // namespace esmc::fuzz
