#pragma once
/// Real time in a Linux process: fixed priority, locked memory, a monotonic clock.

#include <cstdint>
#include <system_error>

#include "hal/linux/descriptor.hpp"

namespace esmc::hal {

/// Time of CLOCK_MONOTONIC, ns: since boot, never set back.
[[nodiscard]] std::uint64_t monotonic_ns();

/// Sets this thread's fixed priority, 1 to 99 (SCHED_FIFO). EPERM without CAP_SYS_NICE or limit (ulimit -r).
[[nodiscard]] std::error_code fixed_priority(int priority);
/// Locks present and future memory of the process in RAM, and touches 256 KiB of this thread's stack. Returns
/// the kernel's error; needs CAP_IPC_LOCK or a limit (ulimit -l).
[[nodiscard]] std::error_code lock_memory();

/// A timer that waits for an absolute instant or a descriptor.
class Alarm {
 public:
  Alarm();
  /// Returns at `instant_ns` of monotonic_ns(), when `descriptor` is readable, at a signal, or after a
  /// second.
  void wait(std::uint64_t instant_ns, int descriptor) const;

 private:
  Descriptor timer_;
};

}  // namespace esmc::hal
