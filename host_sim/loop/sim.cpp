#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <memory>
#include <numbers>

#include "host_sim/controller/robust.hpp"
#include "host_sim/drives/actuators.hpp"
#include "host_sim/drives/placed_axes.hpp"
#include "host_sim/loop/accuracy.hpp"
#include "host_sim/loop/progress.hpp"
#include "host_sim/loop/run.hpp"
#include "host_sim/record/fault_record.hpp"
#include "host_sim/record/finish.hpp"
#include "host_sim/record/recorder.hpp"
#include "host_sim/scene/frame_steps.hpp"

namespace esmc::host {
namespace {

/// What a run is for, and what it keeps in `trace` of every tick of a closed loop.
struct Purpose {
  bool single_precision = false;  ///< of the controller
  bool progress = true;           ///< shown; not by a run among many
  bool digest = true, base_errors = true;
  bool path = false, torques = false;
  bool in_frames = false;  ///< samples and torques in the steps of the drives' frames
  Trace* trace = nullptr;
};

/// One pass over the whole scene with a given number of integration steps per tick.
template <class World>
class SimRun {
 public:
  using Plant = typename World::Plant;
  using M = typename World::Mechanism;
  using Joints = typename Plant::Joints;

  SimRun(const Scene& scene, const RunOptions& options, const LogSink& log, const Purpose& purpose)
      : scene_(scene),
        options_(options),
        use_(purpose),
        recorder_(scene, Pacing::lockstep, log, scene.closed_loop()),
        motion_(make_motion<World>(scene)),
        actuators_(scene.effects, scene.motor_joints(), scene.seed),
        progress_(options.capture == nullptr && purpose.progress) {
    if (!use_.digest) recorder_.without_digest();
    if (!use_.base_errors) recorder_.without_base_errors();
  }

  [[nodiscard]] Recorder<World>& recorder() { return recorder_; }
  /// Appends q at every `stride`th tick and at the end.
  void keep_rows(Pass* pass, std::uint32_t stride) {
    pass_ = pass;
    stride_ = stride;
  }
  /// A pass that is only compared keeps nothing of the run.
  void without_record() { recording_ = false; }

  RunEnd run(int substeps) {
    const auto begin = std::chrono::steady_clock::now();
    RunEnd end;
    begin_record();
    if (scene_.closed_loop()) {
      if (use_.single_precision) {
        closed_loop<typename World::SinglePrecision>(substeps, end);
      } else {
        closed_loop<M>(substeps, end);
      }
    } else {
      open_loop(substeps, end);
    }
    end.wall_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    set_final_state(end, motion_, recorder_.statistics());
    if (pass_ != nullptr) pass_->add(end.q);
    end.state_dimension = motion_.state_dimension() + actuators_.states();
    end.seed = options_.seed;
    return end;
  }

 private:
  /// What is kept is of the last recorded pass alone.
  void begin_record() {
    if (!recording_) use_.path = use_.torques = false;
    if (recording_ && options_.capture != nullptr) recorder_.log().keep(&options_.capture->log);
    if (use_.path) use_.trace->effector.clear();
    if (!use_.torques) return;
    use_.trace->torque.clear();
    use_.trace->saturated.clear();
  }

  void record(std::uint32_t n, const Joints& torque, bool clipped, const ControllerView<M>& seen) {
    if (recording_) recorder_.tick(n, motion_, torque, clipped, seen);
    if (pass_ == nullptr || n % stride_ != 0) return;
    const auto o = motion_.output();
    pass_->add(o.q);
    require_finite(o.q, n * scene_.tick());
  }

  /// Torque as a function of time, no controller, no limits.
  void open_loop(int substeps, RunEnd& end) {
    const double tick = scene_.tick();
    OpenLoop wave{scene_.torque, scene_.motor_joints()};
    if (const auto saturation = find_effect<TorqueSaturation>(scene_.effects)) wave.limit = saturation->limit;
    const MotorTorques<Joints> torque{{}, scene_.torque.empty() ? nullptr : &wave};
    const std::uint32_t ticks = tick_count(scene_);
    Progress progress(progress_ ? ticks : 0);
    for (std::uint32_t n = 0, span = 1; n < ticks; n += span) {
      progress.at(n);
      // What is not recorded needs no ticks: the torque is a function of time.
      if (!recording_) span = std::min({32U, stride_ - n % stride_, ticks - n});
      if (must_stop(options_, n)) {
        end.interrupted = true;
        return;
      }
      const Joints now = torque.at(n * tick);
      const bool clipped =
          std::any_of(now.begin(), now.end(), [&](double v) { return std::abs(v) == wave.limit; });
      record(n, now, clipped, {});
      const int steps = static_cast<int>(span) * substeps, at_once = recording_ ? 1 : scene_.resolution.ticks;
      motion_.advance(n * tick, span * tick, (steps + at_once - 1) / at_once, torque);
    }
  }

  /// The firmware's controller, its torque applied directly over the tick. `C`: its mechanism.
  template <class C>
  void closed_loop(int substeps, RunEnd& end) {
    const auto reference = make_reference<typename C::Scalar>(scene_, Pacing::lockstep);
    Controller<C> controller(make_controller<C>(scene_, Pacing::lockstep, reference));
    Supervisor supervisor(controller.supervision());
    supervisor.begin_tick(Command::enable, {});  // there are no drives to wait for
    std::vector<Sensor> sensors = make_sensors(controller.config().sensor_count());
    Sample<C> sample;
    TickResult<C> result;
    FaultFinder<World> finder(scene_);
    const double tick = scene_.tick(), step = tick / substeps;
    const std::uint32_t ticks = tick_count(scene_);
    Progress progress(progress_ ? ticks : 0);
    for (std::uint32_t n = 0; n < ticks; ++n) {
      progress.at(n);
      const bool stop = must_stop(options_, n + 1);
      supervisor.begin_tick(stop ? Command::stop : Command::none, {true, false}, result.stage_done);
      measure(sensors, sample);
      result = controller.tick(sample, supervisor);
      bool clipped = false;
      Joints asked{};
      for (std::size_t i = 0; i < asked.size(); ++i)
        asked[i] = static_cast<double>(result.torque[static_cast<int>(i)]);
      if (use_.in_frames) round_torques(sensors, asked);
      const Joints torque = actuators_.deliver(asked, tick, clipped);
      if constexpr (std::is_same_v<C, M>) {
        record(n, torque, clipped, {&result, &sample});
        if (recording_) finder.see(result, sample);
      } else {
        record(n, torque, clipped, {});
      }
      if (use_.path) use_.trace->effector.push_back(motion_.output().effector);
      if (use_.torques) {
        for (const std::size_t joint : scene_.motor_joints()) use_.trace->torque.push_back(torque[joint]);
        use_.trace->saturated.push_back(clipped || result.saturated);
      }
      actuators_.advance(motion_, n * tick, tick, step, torque);
      if (stop) {
        supervisor.begin_tick(Command::none, {false, true});  // nor any that would take time to be idle
        end.interrupted = true;
        break;
      }
    }
    set_outcome(end, supervisor, finder.found());
    end.surfaces = surfaces_of<World>(scene_, controller.config());
    if (supervisor.fault() == Fault::loop_not_closed && controller.odd_encoder() != 0)
      end.odd_encoder = World::joint_names[controller.odd_encoder() - 1];
  }

  struct Sensor {
    PlacedAxis axis;
    ShaftSensor shaft;
    double rev_per_rad;
    FrameSteps steps{};
  };
  static double rounded(double value, double step) {
    return step > 0.0 ? step * std::round(value / step) : value;
  }
  static void round_torques(const std::vector<Sensor>& sensors, Joints& asked) {
    for (const Sensor& s : sensors) {
      double& torque = asked[static_cast<std::size_t>(s.axis.joint)];
      if (s.axis.motor) torque = rounded(torque, s.steps.torque * s.axis.mount.gear_ratio);
    }
  }
  std::vector<Sensor> make_sensors(int count) {
    std::vector<Sensor> out;
    const SensorEffects effects(scene_.effects);
    for (const PlacedAxis& a : placed_axes(scene_)) {
      if (count == 2 && a.joint % (M::joints / 2) != 0) continue;
      const double k = a.mount.rev_per_rad();
      out.push_back({a, ShaftSensor(effects, scene_.tick(), k, a.joint, scene_.seed), k});
      if (use_.in_frames) out.back().steps = frame_steps(scene_.drives, a.entry);
      const Shaft shaft = motion_.shaft(static_cast<std::size_t>(a.joint));
      const double rate = scene_.reference.first_tick > 0 ? shaft.rate : 0.0;  // else it has been at rest
      out.back().shaft.settle({(shaft.angle - rate * scene_.tick() - a.mount.offset) * k, rate * k});
    }
    exact_ =
        effects.none() && std::ranges::all_of(out, [](const Sensor& s) { return !(s.steps.position > 0.0); });
    return out;
  }
  template <class C>
  void measure(std::vector<Sensor>& sensors, Sample<C>& sample) const {
    using S = typename C::Scalar;
    for (Sensor& s : sensors) {
      const auto shaft = motion_.shaft(static_cast<std::size_t>(s.axis.joint));
      if (exact_) {  // the truth to the last bit, without conversion to revolutions
        sample.angle[s.axis.joint] = static_cast<S>(shaft.angle);
        sample.rate[s.axis.joint] = static_cast<S>(shaft.rate);
        continue;
      }
      ShaftReading r =
          s.shaft.read({(shaft.angle - s.axis.mount.offset) * s.rev_per_rad, shaft.rate * s.rev_per_rad});
      constexpr double turn = 2.0 * std::numbers::pi;
      r = {rounded(r.position_rev, s.steps.position / turn),
           rounded(r.velocity_rev_s, s.steps.velocity / turn)};
      sample.angle[s.axis.joint] = static_cast<S>(r.position_rev / s.rev_per_rad + s.axis.mount.offset);
      sample.rate[s.axis.joint] = static_cast<S>(r.velocity_rev_s / s.rev_per_rad);
    }
  }

  const Scene& scene_;
  const RunOptions& options_;
  Purpose use_;
  Recorder<World> recorder_;
  Motion<Plant> motion_;
  Actuators<Plant> actuators_;
  bool exact_ = true, progress_, recording_ = true;
  Pass* pass_ = nullptr;
  std::uint32_t stride_ = 1;
};

/// Runs a scene, or the passes that simulation.accuracy needs; `last` and `end`: the run that counts.
/// `log(recorded)`: where a run writes.
template <class World, class LogOf>
void run_scene(Scene& scene, const RunOptions& o, const Purpose& purpose, const LogOf& log,
               std::unique_ptr<SimRun<World>>& last, RunEnd& end) {
  const auto make = [&](const Scene& s, bool recorded) {
    return std::make_unique<SimRun<World>>(s, o, log(recorded), purpose);
  };
  if (!scene.accuracy) {
    last = make(scene, true);
    end = last->run(steps_per_tick(scene));
    return;
  }
  const auto pass = [&](const Scene& s, bool recorded) {
    Pass p;
    if (recorded) last.reset();  // which has the log open
    std::unique_ptr<SimRun<World>> run = make(s, recorded);
    run->keep_rows(&p, row_stride(s, tick_count(s)));
    if (!recorded) run->without_record();
    RunEnd now = run->run(steps_per_tick(s));
    require_finite(now.q, s.duration);
    p.effort = now.effort;
    p.interrupted = now.interrupted;
    if (recorded) {
      last = std::move(run);
      end = std::move(now);
    }
    return p;
  };
  AccuracyReport report = meet_accuracy(scene, World::Plant::outputs, pass);
  if (!end.interrupted) end.accuracy = std::move(report);
}

template <class World>
int simulate(Scene scene, const RunOptions& o) {
  require_reachable<World>(scene, Pacing::lockstep);
  OutputDirectory out = output_of(o);
  const std::unique_ptr<RunMcap> mcap = mcap_of(o, scene);
  std::unique_ptr<SimRun<World>> run;
  RunEnd end;
  const auto log = [&](bool recorded) { return recorded ? log_of(o, out, mcap.get()) : LogSink(); };
  run_scene<World>(scene, o, {}, log, run, end);
  return finish_run(o, scene, "sim", run->recorder().statistics(), end, run->recorder().log(), out,
                    mcap.get());
}

/// A run without files.
template <class World>
Trace study(Scene scene, Purpose purpose) {
  Trace out;
  const RunOptions none;
  purpose.trace = &out;
  std::unique_ptr<SimRun<World>> run;
  try {
    run_scene<World>(
        scene, none, purpose, [](bool) { return LogSink(); }, run, out.end);
  } catch (const Diverged&) {
    if (scene.accuracy) throw;
    out.end.q.assign(World::Plant::outputs,
                     std::numeric_limits<double>::quiet_NaN());  // a result of the study
    out.end.qd = out.end.q;
  }
  out.statistics = run->recorder().statistics();
  out.reference_left = run->recorder().reference_left();
  return out;
}
Trace study(const Scene& scene, const Purpose& purpose) {
  return with_world(scene, [&]<class World>(World) { return study<World>(scene, purpose); });
}

}  // namespace

int run_sim(const RunOptions& o) {
  Scene scene = read_scene(o.scene, o.sets);
  refuse_bus_effects(scene, "esmc sim has no bus");
  scene.seed = o.seed;
  return with_world(scene, [&]<class World>(World) { return simulate<World>(scene, o); });
}

Trace trace(const Scene& scene, bool single_precision) {
  return study(scene, {.single_precision = single_precision, .path = true});
}

Trace probe(const Scene& scene, bool in_frames) {
  return study(scene, {.progress = false, .torques = true, .in_frames = in_frames});
}

Trace run_case(const Scene& scene, bool base_errors, bool single_precision) {
  const Purpose purpose{
      .single_precision = single_precision, .progress = false, .digest = false, .base_errors = base_errors};
  Trace out = study(scene, purpose);
  if (out.reference_left)
    throw InputError(scene.reference_where, "the reference leaves the reach of the mechanism");
  return out;
}

}  // namespace esmc::host
