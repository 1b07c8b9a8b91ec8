#pragma once
/// What the images that provoke faults have in common: text on a port, a stack that runs out of its memory,
/// and the order of events.

#include <cstdint>

#include "boards/cortex_m/crash.hpp"

namespace esmc::test {

/// `Port`: put(char), which waits.
template <class Port>
struct Text {
  Port& port;
  Text& operator<<(const char* s) {
    for (; *s != '\0'; ++s) port.put(*s);
    return *this;
  }
  Text& operator<<(std::uint32_t v) {
    for (unsigned shift = 28; shift > 0; shift -= 4) {
      if ((v >> shift) != 0) port.put("0123456789abcdef"[(v >> shift) & 15U]);
    }
    port.put("0123456789abcdef"[v & 15U]);
    return *this;
  }
};

inline volatile std::uint32_t floor_at = 0xFFFF'FFFFU;
/// As deep as the stack is, and deeper.
inline std::uint32_t dig(std::uint32_t depth) {
  volatile std::uint32_t here[32] = {depth};
  return depth < floor_at ? dig(depth + 1) + here[depth % 32] : 0;
}

/// Tells the record of the last crash and provokes the next one, in their order, then no more. `boots`
/// outlives a restart.
template <class Port, class... F>
[[noreturn]] void crash_again(Port& port, std::uint32_t& boots, F&&... provocations) {
  Text<Port> out{port};
  if (!crash_record.sealed()) {
    boots = 0;
    out << "no record\n";
  } else {
    const CrashRecord& r = crash_record;
    out << "exception " << r.exception << " status " << r.fault_status << " address " << r.address << " sp "
        << r.sp << " pc " << r.pc << " lr " << r.lr << "\n";
    crash_record.forget();
    ++boots;
  }
  std::uint32_t n = 0;
  ((boots == n++ ? void(out << provocations()) : void()), ...);
  out << "done\n";
  for (;;) {
  }
}

}  // namespace esmc::test
