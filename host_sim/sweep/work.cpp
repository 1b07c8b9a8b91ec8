#include "host_sim/sweep/work.hpp"

#include <dlfcn.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <thread>

#include "host_sim/error.hpp"
#include "host_sim/parallel.hpp"
#include "host_sim/record/run_options.hpp"

namespace esmc::host {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t largest_package = 128;

// Messages. To the others: 'g' + identity: begin; 'p' + cases: do these; 'x': no more. From them: 'r' +
// results, which asks for more; 'e' + text: an error ended that process.

std::string packages_message(const std::vector<Package>& packages) {
  std::string out = "p";
  for (const Package& p : packages) {
    put(out, p.size());
    for (const std::uint64_t i : p) put(out, i);
  }
  return out;
}
std::vector<Package> read_packages(const std::string& in) {
  std::vector<Package> out;
  for (std::size_t at = 1; at < in.size();) {
    Package& p = out.emplace_back(take<std::size_t>(in, at));
    for (std::uint64_t& i : p) i = take<std::uint64_t>(in, at);
  }
  return out;
}

/// As OpenMPI, MPICH and Intel's mpirun, and Slurm's launcher say it.
bool started_together() {
  for (const char* name : {"OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "MPI_LOCALNRANKS"}) {
    const char* value = std::getenv(name);  // before there are threads
    if (value != nullptr && std::strtol(value, nullptr, 10) > 1) return true;
  }
  return false;
}

/// This process's threads, until the list is empty.
void compute(WorkList& list, const WorkerConfig& config) {
  run_jobs(config.jobs, [&](int) {
    CaseRunner runner(*config.spec, *config.scenes, config.kernel);
    Package package;
    std::vector<Finished> out;
    try {
      while (!stop_requested() && list.next(package)) {
        out.clear();
        const bool whole = runner.run(package, out);
        list.finish(out);
        if (!whole) return;
      }
    } catch (...) {
      list.stop();
      throw;
    }
  });
}

/// Gives the other processes their cases and takes their results, until none of them works any more. Returns
/// what went wrong, null: nothing.
std::exception_ptr dispatch(WorkList& list, Ranks& ranks, const WorkerConfig& config) {
  std::exception_ptr journal, others;
  std::string message;
  for (int busy = ranks.size() - 1; busy > 0;) {
    const int from = ranks.receive(message, false);
    if (from < 0) {
      std::this_thread::sleep_for(std::chrono::microseconds(200));
      continue;
    }
    if (message.empty() || message[0] == 'e') {
      list.stop();
      --busy;
      if (!others && message.size() > 1) others = std::make_exception_ptr(RunError(message.substr(1)));
      continue;
    }
    try {
      std::vector<Finished> results;
      for (std::size_t at = 1; at < message.size();)
        results.push_back(take_finished(message, at, config.spec->wanted.size()));
      list.finish(results);
    } catch (...) {  // by the journal; the other processes must still be told to end
      list.stop();
      journal = std::current_exception();
    }
    std::vector<Package> more;
    Package package;
    while (more.size() < static_cast<std::size_t>(config.jobs) && !stop_requested() && list.next(package))
      more.push_back(package);
    if (more.empty()) --busy;
    ranks.send(from, more.empty() ? "x" : packages_message(more));
  }
  return journal ? journal : others;
}

}  // namespace

std::unique_ptr<Ranks> join_ranks() {
  if (!started_together()) return nullptr;
  std::error_code error;
  Dl_info self{};  // of the Python module: its folder lies in that of the program
  ::dladdr(reinterpret_cast<const void*>(&join_ranks), &self);  // NOLINT(*-reinterpret-cast)
  const fs::path at = fs::canonical(self.dli_fname, error).parent_path();
  void* module = nullptr;
  for (const fs::path& folder : {at, at.parent_path()}) {
    if (module == nullptr) module = ::dlopen((folder / "esmc_mpi.so").c_str(), RTLD_NOW | RTLD_GLOBAL);
  }
  if (module == nullptr) {
    throw RunError(
        "mpirun has started several processes, but this program was built without MPI: install "
        "libopenmpi-dev and build again");
  }
  using Join = Ranks* (*)();
  auto* join = reinterpret_cast<Join>(::dlsym(module, "esmc_join_ranks"));  // NOLINT(*-reinterpret-cast)
  if (join == nullptr) throw RunError("esmc_mpi.so is not of this program");
  return std::unique_ptr<Ranks>(join());
}

WorkList::WorkList(std::vector<bool> done, std::size_t workers, Sink sink)
    : done_(std::move(done)),
      finished_(static_cast<std::size_t>(std::count(done_.begin(), done_.end(), true))),
      package_size_(std::clamp<std::size_t>(
          (done_.size() - finished_) / (16 * std::max<std::size_t>(1, workers)), 1, largest_package)),
      sink_(std::move(sink)),
      progress_(done_.size(), finished_, "cases") {}

bool WorkList::next(Package& out) {
  const std::lock_guard lock(guard_);
  out.clear();
  if (stopped_) return false;
  for (; at_ < done_.size() && out.size() < package_size_; ++at_) {
    if (!done_[at_]) out.push_back(at_);
  }
  return !out.empty();
}

void WorkList::finish(const std::vector<Finished>& cases) {
  const std::lock_guard lock(guard_);
  if (cases.empty()) return;
  sink_(cases);
  finished_ += cases.size();
  progress_.show(finished_);
}

void WorkList::stop() {
  const std::lock_guard lock(guard_);
  stopped_ = true;
}

void work_off(WorkList& list, const WorkerConfig& config, Ranks* ranks) {
  if (ranks == nullptr) return compute(list, config);
  std::exception_ptr failed;
  std::thread own([&] {
    try {
      compute(list, config);
    } catch (...) {
      failed = std::current_exception();
    }
  });
  const std::exception_ptr others = dispatch(list, *ranks, config);
  own.join();
  for (const std::exception_ptr& e : {failed, others}) {
    if (e) std::rethrow_exception(e);
  }
}

void broadcast_job(Ranks& ranks, std::uint64_t identity) {
  std::string message = "g";
  put(message, identity);
  for (int r = 1; r < ranks.size(); ++r) ranks.send(r, message);
}

void finish_workers(Ranks& ranks) {
  for (int r = 1; r < ranks.size(); ++r) ranks.send(r, "x");
}

void serve(const WorkerConfig& config, Ranks& ranks, std::uint64_t identity) {
  std::string message, results = "r";
  (void)ranks.receive(message, true);
  if (message[0] == 'x') return;
  std::size_t at = 1;
  if (take<std::uint64_t>(message, at) != identity) {
    ranks.send(0, "eprocess " + std::to_string(ranks.rank()) +
                      " has another program, specification or scene than the first one");
    return;
  }
  try {
    std::vector<CaseRunner> runners(static_cast<std::size_t>(config.jobs),
                                    CaseRunner(*config.spec, *config.scenes, config.kernel));
    std::vector<std::vector<Finished>> each(runners.size());
    while (true) {
      ranks.send(0, results);
      results.assign(1, 'r');
      (void)ranks.receive(message, true);
      if (message[0] == 'x') return;
      const auto packages = read_packages(message);
      run_jobs(static_cast<int>(std::min(packages.size(), runners.size())), [&](int slot) {
        const auto i = static_cast<std::size_t>(slot);
        (void)runners[i].run(packages[i], each[i]);
      });
      for (auto& some : each) {
        for (const Finished& f : some) put(results, f);
        some.clear();
      }
    }
  } catch (const std::exception& e) {
    ranks.send(0, std::string("e") + e.what());
  }
}

}  // namespace esmc::host
