#include "host_sim/python/rollout.hpp"

#include <algorithm>
#include <atomic>
#include <limits>
#include <utility>

#include "host_sim/error.hpp"
#include "host_sim/parallel.hpp"
#include "host_sim/python/loop.hpp"
#include "host_sim/record/run_options.hpp"
#include "host_sim/sweep/lanes/cases.hpp"
#include "host_sim/sweep/work.hpp"

namespace esmc::host {
namespace {

int threads_of(int threads) { return threads > 0 ? threads : processors(); }

/// What the cases are, beside their results.
RolloutResult result_of(const SweepSpec& spec, const CaseScenes& scenes) {
  RolloutResult out;
  const std::uint64_t cases = spec.design.cases();
  out.outcomes.assign(cases, outcome_name(outcome_not_run));
  for (std::size_t a = 0; a < spec.vary.size(); ++a) {
    auto& column = out.parameters.emplace_back();
    for (std::uint64_t i = 0; i < cases; ++i) column.push_back(scenes.value(i, a));
  }
  for (std::uint64_t i = 0; i < cases; ++i) out.seeds.push_back(scenes.seed(i));
  return out;
}

constexpr const char* other_width = "other_width";  // of the torques; run_driven refuses it

/// Driven cases, a group of lanes at a time.
class Driver {
 public:
  Driver(const GivenTorques& given, const CaseScenes& scenes, std::size_t width, RolloutResult& out)
      : given_(given),
        scenes_(scenes),
        per_case_(given.torque.size() / out.outcomes.size()),
        width_(width),
        out_(out) {}

  void run(std::uint64_t first, std::uint64_t end) {
    jobs_.clear();
    for (std::uint64_t i = first; i < end; ++i) {
      LaneJob job;
      job.index = i;
      try {
        const Scene& scene = scenes_.at(i);
        if (static_cast<std::size_t>(scene.motors()) * given_.ticks != per_case_) {
          out_.outcomes[i] = other_width;
          continue;
        }
        if (!make_driven_job(scene, given_.ticks, given_.every, job) ||
            (!jobs_.empty() && !(jobs_.front().settings == job.settings))) {
          alone(i);
          continue;
        }
      } catch (const InputError&) {
        out_.outcomes[i] = "impossible";
        continue;
      }
      job.numbers.torque = given_.torque.data() + i * per_case_;
      job.numbers.states = states(i);
      jobs_.push_back(std::move(job));
    }
    if (jobs_.empty()) return;
    run_lane_jobs(lane_kernels().front(), jobs_, scores_);
    for (std::size_t k = 0; k < jobs_.size(); ++k) {
      out_.outcomes[jobs_[k].index] = outcome_name(outcome_ok);
      if (!scores_[k].ok) alone(jobs_[k].index);
    }
  }

 private:
  double* states(std::uint64_t i) { return out_.states.data() + i * out_.rows * width_; }

  void alone(std::uint64_t i) {
    const auto plant = make_python_plant(scenes_.at(i));
    const std::size_t motors = per_case_ / given_.ticks;
    double* to = states(i);
    std::vector<double> q, qd;
    const auto keep = [&] {
      plant->output(q, qd);
      to = std::copy(qd.begin(), qd.end(), std::copy(q.begin(), q.end(), to));
    };
    out_.outcomes[i] = outcome_name(outcome_ok);
    try {
      for (std::uint32_t t = 0; t < given_.ticks && !stop_requested(); ++t) {
        if (given_.every > 0 && t % given_.every == 0) keep();
        plant->step(given_.torque.subspan(i * per_case_ + t * motors, motors));
      }
      keep();
    } catch (const RunError&) {
      out_.outcomes[i] = outcome_name(outcome_diverged);
      std::fill(states(i), states(i + 1), std::numeric_limits<double>::quiet_NaN());
    }
  }

  const GivenTorques& given_;
  CaseScenes scenes_;
  std::size_t per_case_, width_;  // torques; numbers of a row
  RolloutResult& out_;
  std::vector<LaneJob> jobs_;
  std::vector<LaneScore> scores_;
};

}  // namespace

RolloutResult run_rollout(const SweepSpec& spec, int threads) {
  const CaseScenes scenes(spec);
  const auto cases = static_cast<std::size_t>(spec.design.cases());
  const std::size_t columns = spec.wanted.size();
  RolloutResult out = result_of(spec, scenes);
  out.objectives.assign(cases * columns, std::numeric_limits<double>::quiet_NaN());
  const WorkerConfig config{&spec, &scenes, threads_of(threads), &lane_kernels().front()};
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
  return out;
}

RolloutResult run_driven(const SweepSpec& spec, int threads, const GivenTorques& given) {
  const std::uint64_t cases = spec.design.cases();
  const CaseScenes scenes(spec);
  RolloutResult out = result_of(spec, scenes);
  out.rows = given.every > 0 ? (given.ticks - 1) / given.every + 2 : 1;
  out.coordinates = scenes.nominal().type == MechanismType::five_bar ? 6 : 2;
  out.states.assign(cases * out.rows * 2 * out.coordinates, std::numeric_limits<double>::quiet_NaN());
  const auto lanes = static_cast<std::uint64_t>(lane_kernels().front().lanes);
  std::atomic<std::uint64_t> next{0};
  run_jobs(threads_of(threads), [&](int) {
    Driver driver(given, scenes, 2 * out.coordinates, out);
    while (!stop_requested()) {
      const std::uint64_t first = next.fetch_add(lanes);
      if (first >= cases) return;
      driver.run(first, std::min(first + lanes, cases));
    }
  });
  if (stop_requested()) throw Interrupted("interrupted");
  if (const auto bad = std::ranges::find(out.outcomes, other_width); bad != out.outcomes.end())
    refuse("torques: the case with index {} has another number of motors than the scene",
           bad - out.outcomes.begin());
  return out;
}

}  // namespace esmc::host
