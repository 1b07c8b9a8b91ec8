#include "host_sim/parallel.hpp"

#include <cstddef>

#ifdef ESMC_WITH_TBB
#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_arena.h>
#else
#include <exception>
#include <mutex>
#include <thread>
#include <vector>
#endif

namespace esmc::host {

#ifdef ESMC_WITH_TBB

const char* thread_library() { return "oneTBB"; }

void run_jobs(int jobs, const std::function<void(int)>& work) {
  namespace tbb = oneapi::tbb;
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                  static_cast<std::size_t>(jobs));
  tbb::task_arena arena(jobs);
  arena.execute([&] { tbb::parallel_for(0, jobs, 1, work, tbb::simple_partitioner()); });
}

#else

const char* thread_library() { return "std::thread"; }

void run_jobs(int jobs, const std::function<void(int)>& work) {
  std::exception_ptr first;
  std::mutex guard;
  const auto safely = [&](int slot) {
    try {
      work(slot);
    } catch (...) {
      const std::lock_guard lock(guard);
      if (!first) first = std::current_exception();
    }
  };
  std::vector<std::thread> threads;
  for (int i = 1; i < jobs; ++i) threads.emplace_back(safely, i);
  safely(0);
  for (std::thread& t : threads) t.join();
  if (first) std::rethrow_exception(first);
}

#endif

}  // namespace esmc::host
