#pragma once
/// Ticks against the wall clock.

#include <chrono>
#include <cstdint>
#include <thread>

namespace esmc::host {

/// Absolute instants k * period after construction. wait() sleeps until the next one; one missed by more than
/// a period is counted as late, and the instants go on from now.
class Pace {
 public:
  /// `waits` false: wait() returns at once, for a replay. `period_s` in s.
  explicit Pace(double period_s, bool waits = true)
      : waits_(waits),
        period_(std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(period_s))),
        next_(Clock::now()) {}
  void wait() {
    if (!waits_) return;
    next_ += period_;
    const auto now = Clock::now();
    if (now > next_ + period_) {
      ++late_;
      next_ = now;
    }
    std::this_thread::sleep_until(next_);
  }
  [[nodiscard]] std::uint64_t late() const { return late_; }  ///< instants missed so far
  /// Time, s, since the instant that wait() waited for.
  [[nodiscard]] double since() const { return std::chrono::duration<double>(Clock::now() - next_).count(); }

 private:
  using Clock = std::chrono::steady_clock;
  bool waits_;
  Clock::duration period_;
  Clock::time_point next_;
  std::uint64_t late_ = 0;
};

}  // namespace esmc::host
