#pragma once
/// Frames that wait for a CAN controller, which gets one at a time: the waiting ones can be withdrawn, so
/// that no torque of an earlier tick is sent.

#include <array>
#include <cstdint>

#include "hal/can.hpp"

namespace esmc::hal {

/// First in, first out.
class WaitingFrames {
 public:
  static constexpr std::uint32_t capacity = 32;

  /// Appends a copy of f. False: full, nothing changed.
  [[nodiscard]] bool push(const CanFrame& f) {
    if (size_ == capacity) return false;
    at(size_++) = f;
    return true;
  }
  [[nodiscard]] bool empty() const { return size_ == 0; }
  /// The oldest frame; the caller ensures that it is not empty().
  [[nodiscard]] const CanFrame& front() const { return frames_[first_]; }
  /// Removes the oldest frame; the caller ensures that it is not empty().
  void pop() {
    first_ = (first_ + 1) % capacity;
    --size_;
  }
  /// Removes perishable frames and returns their number; the others keep their order.
  std::uint32_t withdraw() {
    const std::uint32_t before = size_;
    std::uint32_t kept = 0;
    for (std::uint32_t i = 0; i < before; ++i) {
      if (!at(i).perishable) at(kept++) = at(i);
    }
    size_ = kept;
    return before - kept;
  }
  /// Removes all frames and returns their number.
  std::uint32_t clear() {
    const std::uint32_t before = size_;
    size_ = 0;
    return before;
  }

 private:
  [[nodiscard]] CanFrame& at(std::uint32_t i) { return frames_[(first_ + i) % capacity]; }

  std::array<CanFrame, capacity> frames_{};
  std::uint32_t first_ = 0, size_ = 0;
};

}  // namespace esmc::hal
