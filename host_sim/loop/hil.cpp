#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <vector>

#include "host_sim/bus/host_bus.hpp"
#include "host_sim/bus/timed_bus.hpp"
#include "host_sim/loop/accuracy.hpp"
#include "host_sim/loop/controller_end.hpp"
#include "host_sim/loop/plant_end.hpp"
#include "host_sim/loop/progress.hpp"
#include "host_sim/loop/run.hpp"
#include "host_sim/record/finish.hpp"

namespace esmc::host {
namespace {

using Json = nlohmann::ordered_json;

/// The frames of a tick on a bus that delivers every frame.
template <class Plant, class Controller>
class DirectExchange {
 public:
  DirectExchange(Plant& plant, Controller& controller, std::string interface)
      : plant_(plant), controller_(controller), interface_(std::move(interface)) {}

  void samples() {
    plant_.publish();
    if (controller_.await_samples() != Waited::silent || stop_requested()) return;
    controller_.shut_down();
    if (controller_.malformed())
      throw RunError("the drives send frames that are not of their protocol: malformed_frame");
    throw RunError("the drives' frames did not reach the controller within 5 s: lost on " + interface_ + "?");
  }
  /// False: Ctrl-C.
  bool torques() {
    const bool all = plant_.await_torques();
    if (!all) (void)plant_.await_last_torques();
    plant_.advance(controller_.view());
    return all;
  }
  /// After an overload it is unknown which tick the next samples belong to.
  [[nodiscard]] bool ended() const { return controller_.overloaded(); }
  bool idle_tick() {
    (void)plant_.await_last_torques();
    plant_.publish();
    return controller_.await_last_samples();
  }
  void close() {
    controller_.shut_down([] { return false; });
    plant_.drain();
  }
  void report(RunEnd&) const {}

 private:
  Plant& plant_;
  Controller& controller_;
  std::string interface_;
};

/// The bus part of the summary of a run on a bus with effects.
BusSummary timed_bus_summary(TimedBus& bus, const Scene& scene, std::uint64_t frames) {
  Json messages = Json::array(), nodes = Json::array();
  auto latencies = bus.latencies();
  std::ranges::sort(latencies, {}, [](const TimedBus::Latency& l) { return std::pair(l.extended, l.id); });
  for (const TimedBus::Latency& l : latencies) {
    messages.push_back({{"id", l.id},
                        {"extended", l.extended},
                        {"count", l.frames},
                        {"latency_mean_s", bus.seconds(l.sum) / static_cast<double>(l.frames)},
                        {"latency_max_s", bus.seconds(l.largest)}});
  }
  for (std::size_t i = 0; i <= scene.drives.nodes.size(); ++i) {
    constexpr const char* states[] = {"active", "passive", "off"};
    const ErrorCounters e = bus.counters(i);
    nodes.push_back({{"name", i == 0 ? "controller" : fmt::format("drive {}", i)},
                     {"error_state", states[static_cast<int>(e.state())]},
                     {"tec", e.transmit()},
                     {"rec", e.receive()}});
  }
  const TimedBus::Counts& c = bus.counts();
  const Json more = {{"timed", find_effect<BitTiming>(scene.effects).has_value()},
                     {"errors", c.errors},
                     {"missed", c.missed},
                     {"duplicated", c.duplicated},
                     {"corrupted", c.corrupted},
                     {"messages", std::move(messages)},
                     {"nodes", std::move(nodes)}};
  const double load =
      bus.now() > 0 ? static_cast<double>(bus.busy_bits()) / static_cast<double>(bus.now()) : 0.0;
  return {frames, c.refused, load, std::make_shared<Json>(more)};
}

/// The frames of a tick on a bus with effects: frames take time or get lost, so a tick has a deadline.
///
///   samples   every drive asks its node to send; until the sample of every axis has arrived, or no node
///             has a frame left to send, or the tick is over
///   (tick)    with the samples received; missing ones are extrapolated up to limits.max_age_ticks
///   torques   until the tick is over; each torque acts from the instant at which the drive received it
///
/// A frame that comes later than its tick is read in the next as if it belonged to it: frames carry no time.
/// It does not make the controller tick earlier.
template <class World>
class TimedExchange {
 public:
  using Plant = PlantEnd<World, BusPort>;
  using Controller = ControllerEnd<World, BusPort>;

  /// All outlive this.
  TimedExchange(const Scene& scene, TimedBus& bus, BusPort& port, Plant& plant, Controller& controller,
                FrameLog& frames)
      : scene_(scene), bus_(bus), port_(port), plant_(plant), controller_(controller), frames_(frames) {}

  /// Begins a tick, up to the controller's samples.
  void samples() {
    begin();
    const auto awaited = [](const auto& report) { return report.has_value(); };
    while (std::ranges::any_of(due_, awaited) && !bus_.quiet() && step()) {
    }
    controller_.receive();
  }
  /// The rest of the tick, and the motion over it. Never interrupted.
  bool torques() {
    rest();
    plant_.advance(commands_, controller_.view());
    return true;
  }
  /// An overload makes the samples late, not the loop meaningless.
  [[nodiscard]] static bool ended() { return false; }
  /// One tick more in which time passes for the drives only.
  bool idle_tick() {
    rest();
    samples();
    return true;
  }
  /// After the last tick of a run that was not stopped.
  void close() {
    controller_.shut_down([&] { return idle_tick(); });
  }
  void report(RunEnd& end) const {
    end.bus = timed_bus_summary(bus_, scene_, frames_.frames());
    end.histograms = {{"Feedback latency",
                       "drives' frames, from the request to send to the last bit; virtual time", feedback_},
                      {"Command latency", "controller's frames, likewise", command_}};
  }

 private:
  void begin() {
    const bool released = plant_.released();
    begin_ = end_;
    end_ = std::llround(static_cast<double>(++ticks_) * scene_.tick() * static_cast<double>(scene_.bitrate));
    frames_.begin_tick(bus_.seconds(begin_));
    // The last frame that an axis sends in publish() is its report of the tick.
    due_.assign(plant_.plant().axes().size(), std::nullopt);
    plant_.plant().publish_from([&](std::size_t axis, const hal::CanFrame& f) {
      const bool taken = bus_.send(axis + 1, f) == hal::SendStatus::ok;
      due_[axis] = taken ? std::optional(arbitration(f)) : std::nullopt;
    });
    plant_.require_armed_in_time();
    if (plant_.released() && !released) bus_.begin_run();
    commands_.assign(1, {0.0, plant_.plant().asked()});
  }
  void rest() {
    while (step()) {
    }
  }
  /// The next frame; false: the tick is over.
  bool step() {
    const auto d = bus_.next(end_);
    if (!d) return false;
    frames_.frame_at(bus_.seconds(d->at), d->bits, d->frame);
    const bool to_controller = (d->receivers & 1U) != 0;
    (to_controller ? feedback_ : command_).add(bus_.seconds(d->at - d->asked));
    if (to_controller) port_.deliver(d->frame);
    for (auto& report : due_) {
      if (d->asked >= begin_ && report == arbitration(d->frame)) report.reset();
    }
    auto& plant = plant_.plant();
    const auto reply = [&](std::size_t axis, const hal::CanFrame& f) { (void)bus_.send(axis + 1, f); };
    for (std::size_t i = 0; i < plant.axes().size(); ++i) {
      if ((d->receivers >> (i + 1) & 1U) != 0) plant.hand_over(i, d->frame, reply);
    }
    const auto asked = plant.asked();
    if (asked != commands_.back().torque) commands_.push_back({bus_.seconds(d->at - begin_), asked});
    return true;
  }

  const Scene& scene_;
  TimedBus& bus_;
  BusPort& port_;
  Plant& plant_;
  Controller& controller_;
  FrameLog& frames_;
  TimedBus::Time begin_ = 0, end_ = 0;
  std::uint64_t ticks_ = 0;
  std::vector<typename Plant::TorqueCommand> commands_;  ///< of the tick
  Histogram feedback_, command_;
  std::vector<std::optional<std::uint32_t>> due_;  ///< arbitration of each axis' report, until it has arrived
};

/// How a run is used: it counts, or is a pass of the search for an accuracy, which takes q from it.
struct Use {
  std::optional<AccuracyReport> accuracy{};  ///< of the run that counts
  Pass* pass = nullptr;                      ///< null: the run counts
};

/// Both ends in one process, in lockstep. `exchange` carries the frames of each tick between them.
template <class Plant, class Controller, class Exchange>
int run_lockstep(const Scene& scene, const RunOptions& o, BusRunFiles& files, Plant& plant,
                 Controller& controller, Exchange& exchange, const Use& use) {
  const auto begin = std::chrono::steady_clock::now();
  const auto idle_tick = [&] { return exchange.idle_tick(); };
  bool stop = false, ended = false;
  Progress progress(o.capture == nullptr ? tick_count(scene) : 0);
  const std::uint32_t stride = row_stride(scene, tick_count(scene));
  while (!plant.finished() && !stop && !ended) {
    progress.at(plant.done());
    if (use.pass != nullptr && plant.done() % stride == 0) use.pass->add(plant.plant().motion().output().q);
    exchange.samples();
    stop = must_stop(o, plant.done() + (plant.released() ? 1U : 0U));
    ended = exchange.ended();
    if (stop) controller.stop();
    controller.tick(true);
    if (!plant.released() && !armed_by_link(scene)) controller.require_armed(idle_tick);
    stop = !exchange.torques() || stop;
  }
  RunEnd end = plant.end(begin);
  end.interrupted = stop;
  end.accuracy = use.accuracy;
  if (use.pass != nullptr) {
    require_finite(end.q, scene.duration);
    use.pass->add(end.q);
    use.pass->effort = end.effort;
    use.pass->interrupted = stop;
  }
  exchange.report(end);
  if (stop) controller.shut_down(idle_tick);
  set_outcome(end, controller.supervisor(), controller.fault());
  end.surfaces = controller.surfaces();
  end.odd_encoder = controller.reports().odd_encoder();
  if (!stop) exchange.close();
  if (use.pass != nullptr) return 0;
  return finish_run(o, scene, "hil", plant.recorder(), end, files);
}

template <class World, class C = typename World::Mechanism, class PlantBus, class ControlBus>
int run_direct(const Scene& scene, const RunOptions& o, PlantBus& plant_bus, ControlBus& control_bus,
               const std::string& interface, const Use& use) {
  BusRunFiles files(o, scene, interface);
  PlantEnd<World, PlantBus> plant(scene, o, plant_bus, files.frames, files.log, true);
  ControllerEnd<World, ControlBus, C> controller(scene, Pacing::lockstep, control_bus);
  DirectExchange exchange(plant, controller, interface);
  return run_lockstep(scene, o, files, plant, controller, exchange, use);
}

template <class World>
int run_timed(const Scene& scene, const RunOptions& o, const Use& use) {
  BusRunFiles files(o, scene, "virtual");
  TimedBus bus({scene.drives.nodes.size(), static_cast<double>(scene.bitrate), scene.effects, scene.seed,
                scene.data_bitrate > 0 ? scene.fast_bit() : 0.0});
  BusPort port(bus, TimedBus::controller);
  PlantEnd<World, BusPort> plant(scene, o, port, files.frames, files.log, true);
  ControllerEnd<World, BusPort> controller(scene, Pacing::lockstep, port);
  TimedExchange<World> exchange(scene, bus, port, plant, controller, files.frames);
  return run_lockstep(scene, o, files, plant, controller, exchange, use);
}

/// On the virtual bus.
template <class World>
int run_virtual(const Scene& scene, const RunOptions& o, const Use& use) {
  if (std::ranges::any_of(scene.effects, acts_on_bus)) return run_timed<World>(scene, o, use);
  const std::string interface = o.again.comparison != nullptr ? o.again.interface : "virtual";
  const auto bus = std::make_unique<hal::VirtualBus<2>>();
  if (o.single_precision) {
    return run_direct<World, typename World::SinglePrecision>(scene, o, bus->port(0), bus->port(1), interface,
                                                              use);
  }
  return run_direct<World>(scene, o, bus->port(0), bus->port(1), interface, use);
}

/// Passes without files until two agree; the run that counts repeats the last one.
template <class World>
int run_to_accuracy(Scene scene, const RunOptions& o) {
  if (o.realtime || o.bus != "virtual") throw InputError(scene.simulation_where, no_accuracy_on_bus);
  if (constexpr double least = 1e-6; *scene.accuracy < least) {
    throw RunError(fmt::format(
        "accuracy = {} cannot be met on a bus, {} can: its frames carry angles and rates as 32-bit floats",
        *scene.accuracy, least));
  }
  RunOptions quiet = o;
  quiet.out.clear();
  quiet.mcap.clear();
  quiet.log = {};
  quiet.again = {};
  quiet.capture = nullptr;
  const AccuracyReport report = meet_accuracy(scene, World::Plant::outputs, [&](const Scene& s, bool) {
    Pass pass;
    (void)run_virtual<World>(s, quiet, {{}, &pass});
    return pass;
  });
  return run_virtual<World>(scene, o, {report, nullptr});
}

template <class World>
int run_hil(const Scene& scene, const RunOptions& o) {
  require_reachable<World>(scene, o.realtime ? Pacing::realtime : Pacing::lockstep);
  const bool on_bus = std::ranges::any_of(scene.effects, acts_on_bus);
  if (on_bus && (o.realtime || o.bus != "virtual")) refuse_bus_effects(scene, no_effects_on_interface);
  if (o.single_precision && (on_bus || o.realtime || o.bus != "virtual"))
    throw InputError("", "--scalar float: only in lockstep on the virtual bus without effects of the bus");
  if (scene.accuracy) return run_to_accuracy<World>(scene, o);
  if (o.realtime) return run_hil_realtime(scene, o);
  if (o.bus == "virtual") return run_virtual<World>(scene, o, {});
  BusEnds ends = open_both_ends(o.bus, scene.bitrate, scene.data_bitrate > 0);
  return run_direct<World>(scene, o, ends.plant, ends.control, ends.plant.interface(), {});
}

}  // namespace

int run_hil(const RunOptions& o) {
  const Scene scene = read_loop_scene(o, true);
  require_confirmed(scene);
  return with_world(scene, [&]<class World>(World) { return run_hil<World>(scene, o); });
}

}  // namespace esmc::host
