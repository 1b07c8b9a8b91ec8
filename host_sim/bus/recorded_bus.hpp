#pragma once
/// A bus for the replay of one node: delivers the frames that the node received, and compares the frames that
/// it sends with those it sent.

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <utility>

#include "hal/can.hpp"

namespace esmc::host {

/// A frame as one node saw it pass.
struct PassedFrame {
  std::int64_t time_us = 0;
  std::uint64_t look = 0;    ///< of the node at the bus, counted from 0
  bool sent = false;         ///< by the node
  std::uint32_t age_us = 0;  ///< of a received one: how long it had waited
  hal::CanFrame frame{};
};

class RecordedBus {
 public:
  /// Returns the next frame with each call; none: no more.
  using Source = std::function<std::optional<PassedFrame>()>;
  /// Calls `next` at once for the first frame; what it captures must outlive the bus.
  RecordedBus(std::string interface, Source next)
      : interface_(std::move(interface)), source_(std::move(next)), head_(source_()) {}

  /// The first sent frame that differs.
  struct Deviation {
    std::uint64_t line;  ///< of the recording, from 1
    std::optional<hal::CanFrame>
        recorded;  ///< none: the node received a frame here, or the recording is over
    std::optional<hal::CanFrame> computed;  ///< none: the node sends nothing
    std::int64_t time_us;
  };

  /// Takes any well-formed frame. One that is not the next of the recording becomes the deviation().
  [[nodiscard]] hal::SendStatus try_send(const hal::CanFrame& f) {
    if (!hal::well_formed(f)) return hal::SendStatus::refused;
    const bool then = head_ && head_->sent;
    if (!then || !(head_->frame == f)) deviate(then ? std::optional(head_->frame) : std::nullopt, f);
    if (then) advance();
    return hal::SendStatus::ok;
  }
  /// Takes the next frame. False, `f` untouched: the node had none at this look, or sent one first.
  [[nodiscard]] bool try_receive(hal::CanFrame& f) {
    if (!has_input() || head_->look > looks_) return false;
    f = head_->frame;
    age_us_ = head_->age_us;
    advance();
    return true;
  }
  [[nodiscard]] std::uint32_t frame_age_us() const { return age_us_; }  ///< of the frame received last
  /// Call before each look of the node at the bus: it may then receive the frames that had come by that look.
  void look() { ++looks_; }

  /// Whether the next recorded frame is one that the node received, at this look or a later one.
  [[nodiscard]] bool has_input() const { return head_ && !head_->sent; }
  [[nodiscard]] bool over() const { return !head_; }  ///< no recorded frame is left
  [[nodiscard]] const std::string& interface() const { return interface_; }
  [[nodiscard]] std::uint64_t passed() const { return line_ - 1; }  ///< recorded frames taken so far
  /// Call when the node is done: a sent frame that remains in the recording is then a deviation.
  void end() {
    for (; head_; advance()) {
      if (head_->sent) return deviate(head_->frame, std::nullopt);
    }
  }
  [[nodiscard]] const std::optional<Deviation>& deviation() const { return deviation_; }  ///< the first

 private:
  void advance() {
    time_us_ = head_->time_us;
    head_ = source_();
    ++line_;
  }
  void deviate(std::optional<hal::CanFrame> recorded, std::optional<hal::CanFrame> computed) {
    if (!deviation_) deviation_ = Deviation{line_, recorded, computed, head_ ? head_->time_us : time_us_};
  }

  std::string interface_;
  Source source_;
  std::optional<PassedFrame> head_;
  std::uint64_t line_ = 1, looks_ = 0;
  std::int64_t time_us_ = 0;
  std::uint32_t age_us_ = 0;
  std::optional<Deviation> deviation_;
};

static_assert(hal::TimesFrames<RecordedBus>);

}  // namespace esmc::host
