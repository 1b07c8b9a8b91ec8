/// The bus model: bits of a frame, arbitration, time, error counters, and what a scene may do to it.

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <map>
#include <random>
#include <string>
#include <vector>

#include "host_sim/bus/timed_bus.hpp"

namespace esmc::host {
namespace {

using hal::CanFrame;
using hal::SendStatus;
using State = ErrorCounters::State;
using Time = TimedBus::Time;

CanFrame frame(std::uint32_t id, std::vector<std::uint8_t> data = {}, bool extended = false) {
  CanFrame f;
  f.id = id;
  f.extended = extended;
  f.size = static_cast<std::uint8_t>(data.size());
  std::ranges::copy(data, f.data.begin());
  return f;
}

// ---- an own reading of the frame, in text, bit by bit ----

std::string binary(std::uint64_t v, int bits) {
  std::string out;
  for (int i = bits - 1; i >= 0; --i) out += ((v >> static_cast<unsigned>(i)) & 1U) != 0 ? '1' : '0';
  return out;
}
/// Remainder of long division by x^15 + x^14 + x^10 + x^8 + x^7 + x^4 + x^3 + 1.
std::string remainder15(std::string message) {
  const std::string divisor = "1100010110011001";
  message += std::string(15, '0');
  for (std::size_t i = 0; i + divisor.size() <= message.size(); ++i) {
    if (message[i] == '0') continue;
    for (std::size_t k = 0; k < divisor.size(); ++k)
      message[i + k] = message[i + k] == divisor[k] ? '0' : '1';
  }
  return message.substr(message.size() - 15);
}
std::string unstuffed(const CanFrame& f) {
  std::string s = "0";
  const std::string rtr = f.remote ? "1" : "0";
  if (f.extended) {
    const std::string id = binary(f.id, 29);
    s += id.substr(0, 11) + "11" + id.substr(11) + rtr + "00";
  } else {
    s += binary(f.id, 11) + rtr + "00";
  }
  s += binary(f.size, 4);
  for (std::size_t i = 0; !f.remote && i < f.size; ++i) s += binary(f.data[i], 8);
  return s + remainder15(s);
}
std::string stuffed(const std::string& plain) {
  std::string out;
  for (const char c : plain) {
    out += c;
    const std::string tail = out.size() < 5 ? "" : out.substr(out.size() - 5);
    if (tail == "00000") out += '1';
    if (tail == "11111") out += '0';
  }
  return out;
}
std::string text(const WireFrame& w) {
  std::string s;
  for (std::uint32_t i = 0; i < w.size; ++i) s += w.bit[i] ? '1' : '0';
  return s;
}

TEST(Wire, EveryBitAgreesWithAReferenceOfItsOwn) {
  std::mt19937 random(1);
  for (int n = 0; n < 20000; ++n) {
    CanFrame f;
    f.extended = n % 2 == 1;
    f.remote = n % 7 == 0;
    f.id = static_cast<std::uint32_t>(random()) & (f.extended ? 0x1FFF'FFFFU : 0x7FFU);
    f.size = static_cast<std::uint8_t>(random() % 9);
    // Long runs of equal bits are what stuffing is about.
    const auto kind = random() % 3;
    for (std::size_t i = 0; i < f.size; ++i)
      f.data[i] = static_cast<std::uint8_t>(kind == 0 ? random() : (kind == 1 ? 0 : 0xFF));
    const std::string plain = unstuffed(f), wire = stuffed(plain);
    const WireFrame w = on_the_wire(f);
    ASSERT_EQ(text(w), wire) << std::hex << f.id;
    ASSERT_EQ(w.stuffed, wire.size() - plain.size());
    ASSERT_EQ(exact_bits(f),
              wire.size() + 1 + 2 + 7 + 3);  // CRC delimiter, acknowledge, end of frame, interframe space
    ASSERT_LE(exact_bits(f), worst_bits(f.remote ? 0U : f.size, f.extended));
  }
}

/// Bits of a CAN FD frame up to the end of its data with stuff bits as the standard inserts them: none behind
/// the last one, where a fixed one follows; `slow`: those at the slow rate.
std::string fd_stuffed(const CanFrame& f, std::size_t& slow) {
  const auto digits = [](std::uint32_t v, int n) {
    std::string s;
    while (n-- > 0) s += (v >> n & 1U) != 0 ? '1' : '0';
    return s;
  };
  std::string plain = "0";
  plain += f.extended ? digits(f.id >> 18U, 11) + "11" + digits(f.id & 0x3FFFFU, 18) + "0"
                      : digits(f.id, 11) + "00";
  plain += f.bit_rate_switch ? "101" : "100";
  const std::size_t head = plain.size();
  const std::map<int, std::uint32_t> codes = {{12, 9},  {16, 10}, {20, 11}, {24, 12},
                                              {32, 13}, {48, 14}, {64, 15}};
  plain += "0" + digits(f.size <= 8 ? f.size : codes.at(f.size), 4);
  for (std::uint8_t i = 0; i < f.size; ++i) plain += digits(f.data[i], 8);
  std::string out;
  for (std::size_t i = 0; i < plain.size(); ++i) {
    out += plain[i];
    std::size_t run = 0;
    while (run < out.size() && out[out.size() - 1 - run] == out.back()) ++run;
    if (run == 5 && i + 1 < plain.size()) out += out.back() == '0' ? '1' : '0';
    if (i + 1 == head) slow = out.size();
  }
  if (!f.bit_rate_switch) slow = out.size();
  return out;
}

TEST(Wire, FlexibleRate) {
  std::mt19937 random(2);
  std::uint32_t most = 0;
  for (int n = 0; n < 20000; ++n) {
    CanFrame f;
    f.fd = true;
    f.bit_rate_switch = n % 5 != 0;
    f.extended = n % 2 == 1;
    f.id = static_cast<std::uint32_t>(random()) & (f.extended ? 0x1FFF'FFFFU : 0x7FFU);
    if (n % 11 == 0) f.id = 0;
    f.size = esmc::hal::can_fd_size(static_cast<std::uint8_t>(random() % 65));
    const auto kind = random() % 4;
    for (std::size_t i = 0; i < f.size; ++i)
      f.data[i] =
          static_cast<std::uint8_t>(kind == 0 ? random() : (kind == 1 ? 0 : (kind == 2 ? 0xFF : 0xF0)));
    std::size_t slow = 0;
    const std::string wire = fd_stuffed(f, slow);
    const WireFrame w = on_the_wire(f);
    ASSERT_EQ(text(w), wire) << std::hex << f.id;
    // Stuff count and CRC, a fixed stuff bit before and after every four; then as in a classic frame.
    const unsigned check = f.size <= 16 ? 21 : 25;
    const double fast = 0.2, rest = static_cast<double>(wire.size() - slow + check + 1 + check / 4);
    const double slow_rest = f.bit_rate_switch ? 0.0 : rest,
                 exact =
                     static_cast<double>(slow) + 13.0 + slow_rest + (f.bit_rate_switch ? fast * rest : 0.0);
    ASSERT_NEAR(exact_bits(f, fast), exact, 1.0);
    ASSERT_GE(exact_bits(f, fast), exact - 1e-6);
    ASSERT_LE(exact_bits(f, fast), worst_bits(f, fast));
    ASSERT_GE(exact_bits(f, fast), fd_bits(f.size, f.extended, f.bit_rate_switch ? fast : 1.0, false));
    if (f.size == 32 && f.extended && f.bit_rate_switch) most = std::max(most, exact_bits(f, fast));
  }
  // A torque command to a moteus and its reply: 44 + 13 and 21 + 13 slow bits at most, 358 and 238 fast ones.
  EXPECT_EQ(fd_bits(32, true, 0.2, true), 57U + 72U);
  EXPECT_EQ(fd_bits(20, false, 0.2, true), 34U + 48U);
  EXPECT_EQ(fd_bits(8, false, 0.2, false), 30U + 20U) << "69 of data, 27 of the CRC";
  EXPECT_GT(most, 100U);
}

// Nominal and worst lengths as the literature tabulates them for 11-bit identifiers.
TEST(Wire, LengthsOfTheTable) {
  const std::map<std::uint32_t, std::pair<std::uint32_t, std::uint32_t>> table = {
      {0, {47, 55}}, {4, {79, 95}}, {5, {87, 105}}, {6, {95, 115}}, {7, {103, 125}}, {8, {111, 135}}};
  for (const auto& [n, bits] : table) {
    const CanFrame f = frame(0x2AA, std::vector<std::uint8_t>(n, 0x55));
    EXPECT_EQ(exact_bits(f) - on_the_wire(f).stuffed, bits.first) << n;
    EXPECT_EQ(worst_bits(n), bits.second) << n;
  }
  EXPECT_EQ(worst_bits(8, true), 160U);  // 67 + 64 + floor(117 / 4)
}

// ---- the bus ----

struct Rig {
  explicit Rig(std::vector<Effect> effects = {BitTiming{}}, std::uint64_t seed = 1)
      : bus({3, 1e6, std::move(effects), seed}) {}
  std::vector<TimedBus::Delivery> run(Time until) {
    std::vector<TimedBus::Delivery> out;
    while (auto d = bus.next(until)) out.push_back(*d);
    return out;
  }
  TimedBus bus;
};
constexpr Span always{-1e9, 1e9};

TEST(Bus, TheSmallestIdentifierFirstWhateverTheOrderOfAsking) {
  Rig rig;
  CanFrame remote = frame(0x100);
  remote.remote = true;
  // 0x100 << 18: an extended identifier with the same first eleven bits loses against both base frames.
  ASSERT_EQ(rig.bus.send(0, frame(0x100U << 18U, {1}, true)), SendStatus::ok);
  ASSERT_EQ(rig.bus.send(1, remote), SendStatus::ok);
  ASSERT_EQ(rig.bus.send(2, frame(0x100, {2})), SendStatus::ok);
  ASSERT_EQ(rig.bus.send(3, frame(0x0FF, {3})), SendStatus::ok);
  ASSERT_EQ(rig.bus.send(3, frame(0x7FF, {4})), SendStatus::ok);
  ASSERT_EQ(rig.bus.send(3, frame(0x001, {5})), SendStatus::ok);  // of one node as well
  const auto got = rig.run(10'000);
  ASSERT_EQ(got.size(), 6U);
  const std::uint32_t order[] = {0x001, 0x0FF, 0x100, 0x100, 0x100U << 18U, 0x7FF};
  for (std::size_t i = 0; i < 6; ++i) EXPECT_EQ(got[i].frame.id, order[i]) << i;
  EXPECT_FALSE(got[2].frame.remote);
  EXPECT_TRUE(got[3].frame.remote);
}

TEST(Bus, AFrameIsLateByItsBitsAndByThoseBeforeIt) {
  Rig rig;
  const CanFrame first = frame(1, {0xAA, 0x55}), second = frame(2, {0, 0, 0}), third = frame(0, {7});
  ASSERT_EQ(rig.bus.send(1, second), SendStatus::ok);
  ASSERT_EQ(rig.bus.send(2, first), SendStatus::ok);
  auto d = rig.bus.next(1000);
  ASSERT_TRUE(d);
  const auto length = [](const CanFrame& f) { return static_cast<Time>(stuffed(unstuffed(f)).size()) + 10; };
  EXPECT_EQ(d->at, length(first));
  EXPECT_EQ(d->receivers, 0b1011U);
  // Asked for while the second one is on the bus: it is not interrupted.
  ASSERT_FALSE(rig.bus.next(length(first) + 3 + 1));
  ASSERT_EQ(rig.bus.send(0, third), SendStatus::ok);
  EXPECT_FALSE(rig.bus.quiet());
  d = rig.bus.next(1000);
  ASSERT_TRUE(d);
  EXPECT_EQ(d->frame.id, 2U);
  EXPECT_EQ(d->at, length(first) + 3 + length(second));
  d = rig.bus.next(1000);
  ASSERT_TRUE(d);
  EXPECT_EQ(d->at, length(first) + 3 + length(second) + 3 + length(third));
  EXPECT_TRUE(rig.bus.quiet());
  EXPECT_FALSE(rig.bus.next(1000));
  EXPECT_EQ(rig.bus.now(), 1000);
  EXPECT_EQ(rig.bus.latencies().size(), 3U);
  EXPECT_EQ(rig.bus.latencies()[1].largest, length(first) + 3 + length(second));
}

TEST(Bus, WithoutBitTimingFramesTakeNoTimeAndKeepTheirOrder) {
  Rig rig({Loss{1e-12, true, true, always}});
  ASSERT_EQ(rig.bus.send(1, frame(9)), SendStatus::ok);
  ASSERT_EQ(rig.bus.send(2, frame(8)), SendStatus::ok);
  const auto got = rig.run(100);
  ASSERT_EQ(got.size(), 2U);
  EXPECT_EQ(got[0].frame.id, 8U);
  EXPECT_EQ(got[0].at, 0);
  EXPECT_EQ(got[1].at, 0);
}

TEST(Bus, ANodeHoldsTenFramesAndTakesNoMalformedOrFdFrame) {
  Rig rig;
  for (int i = 0; i < 10; ++i)
    ASSERT_EQ(rig.bus.send(0, frame(5, {static_cast<std::uint8_t>(i)})), SendStatus::ok);
  EXPECT_EQ(rig.bus.send(0, frame(4)), SendStatus::bus_full);
  EXPECT_EQ(rig.bus.counts().refused, 1U);
  CanFrame fd = frame(1);
  fd.fd = true;
  EXPECT_EQ(rig.bus.send(1, fd), SendStatus::refused);
  EXPECT_EQ(rig.bus.send(1, frame(0x800)), SendStatus::refused);
  const auto got = rig.run(10'000);
  ASSERT_EQ(got.size(), 10U);
  for (std::size_t i = 0; i < 10; ++i) EXPECT_EQ(got[i].frame.data[0], i);  // first in, first out
}

TEST(Bus, EveryFailedTransmissionCountsEightAndTheThirtySecondIsTheLast) {
  Rig rig({BitTiming{}, Corruption{1.0, 0.0, 1, always}});
  ASSERT_EQ(rig.bus.send(1, frame(3, {1, 2, 3})), SendStatus::ok);
  std::map<int, State> seen;
  Time t = 0;
  while (rig.bus.counters(1).state() != State::off && t < 100'000) {
    EXPECT_FALSE(rig.bus.next(++t));
    seen[rig.bus.counters(1).transmit()] = rig.bus.counters(1).state();
  }
  for (const auto& [tec, state] : seen) {
    EXPECT_EQ(tec % 8, 0);
    EXPECT_EQ(state, tec >= 256 ? State::off : (tec >= 128 ? State::passive : State::active)) << tec;
  }
  EXPECT_EQ(seen.size(), 33U);  // 0, 8, ..., 256
  EXPECT_EQ(rig.bus.counts().errors, 32U);
  EXPECT_EQ(rig.bus.counters(0).receive(), 32);  // receivers count one
  EXPECT_EQ(rig.bus.send(1, frame(3)), SendStatus::bus_off);
  EXPECT_TRUE(rig.bus.quiet());
  EXPECT_FALSE(rig.bus.next(t + 1'000'000));  // and off it stays
  EXPECT_EQ(rig.bus.counters(1).state(), State::off);
}

TEST(Bus, ADisturbedFrameIsRepeatedAndACounterFallsByOneWithEachGoodOne) {
  Rig rig({BitTiming{}, Corruption{1.0, 0.0, 1, {-1.0, 0.0}}});
  ASSERT_EQ(rig.bus.send(1, frame(3, {1, 2, 3})), SendStatus::ok);
  while (rig.bus.counters(1).transmit() < 24) ASSERT_FALSE(rig.bus.next(rig.bus.now() + 1));
  rig.bus.begin_run();  // from here on nothing disturbs
  const int receive = rig.bus.counters(2).receive();
  EXPECT_EQ(receive, 3);
  const auto got = rig.run(rig.bus.now() + 1000);
  ASSERT_EQ(got.size(), 1U);
  EXPECT_EQ(got[0].frame, frame(3, {1, 2, 3}));
  EXPECT_EQ(rig.bus.counters(1).transmit(), 23);
  EXPECT_EQ(rig.bus.counters(2).receive(), 2);
}

TEST(Bus, RecoveryTakes128TimesElevenRecessiveBits) {
  Rig rig({BitTiming{}, BusOff{0.0, 2, false}});
  rig.bus.begin_run();
  EXPECT_EQ(rig.bus.counters(2).state(), State::off);
  ASSERT_FALSE(rig.bus.next(5000));
  EXPECT_EQ(rig.bus.send(2, frame(1)), SendStatus::bus_off);
  rig.bus.restart(2);
  ASSERT_FALSE(rig.bus.next(5000 + 128 * 11 - 1));
  EXPECT_EQ(rig.bus.counters(2).state(), State::off);
  ASSERT_FALSE(rig.bus.next(5000 + 128 * 11));
  EXPECT_EQ(rig.bus.counters(2).state(), State::active);
  EXPECT_EQ(rig.bus.counters(2).transmit(), 0);
  EXPECT_EQ(rig.bus.send(2, frame(1)), SendStatus::ok);
}

// On a full bus each frame ends with eleven recessive bits, and there are no others.
TEST(Bus, RecoveryOnAFullBusTakes128Frames) {
  Rig rig({BitTiming{}, BusOff{0.0, 2, true}});
  rig.bus.begin_run();
  ASSERT_EQ(rig.bus.send(1, frame(7, {9})), SendStatus::ok);
  int frames = 0;
  while (rig.bus.counters(2).state() == State::off && frames < 1000) {
    ASSERT_EQ(rig.bus.send(1, frame(7, {9})), SendStatus::ok);
    const auto d = rig.bus.next(1'000'000);
    ASSERT_TRUE(d);
    EXPECT_EQ(d->receivers & 0b0100U, 0U) << "a node that is off hears nothing";
    ++frames;
  }
  EXPECT_EQ(frames, 128);
}

TEST(Bus, ALonelyNodeBecomesPassiveAndStays) {
  TimedBus two({1, 1e6, {BitTiming{}, DriveDropout{1, always}}, 1});
  ASSERT_EQ(two.send(0, frame(4, {1})), SendStatus::ok);
  ASSERT_FALSE(two.next(100'000));
  EXPECT_EQ(two.counters(0).transmit(), 128);
  EXPECT_EQ(two.counters(0).state(), State::passive);
  EXPECT_GT(two.counts().errors, 500U);
}

// Two nodes with one identifier and different data destroy each other's frames until one is passive.
TEST(Bus, TwoSendersOfOneIdentifierCollide) {
  Rig rig;
  ASSERT_EQ(rig.bus.send(1, frame(5, {0x80})), SendStatus::ok);
  ASSERT_EQ(rig.bus.send(2, frame(5, {0x00})), SendStatus::ok);
  const auto got = rig.run(100'000);
  EXPECT_EQ(rig.bus.counts().errors, 16U);  // 16 * 8 = 128: passive, both
  ASSERT_EQ(got.size(), 2U);
  EXPECT_EQ(got[0].frame.data[0], 0x00);  // the recessive bit gave way
  EXPECT_EQ(got[1].frame.data[0], 0x80);
  EXPECT_EQ(rig.bus.counters(1).transmit(), 128 + 8 - 1);
  EXPECT_EQ(rig.bus.counters(2).transmit(), 128 - 1);
}

TEST(Bus, EqualFramesOfTwoNodesAreOne) {
  Rig rig;
  ASSERT_EQ(rig.bus.send(1, frame(5, {1})), SendStatus::ok);
  ASSERT_EQ(rig.bus.send(2, frame(5, {1})), SendStatus::ok);
  const auto got = rig.run(1000);
  ASSERT_EQ(got.size(), 1U);
  EXPECT_EQ(got[0].receivers, 0b1001U);
  EXPECT_EQ(rig.bus.counts().errors, 0U);
}

// ---- effects ----

TEST(BusEffects, LossMissesReceiversEachForItself) {
  Rig rig({BitTiming{}, Loss{0.25, true, false, {0.0, 1e6}}});
  constexpr int n = 4000;
  int controller = 0, drives = 0;
  rig.bus.begin_run();
  for (int i = 0; i < n; ++i) {
    ASSERT_EQ(rig.bus.send(1, frame(5, {1})), SendStatus::ok);
    for (const auto& d : rig.run(rig.bus.now() + 200)) {
      controller += (d.receivers & 1U) != 0 ? 1 : 0;
      drives += (d.receivers & 0b1100U) == 0b1100U ? 1 : 0;
    }
  }
  EXPECT_EQ(drives, n);
  EXPECT_NEAR(controller, 0.75 * n, 4.0 * std::sqrt(n * 0.25 * 0.75));  // four standard deviations
  EXPECT_EQ(rig.bus.counts().missed, static_cast<std::uint64_t>(n - controller));
  EXPECT_EQ(rig.bus.counters(1).state(), State::active) << "no error is detected";
}

TEST(BusEffects, ActFromTheirBeginningToTheirEnd) {
  Rig rig({BitTiming{}, Loss{1.0, true, true, {0.001, 0.002}}});
  const auto heard = [&] {
    EXPECT_EQ(rig.bus.send(1, frame(5)), SendStatus::ok);
    const auto got = rig.run(rig.bus.now() + 100);
    return got.size() == 1 && got[0].receivers != 0;
  };
  EXPECT_TRUE(heard());  // while arming
  ASSERT_FALSE(rig.bus.next(7000));
  rig.bus.begin_run();
  EXPECT_TRUE(heard());
  ASSERT_FALSE(rig.bus.next(8000));
  EXPECT_FALSE(heard());
  ASSERT_FALSE(rig.bus.next(9000));
  EXPECT_TRUE(heard());
}

TEST(BusEffects, ADuplicateComesOnceAfterAnErrorFrame) {
  Rig rig({BitTiming{}, Duplication{1.0, always}});
  const CanFrame f = frame(5, {1, 2});
  ASSERT_EQ(rig.bus.send(1, f), SendStatus::ok);
  const auto got = rig.run(10'000);
  ASSERT_EQ(got.size(), 2U);
  EXPECT_EQ(got[0].frame, f);
  EXPECT_EQ(got[1].frame, f);
  EXPECT_EQ(got[1].receivers, got[0].receivers);
  const Time length = static_cast<Time>(stuffed(unstuffed(f)).size()) + 10;
  EXPECT_EQ(got[1].at - got[0].at, 23 + length);  // 6 + 6 flags, 8 delimiter, 3 interframe space
  EXPECT_EQ(rig.bus.counters(1).transmit(), 8 - 1);
  EXPECT_EQ(rig.bus.counts().duplicated, 1U);
}

TEST(BusEffects, UndetectedCorruptionFlipsOneBitOfThePayload) {
  Rig rig({BitTiming{}, Corruption{0.0, 1.0, 1, always}});
  std::map<unsigned, int> where;
  for (int i = 0; i < 2000; ++i) {
    ASSERT_EQ(rig.bus.send(1, frame(5, {0, 0})), SendStatus::ok);
    const auto got = rig.run(rig.bus.now() + 200);
    ASSERT_EQ(got.size(), 1U);
    EXPECT_EQ(got[0].frame.id, 5U);
    const unsigned bits = got[0].frame.data[0] | static_cast<unsigned>(got[0].frame.data[1]) << 8U;
    ASSERT_EQ(std::popcount(bits), 1);
    ++where[bits];
  }
  EXPECT_EQ(where.size(), 16U);
  EXPECT_EQ(rig.bus.counts().corrupted, 2000U);
  EXPECT_EQ(rig.bus.counters(1).transmit(), 0);
  ASSERT_EQ(rig.bus.send(1, frame(5)), SendStatus::ok);  // no payload, nothing to flip
  EXPECT_EQ(rig.run(rig.bus.now() + 200).size(), 1U);
}

TEST(BusEffects, ABabblingNodeWithTheSmallestIdentifierLeavesNothing) {
  Rig rig({BitTiming{}, BabblingNode{0, false, 8, 1e6, always}});
  ASSERT_EQ(rig.bus.send(1, frame(1)), SendStatus::ok);
  Time last = 0;
  for (const auto& d : rig.run(100'000)) {
    EXPECT_EQ(d.frame.id, 0U);
    EXPECT_LE(d.at - last, 135);
    last = d.at;
  }
  EXPECT_GT(last, 99'000);
}

TEST(BusEffects, ABabblingNodeWithALargeIdentifierIsInTheWayForOneFrameAtMost) {
  Rig rig({BitTiming{}, BabblingNode{0x7F0, false, 8, 1e6, always}});
  for (int i = 0; i < 300; ++i) {
    ASSERT_FALSE(rig.bus.next(0));
    const Time asked = rig.bus.now();
    ASSERT_EQ(rig.bus.send(1, frame(1)), SendStatus::ok);
    Time at = 0;
    for (const auto& d : rig.run(asked + 700)) {
      if (d.frame.id == 1) at = d.at;
    }
    EXPECT_GT(at, asked);
    EXPECT_LE(at - asked, 135 + 55);
  }
}

TEST(BusEffects, ABabblingNodeKeepsItsRate) {
  Rig rig({BitTiming{}, BabblingNode{0x7F0, false, 8, 2000.0, {0.0, 0.1}}});
  EXPECT_TRUE(rig.run(10'000).empty());
  rig.bus.begin_run();
  EXPECT_EQ(rig.run(400'000).size(), 200U);
}

TEST(BusEffects, ADriveThatIsCutOffNeitherSendsNorHears) {
  Rig rig({BitTiming{}, DriveDropout{2, {0.0, 0.001}}});
  rig.bus.begin_run();
  EXPECT_EQ(rig.bus.send(2, frame(1)), SendStatus::bus_full);
  ASSERT_EQ(rig.bus.send(0, frame(3)), SendStatus::ok);
  auto got = rig.run(1000);
  ASSERT_EQ(got.size(), 1U);
  EXPECT_EQ(got[0].receivers, 0b1010U);
  EXPECT_EQ(rig.bus.send(2, frame(1)), SendStatus::ok);
  got = rig.run(2000);
  ASSERT_EQ(got.size(), 1U);
  EXPECT_EQ(got[0].frame.id, 1U);
}

}  // namespace
}  // namespace esmc::host
