#pragma once
/// Threads for work that shares itself out.

#include <cstdint>
#include <functional>

namespace esmc::host {

/// Of this machine, at least one.
[[nodiscard]] int processors();
/// Calls work(slot) once for every slot 0 .. jobs - 1, each in a thread of its own. The first exception of
/// any is thrown again once all are done.
void run_jobs(int jobs, const std::function<void(int slot)>& work);
/// Calls work(index) for 0 .. count - 1, in `jobs` threads, until one returns false or throws.
void run_each(int jobs, std::uint64_t count, const std::function<bool(std::uint64_t index)>& work);

}  // namespace esmc::host
