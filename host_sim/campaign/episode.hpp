#pragma once
/// One episode of a campaign: controller, drives and mechanism in lockstep on a faulty bus, in virtual time.

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "host_sim/campaign/faulty_plant.hpp"
#include "host_sim/campaign/judge.hpp"
#include "host_sim/controller/axes_config.hpp"
#include "host_sim/operate/link_client.hpp"
#include "host_sim/record/recorder.hpp"

namespace esmc::host {

/// A supervisor computer that passes the operator's orders on over the command interface, and may vanish: a
/// sign of life every second tick, and orders; it receives the controller's status.
class Computer {
 public:
  /// `scene` has [command].
  explicit Computer(const Scene& scene) : link_(static_cast<std::uint32_t>(scene.command->base_id)) {}

  /// Takes a frame of the bus; it uses the controller's status and parameter table, and no other.
  void hear(const hal::CanFrame& f) { (void)link_.hear(f); }
  /// Call once per tick: gives `send` the computer's frames. `wanted` replaces an order that still waits: for
  /// the first status, and an order to arm for the parameter table. Returns the order sent in this tick.
  template <class Send>
  Operator act(Operator wanted, const Send& send) {
    if (wanted != Operator::nothing) wanted_ = wanted;
    const bool session = link_.news().status.has_value(), table = link_.news().table.has_value();
    if (session && !table && !asked_) {
      asked_ = true;
      send(link_.request(link::Subject::table));
    }
    if (++ticks_ % 2 == 0) send(link_.order(link::Order::none));
    if (wanted_ == Operator::nothing || !session || (wanted_ == Operator::enable && !table))
      return Operator::nothing;
    const Operator asked = std::exchange(wanted_, Operator::nothing);
    constexpr link::Order orders[] = {link::Order::none, link::Order::arm, link::Order::off,
                                      link::Order::disarm, link::Order::reset};  // as enum Operator
    send(link_.order(orders[static_cast<std::size_t>(asked)]));
    return asked;
  }

 private:
  LinkClient link_;
  std::uint64_t ticks_ = 0;
  bool asked_ = false;
  Operator wanted_ = Operator::nothing;
};

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

/// A line per tick.
using EpisodeTrace = std::vector<std::string>;

template <class Traits>
class EpisodeLoop;

/// What episodes on one scene share; read only.
template <class Traits>
class EpisodeKind {
 public:
  using M = typename Traits::Mechanism;

  /// Copies the scene and runs its loop without a fault, to measure how long arming takes. Throws RunError
  /// where that loop does not reach its reference, InputError for a scene that no controller can be made of.
  explicit EpisodeKind(const Scene& scene) : EpisodeKind(scene, scene) {}
  /// As above. `promised`: the scene by which the loop of `scene` is judged; a test makes them differ.
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

  /// Runs the episode that `draw` decides; `seed` is only copied to the result. `only`: name of the fault to
  /// draw; empty: any; not possible on this scene: no fault. `trace` gets a line per tick; null: none.
  [[nodiscard]] EpisodeResult run(std::uint64_t seed, Draw draw, EpisodeTrace* trace = nullptr,
                                  std::string_view only = {}) const;

 private:
  friend class EpisodeLoop<Traits>;
  /// Ticks from the command to enable to the release of the brake, without a fault. Throws RunError where the
  /// loop does not reach its reference: a campaign on such a loop says nothing about the faults.
  [[nodiscard]] int arming_ticks() const;

  [[nodiscard]] const Scene& defective(Injected k) const {
    return k == Injected::watchdog_off ? unwatched_
                                       : (k == Injected::zero_until_closed_loop ? zeroed_ : scene_);
  }

  Scene scene_, promised_, unwatched_, zeroed_;
  ReferenceBundle<double> reference_;
  AnyCycle<M> cycle_;
  EpisodeTimes times_;
};

/// The times of an episode that are drawn before it begins.
class EpisodeScript {
 public:
  /// `i` must outlive this. Draws all times at once: `draw` is not kept.
  EpisodeScript(const Injection& i, const EpisodeTimes& t, Draw& draw)
      : injection_(i),
        join_(t.join_ticks),
        orders_at_(join_ + draw.between(1, 15)),
        after_(draw.between(0, 3)) {}

  /// The operator's order. `run`: ticks since the brake was released, -1 before; `latched`: ticks since the
  /// controller took the torque away, -1 before.
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
    const Phase phase = injection_.phase;
    if (phase == Phase::arming) return tick >= static_cast<std::uint64_t>(injection_.offset);
    const int from = phase == Phase::joining ? 0 : (phase == Phase::running ? join_ : orders_at_);
    return run >= from + injection_.offset;
  }

 private:
  const Injection& injection_;
  int join_, orders_at_, after_;
};

/// Plant, bus, computer and a copy of the controller, for one pass.
template <class Traits>
class EpisodeLoop {
 public:
  using M = typename Traits::Mechanism;
  using Kind = EpisodeKind<Traits>;

  /// Both arguments must outlive this. In each tick call begin_tick, send_order, publish, control, deliver,
  /// advance.
  EpisodeLoop(const Kind& kind, const Injection& injection)
      : kind_(kind),
        injection_(injection),
        traits_(protocol_traits(kind.scene_.drives.protocol)),
        plant_(make_motion<Traits>(kind.scene_), kind.scene_, kind.defective(injection.kind()), injection,
               traits_),
        bus_(injection, traits_, plant_.nodes(), kind.scene_.bitrate, kind.scene_.fast_bit()),
        cycle_(kind.cycle_),
        foreign_(foreign_command(traits_, kind.scene_, injection)) {
    if (kind.times_.link_ticks > 0) computer_.emplace(kind.scene_);
  }

  [[nodiscard]] FaultyPlant<typename Traits::Plant>& plant() { return plant_; }
  [[nodiscard]] const FaultyBus& bus() const { return bus_; }
  [[nodiscard]] const ControllerWord& word() const { return word_; }
  [[nodiscard]] bool active(Injected k) const { return active_ && injection_.kind() == k; }

  /// Switches the injected fault on or off for this tick, and with it whether the controller ticks. `since`:
  /// ticks since the fault began, -1 before.
  void begin_tick(int since) {
    active_ = since >= 0 && since < injection_.length;
    bus_.begin_tick(active_);
    word_.ticked = !active(Injected::controller_death) && !active(Injected::controller_late);
  }
  /// The operator's order by way of the computer, if there is one. Returns the order that the controller can
  /// know of in this tick.
  Operator send_order(Operator order) {
    if (!computer_ || active(Injected::computer_gone) || !word_.ticked) return order;
    return computer_->act(order, [&](const hal::CanFrame& f) { bus_.from_computer(f); });
  }
  /// The drives' reports and the frames of other nodes. `first`: the fault begins in this tick.
  void publish(bool first) {
    plant_.publish(bus_, active_, first);
    bus_.inject_foreign_frames();
  }
  /// The controller's tick; `order` reaches it by a call unless a computer passes orders on.
  void control(Operator order) {
    if (word_.ticked) std::visit([&](auto& c) { tick(c, computer_ ? Operator::nothing : order); }, cycle_);
    bus_.inject_foreign_frames_after_tick(foreign_);
    if (!computer_) return;
    for (const FaultyBus::Delivery& d : bus_.to_drives()) computer_->hear(d.frame);
  }
  /// Hands the frames of tick number `tick` to the drives.
  void deliver(std::uint64_t tick) {
    plant_.deliver(bus_, static_cast<double>(tick) * kind_.times_.tick * 1e3);
  }
  /// Moves the mechanism over the tick; no effect before the brake is released.
  void advance(std::uint64_t tick) {
    plant_.advance(static_cast<double>(tick) * kind_.times_.tick, kind_.scene_.tick());
  }

  [[nodiscard]] std::string line(std::uint64_t tick) {
    std::string out =
        fmt::format("{:4} {}{:>5} {:<9} {:<22}", tick, active_ ? '*' : ' ', word_.ticked ? "tick" : "-",
                    word_.powered ? "powered" : (word_.faulted ? "fault" : "off"), word_.fault);
    for (std::size_t i = 0; i < plant_.motors(); ++i) out += fmt::format(" {:10.6f}", plant_.motor(i).torque);
    for (const double q : plant_.motion().output().q) out += fmt::format(" {:9.5f}", q);
    return out;
  }

 private:
  void tick(auto& cycle, Operator order) {
    cycle.receive(bus_);
    cycle.enable_input(!active(Injected::enable_open));
    constexpr Command orders[] = {Command::none, Command::enable, Command::stop, Command::halt,
                                  Command::reset};  // as enum Operator
    if (order != Operator::nothing) cycle.command(orders[static_cast<std::size_t>(order)]);
    const TickResult<M> r = cycle.tick(bus_);
    cycle.request(bus_);
    word_.powered = cycle.supervisor().powered();
    word_.faulted = r.state == State::fault;
    word_.fault = esmc::name(r.fault);
  }

  const Kind& kind_;
  const Injection& injection_;
  const ProtocolTraits& traits_;
  FaultyPlant<typename Traits::Plant> plant_;
  FaultyBus bus_;
  AnyCycle<M> cycle_;
  hal::CanFrame foreign_;
  std::optional<Computer> computer_;
  ControllerWord word_;
  bool active_ = false;
};

template <class Traits>
EpisodeResult EpisodeKind<Traits>::run(std::uint64_t seed, Draw draw, EpisodeTrace* trace,
                                       std::string_view only) const {
  constexpr int watch_ticks = 30;
  const ProtocolTraits& traits = protocol_traits(scene_.drives.protocol);
  EpisodeResult out;
  out.seed = seed;
  out.protocol = name(scene_.drives.protocol);
  Injection injection = draw_injection(draw, times_, traits, only);
  if (!has_to_show(injection, promised_)) injection.notice_ticks = InjectionRow::not_demanded;
  const EpisodeScript script(injection, times_, draw);
  EpisodeLoop<Traits> loop(*this, injection);
  auto& plant = loop.plant();
  Judge judge(injection, times_, scene_.effects.empty(), traits.tells_its_state);
  Digest digest;
  Operator pending = Operator::nothing;
  int run = -1, latched = -1, since = -1;
  const int watch =
      watch_ticks + std::max(std::min(injection.length, injection.watch_ticks), injection.notice_ticks);
  const auto most_ticks = static_cast<std::uint64_t>(2000 + times_.arming_ticks + times_.join_ticks +
                                                     times_.halt_ticks + watch + injection.watch_ticks);
  std::uint64_t tick = 0;
  for (; since < watch && tick < most_ticks; ++tick) {
    if (since >= 0 || script.begins(tick, run)) ++since;
    const bool first = since == 0;
    if (first) out.ran = loop.word().powered;
    loop.begin_tick(since);
    if (const Operator o = script.at(tick, run, latched); o != Operator::nothing) pending = o;
    const bool gone = loop.active(Injected::computer_gone), passes = loop.word().ticked && !gone;
    Operator order = passes ? std::exchange(pending, Operator::nothing) : Operator::nothing;
    order = loop.send_order(order);
    loop.publish(first);
    loop.control(order);
    // The controller then has to notice, and to come to rest as after the command halt.
    if (gone && since == injection.notice_ticks) order = Operator::halt;
    loop.deliver(tick);
    judge.look(tick, order, loop.word(), plant, loop.bus(), first);
    if (latched >= 0 || loop.word().faulted) ++latched;
    const auto now = plant.motion().output();
    digest.add(now.q);
    digest.add(now.qd);
    for (std::size_t i = 0; i < plant.motors(); ++i) digest.add(std::array{plant.motor(i).torque});
    if (trace != nullptr) trace->push_back(loop.line(tick));
    loop.advance(tick);
    if (run >= 0 || plant.released()) ++run;
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

template <class Traits>
int EpisodeKind<Traits>::arming_ticks() const {
  constexpr int looks_ahead = 16;  // as the controller does when it joins
  const int patience = std::max(2000, static_cast<int>(2.0 * scene_.rate_hz));
  const Injection nothing{.row = &injection_rows()[0]};
  EpisodeLoop<Traits> loop(*this, nothing);
  int armed = -1;
  for (int tick = 0; armed < 0 || tick <= armed + times_.join_ticks + looks_ahead; ++tick) {
    if (armed < 0 && tick >= patience) throw RunError(scene_.name + ": the drives do not arm");
    const auto n = static_cast<std::uint64_t>(tick);
    loop.begin_tick(-1);
    const Operator order = loop.send_order(tick == 0 ? Operator::enable : Operator::nothing);
    loop.publish(false);
    if (armed < 0 && loop.plant().released()) armed = tick;
    loop.control(order);
    if (loop.word().fault != "none") {
      throw RunError(fmt::format("{}: {} before anything is done to the loop: a campaign needs one that runs",
                                 scene_.name, loop.word().fault));
    }
    loop.deliver(n);
    loop.advance(n);
  }
  return armed;
}

}  // namespace esmc::host
