#pragma once
/// frames.log: every frame that passes a node, in the format of `candump -L`, stamped with virtual time.

#include <cstdint>
#include <cstdio>
#include <functional>
#include <string>
#include <utility>

#include "hal/can.hpp"
#include "host_sim/file_handle.hpp"
#include "host_sim/report/series.hpp"

namespace esmc::host {

/// One line of candump -L, without the newline: "(0000000001.001135) vcan0 022#0000000008000000".
std::string candump_line(std::int64_t time_us, const std::string& interface, const hal::CanFrame& f);

class FrameLog {
 public:
  FrameLog() = default;
  /// Takes both files, null: not written. `bitrate`: bit/s, > 0. `fast_bit`: CAN FD data bit, in bit times.
  /// `passage`: for the replay of one end, a row per frame: count of look(), 1 sent or 0 received, age_us.
  FrameLog(std::FILE* file, std::string interface, std::uint32_t bitrate, double fast_bit,
           std::FILE* passage = nullptr);

  /// Sets the virtual time of the tick that begins, s, never back. Its frames follow at the bit rate.
  void tick(double time_s) {
    const auto now = static_cast<std::int64_t>(time_s * 1e6 + 0.5);
    time_us_ = now > time_us_ ? now : time_us_;
  }
  /// Calls tick(), and adds the bits of the tick before to load(). Call once per tick.
  void begin_tick(double time_s) {
    tick(time_s);
    if (file_ == nullptr) return;
    load_.add(static_cast<double>(bits_ - seen_bits_));
    seen_bits_ = bits_;
  }
  /// Call when the node looks at the bus again: it did not know of the frames that it receives from here on.
  void look() { ++looks_; }
  /// Counts and logs a frame that the node has sent, or received after it waited for age_us.
  void sent(const hal::CanFrame& f) {
    frame(f);
    if (passage_ != nullptr) pass(true, 0);
  }
  void received(const hal::CanFrame& f, std::uint32_t age_us) {
    frame(f);
    if (passage_ != nullptr) pass(false, age_us);
  }
  /// Logs a frame of a bus that knows when its last bit came (`time_s`, virtual, s) and its bits on the wire.
  void frame_at(double time_s, std::uint32_t bits, const hal::CanFrame& f);
  /// Gives every frame with its time, us, to `to` as well.
  void also(std::function<void(std::int64_t, const hal::CanFrame&)> to) { also_ = std::move(to); }
  /// Closes the files. Throws RunError when one could not be written completely.
  void close();

  [[nodiscard]] std::uint64_t frames() const { return frames_; }  ///< also where nothing is written
  [[nodiscard]] std::uint64_t bits() const { return bits_; }      ///< with worst-case stuffing, or as given
  /// Bits before the first tick, then of each tick but the last. Empty where nothing is written.
  [[nodiscard]] const Binned& load() const { return load_; }

 private:
  void frame(const hal::CanFrame& f);
  void write(const hal::CanFrame& f);
  void pass(bool sent, std::uint32_t age_us);

  std::function<void(std::int64_t, const hal::CanFrame&)> also_;
  FileHandle file_, passage_;
  std::string interface_;
  std::uint32_t bitrate_ = 1'000'000;
  double fast_bit_ = 1.0;
  std::int64_t time_us_ = 0, last_us_ = 0;
  std::uint32_t last_bits_ = 0;
  std::uint64_t frames_ = 0, bits_ = 0, seen_bits_ = 0;
  std::uint64_t looks_ = 0;
  Binned load_;
};

/// A bus whose traffic, as one node sees it, goes through a FrameLog. Bus and log must outlive it.
template <hal::CanBus Bus>
class Tapped {
 public:
  Tapped(Bus& bus, FrameLog& log) : bus_(&bus), log_(&log) {}
  /// Sends; a frame that the bus takes is logged, one that it does not is counted in lost().
  [[nodiscard]] hal::SendStatus try_send(const hal::CanFrame& f) {
    const hal::SendStatus s = bus_->try_send(f);
    if (s == hal::SendStatus::ok) {
      log_->sent(f);
    } else {
      ++lost_;
    }
    return s;
  }
  [[nodiscard]] bool try_receive(hal::CanFrame& f) {
    if (!bus_->try_receive(f)) return false;
    log_->received(f, age_us());
    return true;
  }
  void look() {
    log_->look();
    if constexpr (requires { bus_->look(); }) bus_->look();
  }
  [[nodiscard]] std::uint32_t frame_age_us() const requires hal::TimesFrames<Bus> {
    return bus_->frame_age_us();
  }
  [[nodiscard]] Bus& bus() { return *bus_; }  ///< the bus behind it
  [[nodiscard]] const Bus& bus() const { return *bus_; }
  [[nodiscard]] std::uint64_t lost() const { return lost_; }  ///< frames that the bus did not take

 private:
  [[nodiscard]] std::uint32_t age_us() const {
    if constexpr (hal::TimesFrames<Bus>) {
      return bus_->frame_age_us();
    } else {
      return 0;
    }
  }

  Bus* bus_;
  FrameLog* log_;
  std::uint64_t lost_ = 0;
};

}  // namespace esmc::host
