/// The two ends as processes of their own, and both in one process against the wall clock: there each has its
/// own ticks at absolute instants, as drives and a board have. A torque acts from the moment it arrives (to
/// within one integration step), one tick late at most.

#include <fmt/format.h>

#include <atomic>
#include <chrono>
#include <exception>
#include <string>
#include <thread>
#include <vector>

#include "host_sim/bus/host_bus.hpp"
#include "host_sim/bus/response.hpp"
#include "host_sim/error.hpp"
#include "host_sim/loop/controller_end.hpp"
#include "host_sim/loop/plant_end.hpp"
#include "host_sim/loop/progress.hpp"
#include "host_sim/loop/run.hpp"
#include "host_sim/loop/waiting.hpp"
#include "host_sim/record/finish.hpp"
#include "host_sim/record/recorder.hpp"

namespace esmc::host {
namespace {

/// Log and summary of a controller on its own: measurements, references, commands. The true motion is known
/// elsewhere, so the summary has no closure, energy or digest.
template <class World>
class ControllerRecorder {
 public:
  using M = typename World::Mechanism;

  ControllerRecorder(const Scene& scene, const LogSink& log)
      : scene_(scene),
        log_(log, columns(scene), tick_count(scene)),
        mechanism_(params_of<M>(believed_mechanism(scene))),
        mode_(mode_of<M>(scene)),
        torque_(static_cast<std::size_t>(scene.motors())) {
    statistics_.has_truth = false;
  }

  [[nodiscard]] std::uint64_t ticks() const { return statistics_.ticks(); }
  /// Since the drives were released: with the ticks of the sign test, which are not recorded.
  [[nodiscard]] std::uint64_t ticks_released() const { return ticks_released_; }
  /// Throws RunError for a run that ended within the sign test.
  void require_run() const {
    if (tested_only()) throw RunError("the sign test was not over within simulation.duration");
  }
  [[nodiscard]] bool tested_only() const { return ticks() == 0 && ticks_released_ > 0; }
  [[nodiscard]] const Statistics& statistics() const { return statistics_; }
  [[nodiscard]] Log& log() { return log_; }

  /// Ticks before the controller runs are not recorded; from then on every one is, faults included.
  /// `delay_s`: from the instant of the tick to the last frame it sent; 0 where a tick takes no time.
  void tick(const TickResult<M>& r, const Sample<M>& sample, double delay_s = 0.0) {
    started_ = started_ || r.state == State::running;
    if (started_ || r.state == State::testing) ++ticks_released_;
    if (!started_) return;
    const std::vector<double> q = pose(sample);
    TickRecord record;
    record.t = static_cast<double>(ticks()) * scene_.tick();
    for (std::size_t i = 0; i < torque_.size(); ++i)
      torque_[i] = r.torque[ControllerConfig<M>::joint_of(static_cast<int>(i), scene_.motors())];
    record.torque = torque_;
    record.saturated = r.saturated;
    record.faulted = r.fault != Fault::none;
    record.has_reference = r.state == State::running;
    record.reference = {r.desired_effector.x(), r.desired_effector.y()};
    record.effector_error =
        std::hypot(r.effector.x() - r.desired_effector.x(), r.effector.y() - r.desired_effector.y());
    const Vec2<double> base = r.desired_base();
    for (int i = 0; i < 2; ++i) {
      const int joint = ControllerConfig<M>::joint_of(i, 2);
      record.base_error[static_cast<std::size_t>(i)] = wrap_to_pi(sample.angle[joint] - base[i]);
    }
    statistics_.add(record);
    for (int i = 0; i < M::joints; i += step()) {
      const auto u = static_cast<std::size_t>(i);
      feedback_.add(sample.age_ticks[u] * scene_.tick() + sample.phase[u]);
    }
    command_.add(delay_s);
    if (!log_.wanted()) return;
    row_.assign({record.t, r.effector.x(), r.effector.y()});
    row_.insert(row_.end(), q.begin(), q.end());
    row_.insert(row_.end(), torque_.begin(), torque_.end());
    row_.insert(row_.end(), {r.desired_effector.x(), r.desired_effector.y(), base[0], base[1]});
    for (int i = 0; i < M::channels; ++i) row_.push_back(r.sliding[i]);
    for (int i = 0; i < M::joints; i += step()) row_.push_back(sample.rate[i]);
    for (int i = 0; i < M::joints; i += step()) {
      row_.push_back(sample.age_ticks[static_cast<std::size_t>(i)]);
      row_.push_back(sample.phase[static_cast<std::size_t>(i)]);
    }
    row_.push_back(delay_s);
    log_.row(row_, name(r.state));
  }

  /// The end of a run that began at `begin`.
  template <class Controller>
  RunEnd end(std::chrono::steady_clock::time_point begin, std::uint64_t seed, const Controller& controller,
             const BusSummary& bus) const {
    RunEnd e;
    e.wall_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    e.seed = seed;
    set_outcome(e, controller.supervisor(), controller.fault());
    e.surfaces = controller.surfaces();
    e.bus = bus;
    e.histograms = latencies();
    return e;
  }
  /// Latencies as the controller sees them; none in lockstep, where a tick takes no time.
  [[nodiscard]] std::vector<NamedHistogram> latencies() const {
    if (!(command_.largest() > 0.0)) return {};
    return {{"Feedback latency", "from the arrival of a sample to the instant of the tick that uses it",
             feedback_},
            {"Command latency", "from the instant of a tick to the last frame that it sent", command_}};
  }

 private:
  [[nodiscard]] int step() const { return scene_.all_sensors ? 1 : M::joints / 2; }
  static std::vector<std::string> columns(const Scene& s) {
    std::vector<std::string> c{"t", "x", "y"};
    for (const char* n : World::joint_names) c.emplace_back(n);
    for (int i = 0; i < s.motors(); ++i) {
      c.emplace_back(
          World::torque_names[static_cast<std::size_t>(ControllerConfig<M>::joint_of(i, s.motors()))]);
    }
    c.insert(c.end(), {"x_ref", "y_ref"});
    for (int i = 0; i < 2; ++i)
      c.push_back(std::string(World::joint_names[static_cast<std::size_t>(i * M::joints / 2)]) + "_ref");
    for (const char* n : World::channel_names) c.push_back(std::string("s_") + n);
    for (int i = 0; i < M::joints; i += s.all_sensors ? 1 : M::joints / 2)
      c.push_back(std::string(World::joint_names[static_cast<std::size_t>(i)]) + "_rate_meas");
    for (int i = 0; i < M::joints; i += s.all_sensors ? 1 : M::joints / 2) {
      const std::string joint = World::joint_names[static_cast<std::size_t>(i)];
      c.insert(c.end(), {joint + "_age_ticks", joint + "_phase"});
    }
    c.insert(c.end(), {"delay", "state"});
    return c;
  }
  /// All joint angles: as measured, the passive ones by closure of what the controller believes.
  [[nodiscard]] std::vector<double> pose(const Sample<M>& s) const {
    std::vector<double> out(static_cast<std::size_t>(M::joints), std::numeric_limits<double>::quiet_NaN());
    for (int i = 0; i < M::joints; ++i) out[static_cast<std::size_t>(i)] = s.angle[i];
    if constexpr (M::joints == 4) {
      if (scene_.all_sensors) return out;
      const auto p = mechanism_.forward(Vec2<double>(s.angle[0], s.angle[2]), mode_.assembly);
      const Vec<double, 4> all =
          p ? M::angles(*p) : Vec<double, 4>::Constant(std::numeric_limits<double>::quiet_NaN()).eval();
      out[1] = all[1];
      out[3] = all[3];
    }
    return out;
  }

  const Scene& scene_;
  Log log_;
  Statistics statistics_;
  Histogram feedback_, command_;
  M mechanism_;
  typename M::Mode mode_;
  std::vector<double> torque_, row_;
  bool started_ = false;
  std::uint64_t ticks_released_ = 0;
};

using Clock = std::chrono::steady_clock;
using Seconds = std::chrono::duration<double>;

/// In lockstep the plant sets the pace: one tick for each complete set of torques.
template <class World>
RunEnd lead_plant(const Scene& scene, const RunOptions& o, PlantEnd<World, HostBus>& plant) {
  const auto begin = Clock::now();
  bool stop = stop_requested();
  Progress progress(tick_count(scene));
  while (!plant.finished() && !stop) {
    progress.at(plant.done());
    plant.publish();
    stop = (o.again.ticks && plant.done() >= *o.again.ticks) || !plant.await_torques();
    if (!stop) plant.advance({});
  }
  RunEnd end = plant.end(begin);
  end.interrupted = stop;
  return end;
}

/// The plant's ticks until the scene's duration, Ctrl-C, `over()` or 5 s of silence of the controller.
template <class World, class Over>
RunEnd pace_plant(const Scene& scene, const RunOptions& o, PlantEnd<World, HostBus>& plant,
                  const Over& over) {
  const auto begin = Clock::now();
  const Seconds arming(arming_time_max(scene, true));
  auto heard = begin;
  Pace pace(scene.tick(), o.again.bus == nullptr, plant.substeps());
  std::uint64_t late = 0;
  Progress progress(tick_count(scene));
  while (!plant.finished() && !must_stop(o, plant.done()) && !over()) {
    progress.at(plant.done());
    if (!plant.released() && Clock::now() - begin > arming) {
      throw RunError(fmt::format(
          "the drives were not in closed-loop control after {} s (controller dead or not started)",
          arming.count()));
    }
    plant.publish();
    const std::uint64_t before = pace.late();
    for (int substep = 0; substep < plant.substeps(); ++substep) {
      pace.wait();
      plant.advance_substep(substep);
      if (plant.drain() > 0) heard = Clock::now();
    }
    if (pace.late() > before) ++late;
    // A board sends nothing to the drives before a supervisor computer has armed it.
    if ((plant.released() || !armed_by_link(scene)) &&
        Clock::now() - heard > std::chrono::milliseconds(silence_ms))
      throw RunError("the controller was not heard for 5 s");
  }
  RunEnd end = plant.end(begin);
  end.interrupted = stop_requested();
  end.late_ticks = late;
  return end;
}

/// The drives report, the mechanism at rest, until `done()`: the controller must hear that they are idle.
template <class World, class Done>
void keep_publishing(const Scene& scene, PlantEnd<World, HostBus>& plant, const Done& done) {
  Pace pace(scene.tick());
  const auto give_up = Clock::now() + std::chrono::seconds(2);
  while (!done() && Clock::now() < give_up) {
    pace.wait();
    plant.publish();
    (void)plant.drain();
  }
}

/// The controller's ticks against the clock, until `done()` or Ctrl-C. Returns how many were late.
template <class World, class Bus, class Done>
std::uint64_t pace_controller(const Scene& scene, const RunOptions& o, ControllerEnd<World, Bus>& controller,
                              ControllerRecorder<World>& recorder, const Done& done) {
  Pace pace(scene.tick(), o.again.bus == nullptr);
  // Samples that are later than this are the next tick's, one tick old.
  const auto patience =
      std::chrono::duration_cast<std::chrono::microseconds>(Seconds(patience_ticks * scene.tick()));
  const Seconds arming(arming_time_max(scene, true));
  const auto sample = [&] {
    pace.wait();
    controller.late_by(pace.since());
    controller.sample(patience);
    return true;
  };
  const auto begin = Clock::now();
  while (!done() && !must_stop(o, recorder.ticks())) {
    sample();
    controller.tick(true);
    recorder.tick(controller.result(), controller.sample(), pace.since());
    if (const std::string unread = recorder.ticks() == 1 ? controller.reports().limits_unread() : "";
        !unread.empty())
      fmt::print(stderr, "armed without object 6072, the torque limit was not read back: {}\n", unread);
    if (recorder.ticks() > 0) continue;
    if (armed_by_link(scene)) continue;
    const bool in_time = Clock::now() - begin <= arming;
    controller.require_armed(sample);
    if (in_time) continue;
    const std::string why = controller.reports().unready();
    controller.shut_down(sample);
    throw RunError(
        fmt::format("the drives were not in closed-loop control after {} s (plant dead or not started, or "
                    "not ready: {})",
                    arming.count(), why));
  }
  const std::uint64_t late = pace.late();
  controller.shut_down(sample);
  return late;
}

/// In lockstep: asks the drives to arm until they answer, then answers every complete set of samples. Returns
/// the number of sets, and whether the run was stopped.
template <class World, class Bus>
std::pair<std::uint64_t, bool> answer_plant(const Scene& scene, const RunOptions& o, FrameLog& frames,
                                            ControllerEnd<World, Bus>& controller,
                                            ControllerRecorder<World>& recorder, const std::string& bus) {
  if (controller.await_drives(std::chrono::milliseconds(150)) == Waited::silent)
    throw RunError("no drive was heard for 5 s on " + bus);
  bool stop = false, overloaded = false;
  std::uint64_t sets = 0;
  // After an overload it is unknown which set the next samples belong to.
  Progress progress(tick_count(scene));
  while (recorder.ticks_released() < tick_count(scene) && !stop && !overloaded) {
    progress.at(recorder.ticks());
    const Waited set = controller.await_samples();
    stop = set == Waited::stopped || must_stop(o, recorder.ticks() + 1);
    if (set == Waited::silent && !stop) {
      controller.shut_down();
      throw RunError("the drives sent no complete set of encoder frames for 5 s (plant dead or not started)");
    }
    overloaded = controller.overloaded();
    if (stop) controller.stop();
    controller.tick(true);
    frames.tick(static_cast<double>(++sets) * scene.tick());
    recorder.tick(controller.result(), controller.sample());
    if (recorder.ticks() == 0) controller.require_armed([&] { return controller.await_last_samples(); });
  }
  if (stop || recorder.tested_only()) controller.shut_down();
  return {sets, stop};
}

HostBus bus_of(const RunOptions& o, const Scene& scene) {
  return o.again.bus != nullptr ? HostBus(*o.again.bus)
                                : open_bus(o.bus, scene.bitrate, scene.data_bitrate > 0);
}

template <class World>
int plant(const Scene& scene, const RunOptions& o) {
  require_reachable<World>(scene, o.realtime ? Pacing::realtime : Pacing::lockstep);
  HostBus bus = bus_of(o, scene);
  BusRunFiles files(o, scene, bus.interface(), true);
  PlantEnd<World, HostBus> plant(scene, o, bus, files.frames, files.log, false);
  if (!armed_by_link(scene) && !o.again.of_hil &&
      wait_for(bus, [&] { return plant.drain() > 0; }) == Waited::silent) {
    throw RunError("no controller was heard for 5 s on " + bus.name());
  }
  const RunEnd end =
      o.realtime ? pace_plant(scene, o, plant, [] { return false; }) : lead_plant(scene, o, plant);
  return finish_run(o, scene, "plant", plant.recorder(), end, files);
}

template <class World>
int controller(const Scene& scene, const RunOptions& o) {
  const Pacing pacing = o.realtime ? Pacing::realtime : Pacing::lockstep;
  require_reachable<World>(scene, pacing);
  HostBus bus = bus_of(o, scene);
  BusRunFiles files(o, scene, bus.interface(), true);
  Tapped<HostBus> tap(bus, files.frames);
  ControllerEnd<World, Tapped<HostBus>> controller(scene, pacing, tap);
  ControllerRecorder<World> recorder(scene, files.log);
  const auto begin = Clock::now();
  const auto end_of = [&](double bus_time, bool interrupted) {
    if (!interrupted) recorder.require_run();
    RunEnd end = recorder.end(begin, o.seed, controller,
                              bus_summary(files.frames, tap.lost(), scene.bitrate * bus_time));
    end.interrupted = interrupted;
    return end;
  };
  RunEnd end;
  if (o.realtime) {
    const std::uint64_t late = pace_controller(
        scene, o, controller, recorder, [&] { return recorder.ticks_released() >= tick_count(scene); });
    end = end_of(Seconds(Clock::now() - begin).count(), stop_requested());
    end.late_ticks = late;
  } else {
    const auto [sets, stop] = answer_plant(scene, o, files.frames, controller, recorder, bus.name());
    end = end_of(static_cast<double>(sets) * scene.tick(), stop);
    if (!stop) controller.shut_down();
  }
  return finish_run(o, scene, "controller", recorder, end, files);
}

/// Both ends in one process: the plant in this thread, the controller in another, each on its own socket.
template <class World>
int hil_realtime(const Scene& scene, const RunOptions& o) {
  BusEnds ends = open_both_ends(o.bus, scene.bitrate, scene.data_bitrate > 0);
  BusRunFiles files(o, scene, ends.plant.interface(), true);
  PlantEnd<World, HostBus> plant(scene, o, ends.plant, files.frames, files.log, false);
  ControllerEnd<World, HostBus> controller(scene, Pacing::realtime, ends.control);
  ControllerRecorder<World> seen(scene, nullptr);
  std::atomic<bool> over{false}, shut_down{false};
  std::exception_ptr plant_failure, controller_failure;
  std::uint64_t late = 0;
  std::thread thread([&] {
    try {
      late = pace_controller(scene, o, controller, seen, [&] { return over.load(); });
    } catch (...) {
      controller_failure = std::current_exception();
    }
    shut_down = true;
  });
  RunEnd end;
  try {
    end = pace_plant(scene, o, plant, [&] { return shut_down.load(); });
    over = true;
    keep_publishing(scene, plant, [&] { return shut_down.load(); });
  } catch (...) {
    plant_failure = std::current_exception();
  }
  over = true;
  thread.join();
  if (controller_failure) std::rethrow_exception(controller_failure);
  if (plant_failure) std::rethrow_exception(plant_failure);
  end.late_ticks = end.late_ticks.value_or(0) + late;
  end.fault_t = seen.statistics().fault_time();
  end.histograms = seen.latencies();
  set_outcome(end, controller.supervisor(), controller.fault());
  end.surfaces = controller.surfaces();
  return finish_run(o, scene, "hil", plant.recorder(), end, files);
}

/// In lockstep the ends find each other by the request to arm.
Scene read_scene_of_end(const RunOptions& o) {
  Scene scene = read_loop_scene(o);
  if (armed_by_link(scene) && !o.realtime)
    throw InputError(scene.control_where, "command.arm = \"link\" with two processes needs --realtime");
  refuse_bus_effects(scene, no_effects_on_interface);
  return scene;
}

}  // namespace

int run_plant(const RunOptions& o) {
  const Scene scene = read_scene_of_end(o);
  return with_world(scene, [&]<class World>(World) { return plant<World>(scene, o); });
}

int run_controller(const RunOptions& o) {
  Scene scene = read_scene_of_end(o);
  if (o.observe) {
    HostBus bus = open_bus(o.bus, scene.bitrate, scene.data_bitrate > 0);
    return run_observe(scene, o, bus);
  }
  if (o.again.bus == nullptr) {
    scene.hardware = o.realtime && carries_real_drives(o.bus);
    require_confirmed(scene);
  }
  return with_world(scene, [&]<class World>(World) { return controller<World>(scene, o); });
}

int run_hil_realtime(const Scene& scene, const RunOptions& o) {
  if (o.bus == "virtual") {
    throw InputError("",
                     "--realtime needs --bus socketcan:INTERFACE or slcan:PLANT,CONTROLLER: the virtual bus "
                     "has no clock of its own");
  }
  return with_world(scene, [&]<class World>(World) { return hil_realtime<World>(scene, o); });
}

}  // namespace esmc::host
