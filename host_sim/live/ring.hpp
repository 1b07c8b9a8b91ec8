#pragma once
/// A bounded queue from one thread to one other, without locks: neither side ever waits. What does not fit is
/// refused, and the sender decides what that means.

#include <array>
#include <atomic>
#include <cstddef>
#include <utility>

namespace esmc::host {

/// `Capacity`: a power of two.
template <class T, std::size_t Capacity>
class Ring {
  static_assert((Capacity & (Capacity - 1)) == 0 && Capacity > 0);

 public:
  /// Appends `value`; the sender's thread alone. False: full, `value` is unchanged.
  [[nodiscard]] bool push(T&& value) {
    const std::size_t at = written_.load(std::memory_order_relaxed);
    if (at - taken_.load(std::memory_order_acquire) == Capacity) return false;
    slots_[at % Capacity] = std::move(value);
    written_.store(at + 1, std::memory_order_release);
    return true;
  }
  /// Takes the oldest value; the receiver's thread alone. False: empty, `value` is unchanged.
  [[nodiscard]] bool pop(T& value) {
    const std::size_t at = taken_.load(std::memory_order_relaxed);
    if (at == written_.load(std::memory_order_acquire)) return false;
    value = std::exchange(slots_[at % Capacity], T{});  // what it owned is let go of on this side
    taken_.store(at + 1, std::memory_order_release);
    return true;
  }

 private:
  std::array<T, Capacity> slots_{};
  // On cache lines of their own: each is written by one thread and read by the other.
  alignas(64) std::atomic<std::size_t> written_{0};
  alignas(64) std::atomic<std::size_t> taken_{0};
};

}  // namespace esmc::host
