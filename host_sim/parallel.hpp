#pragma once
/// Threads for work that shares itself out.

#include <functional>

namespace esmc::host {

/// Calls work(slot) once for every slot 0 .. jobs - 1, each in a thread of its own. The first exception of
/// any is thrown again once all are done.
void run_jobs(int jobs, const std::function<void(int slot)>& work);

}  // namespace esmc::host
