/// The set-up of a CiA 402 drive as one table, written down once more from docs/cia402.md and the profile.

#include <gtest/gtest.h>

#include <array>
#include <cstdint>

#include "firmware/drive/cia402_setup.hpp"

namespace esmc::drive {
namespace {

using cia402::Task;

struct Row {
  unsigned index, sub, bytes;
  Task task;
  std::uint32_t value;  ///< for node 5, ours 100, 8 and 15 ms, a period of 2 ms
  bool optional = false;
  std::uint32_t mask = 0xFFFF'FFFF;
};
constexpr std::uint32_t off = 0x8000'0000, no_rtr = 0x4000'0000, but_rtr = 0xBFFF'FFFF;
constexpr bool may_lack = true;
constexpr std::size_t count = 45;
constexpr std::array<Row, count> rows{{
    {0x6040, 0, 2, Task::write, 0},
    {0x1017, 0, 2, Task::verify, 8},
    {0x1016, 1, 4, Task::verify, 100 << 16 | 15},
    {0x1029, 1, 1, Task::attempt, 1},
    {0x1014, 0, 4, Task::expect, 0x085, may_lack, but_rtr},
    {0x1005, 0, 4, Task::expect, 0x080, may_lack, 0x7FFF'FFFF},
    {0x1006, 0, 4, Task::verify, 2000, may_lack},
    {0x6007, 0, 2, Task::verify, 1},
    {0x605E, 0, 2, Task::verify, 0},
    {0x605A, 0, 2, Task::verify, 0},
    {0x6502, 0, 4, Task::expect, 0x200, false, 0x200},
    {0x6060, 0, 1, Task::verify, 10},
    {0x6076, 0, 4, Task::rated, 0},
    {0x6072, 0, 2, Task::at_least, 0, may_lack},
    {0x60B2, 0, 2, Task::verify, 0, may_lack},
    {0x60C2, 1, 1, Task::verify, 2, may_lack},
    {0x60C2, 2, 1, Task::verify, 0xFD, may_lack},
    {0x1401, 1, 4, Task::verify, off | 0x305, may_lack, off},
    {0x1402, 1, 4, Task::verify, off | 0x405, may_lack, off},
    {0x1403, 1, 4, Task::verify, off | 0x505, may_lack, off},
    {0x1802, 1, 4, Task::verify, off | no_rtr | 0x385, may_lack, off},
    {0x1803, 1, 4, Task::verify, off | no_rtr | 0x485, may_lack, off},
    {0x1400, 1, 4, Task::write, off | 0x205},
    {0x1600, 0, 1, Task::write, 0},
    {0x1400, 2, 1, Task::verify, 255},
    {0x1400, 5, 2, Task::verify, 15, may_lack},
    {0x1600, 1, 4, Task::verify, 0x6040'0010},
    {0x1600, 2, 4, Task::verify, 0x6071'0010},
    {0x1600, 0, 1, Task::verify, 2},
    {0x1400, 1, 4, Task::verify, 0x205, false, but_rtr},
    {0x1800, 1, 4, Task::write, off | no_rtr | 0x185},
    {0x1A00, 0, 1, Task::write, 0},
    {0x1800, 2, 1, Task::verify, 1},
    {0x1A00, 1, 4, Task::verify, 0x6041'0010},
    {0x1A00, 2, 4, Task::verify, 0x6064'0020},
    {0x1A00, 3, 4, Task::verify, 0x6077'0010},
    {0x1A00, 0, 1, Task::verify, 3},
    {0x1800, 1, 4, Task::verify, no_rtr | 0x185, false, but_rtr},
    {0x1801, 1, 4, Task::write, off | no_rtr | 0x285},
    {0x1A01, 0, 1, Task::write, 0},
    {0x1801, 2, 1, Task::verify, 1},
    {0x1A01, 1, 4, Task::verify, 0x606C'0020},
    {0x1A01, 2, 4, Task::verify, 0x6061'0008},
    {0x1A01, 0, 1, Task::verify, 2},
    {0x1801, 1, 4, Task::verify, no_rtr | 0x285, false, but_rtr},
}};

constexpr Cia402Settings settings() {
  Cia402Settings s;
  s.period_us = 2000;
  s.heartbeat_ms = 8;
  s.consumer_ms = 15;
  s.master_node = 100;
  return s;
}
/// The first row that differs; `count` where none does.
constexpr std::size_t difference() {
  for (std::size_t i = 0; i < count; ++i) {
    const cia402::Entry& e = cia402::setup[i];
    const Row& r = rows[i];
    if (e.object.index != r.index || e.object.sub != r.sub || e.bytes != r.bytes || e.task != r.task ||
        e.optional != r.optional || e.mask != r.mask || cia402::value_of(e, settings(), 5) != r.value) {
      return i;
    }
  }
  return count;
}
static_assert(cia402::setup.size() == count);
static_assert(difference() == count);

/// Rounded half up to a byte and a power of ten of a second, and no longer than 255 s.
TEST(Cia402Table, PeriodsAndTheirIndex) {
  struct Case {
    std::uint32_t us;
    int value, index;
  };
  for (const Case c : {Case{0, 0, -3},
                       Case{1, 1, -6},
                       Case{10, 1, -5},
                       Case{100, 1, -4},
                       Case{125, 125, -6},
                       Case{250, 25, -5},
                       Case{251, 251, -6},
                       Case{256, 26, -5},
                       Case{333, 33, -5},
                       Case{500, 5, -4},
                       Case{1000, 1, -3},
                       Case{1284, 128, -5},
                       Case{1285, 129, -5},
                       Case{2000, 2, -3},
                       Case{10'000, 10, -3},
                       Case{255'000, 255, -3},
                       Case{256'000, 26, -2},
                       Case{300'000, 30, -2},
                       Case{256'000'000, 255, 0},
                       Case{2'550'000'000, 255, 0},
                       Case{4'000'000'000, 255, 0}}) {
    EXPECT_EQ(cia402::interpolation(c.us).value, c.value) << c.us;
    EXPECT_EQ(cia402::interpolation(c.us).index, c.index) << c.us;
  }
}

}  // namespace
}  // namespace esmc::drive
