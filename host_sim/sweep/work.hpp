#pragma once
/// Distribution of the cases over threads of this process, and of others under mpirun. The result does not
/// depend on it.

#include <cstdint>
#include <functional>
#include <mutex>
#include <vector>

#include "host_sim/loop/progress.hpp"
#include "host_sim/sweep/ranks.hpp"
#include "host_sim/sweep/runner.hpp"

namespace esmc::host {

/// Gives out the cases that are still to do, in packages, and takes finished ones.
class WorkList {
 public:
  using Sink = std::function<void(const std::vector<Finished>&)>;
  /// `done[i]`: case i needs no work. `sink` gets every finished package, one at a time. `workers`: number of
  /// threads of all processes, among which a short sweep is shared out evenly.
  WorkList(std::vector<bool> done, std::size_t workers, Sink sink);

  /// Gives out the next package; from any thread. False: nothing left, or the sweep is to stop.
  [[nodiscard]] bool next(Package& out);
  /// Takes finished cases to the sink; from any thread. Throws what the sink throws.
  void finish(const std::vector<Finished>& cases);
  /// Makes next() return false from now on, for good.
  void stop();

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
void work_off(WorkList& list, const WorkerConfig& config, Ranks* ranks);
/// Works for the first process: requests cases, computes and delivers until none are left. `identity` must be
/// that of the first process.
void serve(const WorkerConfig& config, Ranks& ranks, std::uint64_t identity);
/// By the first process: tells the others to begin with the sweep of this identity; call before work_off().
void broadcast_job(Ranks& ranks, std::uint64_t identity);
void finish_workers(Ranks& ranks);  ///< tells them, in place of broadcast_job(), to end

}  // namespace esmc::host
