#pragma once
/// A progress bar on stderr for runs that take long, where that is a terminal.

#include <unistd.h>

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <string>

namespace esmc::host {

/// Progress bar with share and remaining time; draws nothing unless stderr is a terminal.
class Progress {
 public:
  /// `ticks`: total; `before`: done before this run. With a `unit` (plural) the rate is shown as well.
  explicit Progress(std::uint64_t ticks, std::uint64_t before = 0, const char* unit = nullptr)
      : ticks_(::isatty(STDERR_FILENO) != 0 ? ticks : 0), before_(before), unit_(unit) {}
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;
  ~Progress() {
    if (drawn_) std::fputs("\r\033[K", stderr);
  }

  /// Shows that `tick` ticks are done. Call at every tick: it looks at the clock at every 64th.
  void at(std::uint64_t tick) {
    if (tick % 64 == 0) show(tick);
  }
  /// Draws the bar, `tick` ticks being done; at most every 0.2 s and not in the first 2 s.
  void show(std::uint64_t tick) {
    if (ticks_ == 0) return;
    const auto now = Clock::now();
    if (now < next_) return;
    next_ = now + std::chrono::milliseconds(200);
    drawn_ = true;
    constexpr std::size_t width = 30;
    const double done = static_cast<double>(tick) / static_cast<double>(ticks_);
    const auto filled = static_cast<std::size_t>(done * width);
    const double rate =
        static_cast<double>(tick - before_) / std::chrono::duration<double>(now - begin_).count();
    const double left = rate > 0.0 ? static_cast<double>(ticks_ - tick) / rate : 0.0;
    const std::string bar = std::string(filled, '#') + std::string(width - filled, ' ');
    std::fprintf(stderr, "\r[%s] %3.0f %%", bar.c_str(), 100.0 * done);
    if (unit_ != nullptr) std::fprintf(stderr, ", %.0f %s/s", rate, unit_);
    std::fprintf(stderr, ", about %.0f s left\033[K", left);
    std::fflush(stderr);
  }

 private:
  using Clock = std::chrono::steady_clock;
  std::uint64_t ticks_;  ///< 0: nothing is drawn
  std::uint64_t before_;
  const char* unit_;
  Clock::time_point begin_ = Clock::now(), next_ = begin_ + std::chrono::seconds(2);
  bool drawn_ = false;
};

}  // namespace esmc::host
