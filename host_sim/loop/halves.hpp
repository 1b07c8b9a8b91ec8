#pragma once
/// The two halves of hardware in the loop, each on its own CAN node: used in one process (hil) or in two.

#include <algorithm>
#include <chrono>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "host_sim/bus/frame_log.hpp"
#include "host_sim/controller/axes_config.hpp"
#include "host_sim/controller/in_double.hpp"
#include "host_sim/drives/plant_node.hpp"
#include "host_sim/loop/progress.hpp"
#include "host_sim/loop/waiting.hpp"
#include "host_sim/record/recorder.hpp"
#include "host_sim/record/run_options.hpp"
#include "host_sim/scene/read_effects.hpp"

namespace esmc::host {

inline constexpr int silence_ms = 5000;  ///< without a word from the other half: the run has failed
inline constexpr int parting_ms = 20;    ///< per tick, for the other half after a stop
inline constexpr const char* gone_text = "the slcan adapter is gone: unplugged, or closed at its other end";
/// s (in lockstep: of virtual time) until the plant gives up that its drives are armed: longer than the
/// controller tries, and a supervisor computer is given longer still.
[[nodiscard]] inline double arming_time_max(const Scene& s) {
  return armed_by_link(s) ? 60.0 : enabling_time_max(s) + 1.0;
}

/// Why a scene that esmc sim runs cannot run on a bus; empty: it can.
struct BusObstacle {
  std::string where, what;
};
BusObstacle bus_obstacle(const Scene& scene);
/// What decides over torque, cannot be read back from these drives and must be checked by hand; one line.
std::string to_confirm(const Scene& scene);
/// Throws InputError that says what to confirm, where the scene does not and must.
void require_confirmed(const Scene& scene);
/// Reads a scene for a command with a bus in it; open_loop and none are refused.
Scene read_loop_scene(const RunOptions& o);
/// Throws RunError if `f` announces a controller with this scene's command.base_id that was made from another
/// scene.
void require_same_scene(const Scene& scene, const hal::CanFrame& f);

/// Waits for the other half: until `done`, Ctrl-C or the end of our patience. Throws RunError when the bus is
/// gone.
template <class Bus, class Done>
Waited wait_for(Bus& bus, const Done& done, int patience_ms = silence_ms) {
  const Waited w = wait_until(
      bus, done, [&] { return stop_requested().load() || is_gone(bus); },
      std::chrono::milliseconds(patience_ms));
  if (w != Waited::done && is_gone(bus)) throw RunError(gone_text);
  return w;
}

/// What the plant hears, and from whom.
template <hal::CanBus Bus>
class PlantTap : public Tapped<Bus> {
 public:
  PlantTap(Bus& bus, FrameLog& log, const Scene& scene) : Tapped<Bus>(bus, log), scene_(scene) {}
  [[nodiscard]] bool try_receive(hal::CanFrame& f) {
    if (!Tapped<Bus>::try_receive(f)) return false;
    require_same_scene(scene_, f);
    return true;
  }

 private:
  const Scene& scene_;
};

template <class World, class Bus>
class PlantHalf {
 public:
  using Plant = typename World::Plant;
  using M = typename World::Mechanism;
  using Joints = typename Plant::Joints;

  PlantHalf(const Scene& scene, const RunOptions& o, Bus& bus, FrameLog& frames, std::FILE* log,
            bool with_controller)
      : scene_(scene),
        options_(o),
        tap_(bus, frames, scene),
        frames_(frames),
        recorder_(scene, o.realtime ? Pacing::realtime : Pacing::lockstep, log, with_controller),
        node_(make_motion<World>(scene), scene, !o.realtime),
        ticks_(tick_count(scene)),
        substeps_(std::max(1, static_cast<int>(std::ceil(scene.tick() / scene.step - 1e-9)))) {}

  [[nodiscard]] Recorder<World>& recorder() { return recorder_; }
  [[nodiscard]] bool released() const { return node_.released(); }
  [[nodiscard]] bool finished() const { return done_ >= ticks_; }
  [[nodiscard]] std::uint32_t done() const { return done_; }
  [[nodiscard]] int substeps() const { return substeps_; }

  void publish() {
    frames_.begin_tick(node_.time());
    node_.publish(tap_);
    look_at_arming();
  }
  [[nodiscard]] PlantNode<Plant>& node() { return node_; }
  /// Throws RunError when the drives take too long to arm.
  void look_at_arming() const {
    if (!node_.released() && node_.time() > arming_time_max(scene_)) {
      throw RunError(fmt::format("the drives were not in closed-loop control after {} s of virtual time",
                                 arming_time_max(scene_)));
    }
  }
  /// False: Ctrl-C. Throws RunError when the controller says nothing.
  bool await_torques() {
    switch (wait_for(tap_.bus(), [&] { return node_.collect(tap_), node_.answered(); })) {
      case Waited::done:
        return true;
      case Waited::stopped:
        return false;
      case Waited::silent:
        break;
    }
    throw RunError("the controller sent no torque command for 5 s (controller dead or not started)");
  }
  /// After Ctrl-C: the same for a short time, and nobody is blamed.
  bool await_last_torques() {
    return wait_until(
               tap_.bus(), [&] { return node_.collect(tap_), node_.answered(); }, [] { return false; },
               std::chrono::milliseconds(parting_ms)) == Waited::done;
  }
  /// Frames that wait, without waiting for more: how many of them a controller sent to our drives.
  int drain() {
    tap_.look();
    return node_.drain(tap_);
  }

  /// Records the tick (from t = 0 on) and moves to the next.
  void advance(const ControllerView<M>& seen) {
    if (!node_.released()) return;
    bool clipped = false;
    const Joints torque = node_.torque(scene_.tick(), clipped);
    disarmed_ = disarmed_ || node_.disarmed();
    recorder_.tick(done_, node_.motion(), torque, clipped, seen, disarmed_);
    node_.advance(done_ * scene_.tick(), scene_.tick(), scene_.tick() / substeps_, torque);
    ++done_;
  }
  /// What the drives were told, from an instant of the tick on.
  struct TorqueCommand {
    double since;  ///< s since the tick began
    Joints torque;
  };
  /// The same where torques arrive within the tick. The first of `told` holds from its beginning; what holds
  /// at its end is what is recorded.
  void advance(std::span<const TorqueCommand> told, const ControllerView<M>& seen) {
    if (!node_.released()) return;
    bool clipped = false;
    delivered_.clear();
    const auto length = [&](std::size_t i) {
      return (i + 1 < told.size() ? told[i + 1].since : scene_.tick()) - told[i].since;
    };
    for (std::size_t i = 0; i < told.size(); ++i)
      delivered_.push_back(node_.deliver(told[i].torque, length(i), clipped));
    disarmed_ = disarmed_ || node_.disarmed();
    recorder_.tick(done_, node_.motion(), delivered_.back(), clipped, seen, disarmed_);
    for (std::size_t i = 0; i < told.size(); ++i) {
      if (length(i) > 0.0) {
        node_.advance(done_ * scene_.tick() + told[i].since, length(i), scene_.tick() / substeps_,
                      delivered_[i]);
      }
    }
    ++done_;
  }
  /// Real time: a part of the tick, with whatever torque is in force.
  void advance_part(int part, bool record, const ControllerView<M>& seen) {
    if (!node_.released()) return;
    bool clipped = false;
    const double part_s = scene_.tick() / substeps_;
    const Joints torque = node_.torque(part_s, clipped);
    disarmed_ = disarmed_ || node_.disarmed();
    if (record) recorder_.tick(done_, node_.motion(), torque, clipped, seen, disarmed_);
    node_.advance(done_ * scene_.tick() + part * part_s, part_s, part_s, torque);
    if (part + 1 == substeps_) ++done_;
  }
  RunEnd end(std::chrono::steady_clock::time_point begin) {
    RunEnd e;
    e.wall_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    const auto o = node_.motion().output();
    e.q.assign(o.q.begin(), o.q.end());
    e.qd.assign(o.qd.begin(), o.qd.end());
    e.state_dimension = node_.state_dimension();
    e.method = node_.motion().method();
    e.seed = options_.seed;
    const double bus_time = node_.time();
    e.bus =
        BusSummary{frames_.frames(), tap_.lost(),
                   bus_time > 0.0 ? static_cast<double>(frames_.bits()) / (scene_.bitrate * bus_time) : 0.0};
    e.load = frames_.load();
    e.load_ticks = e.load.ticks() > done_ ? e.load.ticks() - done_ + 1 : 0;
    e.final_state = disarmed_ ? "drives_disarmed" : "drives_armed";
    if (disarmed_)
      e.faults.emplace_back(fmt::format("drives_disarmed (axis errors 0x{:x})", node_.drive_errors()));
    if (!disarmed_ && node_.timed_out()) e.faults.emplace_back(e.final_state = "drives_timed_out");
    Statistics& s = recorder_.statistics();
    s.energy_error = larger(s.energy_error, node_.motion().energy_error());
    return e;
  }

 private:
  const Scene& scene_;
  const RunOptions& options_;
  PlantTap<Bus> tap_;
  FrameLog& frames_;
  Recorder<World> recorder_;
  PlantNode<Plant> node_;
  std::uint32_t ticks_, done_ = 0;
  int substeps_;
  bool disarmed_ = false;
  std::vector<Joints> delivered_;
};

/// C: the mechanism in the controller's scalar type.
template <class World, class Bus, class C = typename World::Mechanism>
class ControllerHalf {
 public:
  using M = typename World::Mechanism;
  using S = typename C::Scalar;

  ControllerHalf(const Scene& scene, Pacing pacing, Bus& bus)
      : reference_(make_reference<S>(scene, pacing)),
        bus_(bus),
        lockstep_(pacing == Pacing::lockstep),
        axis_count_(static_cast<int>(scene.drives.nodes.size())),
        endpoints_(scene.drives.endpoints),
        parting_ticks_(static_cast<int>(
                           std::ceil(std::clamp(scene.drives.heartbeat_timeout, 0.05, 1.0) * scene.rate_hz)) +
                       1),
        cycle_(make_cycle<C>(scene, pacing, reference_)) {
    for (std::size_t i = 0; i < static_cast<std::size_t>(scene.motors()); ++i) {
      motors_.emplace_back(static_cast<int>(axis_of(scene, i)), scene.drives.nodes[i]);
    }
    if (!armed_by_link(scene)) with([](auto& c) { c.command(Command::enable); });
  }

  [[nodiscard]] const Supervisor& supervisor() const {
    return with([](const auto& c) -> const Supervisor& { return c.supervisor(); });
  }
  [[nodiscard]] const Sample<M>& sample() const {
    if constexpr (std::is_same_v<C, M>) {
      return with([](const auto& c) -> const Sample<M>& { return c.sample(); });
    } else {
      return sample_;
    }
  }
  /// Some drive has said something; more came in a tick than it may read.
  [[nodiscard]] bool heard() const {
    return with([](const auto& c) { return c.heard(); });
  }
  [[nodiscard]] bool overloaded() const {
    return with([](const auto& c) { return c.overloaded(); });
  }
  [[nodiscard]] const TickResult<M>& result() const { return result_; }
  /// Joint whose encoder contradicts the others, after a fault loop_not_closed; empty: not known.
  [[nodiscard]] std::string odd_encoder() const {
    const int odd = with([](const auto& c) -> int { return c.controller().odd_encoder(); });
    return supervisor().fault() == Fault::loop_not_closed && odd != 0 ? World::joint_names[odd - 1] : "";
  }
  /// Why it did not arm: the fault and, where a drive said so, its node and object.
  [[nodiscard]] std::string refusal() const {
    std::string out = name(supervisor().fault());
    if (supervisor().fault() == Fault::enabling_timeout && !unready().empty())
      out += " (not ready: " + unready() + ")";
    if (!odd_encoder().empty()) out += " (the encoder of " + odd_encoder() + " contradicts the others)";
    with([&](const auto& c) {
      for (int i = 0; i < axis_count_; ++i) {
        if constexpr (requires { c.axis(i).encoder_unconnected(); }) {
          const bool motor = std::ranges::any_of(motors_, [&](const auto& m) { return m.first == i; });
          if (!motor && c.axis(i).encoder_unconnected()) {
            out += fmt::format(
                " (node {} reports position 0, as firmware 0.5.6 does until its first closed loop: no "
                "passive "
                "encoder)",
                c.axis(i).node());
          }
        }
        if constexpr (requires { c.axis(i).refused_endpoint(); }) {
          if (const auto e = c.axis(i).refused_endpoint()) {
            out += fmt::format(" (node {}, {})", c.axis(i).node(), endpoint_path(*e));
          }
        }
        if constexpr (requires { c.axis(i).contradicting_object(); }) {
          if (const auto o = c.axis(i).contradicting_object()) {
            out += fmt::format(" (node {}, object {:04X}:{:02X})", c.axis(i).node(), o->index, o->sub);
          }
        }
      }
    });
    return out;
  }
  /// "node 1, node 2": the motors' drives that have not confirmed torque control.
  [[nodiscard]] std::string unready() const {
    std::string out;
    with([&](const auto& c) {
      for (const auto& [axis, node] : motors_) {
        if (c.axis(axis).ready()) continue;
        out += fmt::format("{}node {}{}", out.empty() ? "" : ", ", node,
                           c.axis(axis).alive() ? "" : " (silent)");
      }
    });
    return out;
  }
  [[nodiscard]] ControllerView<M> view() const { return {&result_, &sample(), std::is_same_v<C, M>}; }

  /// Takes frames until every axis has sent its sample, or more came than a tick may read: that is a set as
  /// well, for a tick that raises bus_overload.
  Waited await_set() {
    return wait_for(bus_, [&] { return take_set(); });
  }
  /// Asks the drives to arm until one of ours is heard, whoever else speaks on the bus. Silent: after 5 s.
  Waited await_drives(std::chrono::milliseconds retry) {
    const auto answered = [&] { return receive(), heard() || overloaded(); };
    const auto give_up = std::chrono::steady_clock::now() + std::chrono::milliseconds(silence_ms);
    Waited w = Waited::silent;
    while (w == Waited::silent && std::chrono::steady_clock::now() < give_up) {
      request_arming();
      if (supervisor().state() == State::fault) return Waited::done;
      w = wait_for(bus_, answered, static_cast<int>(retry.count()));
    }
    return w;
  }
  void receive() {
    with([&](auto& c) { c.receive(bus_); });
  }
  void tick(bool answer) {
    with([&](auto& c) {
      if constexpr (std::is_same_v<C, M>) {
        result_ = c.tick(bus_, answer);
      } else {
        result_ = in_double<M, C>(c.tick(bus_, answer));
        sample_ = in_double<M, C>(c.sample());
      }
      if (lockstep_) c.request(bus_);
    });
  }
  /// Against the clock a tick begins with this: takes what has come and, where the drives sample on demand,
  /// asks them and waits for their answers, no longer than `patience`.
  void sample(std::chrono::microseconds patience) {
    if constexpr (requires { bus_.look(); }) bus_.look();
    receive();
    if (!with([](const auto& c) { return c.samples_on_demand; })) return;
    with([&](auto& c) { c.request(bus_); });
    const auto deadline = std::chrono::steady_clock::now() + patience;
    while (!take_set() && std::chrono::steady_clock::now() < deadline) (void)wait_for_frame(bus_, 0);
  }
  /// Asks the drives to arm without being asked for a torque: nobody is there yet.
  void request_arming() {
    with([](auto& c) { c.ask_again(); });
    tick(false);
  }
  void stop() {
    with([](auto& c) { c.command(Command::stop); });
  }
  /// Zero torque and idle, again and again, until every drive has said that it is idle. `next` brings about
  /// the next tick; when it says false, or a drive has been silent for too long, there is nobody to wait for.
  template <class Next>
  void part(const Next& next) {
    stop();
    tick(true);
    bool more = true;
    for (int n = 0; more && !at_rest() && n < parting_ticks_; ++n) {
      more = next();
      tick(true);
    }
  }
  /// The same when only the other half can bring about a tick.
  void shut_down() {
    part([&] { return await_last_set(); });
  }
  /// After a stop: a set, but only for a short time.
  bool await_last_set() {
    return wait_until(
               bus_, [&] { return take_set(); }, [] { return false; },
               std::chrono::milliseconds(parting_ms)) == Waited::done;
  }

 private:
  [[nodiscard]] bool at_rest() const {
    return (supervisor().state() == State::disabled || supervisor().state() == State::fault) &&
           with([](const auto& c) { return c.all_idle(); });
  }
  bool take_set() {
    receive();
    return with([](const auto& c) { return c.complete() || c.overloaded(); });
  }
  template <class F>
  decltype(auto) with(F&& f) {
    return std::visit(std::forward<F>(f), cycle_);
  }
  template <class F>
  decltype(auto) with(F&& f) const {
    return std::visit(std::forward<F>(f), cycle_);
  }

  ReferenceBundle<S> reference_;
  Bus& bus_;
  bool lockstep_;
  /// The vendor's name of an endpoint of the scene.
  [[nodiscard]] std::string endpoint_path(std::uint16_t id) const {
    if (id == drive::OdriveReadBack::version_endpoint) return "version of the firmware";
    if (endpoints_) {
      for (const OdriveEndpoint& e : endpoints_->list) {
        if (e.id == id) return odrive_values[static_cast<std::size_t>(e.value)].path;
      }
    }
    return fmt::format("endpoint {}", id);
  }

  std::vector<std::pair<int, int>> motors_;  // axis and node of each
  int axis_count_;
  std::optional<OdriveEndpoints> endpoints_;
  int parting_ticks_;
  AnyCycle<C> cycle_;
  TickResult<M> result_{};
  Sample<M> sample_{};  // of a controller in another scalar type
};

}  // namespace esmc::host
