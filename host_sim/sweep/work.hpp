#pragma once
/// Who computes which cases: threads of this process, and of others where mpirun has started them. The result
/// does not depend on it.

#include <chrono>
#include <cstdint>
#include <functional>
#include <mutex>
#include <vector>

#include "host_sim/loop/progress.hpp"
#include "host_sim/sweep/ranks.hpp"
#include "host_sim/sweep/runner.hpp"

namespace esmc::host {

/// The cases that are still to do, in packages, and the place where finished ones go.
class WorkList {
 public:
  using Sink = std::function<void(const std::vector<Finished>&)>;
  /// `done[i]`: case i needs no work. `sink` gets every finished package, one at a time. `workers`: so that
  /// each gets its share of a short sweep.
  WorkList(std::vector<bool> done, std::size_t workers, Sink sink);

  /// False: nothing left, or the sweep is to stop. Any thread.
  [[nodiscard]] bool next(Package& out);
  /// Any thread; throws what the sink throws.
  void finish(const std::vector<Finished>& cases);
  /// Nothing more is given out.
  void stop();
  [[nodiscard]] bool complete() const { return finished_ == done_.size(); }

 private:
  std::mutex guard_;
  std::vector<bool> done_;
  std::size_t at_ = 0, finished_ = 0, package_size_ = 1;
  bool stopped_ = false;
  Sink sink_;
  Progress progress_;
};

struct WorkerConfig {
  const SweepSpec* spec = nullptr;
  const CaseScenes* scenes = nullptr;
  int jobs = 1;
  const LaneKernel* kernel = nullptr;  ///< null: no lanes
};

/// Works the list off with this process's threads and, as the first of several processes, serves the others.
void work_off(WorkList& list, const WorkerConfig& crew, Ranks* ranks);
/// What the other processes do: ask, compute, deliver, until there is no more. `identity` must be the
/// first's.
void serve(const WorkerConfig& crew, Ranks& ranks, std::uint64_t identity);
/// Tells the others what to work on, before work_off; or, without, that there is nothing to do.
void broadcast_job(Ranks& ranks, std::uint64_t identity);
void finish_workers(Ranks& ranks);

}  // namespace esmc::host
