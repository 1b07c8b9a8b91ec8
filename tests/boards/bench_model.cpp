/// The bench image's program on the host: driver and loop-back of an STM32 on a model of its controller,
/// frame by frame at 1 Mbit/s. Prints what the console of a board would.

#include <iostream>
#include <string>
#include <vector>

#include "boards/bench.hpp"

#include "hal/fdcan/fdcan.hpp"
#include "tests/support/fdcan_model.hpp"

namespace {
using namespace esmc;

class Target {
 public:
  static constexpr const char* unit = "calls";
  using Bus = hal::Fdcan<ESMC_CHIP, test::FdcanModelAccess>;

  [[nodiscard]] bool start() { return bus_.open(24'000'000, baked::bitrate, 0, {}, true); }
  [[nodiscard]] Bus& bus() { return bus_; }
  /// A microsecond, and what the controller does in it.
  [[nodiscard]] std::uint32_t now_us() {
    if (on_wire_us_ == 0) {
      if (const auto f = model_.begin_frame())
        on_wire_us_ = 47U + 8U * static_cast<std::uint32_t>(f->bytes.size());
    } else if (--on_wire_us_ == 0) {
      model_.delivered();
    }
    model_.bits(1);
    return ++now_us_;
  }
  [[nodiscard]] static std::uint32_t count() { return ++calls_; }
  std::ostream& out() { return std::cout; }
  [[nodiscard]] const std::vector<std::string>& wrong() const { return model_.wrong; }

 private:
  static inline std::uint32_t calls_ = 0;
  test::FdcanModel model_{test::FdcanModel::Chip::ESMC_MODEL};
  Bus bus_{test::FdcanModelAccess{&model_}};
  std::uint32_t now_us_ = 0, on_wire_us_ = 0;
};
}  // namespace

// A stack for stack_used(): none of it is painted.
alignas(256) std::uint32_t esmc_test_stack[128];
asm(".globl esmc_stack_bottom, esmc_stack_top\n"
    ".set esmc_stack_bottom, esmc_test_stack\n"
    ".set esmc_stack_top, esmc_test_stack + 512\n");

int main() {
  static Target target;
  if (!target.start()) return 1;
  bench::run(target);
  for (const std::string& w : target.wrong()) std::cout << w << "\n";
  return target.wrong().empty() ? 0 : 1;
}
