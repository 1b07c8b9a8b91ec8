/// Image of an emulated board that measures the cycle: instructions, and a bus in memory.

#include "boards/bench.hpp"

#include "hal/waiting_frames.hpp"
#include "tests/boards/mps2_console.hpp"

namespace {
using namespace esmc;

class Target {
 public:
  static constexpr const char* unit = "instructions";

  /// A bus whose frames come back at once.
  struct Memory {
    hal::WaitingFrames frames;
    hal::SendStatus try_send(const hal::CanFrame& f) {
      return frames.push(f) ? hal::SendStatus::ok : hal::SendStatus::bus_full;
    }
    bool try_receive(hal::CanFrame& f) {
      if (frames.empty()) return false;
      hal::copy_used(frames.front(), f);
      frames.pop();
      return true;
    }
  };
  [[nodiscard]] Memory& bus() { return bus_; }
  [[nodiscard]] std::uint32_t now_us() const { return timer().now() / 25U; }
  [[nodiscard]] static std::uint32_t count() { return timer().now() * 5U / 8U; }
  [[nodiscard]] Text& out() { return text_; }

 private:
  [[nodiscard]] static const Timer& timer() {
    static const Timer running;
    return running;
  }
  Memory bus_;
  Uart uart_{0x4000'4000U};
  Text text_{uart_};
};
}  // namespace

extern "C" [[noreturn]] void esmc_main() {
  static Target target;
  bench::run(target);
  for (;;) {
  }
}
