/// slcan against lines written by hand, or by this file's own printf and sscanf. Nothing is compared with
/// what the encoder itself made.

#include "hal/slcan/slcan.hpp"

#include <gtest/gtest.h>

#include <cctype>
#include <cstdio>
#include <deque>
#include <iterator>
#include <random>
#include <sstream>
#include <string>
#include <vector>

namespace {

using namespace esmc::hal;

CanFrame frame(std::uint32_t id, const std::vector<unsigned>& bytes, bool extended = false) {
  CanFrame f;
  f.id = id;
  f.extended = extended;
  f.size = static_cast<std::uint8_t>(bytes.size());
  for (std::size_t i = 0; i < bytes.size(); ++i) f.data.at(i) = static_cast<std::uint8_t>(bytes[i]);
  return f;
}
CanFrame remote(std::uint32_t id, std::uint8_t size, bool extended = false) {
  CanFrame f;
  f.id = id;
  f.extended = extended;
  f.remote = true;
  f.size = size;
  return f;
}

std::string encoded(const CanFrame& f) {
  std::array<char, slcan_line_max> line{};
  const int n = slcan_encode(f, line);
  return {line.data(), static_cast<std::size_t>(n)};
}

/// What a decoder makes of some bytes.
std::vector<CanFrame> heard(const std::string& bytes) {
  SlcanDecoder decoder;
  std::vector<CanFrame> out;
  CanFrame f;
  for (const char c : bytes) {
    if (decoder.feed(c, f)) out.push_back(f);
  }
  return out;
}

struct Example {
  std::string line;
  CanFrame f;
};
std::vector<Example> examples() {
  return {
      {"t10021133\r", frame(0x100, {0x11, 0x33})},
      {"t0000\r", frame(0, {})},
      {"t7FF8FFFFFFFFFFFFFFFF\r", frame(0x7FF, {0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF})},
      {"t02E4CDCC4C3E\r", frame(0x02E, {0xCD, 0xCC, 0x4C, 0x3E})},
      {"T0000010021133\r", frame(0x100, {0x11, 0x33}, true)},
      {"T1FFFFFFF80123456789ABCDEF\r",
       frame(0x1FFFFFFF, {0x01, 0x23, 0x45, 0x67, 0x89, 0xAB, 0xCD, 0xEF}, true)},
      {"T000000000\r", frame(0, {}, true)},
      {"r1002\r", remote(0x100, 2)},
      {"r7FF8\r", remote(0x7FF, 8)},
      {"r0000\r", remote(0, 0)},
      {"R000001002\r", remote(0x100, 2, true)},
      {"R1FFFFFFF8\r", remote(0x1FFFFFFF, 8, true)},
  };
}

TEST(Slcan, EveryKindOfFrameIsTheLineOfTheManual) {
  for (const Example& e : examples()) EXPECT_EQ(encoded(e.f), e.line);
}

TEST(Slcan, EveryKindOfLineIsItsFrameInEitherCaseAndWithATimeStamp) {
  for (const Example& e : examples()) {
    std::string lower = e.line, stamped = e.line.substr(0, e.line.size() - 1) + "EA5f\r";
    for (std::size_t i = 1; i < lower.size(); ++i) lower[i] = static_cast<char>(std::tolower(lower[i]));
    for (const std::string& line : {e.line, lower, stamped}) {
      const auto h = heard(line);
      ASSERT_EQ(h.size(), 1U) << line;
      EXPECT_TRUE(h[0] == e.f) << line;
    }
  }
}

TEST(Slcan, TheLongestLineFitsAndOneMoreDoesNot) {
  const std::string longest = "T1FFFFFFF80123456789ABCDEFEA5F\r";
  EXPECT_EQ(longest.size(), static_cast<std::size_t>(slcan_line_max));
  EXPECT_EQ(heard(longest).size(), 1U);
  EXPECT_EQ(heard("T1FFFFFFF80123456789ABCDEFEA5F0\r" + longest).size(), 1U);
}

TEST(Slcan, RandomFramesThereAndBackThroughPrintf) {
  std::mt19937 random(7);
  for (int n = 0; n < 20000; ++n) {
    CanFrame f;
    f.extended = (random() & 1U) != 0U;
    f.remote = random() % 4U == 0U;
    f.id = static_cast<std::uint32_t>(random()) & (f.extended ? 0x1FFFFFFFU : 0x7FFU);
    f.size = static_cast<std::uint8_t>(random() % 9U);
    std::array<char, 64> text{};
    int length =
        std::snprintf(text.data(), text.size(), f.extended ? "%c%08X%X" : "%c%03X%X",
                      f.remote ? (f.extended ? 'R' : 'r') : (f.extended ? 'T' : 't'), f.id, unsigned{f.size});
    for (std::size_t i = 0; i < f.size && !f.remote; ++i) {
      f.data.at(i) = static_cast<std::uint8_t>(random());
      length += std::snprintf(&text.at(static_cast<std::size_t>(length)), 3, "%02X", unsigned{f.data.at(i)});
    }
    const std::string line = std::string(text.data()) + "\r";
    ASSERT_EQ(encoded(f), line);
    const auto h = heard(line);
    ASSERT_EQ(h.size(), 1U) << line;
    ASSERT_TRUE(h[0] == f) << line;
  }
}

TEST(Slcan, WhatItCannotSayIsRefusedAndTheLineUntouched) {
  CanFrame fd = frame(1, {1, 2, 3});
  fd.fd = true;
  CanFrame fast = frame(1, {1});
  fast.bit_rate_switch = true;
  CanFrame longer = frame(1, {});
  longer.size = 9;
  CanFrame longest = frame(1, {});
  longest.size = 255;
  for (const CanFrame& f : {fd, fast, longer, longest, frame(0x800, {}), frame(0x20000000, {}, true),
                            frame(0xFFFFFFFF, {}, true), remote(0x800, 0), remote(0, 9)}) {
    std::array<char, slcan_line_max> line{};
    line.fill('#');
    EXPECT_EQ(slcan_encode(f, line), 0);
    EXPECT_EQ(std::string(line.data(), line.size()), std::string(slcan_line_max, '#'));
  }
}

TEST(Slcan, AfterHostileLinesTheNextFrameIsHeard) {
  // Too short or too long, identifiers out of range, digits that are none, other orders.
  std::istringstream words(
      "t r T R t1 t10 t100 t1001 t10011 t1002113 t100211334 t1002113344 t10021133445 t100211334455A t1000AB "
      "r10021133A r1002113 T00000100211 T000001002113 R00000100 t8000 tFFF0 T200000000 TFFFFFFFF0 R200000000 "
      "r8000 t10g0 t10G0 t10`0 t10@0 t10:0 t10/0 t1001/0 t10010/ tg000 t1002113x t1002-133 t+100 T0x000010 "
      "t10021133EA5G d1000 D000001000 b1000 x V1013 NA123 F00 O C S8 Z1 zz zt1000");
  std::vector<std::string> bad{std::istream_iterator<std::string>(words), {}};
  bad.insert(bad.end(),
             {"t100211 3", "t10021133 A5F", " t1000", "t1000 ", "t1000\n", "\nt1000", "t1\a000", "t1000\a"});
  bad.insert(bad.end(), {"t1001\x80\x80", "t1001\xFF\xFF"});
  bad.emplace_back(1, '\0');
  bad.emplace_back("t1001\0\0", 7);
  bad.emplace_back("\0t1000", 6);
  for (const char* dlc : {"9", "A", "B", "C", "D", "E", "F", "a", "f"}) {
    bad.push_back("t100" + std::string(dlc));
    bad.push_back("t100" + std::string(dlc) + "0102030405060708");
    bad.push_back("t100" + std::string(dlc) + "010203040506070809");
    bad.push_back("T00000100" + std::string(dlc) + "0102030405060708");
    bad.push_back("r100" + std::string(dlc));
  }
  for (const std::size_t length : {31U, 32U, 100U, 10000U}) {
    bad.push_back("t1000" + std::string(length - 5, '0'));
    bad.emplace_back(length, 't');
    bad.emplace_back(length, '\0');
  }
  for (const std::string& line : bad) {
    const auto h = heard(line + "\r" + "t02E4CDCC4C3E\r");
    ASSERT_EQ(h.size(), 1U) << line;
    EXPECT_TRUE(h[0] == frame(0x02E, {0xCD, 0xCC, 0x4C, 0x3E})) << line;
  }
}

TEST(Slcan, NothingInALongLineReachesBeyondItsEnd) {
  // The end of it, on its own, would be a frame.
  EXPECT_TRUE(heard(std::string(slcan_line_max, '0') + "t10021133\r").empty());
  EXPECT_TRUE(heard(std::string(10000, '\a') + "xt10021133\r").empty());
}

TEST(Slcan, AnswersAreNoFrames) { EXPECT_EQ(heard("\r\rz\rZ\r\a\at10021133\r\a\rz\r").size(), 1U); }

TEST(Slcan, AFrameLeavesTheOtherAloneUntilItIsWhole) {
  SlcanDecoder decoder;
  const CanFrame before = frame(0x55, {1, 2, 3});
  CanFrame f = before;
  for (const char c : std::string("t1002113\rt1002113")) EXPECT_FALSE(decoder.feed(c, f));
  EXPECT_TRUE(f == before);
  EXPECT_FALSE(decoder.feed('3', f));
  EXPECT_TRUE(f == before);
  EXPECT_TRUE(decoder.feed('\r', f));
  EXPECT_TRUE(f == frame(0x100, {0x11, 0x33}));
}

TEST(Slcan, OldDataDoNotShowThroughAShorterFrame) {
  CanFrame f;
  SlcanDecoder decoder;
  for (const char c : std::string("t1008FFFFFFFFFFFFFFFF\rr1008\r")) (void)decoder.feed(c, f);
  EXPECT_TRUE(f == remote(0x100, 8));
}

// ---- the bus

/// A port in memory that gives out `at_once` bytes between two calls of more().
class Wire {
 public:
  std::string sent;
  std::deque<char> waiting;
  std::size_t at_hand = 0;
  bool full = false;
  int reads = 0;

  [[nodiscard]] bool try_write(std::span<const char> out) {
    if (full) return false;
    sent.append(out.begin(), out.end());
    return true;
  }
  [[nodiscard]] bool try_read(char& in) {
    ++reads;
    if (at_hand == 0 || waiting.empty()) return false;
    in = waiting.front();
    waiting.pop_front();
    --at_hand;
    return true;
  }
};
class LosableWire : public Wire {
 public:
  bool lost = false;
  [[nodiscard]] bool gone() const { return lost; }
};
static_assert(BytePort<Wire> && !LosablePort<Wire> && LosablePort<LosableWire>);
static_assert(CanBus<SlcanBus<Wire>> && CanBus<SlcanBus<LosableWire>>);

TEST(SlcanBus, SendsWholeLinesAndSaysWhyNot) {
  Wire wire;
  SlcanBus bus(wire);
  EXPECT_EQ(bus.try_send(frame(0x100, {0x11, 0x33})), SendStatus::ok);
  wire.full = true;
  EXPECT_EQ(bus.try_send(frame(0x100, {0x11, 0x33})), SendStatus::bus_full);
  EXPECT_EQ(bus.try_send(frame(0x800, {})), SendStatus::refused);
  CanFrame fd = frame(1, {});
  fd.fd = true;
  wire.full = false;
  EXPECT_EQ(bus.try_send(fd), SendStatus::refused);
  EXPECT_EQ(wire.sent, "t10021133\r");
}

TEST(SlcanBus, APortThatIsGoneIsBusOff) {
  LosableWire wire;
  SlcanBus bus(wire);
  EXPECT_EQ(bus.try_send(frame(1, {})), SendStatus::ok);
  wire.full = true;
  EXPECT_EQ(bus.try_send(frame(1, {})), SendStatus::bus_full);
  wire.lost = true;
  EXPECT_EQ(bus.try_send(frame(1, {})), SendStatus::bus_off);
  wire.full = false;
  EXPECT_EQ(bus.try_send(frame(1, {})), SendStatus::bus_off);
  EXPECT_EQ(bus.try_send(frame(0x800, {})), SendStatus::refused);
}

TEST(SlcanBus, FramesSplitAtEveryByteArriveWhole) {
  std::string stream;
  std::vector<CanFrame> expected;
  for (const Example& e : examples()) {
    stream += e.line;
    expected.push_back(e.f);
  }
  for (std::size_t cut = 0; cut <= stream.size(); ++cut) {
    Wire wire;
    SlcanBus bus(wire);
    wire.waiting.assign(stream.begin(), stream.end());
    std::vector<CanFrame> got;
    CanFrame f;
    for (const std::size_t part : {cut, stream.size() - cut}) {
      wire.at_hand = part;
      while (bus.try_receive(f)) got.push_back(f);
    }
    ASSERT_EQ(got.size(), expected.size()) << cut;
    for (std::size_t i = 0; i < got.size(); ++i) EXPECT_TRUE(got[i] == expected[i]) << cut;
  }
}

TEST(SlcanBus, ReadsNoMoreThanItsBoundPerCall) {
  Wire wire;
  SlcanBus bus(wire);
  const std::string noise(10000, 'x'), line = "\rt10021133\r";
  wire.waiting.assign(noise.begin(), noise.end());
  wire.waiting.insert(wire.waiting.end(), line.begin(), line.end());
  wire.at_hand = wire.waiting.size();
  CanFrame f;
  int calls = 0;
  for (bool got = false; !got && calls < 1000; ++calls) {
    wire.reads = 0;
    got = bus.try_receive(f);
    EXPECT_LE(wire.reads, bus.bytes_per_receive);
  }
  EXPECT_EQ(calls, (10000 + 11 + bus.bytes_per_receive - 1) / bus.bytes_per_receive);
  EXPECT_TRUE(f == frame(0x100, {0x11, 0x33}));
}

/// Both directions without a heap or an operating system: the compiler does it.
constexpr bool round_trip() {
  CanFrame f, g;
  f.id = 0x12345;
  f.extended = true;
  f.size = 2;
  f.data[0] = 0xA5;
  std::array<char, slcan_line_max> line{};
  const int n = slcan_encode(f, line);
  SlcanDecoder decoder;
  for (std::size_t i = 0; i + 1 < static_cast<std::size_t>(n); ++i) {
    if (decoder.feed(line[i], g)) return false;
  }
  return decoder.feed('\r', g) && f == g;
}
static_assert(round_trip());

}  // namespace
