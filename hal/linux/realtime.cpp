#include "hal/linux/realtime.hpp"

#include <poll.h>
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/timerfd.h>
#include <time.h>

#include <array>
#include <cerrno>

namespace esmc::hal {
namespace {
std::error_code reason(int code) { return {code, std::generic_category()}; }
}  // namespace

std::uint64_t monotonic_ns() {
  timespec t{};
  (void)::clock_gettime(CLOCK_MONOTONIC, &t);
  return static_cast<std::uint64_t>(t.tv_sec) * 1'000'000'000U + static_cast<std::uint64_t>(t.tv_nsec);
}

std::error_code fixed_priority(int priority) {
  const sched_param wanted{.sched_priority = priority};
  return reason(::pthread_setschedparam(::pthread_self(), SCHED_FIFO, &wanted));
}

std::error_code lock_memory() {
  if (::mlockall(MCL_CURRENT | MCL_FUTURE) != 0) return reason(errno);
  std::array<unsigned char, 256 * 1024> touched;
  for (std::size_t i = 0; i < touched.size(); i += 1024) static_cast<volatile unsigned char&>(touched[i]) = 0;
  return {};
}

Alarm::Alarm() : timer_(::timerfd_create(CLOCK_MONOTONIC, TFD_NONBLOCK | TFD_CLOEXEC)) {}

void Alarm::wait(std::uint64_t instant_ns, int descriptor) const {
  itimerspec at{};
  at.it_value.tv_sec = static_cast<time_t>(instant_ns / 1'000'000'000U);
  at.it_value.tv_nsec = static_cast<long>(instant_ns % 1'000'000'000U);
  (void)::timerfd_settime(timer_.get(), TFD_TIMER_ABSTIME, &at, nullptr);
  // A second at most, in case there is no timer. A lost interface must not wake this thread all the time.
  std::array<pollfd, 2> either{pollfd{timer_.get(), POLLIN, 0}, pollfd{descriptor, POLLIN, 0}};
  if (::poll(either.data(), either.size(), 1000) > 0 &&
      (either[1].revents & (POLLERR | POLLHUP | POLLNVAL)) != 0) {
    (void)::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at.it_value, nullptr);
  }
}

}  // namespace esmc::hal
