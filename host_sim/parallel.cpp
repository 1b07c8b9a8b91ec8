#include "host_sim/parallel.hpp"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <exception>
#include <future>
#include <mutex>
#include <thread>
#include <vector>

#include "host_sim/stop.hpp"

namespace esmc::host {

int processors() { return static_cast<int>(std::max(1U, std::thread::hardware_concurrency())); }

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
  std::vector<std::future<void>> others;
  for (int i = 1; i < jobs; ++i) others.push_back(std::async(std::launch::async, safely, i));
  safely(0);
  for (const std::future<void>& o : others) {
    // A hook of this thread may hear of a signal here; the other threads then find the request.
    while (o.wait_for(std::chrono::milliseconds(50)) != std::future_status::ready) (void)stop_requested();
  }
  if (first) std::rethrow_exception(first);
}

void run_each(int jobs, std::uint64_t count, const std::function<bool(std::uint64_t)>& work) {
  std::atomic<std::uint64_t> next{0};
  run_jobs(jobs, [&](int) {
    try {
      for (std::uint64_t i = next++; i < count && work(i);) i = next++;
    } catch (...) {
      next = count;  // the other threads need not go on
      throw;
    }
  });
}

}  // namespace esmc::host
