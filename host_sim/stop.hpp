#pragma once
/// The request to stop, which every loop asks for.

#include <atomic>

namespace esmc::host {

using StopHook = void (*)();
/// What this thread calls whenever its loops ask whether to stop; null: nothing. It may set the flag.
inline constinit thread_local StopHook before_stop_check = nullptr;
/// Set by SIGINT and SIGTERM: loops end with zero torque and a summary.
inline std::atomic<bool>& stop_requested() {
  static std::atomic<bool> flag{false};
  if (before_stop_check != nullptr) before_stop_check();
  return flag;
}

}  // namespace esmc::host
