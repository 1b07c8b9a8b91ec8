#include "host_sim/python/rollout.hpp"

#include <algorithm>
#include <limits>

#include "host_sim/error.hpp"
#include "host_sim/parallel.hpp"
#include "host_sim/record/run_options.hpp"
#include "host_sim/sweep/work.hpp"

namespace esmc::host {
namespace {

SweepSpec spec_of(const RolloutRequest& r) {
  SweepSpec out;
  out.file = out.scene = r.scene;
  out.sets = r.sets;
  out.seed = r.seed;
  out.wanted = r.objectives;
  std::vector<Axis> axes;
  for (const RolloutParameter& p : r.parameters) {
    Vary vary;
    vary.key = p.key;
    vary.where = "parameters['" + p.key + "']";
    Axis axis;
    if (const auto* range = std::get_if<0>(&p.values)) {
      axis.from = range->first;
      axis.to = range->second;
    } else {
      vary.values = std::get<1>(p.values);
      axis.listed = vary.values.size();
      axis.in_order = true;
      if (axis.listed != r.cases) refuse("{}: {} values for {} cases", vary.where, axis.listed, r.cases);
    }
    axes.push_back(axis);
    out.vary.push_back(std::move(vary));
  }
  out.design = Design(Sampling::latin_hypercube, r.cases, r.seed, std::move(axes));
  return out;
}

}  // namespace

RolloutResult run_rollout(const RolloutRequest& r) {
  if (r.cases == 0 || r.cases > Design::most_cases) refuse("n = {}: 1 to {}", r.cases, Design::most_cases);
  if (r.threads < 0 || r.threads > 4096) refuse("threads = {}: 0 (all processors) to 4096", r.threads);
  const SweepSpec spec = spec_of(r);
  const CaseScenes scenes(spec);
  const auto cases = static_cast<std::size_t>(r.cases);
  const std::size_t columns = r.objectives.size();
  RolloutResult out;
  out.objectives.assign(cases * columns, std::numeric_limits<double>::quiet_NaN());
  out.outcomes.assign(cases, outcome_name(outcome_not_run));
  const WorkerConfig config{&spec, &scenes, r.threads > 0 ? r.threads : processors(),
                            &lane_kernels().front()};
  WorkList list(std::vector<bool>(cases, false), static_cast<std::size_t>(config.jobs),
                [&](const std::vector<Finished>& done) {
                  for (const Finished& f : done) {
                    std::copy(f.values.begin(), f.values.end(),
                              out.objectives.begin() + static_cast<std::ptrdiff_t>(f.index * columns));
                    out.outcomes[f.index] = outcome_name(f.outcome);
                  }
                });
  work_off(list, config, nullptr);
  if (stop_requested()) throw Interrupted("interrupted");
  for (std::size_t a = 0; a < spec.vary.size(); ++a) {
    auto& column = out.parameters.emplace_back();
    for (std::uint64_t i = 0; i < r.cases; ++i) column.push_back(scenes.value(i, a));
  }
  return out;
}

}  // namespace esmc::host
