#pragma once
/// Log and summary of a controller on its own: measurements, references, commands. The true motion is known
/// elsewhere, so the summary has no closure, energy or digest.

#include <chrono>
#include <string>
#include <vector>

#include "host_sim/error.hpp"
#include "host_sim/record/recorder.hpp"

namespace esmc::host {

template <class World>
class ControllerRecorder {
 public:
  using M = typename World::Mechanism;

  ControllerRecorder(const Scene& scene, std::FILE* log)
      : scene_(scene),
        log_(log, columns(scene), tick_count(scene)),
        mechanism_(make_mechanism(believed_mechanism(scene), static_cast<M*>(nullptr))),
        mode_(mode_of(scene, static_cast<M*>(nullptr))),
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
  RunEnd end(std::chrono::steady_clock::time_point begin, std::uint64_t seed, const Supervisor& supervisor,
             const BusSummary& bus) const {
    RunEnd e;
    e.wall_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    e.seed = seed;
    set_outcome(e, supervisor);
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

}  // namespace esmc::host
