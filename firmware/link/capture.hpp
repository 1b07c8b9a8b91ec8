#pragma once
/// The last ticks before a fault, in memory that the board provides, for the supervisor computer to read.

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>

#include "firmware/link/codec.hpp"

namespace esmc::link {

/// A tick as it is kept, little endian; docs/command-interface.md has its fields.
using CaptureRecord = std::array<std::uint8_t, capture_record_size>;

/// Values of a tick of which a record is made. Torques are stored as shares of their limits.
struct CaptureTick {
  std::uint32_t tick = 0;         ///< since power-up, modulo 2^32
  std::uint32_t lateness_us = 0;  ///< of the tick; more than 65535 are stored as 65535
  State state = State::disabled;
  Fault fault = Fault::none;
  bool obeyed = false, refused = false;  ///< a frame of the supervisor computer was, since the record before
  std::array<float, 2> angle{};          ///< rad, base joints
  std::array<float, 2> torque{}, torque_max{};  ///< N m, base joints; |torque| <= torque_max
  std::array<float, 2> error{};                 ///< m, effector
};

/// Integer nearest to v, at most `most` in size; 0 for a NaN.
[[nodiscard]] constexpr std::int32_t rounded_within(float v, std::int32_t most) {
  const auto limit = static_cast<float>(most);
  if (v >= limit) return most;
  if (v <= -limit) return -most;
  return v == v ? static_cast<std::int32_t>(v + (v < 0.0F ? -0.5F : 0.5F)) : 0;
}

/// Record of a tick: see CaptureRecord. Angles and errors are clamped to 23 bits of position_unit.
[[nodiscard]] constexpr CaptureRecord encode_record(const CaptureTick& t) {
  CaptureRecord r{};
  unsigned at = 0;
  const auto put = [&](std::uint32_t v, unsigned bytes) {
    for (unsigned i = 0; i < bytes; ++i) r[at++] = static_cast<std::uint8_t>(v >> (8U * i));
  };
  const auto number = [&](float v, std::int32_t most, unsigned bytes) {
    put(static_cast<std::uint32_t>(rounded_within(v, most)), bytes);
  };
  put(t.tick, 4);
  for (const float a : t.angle) number(a / position_unit, 0x7F'FFFF, 3);
  for (unsigned i = 0; i < 2; ++i)
    number(t.torque[i] / t.torque_max[i] * capture_torque_steps, static_cast<int>(capture_torque_steps), 2);
  for (const float e : t.error) number(e / position_unit, 0x7F'FFFF, 3);
  put(std::min<std::uint32_t>(t.lateness_us, 0xFFFF), 2);
  put(static_cast<std::uint32_t>(t.fault), 1);
  put(static_cast<unsigned>(t.state) | (t.obeyed ? 0x10U : 0U) | (t.refused ? 0x20U : 0U), 1);
  return r;
}

/// Keeps a record of each tick in which the controller is not disabled, in a ring. After a fault it records
/// an eighth of the ring more and stops until the reset; the next arming overwrites the oldest records. It
/// can be read while nothing is recorded.
class Capture {
 public:
  static constexpr std::size_t block = 64;  ///< records per request
  static constexpr std::size_t records_max =
      0x3FFF;  ///< numbers of parts have 16 bits, one is capture_status
  static_assert(records_max / block < 256, "an index of a request has 8 bits");

  Capture() = default;
  /// `memory`: at most records_max are used; it must outlive every copy of this object. Empty: no capture.
  explicit Capture(std::span<CaptureRecord> memory)
      : memory_(memory.first(std::min(memory.size(), records_max))) {}

  [[nodiscard]] bool active() const { return !memory_.empty(); }  ///< false: nothing is kept
  /// Records a tick; once per tick, while active().
  void record(const CaptureTick& t) {
    if (t.fault == Fault::none) left_ = memory_.size() / 8 + 1;
    ready_ = t.state == State::disabled || left_ == 0;
    if (ready_) return;
    if (t.fault != Fault::none) --left_;
    next_ = end_ = 0;
    memory_[head_] = encode_record(t);
    head_ = head_ + 1 < memory_.size() ? head_ + 1 : 0;
    count_ = std::min(count_ + 1, memory_.size());
    ++recorded_;
  }
  /// Answers a request: queues the state and, if it is ready, the records of block `index` (0: the oldest).
  void read(std::uint8_t index) {
    state_due_ = true;
    if (!ready_) return;
    next_ = std::min(index * block, count_) * capture_parts;
    end_ = std::min((index + 1U) * block, count_) * capture_parts;
  }
  /// Sends the next queued frame, which stays queued if the bus does not take it. False: nothing is queued.
  template <class Send>
  bool transmit(std::uint32_t base, Send&& send) {
    const auto byte = [](std::size_t v) { return static_cast<std::uint8_t>(v); };
    if (state_due_) {
      const CaptureState s = memory_.empty() ? CaptureState::none
                             : ready_        ? CaptureState::ready
                                             : CaptureState::recording;
      state_due_ = !send(encode_capture(base, capture_status,
                                        {static_cast<std::uint8_t>(s), 0, byte(count_), byte(count_ >> 8U),
                                         byte(recorded_), byte(recorded_ >> 8U)}));
      return true;
    }
    if (next_ == end_) return false;
    const std::size_t oldest = count_ < memory_.size() ? 0 : head_, at = oldest + next_ / capture_parts;
    const CaptureRecord& r = memory_[at < memory_.size() ? at : at - memory_.size()];
    CapturePart part{};
    for (unsigned i = 0; i < capture_part_size; ++i)
      part[i] = r[next_ % capture_parts * capture_part_size + i];
    if (send(encode_capture(base, static_cast<std::uint16_t>(next_), part))) ++next_;
    return true;
  }

 private:
  std::span<CaptureRecord> memory_;
  std::size_t head_ = 0, count_ = 0, left_ = 0;  // next record; records; yet to come after a fault
  std::size_t next_ = 0, end_ = 0;               // parts to be sent
  std::size_t recorded_ = 0;                     // since power-up
  bool ready_ = true, state_due_ = false;
};

}  // namespace esmc::link
