/// Worst-case latencies: by hand, by a published example's trap, and against the bus that is simulated.

#include "host_sim/bus/response.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <string>
#include <vector>

#include "host_sim/bus/timed_bus.hpp"

namespace esmc::host {
namespace {

using Time = TimedBus::Time;

BusMessage message(std::uint32_t key, std::uint32_t bits, double period, double jitter = 0.0) {
  BusMessage m;
  m.key = m.id = key;
  m.bits = bits;
  m.period = period;
  m.jitter = jitter;
  return m;
}

// Priorities 1 > 2 > 3, by hand. Message 1: one longer frame of 3 is on the bus, 135, then its own 95.
// Message 2: 135, one of 1, its own 105; the next of 1 comes at 500. Message 3: nobody below; one each of 1
// and 2, its own 135.
TEST(Response, ByHand) {
  const std::vector<BusMessage> all{message(1, 95, 500), message(2, 105, 700), message(3, 135, 1000)};
  EXPECT_EQ(response_time(all, all[0]), 135 + 95);
  EXPECT_EQ(response_time(all, all[1]), 135 + 95 + 105);
  EXPECT_EQ(response_time(all, all[2]), 95 + 105 + 135);
}

// The example with which Davis et al. (2007) refute the older analysis, in units of 1/1000: three messages
// of 1.0, periods 2.5, 3.5, 3.5. The second instance of the third is the late one: 3.5, where looking at the
// first alone gives 3.0.
TEST(Response, TheSecondInstanceMayBeTheLateOne) {
  const std::vector<BusMessage> all{message(1, 1000, 2500), message(2, 1000, 3500), message(3, 1000, 3500)};
  EXPECT_EQ(response_time(all, all[0]), 2000);
  EXPECT_EQ(response_time(all, all[1]), 3000);
  EXPECT_EQ(response_time(all, all[2]), 3500);
}

TEST(Response, JitterOfAnotherBringsItTwice) {
  // Within 135 + 95 there is one of message 1 every 500, two when the first may be 400 late.
  std::vector<BusMessage> all{message(1, 95, 500), message(2, 135, 1000)};
  EXPECT_EQ(response_time(all, all[1]), 95 + 135);
  all[0].jitter = 450;
  EXPECT_EQ(response_time(all, all[1]), 95 + 95 + 135);
  all[1].jitter = 30;  // of its own it counts in full
  EXPECT_EQ(response_time(all, all[1]), 95 + 95 + 135 + 30);
}

TEST(Response, NoBoundAboveFullLoad) {
  const std::vector<BusMessage> all{message(1, 135, 200), message(2, 135, 300)};
  EXPECT_TRUE(response_time(all, all[0]));
  EXPECT_FALSE(response_time(all, all[1]));
}

Scene scene(const std::vector<std::string>& sets) { return read_scene(ESMC_SCENE, sets); }

// Two drives at 1 kHz and 1 Mbit/s, frames of 135 bits: identifiers 0x21 < 0x29 < 0x2E < 0x41 < 0x49 < 0x4E.
// Each waits for one below it and for those above it.
TEST(Response, OfTheComparisonScenario) {
  const BusAnalysis a = analyse_bus(scene({}));
  ASSERT_EQ(a.messages.size(), 6U);
  const std::uint32_t ids[] = {0x21, 0x29, 0x2E, 0x41, 0x49, 0x4E};
  const double waits[] = {2, 3, 4, 5, 6, 6};  // frames, its own included
  for (std::size_t i = 0; i < 6; ++i) {
    EXPECT_EQ(a.messages[i].id, ids[i]);
    ASSERT_TRUE(a.messages[i].response_s);
    EXPECT_NEAR(*a.messages[i].response_s, waits[i] * 135e-6, 1e-9) << std::hex << ids[i];
  }
  EXPECT_NEAR(a.load, (4 * 0.135 + 2 * 0.0135), 1e-9);
  ASSERT_TRUE(a.loop_s);
  EXPECT_NEAR(*a.loop_s, 6 * 135e-6, 1e-9);
}

/// The loop's frames as it sends them, with data of every kind: drives at the tick, commands when the samples
/// are through.
std::map<std::uint32_t, Time> worst_seen(const Scene& s, int ticks);

TEST(Response, TheSimulatedBusNeverExceedsIt) {
  int bounded = 0;
  for (const int bitrate : {1'000'000, 800'000, 700'000, 500'000, 250'000}) {
    for (const char* stranger :
         {"", ", {type=\"babbling_node\", identifier=0, rate_hz=700.0, size=3, from=-1}",
          ", {type=\"babbling_node\", identifier=2000, rate_hz=5000.0, from=-1}",
          ", {type=\"babbling_node\", identifier=60, rate_hz=1300.0, extended=true, from=-1}"}) {
      const Scene s = scene({"bus.bitrate=" + std::to_string(bitrate),
                             std::string("effects=[{type=\"bit_timing\"}") + stranger + "]"});
      const BusAnalysis a = analyse_bus(s);
      const auto seen = worst_seen(s, 3000);
      for (const BusAnalysis::Message& m : a.messages) {
        if (!m.response_s || !seen.contains(m.id)) continue;
        ++bounded;
        EXPECT_LE(static_cast<double>(seen.at(m.id)) / bitrate, *m.response_s + 1e-12)
            << m.name << " at " << bitrate << stranger;
      }
    }
  }
  EXPECT_GT(bounded, 50);
}

std::map<std::uint32_t, Time> worst_seen(const Scene& s, int ticks) {
  TimedBus bus({2, static_cast<double>(s.bitrate), s.effects, 1});
  Uniform random(3, Stream::bus_loss);
  // Random data, or data with as many stuff bits as can be had.
  const auto make = [&](std::uint32_t id) {
    hal::CanFrame f;
    f.id = id;
    f.size = 8;
    const std::uint32_t kind = random.below(3);
    const std::uint8_t stuffing[] = {0x3C, 0x78, 0xF0, 0xE1, 0xC3, 0x87, 0x0F, 0x1E};
    for (std::size_t i = 0; i < 8; ++i)
      f.data[i] = kind == 0 ? static_cast<std::uint8_t>(random.below(256)) : (kind == 1 ? stuffing[i] : 0);
    return f;
  };
  for (int k = 0; k < ticks; ++k) {
    const Time end = std::llround((k + 1) * s.tick() * s.bitrate);
    int samples = 0;
    for (std::uint32_t node = 1; node <= 2; ++node) {
      if (k % 10 == 0) (void)bus.send(node, make(node << 5U | 1U));
      samples += bus.send(node, make(node << 5U | 9U)) == hal::SendStatus::ok ? 1 : 0;
    }
    const Time begin = bus.now();
    const auto command = [&] {
      for (std::uint32_t node = 1; node <= 2; ++node) (void)bus.send(0, make(node << 5U | 0xEU));
    };
    bool answered = false;
    while (const auto d = bus.next(end)) {
      if ((d->frame.id == 0x29 || d->frame.id == 0x49) && d->asked >= begin && --samples == 0) {
        command();
        answered = true;
      }
    }
    if (!answered) command();
  }
  std::map<std::uint32_t, Time> out;
  for (const TimedBus::Latency& l : bus.latencies()) out[l.id] = l.largest;
  return out;
}

}  // namespace
}  // namespace esmc::host
