#pragma once
/// One episode of a campaign: controller, drives and mechanism in lockstep on a faulty wire, in virtual time.

#include <cstdint>
#include <string>
#include <vector>

#include "host_sim/campaign/computer.hpp"
#include "host_sim/campaign/judge.hpp"
#include "host_sim/campaign/world.hpp"
#include "host_sim/loop/halves.hpp"
#include "host_sim/record/recorder.hpp"

namespace esmc::host {

struct EpisodeResult {
  std::uint64_t seed = 0;
  std::size_t variant = 0;
  std::string_view protocol;
  Injection injection;
  Verdict verdict;
  Reaction reaction;
  std::string_view first_fault;  ///< "": none
  std::uint64_t ticks = 0, digest = 0;
  double tick_s = 1e-3;
  bool ran = false;  ///< there was torque before the fault
};

/// A line per tick, where somebody wants to read them.
using EpisodeTrace = std::vector<std::string>;

/// What episodes on one scene share; read only.
template <class World_>
class EpisodeKind {
 public:
  using Plant = typename World_::Plant;
  using M = typename World_::Mechanism;

  explicit EpisodeKind(const Scene& scene) : EpisodeKind(scene, scene) {}
  /// `promised`: the scene by which the loop of `scene` is judged. Where they differ, a judge has something
  /// to find.
  EpisodeKind(const Scene& scene, const Scene& promised)
      : scene_(scene),
        promised_(promised),
        unwatched_(scene),
        zeroed_(scene),
        reference_(make_reference(scene_, Pacing::lockstep)),
        cycle_(make_cycle<M>(scene_, Pacing::lockstep, reference_)),
        times_(episode_times(promised_)) {
    unwatched_.drives.watchdog_timeout = 1e3;
    zeroed_.drives.defects.zero_until_closed_loop = true;
    times_.join_ticks = static_cast<int>(reference_.join_ticks);
    times_.arming_ticks = arming_ticks();
  }
  EpisodeKind(const EpisodeKind&) = delete;
  EpisodeKind& operator=(const EpisodeKind&) = delete;

  /// `only`: the fault of the episode; empty: any.
  [[nodiscard]] EpisodeResult run(std::uint64_t seed, Draw draw, EpisodeTrace* trace = nullptr,
                                  std::string_view only = {}) const;

 private:
  /// Ticks from the command to enable to the release of the brake, without a fault. Throws RunError where the
  /// loop does not get onto its reference: what a campaign says of such a loop says nothing of the faults.
  [[nodiscard]] int arming_ticks() const;

  [[nodiscard]] const Scene& defective(Injected k) const {
    return k == Injected::watchdog_off ? unwatched_
                                       : (k == Injected::zero_until_closed_loop ? zeroed_ : scene_);
  }
  /// The operator of an episode, where the scene has it arm over the command interface.
  [[nodiscard]] std::optional<Computer> computer() const {
    return times_.link_ticks > 0 ? std::optional<Computer>(scene_) : std::nullopt;
  }

  Scene scene_, promised_, unwatched_, zeroed_;
  ReferenceBundle<double> reference_;
  AnyCycle<M> cycle_;
  EpisodeTimes times_;
};

/// When what happens, as far as that is known before.
class EpisodeScript {
 public:
  EpisodeScript(const Injection& i, const EpisodeTimes& t, Draw& draw)
      : injection_(i),
        join_(t.join_ticks),
        orders_at_(join_ + draw.between(1, 15)),
        after_(draw.between(0, 3)) {}

  /// What the operator asks for. `run`: ticks since the brake was released, -1 before; `latched`: since the
  /// controller has taken the torque away, -1 before.
  [[nodiscard]] Operator at(std::uint64_t tick, int run, int latched) const {
    if (tick == 0) return Operator::enable;
    if (latched == 5 && after_ == 1) return Operator::enable;  // not without a reset
    if (latched == 5 && after_ >= 2) return Operator::reset;
    if (latched == 10 && after_ == 3) return Operator::enable;
    if (latched >= 0 || run != orders_at_) return Operator::nothing;
    if (injection_.phase == Phase::halting) return Operator::halt;
    return injection_.phase == Phase::stopping ? Operator::stop : Operator::nothing;
  }
  /// Whether the fault begins in this tick or has begun.
  [[nodiscard]] bool begins(std::uint64_t tick, int run) const {
    switch (injection_.phase) {
      case Phase::arming:
        return tick >= static_cast<std::uint64_t>(injection_.offset);
      case Phase::joining:
        return run >= injection_.offset;
      case Phase::running:
        return run >= join_ + injection_.offset;
      case Phase::halting:
      case Phase::stopping:
        break;
    }
    return run >= orders_at_ + injection_.offset;
  }

 private:
  const Injection& injection_;
  int join_, orders_at_, after_;
};

/// What the stranger of a fault sends; nothing in other faults.
inline hal::CanFrame foreign_command(const ProtocolTraits& words, const Scene& scene, const Injection& i) {
  if (i.kind() != Injected::foreign_controller) return {};
  if (i.choice % 2 == 0) return words.foreign_torque(scene, i.drive, i.amount * scene.torque_limit[i.drive]);
  return words.foreign_command(scene.drives.nodes[i.drive], static_cast<unsigned>(i.choice / 2));
}

template <class World_>
EpisodeResult EpisodeKind<World_>::run(std::uint64_t seed, Draw draw, EpisodeTrace* trace,
                                       std::string_view only) const {
  constexpr int watch_ticks = 30;
  EpisodeResult out;
  out.seed = seed;
  const ProtocolTraits& words = dialect(scene_.drives.protocol);
  Injection injection = draw_injection(draw, times_, words, only);
  if (!has_to_show(injection, promised_)) injection.notice_ticks = InjectionRow::not_demanded;
  const EpisodeScript script(injection, times_, draw);
  World<Plant> world(make_motion<World_>(scene_), scene_, defective(injection.kind()), injection, words);
  std::optional<Computer> desk = computer();
  FaultyBus wire(injection, words, world.nodes(), scene_.bitrate);
  Judge judge(injection, times_, scene_.effects.empty(), words.tells_its_state);
  AnyCycle<M> cycle = cycle_;
  const hal::CanFrame foreign = foreign_command(words, scene_, injection);
  Digest digest;
  Operator pending = Operator::nothing;
  ControllerWord word;
  int run = -1, latched = -1, since = -1;
  const int watch =
      watch_ticks + std::max(std::min(injection.length, injection.watch_ticks), injection.notice_ticks);
  const auto most_ticks = static_cast<std::uint64_t>(2000 + times_.arming_ticks + times_.join_ticks +
                                                     times_.halt_ticks + watch + injection.watch_ticks);
  std::uint64_t tick = 0;
  for (; since < watch && tick < most_ticks; ++tick) {
    if (since >= 0 || script.begins(tick, run)) ++since;
    const bool first = since == 0, active = since >= 0 && since < injection.length;
    wire.begin_tick(active);
    const bool gone = active && injection.kind() == Injected::computer_gone;
    if (const Operator o = script.at(tick, run, latched); o != Operator::nothing) pending = o;

    if (first) out.ran = word.powered;
    const bool absent = active && (injection.kind() == Injected::controller_death ||
                                   injection.kind() == Injected::controller_late);
    Operator asked = absent || gone ? Operator::nothing : std::exchange(pending, Operator::nothing);
    if (desk && !gone && !absent)
      asked = desk->act(asked, [&](const hal::CanFrame& f) { wire.from_computer(f); });
    world.publish(wire, active, first);
    wire.inject_foreign_frames();
    word.ticked = !absent;
    if (!absent) {
      std::visit(
          [&](auto& c) {
            c.receive(wire);
            c.enable_input(!(active && injection.kind() == Injected::enable_open));
            switch (desk ? Operator::nothing : asked) {
              case Operator::enable:
                c.command(Command::enable);
                break;
              case Operator::stop:
                c.command(Command::stop);
                break;
              case Operator::halt:
                c.command(Command::halt);
                break;
              case Operator::reset:
                c.command(Command::reset);
                break;
              case Operator::nothing:
                break;
            }
            const TickResult<M> r = c.tick(wire);
            c.request(wire);
            word.powered = c.supervisor().powered();
            word.faulted = r.state == State::fault;
            word.fault = esmc::name(r.fault);
          },
          cycle);
    }
    wire.inject_foreign_frames_after_tick(foreign);
    for (const FaultyBus::Delivery& d : wire.to_drives()) {
      if (desk) desk->hear(d.frame);
    }
    // Then the controller has to notice, and to come to rest as if it had been asked to.
    if (gone && since == injection.notice_ticks) asked = Operator::halt;
    world.deliver(wire, static_cast<double>(tick) * times_.tick * 1e3);
    judge.look(tick, asked, word, world, wire, first);
    if (latched >= 0 || word.faulted) ++latched;

    const auto now = world.motion().output();
    digest.add(now.q);
    digest.add(now.qd);
    for (std::size_t i = 0; i < world.motors(); ++i) digest.add(std::array{world.motor(i).torque});
    if (trace != nullptr) {
      std::string line =
          fmt::format("{:4} {}{:>5} {:<9} {:<22}", tick, active ? '*' : ' ', word.ticked ? "tick" : "-",
                      word.powered ? "powered" : (word.faulted ? "fault" : "off"), word.fault);
      for (std::size_t i = 0; i < world.motors(); ++i)
        line += fmt::format(" {:10.6f}", world.motor(i).torque);
      for (const double q : now.q) line += fmt::format(" {:9.5f}", q);
      trace->push_back(line);
    }
    world.advance(static_cast<double>(tick) * times_.tick);
    if (run >= 0 || world.released()) ++run;
  }
  judge.end();
  out.injection = injection;
  out.verdict = judge.verdict();
  out.reaction = judge.reaction();
  out.first_fault = judge.first_fault();
  out.ticks = tick;
  out.tick_s = times_.tick;
  out.digest = digest.value();
  return out;
}

template <class World_>
int EpisodeKind<World_>::arming_ticks() const {
  constexpr int looks_ahead = 16;  // as the controller does when it joins
  const int patience = std::max(2000, static_cast<int>(2.0 * scene_.rate_hz));
  const Injection nothing{.row = &injection_rows()[0]};
  const ProtocolTraits& words = dialect(scene_.drives.protocol);
  World<Plant> world(make_motion<World_>(scene_), scene_, scene_, nothing, words);
  std::optional<Computer> desk = computer();
  FaultyBus wire(nothing, words, world.nodes(), scene_.bitrate);
  AnyCycle<M> cycle = cycle_;
  if (!desk) std::visit([](auto& c) { c.command(Command::enable); }, cycle);
  int armed = -1;
  for (int tick = 0; armed < 0 || tick <= armed + times_.join_ticks + looks_ahead; ++tick) {
    if (armed < 0 && tick >= patience) throw RunError(scene_.name + ": the drives do not arm");
    wire.begin_tick(false);
    if (desk)
      (void)desk->act(tick == 0 ? Operator::enable : Operator::nothing,
                      [&](const hal::CanFrame& f) { wire.from_computer(f); });
    world.publish(wire, false, false);
    if (armed < 0 && world.released()) armed = tick;
    const Fault fault = std::visit(
        [&](auto& c) {
          c.receive(wire);
          const TickResult<M> r = c.tick(wire);
          c.request(wire);
          return r.fault;
        },
        cycle);
    if (fault != Fault::none) {
      throw RunError(fmt::format("{}: {} before anything is done to the loop: a campaign needs one that runs",
                                 scene_.name, esmc::name(fault)));
    }
    for (const FaultyBus::Delivery& d : wire.to_drives()) {
      if (desk) desk->hear(d.frame);
    }
    world.deliver(wire, tick * times_.tick * 1e3);
    world.advance(tick * times_.tick);
  }
  return armed;
}

}  // namespace esmc::host
