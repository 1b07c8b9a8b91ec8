/// Image of an emulated board that provokes faults one after the other and prints, after the reset that each one causes,
/// the record that it left: reading where nothing is, and a stack that runs out of its memory.

#include <cstdint>

#include "boards/cortex_m/crash.hpp"
#include "boards/mps2/board.hpp"

namespace {

[[gnu::section(".noinit")]] std::uint32_t boots;

struct Text {
  esmc::Uart& port;
  Text& operator<<(const char* s) {
    for (; *s != '\0'; ++s) put(*s);
    return *this;
  }
  Text& operator<<(std::uint32_t v) {
    for (unsigned shift = 28; shift > 0; shift -= 4) {
      if ((v >> shift) != 0) put("0123456789abcdef"[(v >> shift) & 15U]);
    }
    put("0123456789abcdef"[v & 15U]);
    return *this;
  }
  void put(char c) {
    while (!port.try_write({&c, 1})) {
    }
  }
};

volatile std::uint32_t floor_at = 0xFFFF'FFFFU;
/// As deep as the stack is, and deeper.
std::uint32_t dig(std::uint32_t depth) {
  volatile std::uint32_t here[32] = {depth};
  return depth < floor_at ? dig(depth + 1) + here[depth % 32] : 0;
}

}  // namespace

extern "C" [[gnu::noinline, gnu::used]] std::uint32_t read_nowhere() {
  return *reinterpret_cast<volatile std::uint32_t*>(0x9000'0000U);
}

extern "C" [[noreturn]] void esmc_main() {
  using esmc::crash_record;
  static esmc::Uart port(0x4000'4000U);
  Text out{port};
  if (!crash_record.sealed()) {
    boots = 0;
    out << "no record\n";
  } else {
    out << "exception " << crash_record.exception << " status " << crash_record.fault_status << " address " << crash_record.address << " sp " << crash_record.sp << " pc " << crash_record.pc
        << " lr " << crash_record.lr << "\n";
    crash_record.forget();
    ++boots;
  }
  if (boots == 0) out << read_nowhere();
  if (boots == 1) out << dig(0);
  out << "done\n";
  for (;;) {
  }
}
