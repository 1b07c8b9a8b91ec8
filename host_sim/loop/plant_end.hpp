#pragma once
/// The plant's end of hardware in the loop on its CAN node: emulated plant, recorder and frame log.

#include <chrono>
#include <span>
#include <vector>

#include "host_sim/bus/frame_log.hpp"
#include "host_sim/drives/emulated_plant.hpp"
#include "host_sim/loop/run.hpp"
#include "host_sim/loop/waiting.hpp"
#include "host_sim/record/recorder.hpp"
#include "host_sim/record/run_options.hpp"

namespace esmc::host {

/// The plant's access to the bus, with a log of frames; bus, log and scene must outlive it. try_receive()
/// throws RunError for a controller made from another scene.
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

/// The emulated plant and drives of a scene on a bus, with waiting and recording.
template <class World, class Bus>
class PlantEnd {
 public:
  using Plant = typename World::Plant;
  using M = typename World::Mechanism;
  using Joints = typename Plant::Joints;

  /// All references must outlive this. `log` may be null. `with_controller`: advance() gets its ticks.
  PlantEnd(const Scene& scene, const RunOptions& o, Bus& bus, FrameLog& frames, const LogSink& log,
           bool with_controller)
      : scene_(scene),
        options_(o),
        tap_(bus, frames, scene),
        frames_(frames),
        recorder_(scene, o.realtime ? Pacing::realtime : Pacing::lockstep, log, with_controller),
        plant_(make_motion<World>(scene), scene, !o.realtime),
        ticks_(tick_count(scene)),
        substeps_(steps_per_tick(scene)) {
    if (o.capture != nullptr) recorder_.log().keep(&o.capture->log);
  }

  [[nodiscard]] Recorder<World>& recorder() { return recorder_; }    ///< record of this run
  [[nodiscard]] EmulatedPlant<Plant>& plant() { return plant_; }     ///< mechanism and drives
  [[nodiscard]] bool released() const { return plant_.released(); }  ///< all drives are armed: t >= 0
  [[nodiscard]] bool finished() const { return done_ >= ticks_; }    ///< duration is over
  /// Number of recorded ticks.
  [[nodiscard]] std::uint32_t done() const { return done_; }
  /// Number of integration steps in a tick.
  [[nodiscard]] int substeps() const { return substeps_; }

  /// Begins a tick: every drive sends its reports. Throws RunError like require_armed_in_time().
  void publish() {
    frames_.begin_tick(plant_.time());
    plant_.publish(tap_);
    require_armed_in_time();
  }
  /// Throws RunError if the drives are not armed after arming_time_max() of virtual time.
  void require_armed_in_time() const {
    const double limit = arming_time_max(scene_, options_.realtime);
    if (!plant_.released() && plant_.time() > limit) {
      throw RunError(
          fmt::format("the drives were not in closed-loop control after {} s of virtual time", limit));
    }
  }
  /// Waits until every motor has its torque. False: Ctrl-C. Throws RunError when the controller is silent for
  /// 5 s.
  bool await_torques() {
    const Waited w = wait_for(tap_.bus(), [&] { return receive_torques(); });
    if (w != Waited::silent) return w == Waited::done;
    throw RunError("the controller sent no torque command for 5 s (controller dead or not started)");
  }
  /// Waits at most 20 ms for torques, after Ctrl-C. False: not all came.
  bool await_last_torques() {
    return wait_briefly(tap_.bus(), [&] { return receive_torques(); });
  }
  /// Passes the waiting frames to the drives. Returns the number of commands to them.
  int drain() {
    tap_.look();
    return plant_.drain(tap_);
  }

  /// The torques that the drives hold from an instant of the tick on.
  struct TorqueCommand {
    double since;  ///< s since the tick began
    Joints torque;
  };
  /// Records the tick with the last of `commands` (>= 1) and simulates it; the first has since = 0.
  void advance(std::span<const TorqueCommand> commands, const ControllerView<M>& seen) {
    if (!plant_.released()) return;
    bool clipped = false;
    delivered_.clear();
    const auto length = [&](std::size_t i) {
      return (i + 1 < commands.size() ? commands[i + 1].since : scene_.tick()) - commands[i].since;
    };
    for (std::size_t i = 0; i < commands.size(); ++i)
      delivered_.push_back(plant_.deliver(commands[i].torque, length(i), clipped));
    record(delivered_.back(), clipped, seen);
    for (std::size_t i = 0; i < commands.size(); ++i) {
      if (length(i) > 0.0) {
        plant_.advance(done_ * scene_.tick() + commands[i].since, length(i), scene_.tick() / substeps_,
                       delivered_[i]);
      }
    }
    ++done_;
  }
  /// Records the tick and simulates it under the torques of the last commands.
  void advance(const ControllerView<M>& seen) {
    const TorqueCommand whole{0.0, plant_.asked()};
    advance({&whole, 1}, seen);
  }
  /// In real time: one integration step of the tick, 0 .. substeps() - 1, under the torques of the last
  /// commands. The first one records the tick.
  void advance_substep(int substep) {
    if (!plant_.released()) return;
    bool clipped = false;
    const double length = scene_.tick() / substeps_;
    const Joints torque = plant_.deliver(plant_.asked(), length, clipped);
    if (substep == 0) record(torque, clipped, {});
    disarmed_ = disarmed_ || plant_.disarmed();
    plant_.advance(done_ * scene_.tick() + substep * length, length, length, torque);
    if (substep + 1 == substeps_) ++done_;
  }

  /// Returns the outcome of a run that began at `begin`; call after the last tick.
  RunEnd end(std::chrono::steady_clock::time_point begin) {
    RunEnd e;
    e.wall_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    set_final_state(e, plant_.motion(), recorder_.statistics());
    e.state_dimension = plant_.state_dimension();
    e.seed = options_.seed;
    e.bus = bus_summary(frames_, tap_.lost(), scene_.bitrate * plant_.time());
    e.load = frames_.load();
    e.load_ticks = e.load.ticks() > done_ ? e.load.ticks() - done_ + 1 : 0;
    e.final_state = disarmed_ ? "drives_disarmed" : "drives_armed";
    if (disarmed_)
      e.faults.push_back(
          {.name = e.final_state, .where = fmt::format("axis errors 0x{:x}", plant_.drive_errors())});
    if (!disarmed_ && plant_.timed_out()) e.faults.push_back({.name = e.final_state = "drives_timed_out"});
    return e;
  }

 private:
  bool receive_torques() {
    plant_.collect(tap_);
    return plant_.answered();
  }
  void record(const Joints& torque, bool clipped, const ControllerView<M>& seen) {
    disarmed_ = disarmed_ || plant_.disarmed();
    recorder_.tick(done_, plant_.motion(), torque, clipped, seen, disarmed_);
  }

  const Scene& scene_;
  const RunOptions& options_;
  PlantTap<Bus> tap_;
  FrameLog& frames_;
  Recorder<World> recorder_;
  EmulatedPlant<Plant> plant_;
  std::uint32_t ticks_, done_ = 0;
  int substeps_;
  bool disarmed_ = false;
  std::vector<Joints> delivered_;
};

}  // namespace esmc::host
