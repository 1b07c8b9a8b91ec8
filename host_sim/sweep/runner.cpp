#include "host_sim/sweep/runner.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>

#include "firmware/safety/faults.hpp"
#include "host_sim/error.hpp"
#include "host_sim/loop/run.hpp"
#include "host_sim/record/run_options.hpp"

namespace esmc::host {
namespace {

Score empty_score() {
  Score s;
  s.fill(std::numeric_limits<double>::quiet_NaN());
  return s;
}

bool all_finite(const std::vector<double>& v) {
  return std::ranges::all_of(v, [](double x) { return std::isfinite(x); });
}

std::uint32_t fault_number(const std::string& of) {
  for (int f = 0; f < fault_count; ++f) {
    if (of == name(static_cast<Fault>(f))) return static_cast<std::uint32_t>(f);
  }
  return 0;
}

/// The objectives of a run that ended well, but tick_ns. `tick` in s.
Score score_of(const RunSums<double>& s, double tick) {
  Score out = empty_score();
  const auto set = [&](Objective o, double v) { out[static_cast<std::size_t>(o)] = v; };
  const auto moments = [&](Objective rms, Objective max, const ErrorStatistics::Moments& m) {
    if (m.count == 0) return;
    set(rms, m.rms());
    set(max, m.largest);
  };
  moments(Objective::rms_m, Objective::max_m, s.effector.all());
  moments(Objective::settled_rms_m, Objective::settled_max_m, s.effector.settled());
  moments(Objective::rms_rad, Objective::max_rad, s.base.all());
  moments(Objective::settled_rms_rad, Objective::settled_max_rad, s.base.settled());
  set(Objective::torque_max_nm, s.torque_max);
  set(Objective::torque_activity_nm, s.torque_activity());
  set(Objective::saturated_ticks, s.saturated_ticks);
  set(Objective::energy_j, s.power_sum * tick);
  set(Objective::faulted, 0.0);
  return out;
}

/// What `esmc sim` would say of the scene: the very numbers of its summary.
Score score_of(const Trace& trace, double tick, std::uint32_t& outcome) {
  outcome = outcome_ok;
  if (!trace.end.faults.empty()) outcome = outcome_fault + fault_number(trace.end.faults.front().name);
  if (!all_finite(trace.end.q) || !all_finite(trace.end.qd)) {
    outcome = outcome_diverged;
    return empty_score();
  }
  Score out = score_of(trace.statistics.sums(), tick);
  out[static_cast<std::size_t>(Objective::faulted)] = outcome == outcome_ok ? 0.0 : 1.0;
  return out;
}

}  // namespace

std::string outcome_name(std::uint32_t outcome) {
  if (outcome == outcome_ok) return "ok";
  if (outcome == outcome_diverged) return "diverged";
  if (outcome == outcome_inaccurate) return "inaccurate";
  if (outcome == outcome_not_run) return "not_run";
  if (outcome < outcome_fault) return "impossible";
  return name(static_cast<Fault>(outcome - outcome_fault));
}

Finished CaseRunner::finished(std::uint64_t index, std::uint32_t outcome, const Score& score) const {
  Finished f{index, outcome, {}};
  for (const Objective o : spec_->wanted) f.values.push_back(score[static_cast<std::size_t>(o)]);
  return f;
}

bool CaseRunner::run_alone(std::uint64_t index, std::vector<Finished>& out) {
  std::uint32_t outcome = outcome_impossible;
  Score score = empty_score();
  try {
    const Scene& scene = scenes_.at(index);
    const auto begin = std::chrono::steady_clock::now();
    const Trace trace = run_case(scene, wants_base_errors(spec_->wanted));
    const double wall = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    if (trace.end.interrupted) return false;
    score = score_of(trace, scene.tick(), outcome);
    score[static_cast<std::size_t>(Objective::tick_ns)] = wall * 1e9 / (scene.duration * scene.rate_hz);
  } catch (const InputError&) {  // no such scene: an answer like any other
    score[static_cast<std::size_t>(Objective::faulted)] = 1.0;
  } catch (const Diverged&) {
    outcome = outcome_diverged;
  } catch (const Interrupted&) {
    return false;
  } catch (const RunError&) {  // simulation.accuracy is not met
    outcome = outcome_inaccurate;
    score[static_cast<std::size_t>(Objective::faulted)] = 1.0;
  }
  if (outcome == outcome_diverged) score[static_cast<std::size_t>(Objective::faulted)] = 1.0;
  out.push_back(finished(index, outcome, score));
  return true;
}

CaseRunner::CaseRunner(const SweepSpec& spec, const CaseScenes& scenes, const LaneKernel* kernel)
    : spec_(&spec), scenes_(scenes), kernel_(kernel) {}

void CaseRunner::run_together(std::vector<LaneJob>& jobs, std::vector<Finished>& out) {
  if (jobs.empty()) return;
  const auto begin = std::chrono::steady_clock::now();
  share_reference(jobs, track_);
  run_lane_jobs(*kernel_, jobs, scores_);
  const double wall = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  for (std::size_t i = 0; i < jobs.size(); ++i) {
    if (!scores_[i].ok) {
      (void)run_alone(jobs[i].index, out);
      continue;
    }
    Score score = score_of(scores_[i].sums, jobs[i].settings.tick);
    score[static_cast<std::size_t>(Objective::tick_ns)] =
        wall * 1e9 / static_cast<double>(jobs.size()) / jobs[i].settings.ticks;
    out.push_back(finished(jobs[i].index, outcome_ok, score));
  }
  jobs.clear();
}

bool CaseRunner::run(const Package& package, std::vector<Finished>& out) {
  for (auto& g : groups_) g.clear();
  for (const std::uint64_t index : package) {
    if (stop_requested()) return false;
    LaneJob job;
    job.index = index;
    job.bundle = bundle_;
    bool fits = kernel_ != nullptr;
    try {
      fits = fits && make_lane_job(scenes_.at(index), spec_->wanted, job);
    } catch (const InputError&) {
      fits = false;
    }
    if (!fits) {
      if (!run_alone(index, out)) return false;
      continue;
    }
    bundle_ = job.bundle;
    auto group = std::find_if(groups_.begin(), groups_.end(), [&](const std::vector<LaneJob>& g) {
      return g.empty() || g.front().settings == job.settings;
    });
    if (group == groups_.end()) group = groups_.insert(group, std::vector<LaneJob>());
    group->push_back(std::move(job));
    if (group->size() == static_cast<std::size_t>(kernel_->lanes)) run_together(*group, out);
  }
  for (auto& g : groups_) run_together(g, out);
  return !stop_requested();
}

}  // namespace esmc::host
