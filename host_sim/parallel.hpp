#pragma once
/// Threads for work that shares itself out.

#include <cstdint>
#include <functional>

namespace esmc::host {

/// Number of processors of this machine, at least 1.
[[nodiscard]] int processors();
/// Calls work(slot) once for every slot 0 .. jobs - 1 at the same time: slot 0 in the calling thread (also
/// with jobs < 1), every other one in a thread of its own. Returns once all are done, and then throws the
/// first exception of any again.
void run_jobs(int jobs, const std::function<void(int slot)>& work);
/// Calls work(index) once for each index 0 .. count - 1, in `jobs` threads. A call that returns false ends
/// its own thread alone. One that throws ends all, and the exception is thrown again.
void run_each(int jobs, std::uint64_t count, const std::function<bool(std::uint64_t index)>& work);

}  // namespace esmc::host
