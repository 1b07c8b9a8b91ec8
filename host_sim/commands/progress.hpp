#pragma once
/// A progress bar on stderr for runs that take long, where that is a terminal.

#include <unistd.h>

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <string>

namespace esmc::host {

class Progress {
 public:
  explicit Progress(std::uint64_t ticks) : ticks_(::isatty(STDERR_FILENO) != 0 ? ticks : 0) {}
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;
  ~Progress() {
    if (drawn_) std::fputs("\r\033[K", stderr);
  }

  /// Call at every tick; looks at the clock at every 64th.
  void at(std::uint64_t tick) {
    if (ticks_ == 0 || tick % 64 != 0) return;
    const auto now = Clock::now();
    if (now < next_) return;
    next_ = now + std::chrono::milliseconds(200);
    drawn_ = true;
    constexpr std::size_t width = 30;
    const double done = static_cast<double>(tick) / static_cast<double>(ticks_);
    const auto filled = static_cast<std::size_t>(done * width);
    const double left =
        done > 0.0 ? std::chrono::duration<double>(now - begin_).count() * (1.0 / done - 1.0) : 0.0;
    const std::string bar = std::string(filled, '#') + std::string(width - filled, ' ');
    std::fprintf(stderr, "\r[%s] %3.0f %%, about %.0f s left\033[K", bar.c_str(), 100.0 * done, left);
    std::fflush(stderr);
  }

 private:
  using Clock = std::chrono::steady_clock;
  std::uint64_t ticks_;  ///< 0: nothing is drawn
  Clock::time_point begin_ = Clock::now(), next_ = begin_ + std::chrono::seconds(2);
  bool drawn_ = false;
};

}  // namespace esmc::host
