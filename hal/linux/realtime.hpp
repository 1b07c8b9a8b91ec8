#pragma once
/// What makes a Linux process keep its instants: fixed priority, memory that stays, a clock that nobody sets.

#include <cstdint>
#include <system_error>

namespace esmc::hal {

/// CLOCK_MONOTONIC, ns.
[[nodiscard]] std::uint64_t monotonic_ns();

/// This thread before all others of lower priority, 1 to 99 (SCHED_FIFO). Needs CAP_SYS_NICE or a limit
/// (ulimit -r).
[[nodiscard]] std::error_code fixed_priority(int priority);
/// All memory of the process, what it will get too, stays in RAM, and 256 KiB of this thread's stack are
/// there already. Needs CAP_IPC_LOCK or a limit (ulimit -l).
[[nodiscard]] std::error_code lock_memory();

/// Waits for an absolute instant or a descriptor, whichever is first.
class Alarm {
 public:
  Alarm();
  Alarm(const Alarm&) = delete;
  Alarm& operator=(const Alarm&) = delete;
  ~Alarm();
  /// Until `instant_ns` of monotonic_ns(), or `descriptor` can be read, or a signal came, or for a second.
  void wait(std::uint64_t instant_ns, int descriptor) const;

 private:
  int timer_;
};

}  // namespace esmc::hal
