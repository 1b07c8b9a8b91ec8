/// The emulated CiA 402 drive against the standards' rules, in frames written byte by byte: what a controller
/// that was written from the same documents may rely on.

#include "host_sim/drives/cia402_axis.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

#include "tests/support/canopen_bytes.hpp"

namespace esmc::host {
namespace {

using hal::CanFrame;
using test::can;
using test::entry;

constexpr unsigned node = 6;

class Drive : public testing::Test {
 protected:
  Drive() : axis(mount(), settings(), SensorEffects({}), 0, 1) {}

  static AxisMount mount() {
    return {.node = static_cast<int>(node), .direction = -1.0, .gear_ratio = 2.0, .offset = 0.25};
  }
  static Cia402Axis::Settings settings(bool lockstep = true) {
    return {.lockstep = lockstep,
            .period = 1e-3,
            .rated_torque = 0.5,
            .rated_torque_unit = 1e-6,
            .max_torque = 2.0,
            .counts_per_turn = 1000.0,
            .velocity_unit = 0.001};
  }
  EmulatedAxis::Send sink() {
    return [this](const CanFrame& f) { said.push_back(f); };
  }
  std::vector<CanFrame> publish(double angle = 0.25, double rate = 0.0) {
    said.clear();
    axis.publish(angle, rate, sink());
    return said;
  }
  bool give(const CanFrame& f) {
    said.clear();
    return axis.receive(f, sink());
  }
  /// The answer to an SDO request: first byte and value.
  std::pair<int, std::uint32_t> ask(int command, std::uint32_t object, std::uint32_t value = 0) {
    give(test::sdo(0x600 + node, command, object >> 8U, object & 0xFFU, value));
    if (said.empty()) return {-1, 0};
    EXPECT_EQ(said.back().id, 0x580U + node);
    EXPECT_EQ(said.back().size, 8);
    EXPECT_EQ(entry(said.back().data[1] + 256U * said.back().data[2], said.back().data[3]), object);
    return {said.back().data[0], test::little(said.back(), 4, 4)};
  }
  void write(std::uint32_t object, std::uint32_t value, unsigned bytes) {
    const int command = bytes == 1 ? 0x2F : (bytes == 2 ? 0x2B : 0x23);
    ASSERT_EQ(ask(command, object, value).first, 0x60) << std::hex << object;
  }
  std::uint32_t abort_of_write(std::uint32_t object, std::uint32_t value, unsigned bytes) {
    const int command = bytes == 1 ? 0x2F : (bytes == 2 ? 0x2B : 0x23);
    const auto [first, code] = ask(command, object, value);
    return first == 0x80 ? code : 0;
  }
  /// Torque mode, RPDO1 {6040, 6071}, TPDO1 {6041, 6064, 6077} at every SYNC, and operational.
  void set_up() {
    write(entry(0x6060, 0), 10, 1);
    write(entry(0x1400, 1), 0x8000'0200 + node, 4);
    write(entry(0x1600, 0), 0, 1);
    write(entry(0x1600, 1), 0x6040'0010, 4);
    write(entry(0x1600, 2), 0x6071'0010, 4);
    write(entry(0x1600, 0), 2, 1);
    write(entry(0x1400, 1), 0x0000'0200 + node, 4);
    write(entry(0x1800, 1), 0xC000'0180 + node, 4);
    write(entry(0x1A00, 0), 0, 1);
    write(entry(0x1800, 2), 1, 1);
    write(entry(0x1A00, 1), 0x6041'0010, 4);
    write(entry(0x1A00, 2), 0x6064'0020, 4);
    write(entry(0x1A00, 3), 0x6077'0010, 4);
    write(entry(0x1A00, 0), 3, 1);
    write(entry(0x1800, 1), 0x4000'0180 + node, 4);
    give(test::nmt(1, node));
  }
  void control(int word, int torque = 0) {
    give(can(0x200 + node, {word % 256, word / 256, torque & 0xFF, (torque >> 8) & 0xFF}));
  }
  unsigned status() { return ask(0x40, entry(0x6041, 0)).second & 0x6FU; }
  void enable() {
    for (const int word : {0x06, 0x07, 0x0F}) control(word);
    ASSERT_EQ(status(), 0x27U);
  }

  Cia402Axis axis;
  std::vector<CanFrame> said;
};

TEST_F(Drive, ServesItsDictionary) {
  EXPECT_EQ(ask(0x40, entry(0x1000, 0)), (std::pair<int, std::uint32_t>{0x43, 0x0002'0192}));
  EXPECT_EQ(ask(0x40, entry(0x1001, 0)), (std::pair<int, std::uint32_t>{0x4F, 0}));
  EXPECT_EQ(ask(0x40, entry(0x1018, 0)), (std::pair<int, std::uint32_t>{0x4F, 4}));
  EXPECT_EQ(ask(0x40, entry(0x1018, 4)), (std::pair<int, std::uint32_t>{0x43, node}));
  EXPECT_EQ(ask(0x40, entry(0x6502, 0)).second >> 9U & 1U, 1U) << "cyclic torque";
  EXPECT_EQ(ask(0x40, entry(0x6076, 0)), (std::pair<int, std::uint32_t>{0x43, 500'000}))
      << "micro newton metres";
  EXPECT_EQ(ask(0x40, entry(0x6072, 0)), (std::pair<int, std::uint32_t>{0x4B, 2000}));
  EXPECT_EQ(ask(0x40, entry(0x1017, 0)), (std::pair<int, std::uint32_t>{0x4B, 0}))
      << "off, as from the factory";
  for (const std::uint32_t object :
       {entry(0x1005, 0), entry(0x1006, 0), entry(0x1014, 0), entry(0x1016, 1), entry(0x1029, 1),
        entry(0x6007, 0), entry(0x603F, 0), entry(0x6040, 0), entry(0x605A, 0), entry(0x605E, 0),
        entry(0x6061, 0), entry(0x6064, 0), entry(0x606C, 0), entry(0x6071, 0), entry(0x6077, 0),
        entry(0x60C2, 1), entry(0x60C2, 2)}) {
    EXPECT_NE(ask(0x40, object).first, 0x80) << std::hex << object;
  }
}

TEST_F(Drive, AbortsWithTheReason) {
  EXPECT_EQ(ask(0x40, entry(0x2000, 0)), (std::pair<int, std::uint32_t>{0x80, 0x0602'0000}));
  EXPECT_EQ(ask(0x40, entry(0x1018, 9)), (std::pair<int, std::uint32_t>{0x80, 0x0609'0011}));
  EXPECT_EQ(abort_of_write(entry(0x6041, 0), 0, 2), 0x0601'0002U);
  EXPECT_EQ(abort_of_write(entry(0x6076, 0), 1, 4), 0x0601'0002U);
  EXPECT_EQ(abort_of_write(entry(0x6040, 0), 0, 4), 0x0607'0010U);
  EXPECT_EQ(abort_of_write(entry(0x6060, 0), 8, 1), 0x0609'0030U) << "cyclic position: not supported";
  EXPECT_EQ(abort_of_write(entry(0x6060, 0), 200, 1), 0x0609'0030U);
  EXPECT_EQ(abort_of_write(entry(0x6007, 0), 4, 2), 0x0609'0030U);
  EXPECT_EQ(abort_of_write(entry(0x1029, 1), 3, 1), 0x0609'0030U);
  EXPECT_EQ(abort_of_write(entry(0x605A, 0), 0xFFFF, 2), 0x0609'0030U);
  EXPECT_EQ(abort_of_write(entry(0x605E, 0), 5, 2), 0x0609'0030U);
  EXPECT_EQ(ask(0x21, entry(0x6040, 0), 2), (std::pair<int, std::uint32_t>{0x80, 0x0504'0001}))
      << "segmented";
  EXPECT_EQ(ask(0x22, entry(0x6060, 0), 10).first, 0x60) << "without a size";
  EXPECT_EQ(ask(0x80, entry(0x6040, 0)).first, -1) << "the client's abort has no answer";
  CanFrame cut = test::sdo(0x600 + node, 0x40, 0x1000, 0);
  cut.size = 7;
  give(cut);
  EXPECT_TRUE(said.empty());
}

TEST_F(Drive, RefusesToBeRemappedInTheWrongOrder) {
  EXPECT_EQ(abort_of_write(entry(0x1600, 0), 0, 1), 0x0800'0022U) << "the PDO is on";
  EXPECT_EQ(abort_of_write(entry(0x1400, 2), 1, 1), 0x0800'0022U);
  EXPECT_EQ(abort_of_write(entry(0x1400, 1), 0x201 + node, 4), 0x0609'0030U) << "moved while on";
  EXPECT_EQ(abort_of_write(entry(0x1400, 1), 0x8000'0080, 4), 0x0609'0030U) << "the identifier of SYNC";
  write(entry(0x1400, 1), 0x8000'0200 + node, 4);
  EXPECT_EQ(abort_of_write(entry(0x1600, 1), 0x6071'0010, 4), 0x0800'0022U) << "it has entries";
  write(entry(0x1600, 0), 0, 1);
  EXPECT_EQ(abort_of_write(entry(0x1400, 2), 241, 1), 0x0609'0030U);
  for (const std::uint32_t map : {0x6071'0020U, 0x6099'0010U, 0x6041'0010U, 0x1000'0020U, 0x6040'0008U}) {
    EXPECT_EQ(abort_of_write(entry(0x1600, 1), map, 4), 0x0604'0041U) << std::hex << map;
  }
  EXPECT_EQ(abort_of_write(entry(0x1600, 0), 2, 1), 0x0604'0041U) << "the second entry was never written";
  for (unsigned i = 1; i <= 5; ++i) write(entry(0x1600, i), 0x6071'0010, 4);
  EXPECT_EQ(abort_of_write(entry(0x1600, 0), 5, 1), 0x0604'0042U) << "ten bytes";
  EXPECT_EQ(abort_of_write(entry(0x1600, 0), 9, 1), 0x0604'0042U);
  write(entry(0x1600, 0), 4, 1);
  set_up();
  EXPECT_EQ(abort_of_write(entry(0x1800, 1), 0xC000'0180 + node, 4), 0x0800'0022U) << "operational";
  give(test::nmt(0x80, node));
  EXPECT_EQ(abort_of_write(entry(0x1800, 1), 0xC000'0180 + node, 4), 0U);
}

TEST_F(Drive, KeepsToElevenBitsAndToItsOwnIdentifiers) {
  write(entry(0x1400, 1), 0x8000'0200 + node, 4);
  EXPECT_EQ(abort_of_write(entry(0x1400, 1), 0x2000'0200 + node, 4), 0x0609'0030U) << "29 bits";
  EXPECT_EQ(abort_of_write(entry(0x1005, 0), 0x600 + node, 4), 0x0609'0030U)
      << "SYNC would be its SDO requests";
  EXPECT_EQ(abort_of_write(entry(0x1005, 0), 0x80, 4), 0U);
  EXPECT_EQ(abort_of_write(entry(0x1014, 0), 0x081 + node, 4), 0x0609'0030U) << "somebody else's emergencies";
}

TEST_F(Drive, EmergenciesCanBeSwitchedOff) {
  set_up();
  const CanFrame torn = can(0x200 + node, {0x0F});
  write(entry(0x1014, 0), 0x8000'0080 + node, 4);
  give(torn);
  EXPECT_TRUE(said.empty());
  write(entry(0x1014, 0), 0x80 + node, 4);
  give(torn);
  EXPECT_EQ(said.size(), 1U);
}

TEST_F(Drive, StartsAnewWithoutItsFaultAndItsLastControlword) {
  const auto miss_the_master = [&] {
    write(entry(0x1016, 1), 0x0064'0005, 4);
    write(entry(0x6007, 0), 1, 2);
    give(can(0x764, {5}));
    for (int i = 0; i < 8; ++i) publish();
    ASSERT_EQ(status(), 0x08U);
    ASSERT_EQ(axis.error(), 0x8130U);
  };
  miss_the_master();
  give(test::nmt(0x82, node));
  EXPECT_EQ(axis.error(), 0U);
  EXPECT_EQ(status(), 0x40U);
  write(entry(0x6040, 0), 0x80, 2);
  give(test::nmt(0x81, node));
  miss_the_master();
  give(can(0x764, {5}));
  write(entry(0x6040, 0), 0x80, 2);
  EXPECT_EQ(status(), 0x40U) << "an edge: the word before was told to another start";
}

TEST_F(Drive, PowerStateMachine) {
  set_up();
  publish();
  struct Step {
    int control;
    unsigned status;
  };
  for (const Step s :
       {Step{0x07, 0x40}, Step{0x0F, 0x40}, Step{0x06, 0x21}, Step{0x0F, 0x23}, Step{0x06, 0x21},
        Step{0x07, 0x23}, Step{0x0F, 0x27}, Step{0x07, 0x23}, Step{0x0F, 0x27}, Step{0x06, 0x21},
        Step{0x07, 0x23}, Step{0x0F, 0x27}, Step{0x02, 0x07}, Step{0x0F, 0x27}, Step{0x02, 0x07},
        Step{0x00, 0x40}, Step{0x80, 0x40}, Step{0x06, 0x21}, Step{0x02, 0x40}}) {
    control(s.control);
    ASSERT_EQ(status(), s.status) << std::hex << s.control;
  }
  write(entry(0x605A, 0), 0, 2);
  enable();
  control(0x02);
  EXPECT_EQ(status(), 0x40U) << "quick stop that takes the torque away at once";
}

TEST_F(Drive, TorqueActsInTorqueModeAndEnabledOnly) {
  set_up();
  publish();
  control(0x06, 400);
  EXPECT_EQ(axis.joint_torque(), 0.0);
  control(0x07, 400);
  control(0x0F, 400);
  // 0.4 of 0.5 N m at the shaft; two motor turns per joint turn, against the joint.
  EXPECT_NEAR(axis.joint_torque(), -0.4, 1e-12);
  EXPECT_TRUE(axis.closed_loop());
  control(0x0F, -32768);
  EXPECT_NEAR(axis.joint_torque(), 2.0, 1e-12) << "limited to twice the rated torque";
  write(entry(0x6060, 0), 1, 1);
  EXPECT_EQ(axis.joint_torque(), 0.0);
  EXPECT_FALSE(axis.closed_loop());
  write(entry(0x6060, 0), 10, 1);
  control(0x07, 400);
  EXPECT_EQ(axis.joint_torque(), 0.0);
  control(0x0F);
  EXPECT_EQ(axis.joint_torque(), 0.0) << "nothing is remembered";
}

TEST_F(Drive, ReportsWhatItReadsInItsUnits) {
  publish();
  set_up();
  give(can(0x080, {}));
  // Joint 0.25 + 0.1 rad: the shaft is at -0.2 rad.
  const auto out = publish(0.35, 3.0);
  ASSERT_EQ(out.size(), 1U);
  EXPECT_EQ(out[0].id, 0x180U + node);
  EXPECT_EQ(static_cast<std::int32_t>(test::little(out[0], 2, 4)),
            static_cast<std::int32_t>(std::round(-0.2 / (2 * 3.14159265358979) * 1000)));
  EXPECT_EQ(static_cast<std::int32_t>(ask(0x40, entry(0x606C, 0)).second), -6000) << "-6 rad/s";
}

TEST_F(Drive, InLockstepSaysOneThingPerTick) {
  EXPECT_EQ(publish(), std::vector<CanFrame>{can(0x700 + node, {0x00})}) << "boot-up";
  EXPECT_EQ(publish(), std::vector<CanFrame>{can(0x700 + node, {0x7F})});
  EXPECT_TRUE(give(can(0x200 + node, {0, 0, 0, 0}))) << "the torque frame is all it waits for";
  EXPECT_FALSE(give(can(0x080, {})));
  set_up();
  EXPECT_TRUE(publish().empty()) << "nobody has asked";
  EXPECT_FALSE(give(can(0x080, {}))) << "no torque frame yet";
  EXPECT_FALSE(give(can(0x200 + node, {0, 0, 0, 0})));
  EXPECT_TRUE(give(can(0x080, {})));
  EXPECT_TRUE(said.empty()) << "it is sampled when the next tick begins";
  EXPECT_EQ(publish().size(), 1U);
  EXPECT_FALSE(give(can(0x080, {}))) << "the torque frame was the last tick's";
  give(test::nmt(0x02, node));
  EXPECT_EQ(publish(), std::vector<CanFrame>{can(0x700 + node, {0x04})});
  EXPECT_EQ(ask(0x40, entry(0x1000, 0)).first, -1) << "stopped: no SDO";
}

TEST_F(Drive, ByItsOwnClockItAnswersSyncAtOnceAndBeatsAsItIsTold) {
  axis = Cia402Axis(mount(), settings(false), SensorEffects({}), 0, 1);
  EXPECT_EQ(publish(), std::vector<CanFrame>{can(0x700 + node, {0x00})});
  for (int i = 0; i < 50; ++i) EXPECT_TRUE(publish().empty());
  set_up();
  write(entry(0x1017, 0), 4, 2);
  std::vector<int> beats;
  for (int i = 1; i <= 12; ++i) {
    if (!publish().empty()) beats.push_back(i);
  }
  EXPECT_EQ(beats, (std::vector<int>{4, 8, 12}));
  EXPECT_EQ(said[0], can(0x700 + node, {0x05}));
  give(can(0x080, {}));
  ASSERT_EQ(said.size(), 1U);
  EXPECT_EQ(said[0].id, 0x180U + node);
  give(test::nmt(0x82, 0));
  EXPECT_EQ(said[0], can(0x700 + node, {0x00}));
  give(can(0x080, {}));
  EXPECT_TRUE(said.empty());
}

TEST_F(Drive, MissesItsMasterAndDoesAsItWasTold) {
  struct Case {
    unsigned option, status;
    double torque;
    bool error;
  };
  for (const Case c : {Case{0, 0x27, -0.5, false}, Case{1, 0x08, 0.0, true}, Case{2, 0x40, 0.0, false},
                       Case{3, 0x07, 0.0, false}}) {
    axis = Cia402Axis(mount(), settings(), SensorEffects({}), 0, 1);
    write(entry(0x1016, 1), 0x0064'0005, 4);  // node 100, 5 ms
    write(entry(0x6007, 0), c.option, 2);
    set_up();
    enable();
    control(0x0F, 500);
    for (int i = 0; i < 20; ++i) publish();
    EXPECT_TRUE(axis.closed_loop()) << "a master that was never heard is not missed";
    give(can(0x764, {5}));
    for (int i = 0; i < 5; ++i) publish();
    EXPECT_TRUE(axis.closed_loop());
    publish();
    ASSERT_FALSE(said.empty());
    EXPECT_EQ(said[0].id, 0x080U + node);
    EXPECT_EQ(test::little(said[0], 0, 2), 0x8130U);
    EXPECT_NEAR(axis.joint_torque(), c.torque, 1e-12) << c.option;
    publish();
    EXPECT_EQ(status(), c.status) << c.option;
    EXPECT_EQ(axis.error(), c.error ? 0x8130U : 0U);
  }
}

TEST_F(Drive, WithoutItsMasterItStaysInTheStateThatItsErrorBehaviourSays) {
  struct Case {
    unsigned behaviour, state;
  };
  for (const auto& [behaviour, state] : {Case{0, 0x7F}, Case{1, 0x05}, Case{2, 0x04}}) {
    axis = Cia402Axis(mount(), settings(), SensorEffects({}), 0, 1);
    write(entry(0x1016, 1), 0x0064'0005, 4);
    write(entry(0x1017, 0), 1, 2);
    write(entry(0x1029, 1), behaviour, 1);
    write(entry(0x6007, 0), 0, 2);
    set_up();
    enable();
    control(0x0F, 500);
    give(can(0x764, {5}));
    for (int i = 0; i < 5; ++i) publish();
    give(can(0x080, {}));
    publish();
    const auto beats = [&](unsigned s) {
      return std::ranges::count(said, can(0x700 + node, {static_cast<std::uint8_t>(s)}));
    };
    EXPECT_EQ(beats(state), 1) << behaviour;
    EXPECT_EQ(axis.confirmations() > 0, behaviour == 1);
    EXPECT_NEAR(axis.joint_torque(), -0.5, 1e-12) << "the torque is for 6007 to take";
  }
  axis = Cia402Axis(mount(), settings(), SensorEffects({}), 0, 1);
  write(entry(0x1016, 1), 0x0064'0005, 4);
  give(can(0x764, {5}));
  give(test::nmt(0x02, node));
  for (int i = 0; i < 8; ++i) publish();
  EXPECT_EQ(said.at(0), can(0x700 + node, {0x04})) << "stopped before: no way up";
}

TEST_F(Drive, AFaultIsLatchedUntilAnEdgeAfterItsCauseIsGone) {
  write(entry(0x1016, 1), 0x0064'0005, 4);
  write(entry(0x1029, 1), 1, 1);
  write(entry(0x6007, 0), 1, 2);
  set_up();
  enable();
  give(can(0x764, {5}));
  for (int i = 0; i < 8; ++i) publish();
  ASSERT_EQ(status(), 0x08U);
  for (const int word : {0x06, 0x0F, 0x00, 0x80}) control(word);
  EXPECT_EQ(status(), 0x08U) << "the master is still missing";
  give(can(0x764, {5}));
  control(0x80);
  EXPECT_EQ(status(), 0x08U) << "no edge";
  control(0x00);
  control(0x80);
  EXPECT_EQ(said[0], can(0x080 + node, {0, 0, 0, 0, 0, 0, 0, 0}));
  EXPECT_EQ(status(), 0x40U);
  EXPECT_EQ(axis.error(), 0U);
}

TEST_F(Drive, LeavingOperationalWhileEnabledIsALostConnection) {
  for (const int command : {0x80, 0x02}) {
    axis = Cia402Axis(mount(), settings(), SensorEffects({}), 0, 1);
    write(entry(0x6007, 0), 1, 2);
    set_up();
    enable();
    control(0x0F, 500);
    give(test::nmt(command, 0));
    EXPECT_EQ(axis.joint_torque(), 0.0);
    EXPECT_FALSE(axis.closed_loop());
    EXPECT_EQ(axis.error(), 0x8130U);
  }
  axis = Cia402Axis(mount(), settings(), SensorEffects({}), 0, 1);
  set_up();
  enable();
  give(test::nmt(0x81, node));
  EXPECT_EQ(status(), 0x40U);
  EXPECT_EQ(ask(0x40, entry(0x6060, 0)).second, 0U) << "reset: as from the factory";
}

TEST_F(Drive, ATorqueFrameThatIsTooShortIsReportedAndNotUsed) {
  set_up();
  enable();
  control(0x0F, 100);
  give(can(0x200 + node, {0x0F, 0x00, 0x10}));
  EXPECT_EQ(said.at(0).id, 0x080U + node);
  EXPECT_EQ(test::little(said[0], 0, 2), 0x8210U);
  EXPECT_NEAR(axis.joint_torque(), -0.1, 1e-12);
}

TEST_F(Drive, KnowsWhatOnlyAControllerSendsToIt) {
  for (const CanFrame& f : {test::nmt(1, node), test::nmt(0x80, 0), test::sdo(0x600 + node, 0x40, 0x1000, 0),
                            can(0x200 + node, {0, 0, 0, 0}), can(0x500 + node, {0, 0})}) {
    EXPECT_TRUE(axis.commanded_by(f)) << std::hex << f.id;
    CanFrame other = f;
    other.remote = true;
    EXPECT_FALSE(axis.commanded_by(other));
  }
  const CanFrame moved = can(0x300 + node + 1, {0, 0});
  EXPECT_FALSE(axis.commanded_by(moved));
  write(entry(0x1401, 1), 0x8000'0300 + node, 4);
  write(entry(0x1401, 1), 0x300 + node + 1, 4);
  EXPECT_TRUE(axis.commanded_by(moved)) << "where it listens now";
  for (const CanFrame& f : {test::nmt(1, 9), can(0x080, {}), can(0x77F, {5}), test::report_of(node, 0),
                            can(0x209, {0, 0, 0, 0}), test::emergency_of(node, 1)}) {
    EXPECT_FALSE(axis.commanded_by(f)) << std::hex << f.id;
  }
}

TEST_F(Drive, CountsReportsOfTorqueControl) {
  set_up();
  enable();
  for (int i = 1; i <= 3; ++i) {
    EXPECT_EQ(axis.confirmations(), i - 1);
    give(can(0x080, {}));
    publish();
  }
  control(0x07);
  EXPECT_EQ(axis.confirmations(), 0);
}

}  // namespace
}  // namespace esmc::host
