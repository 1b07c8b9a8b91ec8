#include "host_sim/parallel.hpp"

#include <exception>
#include <mutex>
#include <thread>
#include <vector>

namespace esmc::host {

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

}  // namespace esmc::host
