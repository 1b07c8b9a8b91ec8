#include "host_sim/commands/sweep_runner.hpp"

#include <chrono>
#include <cmath>
#include <limits>

#include "firmware/safety/faults.hpp"
#include "host_sim/commands/trace.hpp"
#include "host_sim/error.hpp"

namespace esmc::host {
namespace {

constexpr double nothing = std::numeric_limits<double>::quiet_NaN();

Score empty_score() {
  Score s;
  s.fill(nothing);
  return s;
}

bool all_finite(const std::vector<double>& v) {
  for (const double x : v) {
    if (!std::isfinite(x)) return false;
  }
  return true;
}

std::uint32_t fault_number(const std::string& of) {
  for (int f = 0; f < fault_count; ++f) {
    if (of == name(static_cast<Fault>(f))) return static_cast<std::uint32_t>(f);
  }
  return 0;
}

}  // namespace

std::string outcome_name(std::uint32_t outcome) {
  if (outcome == outcome_ok) return "ok";
  if (outcome == outcome_diverged) return "diverged";
  if (outcome < outcome_fault) return "impossible";
  return name(static_cast<Fault>(outcome - outcome_fault));
}

Score score_of(const Trace& trace, double tick, std::uint32_t& outcome) {
  Score out = empty_score();
  const auto set = [&](Objective o, double v) { out[static_cast<std::size_t>(o)] = v; };
  outcome = outcome_ok;
  if (!trace.end.faults.empty()) outcome = outcome_fault + fault_number(trace.end.faults.front());
  if (!all_finite(trace.end.q) || !all_finite(trace.end.qd)) {
    outcome = outcome_diverged;
    return out;
  }
  const Statistics& s = trace.statistics;
  const auto moments = [&](Objective rms, Objective max, const ErrorStatistics::Moments& m) {
    if (m.count == 0) return;
    set(rms, m.rms());
    set(max, m.largest);
  };
  moments(Objective::rms_m, Objective::max_m, s.effector().all());
  moments(Objective::settled_rms_m, Objective::settled_max_m, s.effector().settled());
  moments(Objective::rms_rad, Objective::max_rad, s.base().all());
  moments(Objective::settled_rms_rad, Objective::settled_max_rad, s.base().settled());
  set(Objective::torque_max_nm, s.torque_max());
  set(Objective::torque_activity_nm, s.torque_activity());
  set(Objective::saturated_ticks, static_cast<double>(s.saturated_ticks()));
  set(Objective::energy_j, s.power_sum() * tick);
  set(Objective::faulted, outcome == outcome_ok ? 0.0 : 1.0);
  return out;
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
    const Trace trace = run_case(scene);
    const double wall = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    if (trace.end.interrupted) return false;
    score = score_of(trace, scene.tick(), outcome);
    score[static_cast<std::size_t>(Objective::tick_ns)] = wall * 1e9 / (scene.duration * scene.rate_hz);
  } catch (const InputError&) {  // no such scene: an answer like any other
    score[static_cast<std::size_t>(Objective::faulted)] = 1.0;
  }
  if (outcome == outcome_diverged) score[static_cast<std::size_t>(Objective::faulted)] = 1.0;
  out.push_back(finished(index, outcome, score));
  return true;
}

bool CaseRunner::run(const Package& package, std::vector<Finished>& out) {
  for (const std::uint64_t index : package.cases) {
    if (!run_alone(index, out)) return false;
  }
  return true;
}

}  // namespace esmc::host
