#pragma once
/// A queue from an interrupt to the program that it interrupts, or between two threads, without locks.

#include <array>
#include <atomic>
#include <cstdint>

namespace esmc::hal {

/// Queue of one producer and one consumer. Each index has one writer: `head_` the producer, `tail_` the
/// consumer. The release of an index publishes the slots before it, so neither side has to mask interrupts.
/// `size`: a power of two, for indices wrap.
template <class T, std::uint32_t size>
class SpscRing {
  static_assert((size & (size - 1)) == 0);

 public:
  /// Producer: the slot to fill before push(); null: full.
  [[nodiscard]] T* free_slot() {
    const std::uint32_t head = head_.load(std::memory_order_relaxed);
    return head - tail_.load(std::memory_order_acquire) == size ? nullptr : &slots_[head % size];
  }
  /// Producer: appends the filled slot to the queue.
  void push() { head_.store(head_.load(std::memory_order_relaxed) + 1, std::memory_order_release); }
  /// Consumer: the oldest element, valid until pop(); null: empty.
  [[nodiscard]] const T* front() const {
    const std::uint32_t tail = tail_.load(std::memory_order_relaxed);
    return head_.load(std::memory_order_acquire) == tail ? nullptr : &slots_[tail % size];
  }
  /// Consumer: removes front(); the caller ensures that there is one.
  void pop() { tail_.store(tail_.load(std::memory_order_relaxed) + 1, std::memory_order_release); }
  /// Drops all elements; while there is no producer.
  void clear() { tail_.store(head_.load(std::memory_order_relaxed), std::memory_order_relaxed); }

 private:
  std::array<T, size> slots_{};
  std::atomic<std::uint32_t> head_ = 0, tail_ = 0;
};

}  // namespace esmc::hal
