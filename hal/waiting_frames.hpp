#pragma once
/// Frames that wait for a buffer of a CAN controller, in the order in which the bus would take them.

#include <array>
#include <cstdint>

#include "hal/can.hpp"

namespace esmc::hal {

/// Priority queue of frames: the smallest arbitration field first, so that no frame of the node waits behind
/// a less urgent one; equal ones first in, first out. Identifiers are priorities on any bus, also in the
/// queues of other nodes and of adapters, so no sequence of a protocol relies on the order of two
/// identifiers: each step waits for the drive's answer to the one before. Perishable frames can be withdrawn,
/// so that no torque of an earlier tick is sent.
class WaitingFrames {
 public:
  static constexpr std::uint32_t capacity = 32;
  static constexpr std::uint32_t returned_max = 3;  ///< frames beyond `capacity` that give_back() may add

  /// Adds a copy of f behind those of its priority; when full, in the place of the least urgent frame, which
  /// is dropped: on a bus that lets only urgent frames through, the others must not keep these out. False:
  /// full of frames that are not less urgent, nothing changed.
  [[nodiscard]] bool push(const CanFrame& f) {
    if (size_ >= capacity) {
      if (arbitration(f) >= arbitration(frames_[0])) return false;
      for (std::uint32_t i = 1; i < size_; ++i) copy_used(frames_[i], frames_[i - 1]);
      --size_;
      ++dropped_;
    }
    insert(f, true);
    return true;
  }
  /// Adds a copy of f, which a controller has returned, before those of its priority; dropped if all is full.
  void give_back(const CanFrame& f) {
    if (size_ < frames_.size()) insert(f, false);
  }
  [[nodiscard]] bool empty() const { return size_ == 0; }
  /// Number of frames that push() has dropped.
  [[nodiscard]] std::uint32_t dropped() const { return dropped_; }
  /// The most urgent frame; the caller ensures that it is not empty().
  [[nodiscard]] const CanFrame& front() const { return frames_[size_ - 1]; }
  /// Removes front(); the caller ensures that it is not empty().
  void pop() { --size_; }
  /// Removes perishable frames and returns their number; the others keep their order.
  std::uint32_t withdraw() {
    const std::uint32_t before = size_;
    std::uint32_t kept = 0;
    for (std::uint32_t i = 0; i < before; ++i) {
      if (!frames_[i].perishable) frames_[kept++] = frames_[i];
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
  /// Before the frames of the same priority, or `behind` them.
  void insert(const CanFrame& f, bool behind) {
    const std::uint32_t key = arbitration(f);
    std::uint32_t i = size_++;
    for (; i > 0; --i) {
      const std::uint32_t other = arbitration(frames_[i - 1]);
      if (behind ? other > key : other >= key) break;
      copy_used(frames_[i - 1], frames_[i]);
    }
    copy_used(f, frames_[i]);
  }

  std::array<CanFrame, capacity + returned_max> frames_{};  // the most urgent last
  std::uint32_t size_ = 0, dropped_ = 0;
};

}  // namespace esmc::hal
