#pragma once
/// Frames that wait for a CAN controller which is given one at a time, so that what the bus has not taken can
/// be withdrawn: no torque of an earlier tick is sent.

#include <array>
#include <cstdint>

#include "hal/can.hpp"

namespace esmc::hal {

/// First in, first out.
class WaitingFrames {
 public:
  static constexpr std::uint32_t most = 32;

  /// False: there is no room.
  [[nodiscard]] bool push(const CanFrame& f) {
    if (size_ == most) return false;
    at(size_++) = f;
    return true;
  }
  [[nodiscard]] bool empty() const { return size_ == 0; }
  /// The oldest one. Not empty.
  [[nodiscard]] const CanFrame& front() const { return frames_[first_]; }
  void pop() {
    first_ = (first_ + 1) % most;
    --size_;
  }
  /// Without what is perishable; the others keep their order: whoever sent them counts on their being sent.
  /// How many it were.
  std::uint32_t withdraw() {
    const std::uint32_t before = size_;
    std::uint32_t kept = 0;
    for (std::uint32_t i = 0; i < before; ++i) {
      if (!at(i).perishable) at(kept++) = at(i);
    }
    size_ = kept;
    return before - kept;
  }
  /// Without any. How many it were.
  std::uint32_t clear() {
    const std::uint32_t before = size_;
    size_ = 0;
    return before;
  }

 private:
  [[nodiscard]] CanFrame& at(std::uint32_t i) { return frames_[(first_ + i) % most]; }

  std::array<CanFrame, most> frames_{};
  std::uint32_t first_ = 0, size_ = 0;
};

}  // namespace esmc::hal
