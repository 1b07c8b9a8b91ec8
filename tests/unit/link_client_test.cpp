/// The supervisor computer's end of the command interface: its frames against a desk made of bytes, its ears
/// against frames that lie, and both against the firmware's end.

#include "host_sim/operate/link_client.hpp"

#include <gtest/gtest.h>

#include <random>
#include <string>
#include <vector>

#include "host_sim/operate/sample_stream.hpp"
#include "host_sim/scene/scene.hpp"
#include "tests/support/link_bench.hpp"

namespace esmc::test {
namespace {

using host::LinkClient;

std::string bytes(const hal::CanFrame& f) {
  std::string out = std::to_string(f.id) + (f.extended || f.remote || f.fd ? "!" : "#");
  for (unsigned i = 0; i < f.size; ++i) out += std::to_string(f.data[i]) + " ";
  return out;
}

/// A client and a desk that have heard the same of a controller.
struct Pair {
  LinkBench bench;
  LinkClient client{0x780};
  void listen(int ticks) {
    for (int n = 0; n < ticks; ++n) bench.tick();
    for (const auto& f : bench.desk.heard) (void)client.hear(f);
  }
};

TEST(LinkClient, FramesAreThoseOfTheDesk) {
  Pair p;
  Desk& desk = p.bench.desk;
  for (int n = 0; n < 8; ++n) p.bench.tick({desk.ask(2)});
  p.listen(8);
  desk.counter = {};  // the client has sent nothing yet
  ASSERT_TRUE(p.client.news().status && p.client.news().table);
  for (int round = 0; round < 20; ++round) {  // past the end of the counters
    for (std::uint8_t o = 0; o < 255; ++o) {
      if (!is_order(o)) continue;
      ASSERT_EQ(bytes(p.client.order(static_cast<Order>(o), o)), bytes(desk.order(o, o)));
    }
    ASSERT_EQ(bytes(*p.client.set_point(Space::effector, {-0.123456, 8.0})),
              bytes(desk.pair(Desk::point, -123456, 8000000)));
    const auto sample = p.client.sample(Space::base_joints, {0.5, -0.25}, {-0.1, 83.0});
    ASSERT_TRUE(sample);
    ASSERT_EQ(bytes((*sample)[0]), bytes(desk.pair(Desk::position, 500000, -250000, 1)));
    ASSERT_EQ(bytes((*sample)[1]), bytes(desk.pair(Desk::velocity, -10000, 8300000, 1)));
    ASSERT_EQ(bytes(p.client.write(3, -1.5F)), bytes(desk.set_gain(3, -1.5F)));
    ASSERT_EQ(bytes(p.client.request(Subject::parameter, 7)), bytes(desk.ask(1, 7)));
  }
}

TEST(LinkClient, NumbersBeyondTheWireMakeNoFrame) {
  LinkClient client(0x780);
  const double inf = std::numeric_limits<double>::infinity(), nan = std::numeric_limits<double>::quiet_NaN();
  for (const double v : {8.388608, -8.388608, 1e300, inf, -inf, nan}) {
    EXPECT_FALSE(client.set_point(Space::effector, {v, 0.0})) << v;
    EXPECT_FALSE(client.set_point(Space::effector, {0.0, v})) << v;
    EXPECT_FALSE(client.sample(Space::effector, {0.0, v}, {0.0, 0.0})) << v;
  }
  EXPECT_FALSE(client.sample(Space::effector, {0.0, 0.0}, {84.0, 0.0}));
  EXPECT_TRUE(client.set_point(Space::effector, {8.388607, -8.388607}));
}

/// Position and tracking error are of one tick, also where a frame is lost: their sum is where the reference
/// is.
TEST(LinkClient, PairsEffectorAndTrackingErrorOfOneTick) {
  LinkClient client(0x780);
  const auto hear = [&](link::Message m, float x) {
    (void)client.hear(link::encode_floats(0x780, static_cast<std::uint8_t>(m), x, -x));
  };
  const auto& n = client.news();
  hear(link::Message::tracking_error, 1.0F);  // its effector was lost
  EXPECT_FALSE(n.effector || n.error);
  hear(link::Message::effector, 2.0F);
  EXPECT_FALSE(n.effector || n.error);
  hear(link::Message::tracking_error, 3.0F);
  ASSERT_TRUE(n.effector && n.error);
  EXPECT_EQ(n.telemetry, 1U);
  hear(link::Message::effector, 4.0F);
  EXPECT_EQ((*n.effector)[0], 2.0F);
  EXPECT_EQ((*n.error)[1], -3.0F);
  hear(link::Message::effector, 5.0F);  // the error between them was lost
  hear(link::Message::tracking_error, 6.0F);
  hear(link::Message::tracking_error, 7.0F);
  EXPECT_EQ((*n.effector)[0], 5.0F);
  EXPECT_EQ((*n.error)[0], 6.0F);
  EXPECT_EQ(n.telemetry, 2U);
}

TEST(LinkClient, HearsWhatTheControllerSays) {
  Pair p;
  p.bench.report.effector = {0.25F, -0.5F};
  for (int n = 0; n < 8; ++n) p.bench.tick({p.bench.desk.ask(2), p.bench.desk.ask(1, 6)});
  p.bench.tick({p.bench.desk.set_gain(0, 55.0F)});
  p.bench.tick({}, Fault::none);
  p.listen(16);
  const auto& n = p.client.news();
  ASSERT_TRUE(n.status);
  EXPECT_EQ(static_cast<unsigned>(n.status->state), p.bench.desk.state);
  EXPECT_EQ(n.status->tick, p.bench.desk.tick);
  EXPECT_EQ(p.client.session(), 77);
  EXPECT_EQ(n.scene.value_or(0), 0x89ABCDEFU);
  EXPECT_EQ(n.version, protocol_version);
  EXPECT_EQ(n.table.value_or(0), p.bench.desk.crc32);
  EXPECT_EQ(n.parameter[6].value, 2.0F);
  EXPECT_FALSE(n.parameter[6].writable);
  EXPECT_EQ(n.parameter[0].value, 55.0F);
  EXPECT_EQ(n.parameter[0].answer, Answer::ok);
  EXPECT_TRUE(n.parameter[0].writable);
}

/// A console that asks every 5 ticks, which at 25 Hz is 0.2 s; `drops`: takes a frame of the controller away.
template <class Drops>
std::size_t read_out(int ticks, const Drops& drops) {
  LinkConfig c = link_config();
  c.telemetry_ticks = 1;
  LinkBench bench(c);
  LinkClient client(0x780);
  bench.supervisor.begin_tick(Command::enable, {});  // faults count once it is not disabled
  for (const Fault f : {Fault::joint_speed, Fault::feedback_jump, Fault::stale_feedback}) bench.tick({}, f);
  for (int n = 0; n < 20; ++n) bench.tick();  // they have been announced
  for (int n = 0; n < ticks; ++n) {
    for (const auto& f : bench.desk.heard)
      if (!drops(f)) (void)client.hear(f);
    bench.desk.heard.clear();
    if (n == 5) client.forget_faults();
    const auto asks = n >= 5 && n % 5 == 0 ? client.request_faults() : std::nullopt;
    bench.tick(asks ? std::vector{*asks} : std::vector<hal::CanFrame>{});
    if (n > 5 && client.news().readout_over) break;
  }
  return client.news().readout_over ? client.news().faults.size() : 0;
}

TEST(LinkClient, ReadsAllFaultsOfALowRate) {
  EXPECT_EQ(read_out(60, [](const hal::CanFrame&) { return false; }), 3U);
}

TEST(LinkClient, AsksAgainForALostRecord) {
  int records = 0;  // three when they occur, then three of the first readout
  const auto fifth = [&](const hal::CanFrame& f) {
    return f.id == 0x791 && f.data[0] != 0 && ++records == 5;
  };
  EXPECT_EQ(read_out(150, fifth), 3U);
  EXPECT_EQ(records, 9);
}

/// What a console decides by, session and tick, comes from intact Status only: checksum by long division.
TEST(LinkClient, ForgedFramesChangeNoSession) {
  std::mt19937 draw(7);
  LinkClient client(0x780);
  Desk desk;
  std::uint32_t taken = 0;
  for (int n = 0; n < 100000; ++n) {
    hal::CanFrame f;
    f.id = draw() % 2 == 0 ? 0x790 : 0x770 + draw() % 0x40;
    f.size = static_cast<std::uint8_t>(draw() % 4 == 0 ? draw() % 9 : 8);
    f.extended = draw() % 16 == 0;
    f.remote = draw() % 16 == 0;
    f.fd = draw() % 16 == 0;
    for (unsigned i = 0; i < 8; ++i) f.data[i] = static_cast<std::uint8_t>(draw());
    const auto before = client.news().status;
    const bool heard = client.hear(f);
    const bool status = f.id == 0x790 && f.size == 8 && !f.extended && !f.remote && !f.fd && f.data[7] != 0 &&
                        desk.seal(f, f.data[7]).data[0] == f.data[0] && (f.data[1] >> 4) < 9 &&
                        (f.data[3] & 3) < 3 && ((f.data[3] >> 2) & 3) < 3 && (f.data[3] >> 6) < 3;
    ASSERT_EQ(heard, status);
    if (!heard) {
      ASSERT_EQ(client.news().status.has_value(), before.has_value());
      if (before) {
        ASSERT_EQ(client.session(), before->session);
        ASSERT_EQ(client.news().status->tick, before->tick);
      }
    }
    taken += heard ? 1 : 0;
  }
  EXPECT_GT(taken, 3U);
}

TEST(LinkClient, TwoConsolesStayInStep) {
  Pair p;
  p.listen(8);
  LinkClient other(0x780);
  for (const auto& f : p.bench.desk.heard) (void)other.hear(f);
  LinkClient* const consoles[] = {&p.client, &other};
  std::mt19937 draw(3);
  for (int n = 0; n < 1000; ++n) {
    const unsigned who = n == 0 ? 0 : draw() % 2;
    const hal::CanFrame f = consoles[who]->order(Order::none);
    (void)consoles[1 - who]->hear(f);
    ASSERT_EQ(p.bench.one(f), Outcome::obeyed) << n;
  }
}

TEST(LinkClient, ForgedOrderOfAnotherConsoleMovesNoCounter) {
  Pair p;
  p.listen(8);
  ASSERT_EQ(p.bench.one(p.client.order(Order::none)), Outcome::obeyed);
  hal::CanFrame forged = LinkClient(0x780).order(Order::none);  // of no session
  forged.data[1] = 9;
  (void)p.client.hear(forged);
  EXPECT_EQ(p.bench.one(p.client.order(Order::none)), Outcome::obeyed);
}

TEST(LinkClient, StopsWithoutAStatus) {
  LinkBench bench;
  bench.tick();
  EXPECT_EQ(bench.one(LinkClient(0x780).order(Order::off)), Outcome::obeyed);
  EXPECT_EQ(bench.one(LinkClient(0x780).order(Order::disarm)), Outcome::obeyed);
  EXPECT_NE(bench.one(LinkClient(0x780).order(Order::arm)), Outcome::obeyed);
}

/// Leg 2 stretched exactly: its base joint's rate is 0 / 0 even at rest.
TEST(SampleStream, AStretchedSecondLegHasNoRateInTheOtherSpace) {
  const host::Scene scene = host::read_scene_text(
      std::string(host::starting_scene("five_bar")), "scene",
      {"mechanism.half_base=0.0625", "mechanism.leg.l1=0.125", "mechanism.leg.l2=0.25"});
  const auto there = [&](double x, double y) {
    return host::in_other_space(scene, link::Space::effector, {{x, y}, {}}).has_value();
  };
  EXPECT_FALSE(there(0.3125, 0.0)) << "leg 2";
  EXPECT_FALSE(there(-0.3125, 0.0)) << "leg 1";
  EXPECT_TRUE(there(0.0, 0.25));
}

/// Of a console that answers each Status: at 10 Hz the defaults of a fast loop would refuse its orders and
/// lose its sign of life.
TEST(CommandDefaults, AStatusCanBeAnsweredUntilTheNextOne) {
  const auto command = [](const std::vector<std::string>& sets) {
    std::vector<std::string> all{"command.arm=\"link\"", "command.speed=0.3", "command.acceleration=3.0"};
    all.insert(all.end(), sets.begin(), sets.end());
    return *host::read_scene_text(std::string(host::starting_scene("five_bar")), "scene", all).command;
  };
  EXPECT_EQ(command({}).order_age, 0.5);
  EXPECT_EQ(command({}).timeout, 1.0);
  EXPECT_EQ(command({"control.rate_hz=10"}).order_age, 2.0);
  EXPECT_EQ(command({"control.rate_hz=10"}).timeout, 3.0);
  EXPECT_EQ(command({"command.status_ticks=1000"}).order_age, 2.0);
  EXPECT_EQ(command({"control.rate_hz=10", "command.status_ticks=100000"}).order_age, 10.0);
  EXPECT_EQ(command({"control.rate_hz=10", "command.status_ticks=100000"}).timeout, 15.0);
  EXPECT_EQ(command({"control.rate_hz=10", "command.order_age=0.25", "command.timeout=0.75"}).order_age,
            0.25);
  EXPECT_EQ(command({"control.rate_hz=10", "command.order_age=0.25", "command.timeout=0.75"}).timeout, 0.75);
  EXPECT_EQ(command({"control.rate_hz=10", "command.arm=\"start\""}).timeout, 0.0);
}

}  // namespace
}  // namespace esmc::test
