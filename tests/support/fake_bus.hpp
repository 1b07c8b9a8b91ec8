#pragma once
/// A CAN controller under the hand of a test: frames to be received are queued, frames sent are listed, and
/// it can refuse to send as a full or a dead controller does. Fixed storage: it serves the no-heap test as
/// well.

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <span>

#include "hal/can.hpp"

namespace esmc::test {

/// `Waiting`: frames its receive queue holds.
template <std::size_t Waiting>
class BasicFakeBus {
 public:
  static constexpr std::size_t waiting_max = Waiting;
  static constexpr std::size_t sent_max = 64;

  /// `f` will be received after those already queued.
  void push(const hal::CanFrame& f) {
    if (pushed_ - taken_ == waiting_max) std::abort();  // a test that loses frames proves nothing
    waiting_[pushed_++ % waiting_max] = f;
  }
  [[nodiscard]] std::size_t waiting() const { return pushed_ - taken_; }

  /// What was accepted for sending since the last `clear`.
  [[nodiscard]] std::span<const hal::CanFrame> sent() const { return {sent_.data(), sent_count_}; }
  /// What was offered, accepted or not.
  [[nodiscard]] std::size_t offered() const { return offered_; }
  void clear() { sent_count_ = offered_ = 0; }

  /// The answer to frames from now on: `status`, after `accepted` more of them were taken.
  void answer(hal::SendStatus status, std::size_t accepted = 0) {
    status_ = status;
    accepted_ = accepted;
  }

  hal::SendStatus try_send(const hal::CanFrame& f) {
    ++offered_;
    if (!hal::well_formed(f)) return hal::SendStatus::refused;
    if (status_ != hal::SendStatus::ok) {
      if (accepted_ == 0) return status_;
      --accepted_;
    }
    if (sent_count_ == sent_max) std::abort();
    sent_[sent_count_++] = f;
    return hal::SendStatus::ok;
  }
  bool try_receive(hal::CanFrame& f) {
    if (taken_ == pushed_) return false;
    f = waiting_[taken_++ % waiting_max];
    return true;
  }

 private:
  std::array<hal::CanFrame, waiting_max> waiting_{};
  std::array<hal::CanFrame, sent_max> sent_{};
  std::size_t pushed_ = 0, taken_ = 0, sent_count_ = 0, offered_ = 0, accepted_ = 0;
  hal::SendStatus status_ = hal::SendStatus::ok;
};

using FakeBus = BasicFakeBus<1024>;
static_assert(hal::CanBus<FakeBus>);

/// Knows how long a frame has waited.
struct TimedBus : FakeBus {
  std::uint32_t age_us = 0;
  [[nodiscard]] std::uint32_t frame_age_us() const { return age_us; }
};
static_assert(hal::TimesFrames<TimedBus>);

/// Counts what it has lost.
struct LosingBus : FakeBus {
  std::uint32_t lost = 0;
  [[nodiscard]] std::uint32_t overruns() const { return lost; }
};

}  // namespace esmc::test
