/// The set-up against the object lists of real drives (tests/drives/objects), each as an emulated drive that
/// has the listed objects only: it arms with the right torque, or is refused with an object whose absence or
/// limits are in the list. And against each defect that the set-up meets.

#include <gtest/gtest.h>

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <optional>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "firmware/drive/cia402_axis.hpp"
#include "host_sim/drives/cia402_axis.hpp"
#include "tests/support/canopen_bytes.hpp"

namespace esmc::test {
namespace {

using hal::CanFrame;

/// With the limits of the values that may be written; signed where the low one is negative.
struct Listed : host::Cia402Axis::ListedObject {
  std::optional<std::int64_t> low{}, high{};
  [[nodiscard]] bool allows(std::uint32_t wanted) const {
    const std::int64_t span = std::int64_t{1} << (8U * bytes),
                       given = static_cast<std::int64_t>(wanted) % span;
    const std::int64_t v = low && *low < 0 && given >= span / 2 ? given - span : given;
    return !(low && v < *low) && !(high && v > *high);
  }
};

constexpr std::uint8_t drive_node = 6, controller_node = 127;

struct ObjectList {
  std::vector<Listed> objects;
  [[nodiscard]] const Listed* find(std::uint16_t index, std::uint8_t sub) const {
    for (const Listed& o : objects) {
      if (o.index == index && o.sub == sub) return &o;
    }
    return nullptr;
  }
};

std::int64_t number(const std::string& text) {
  constexpr std::size_t prefix = 8;  // $NODEID+
  const bool relative = text.compare(0, prefix, "$NODEID+") == 0;
  return (relative ? drive_node : 0) + std::stoll(text.substr(relative ? prefix : 0), nullptr, 0);
}

ObjectList read_list(const std::string& name) {
  std::ifstream in(std::filesystem::path(ESMC_OBJECT_LISTS) / (name + ".csv"));
  EXPECT_TRUE(in.good()) << name;
  ObjectList out;
  bool source = false, head = false;
  for (std::string line; std::getline(in, line);) {
    if (line.starts_with("#")) {
      source = source || line.starts_with("# Source: ");
      continue;
    }
    if (!std::exchange(head, true)) {
      EXPECT_EQ(line, "index,sub,type,access,default,low,high");
      continue;
    }
    std::vector<std::string> cells(1);
    for (const char c : line) {
      if (c == ',') {
        cells.emplace_back();
      } else {
        cells.back() += c;
      }
    }
    EXPECT_EQ(cells.size(), 7U) << name << ": " << line;
    Listed o;
    o.index = static_cast<std::uint16_t>(std::stoul(cells[0], nullptr, 16));
    o.sub = static_cast<std::uint8_t>(std::stoul(cells[1]));
    o.bytes = static_cast<std::uint8_t>(std::stoul(cells[2].substr(1)) / 8);
    o.writable = cells[3].starts_with("rw");
    if (!cells[4].empty()) o.value = static_cast<std::uint32_t>(number(cells[4]));
    if (!cells[5].empty()) o.low = number(cells[5]);
    if (!cells[6].empty()) o.high = number(cells[6]);
    out.objects.push_back(o);
  }
  EXPECT_TRUE(source) << name << " names no source";
  return out;
}

/// An emulated drive and the firmware's axis on a bus of their own.
struct Pair {
  Pair(const host::Cia402Axis::Settings& theirs, const drive::Cia402Settings& ours)
      : drive({.node = drive_node}, theirs, host::SensorEffects({}), 0, 1),
        axis({.node = drive_node}, ours) {}

  void give(const CanFrame& f) {
    if (f.id == 0x600U + drive_node && f.data[0] != 0x40) {
      const unsigned index = f.data[1] + 256U * f.data[2];
      const Listed* o = list.find(static_cast<std::uint16_t>(index), f.data[3]);
      if (o != nullptr && o->writable && !o->allows(little(f, 4, 4)))
        return answers.push_back(sdo(0x580 + drive_node, 0x80, index, f.data[3], 0x0609'0030));
    }
    if (f.id == 0x600U + drive_node && f.data[0] == 0x23 && f.data[1] + 256U * f.data[2] >= 0x1800 &&
        f.data[1] + 256U * f.data[2] <= 0x1803 && f.data[3] == 1) {
      tpdo_cob_ids.push_back(little(f, 4, 4));
    }
    (void)drive.receive(f, [this](const CanFrame& reply) { answers.push_back(reply); });
  }
  void hear() {
    for (const CanFrame& f : std::exchange(answers, {})) (void)axis.receive(f);
  }
  void tick(float torque = 0.0F, bool with_command = true) {
    axis.begin_tick();
    axis.expect_set(true);
    drive.publish(0.2, 0.0, [this](const CanFrame& f) { answers.push_back(f); });
    give(can(0x080, {}));
    hear();
    const auto send = [this](const CanFrame& f) {
      give(f);
      return true;
    };
    axis.enable(send);
    CanFrame command;
    axis.put_torque(command, torque);
    if (with_command) give(command);
    give(can(0x700 + controller_node, {5}));
    hear();
  }
  /// Until ready, refused, or 2 s.
  void arm() {
    for (int i = 0; i < 2000 && !axis.ready() && !axis.config_mismatch(); ++i) tick();
  }
  [[nodiscard]] std::string refused() const {
    const auto o = axis.contradicting_object();
    if (!o) return axis.ready() ? "" : "never ready";
    std::ostringstream text;
    text << std::hex << std::uppercase << o->index << ":" << int{o->sub};
    return text.str();
  }

  host::Cia402Axis drive;
  drive::Cia402Axis axis;
  ObjectList list;  ///< whose limits it keeps
  std::vector<CanFrame> answers;
  std::vector<std::uint32_t> tpdo_cob_ids;
};

host::Cia402Axis::Settings plain_drive() { return {.lockstep = false, .rated_torque = 0.5}; }
drive::Cia402Settings matching(const host::Cia402Axis::Settings& s) {
  drive::Cia402Settings out;
  out.rated_torque = static_cast<float>(s.rated_torque);
  out.rated_torque_unit = static_cast<float>(s.rated_torque_unit);
  out.torque_limit = out.rated_torque;
  return out;
}

/// Torque at the shaft for half of the rated one: right to half a thousandth.
void expect_torque(Pair& p, double rated) {
  for (int i = 0; i < 3; ++i) p.tick(static_cast<float>(0.5 * rated));
  EXPECT_TRUE(p.drive.closed_loop());
  EXPECT_NEAR(p.drive.joint_torque(), 0.5 * rated, 0.0006 * rated);
}

struct RealDrive {
  const char* list;
  double rated_torque;  ///< N m, of the motor's plate: what 6076 says in this unit, or commissioning
  double unit;          ///< N m per LSB of 6076
  const char* refused;  ///< object; "": arms
  bool limit_read;
};
class ObjectLists : public testing::TestWithParam<RealDrive> {};

TEST_P(ObjectLists, ArmsOrTheListExplainsWhyNot) {
  const RealDrive& real = GetParam();
  const ObjectList list = read_list(real.list);
  host::Cia402Axis::Settings theirs = plain_drive();
  theirs.rated_torque = real.rated_torque;
  theirs.rated_torque_unit = real.unit;
  theirs.objects.assign(list.objects.begin(), list.objects.end());
  Pair p(theirs, matching(theirs));
  p.list = list;
  p.arm();
  ASSERT_EQ(p.refused(), real.refused);
  if (*real.refused == '\0') {
    EXPECT_EQ(p.axis.torque_limit_unread(), list.find(0x6072, 0) == nullptr);
    EXPECT_EQ(p.axis.torque_limit_unread(), !real.limit_read);
    EXPECT_NEAR(p.axis.torque_lsb(), real.rated_torque / 1000.0, 1e-3 * real.rated_torque / 1000.0);
    expect_torque(p, real.rated_torque);
    return;
  }
  EXPECT_EQ(p.drive.joint_torque(), 0.0);
  const auto o = p.axis.contradicting_object();
  const Listed* listed = list.find(o->index, o->sub);
  const bool without_mode = o->index == 0x6502 && listed != nullptr && ((*listed->value >> 9U) & 1U) == 0;
  EXPECT_TRUE(listed == nullptr || !listed->writable || without_mode) << "the list has no reason";
}

// The refusals: SimplIQ has no cyclic torque mode (6502 bit 9); Ingenia has no consumer heartbeat 1016; Pilz
// and Schunk have no abort-connection option 6007, nor a target torque.
INSTANTIATE_TEST_SUITE_P(RealDrives, ObjectLists,
                         testing::Values(RealDrive{"epos4_0110", 0.128, 1e-6, "", false},
                                         RealDrive{"epos4_0170", 0.004793, 1e-6, "", false},
                                         RealDrive{"elmo_gold", 1.2, 1e-3, "", true},
                                         RealDrive{"elmo_simpliq", 1.2, 1e-3, "6502:0", true},
                                         RealDrive{"ingenia_eve_net_c", 1.0, 1e-3, "1016:1", false},
                                         RealDrive{"pilz_prbt", 1.0, 1e-3, "6007:0", false},
                                         RealDrive{"schunk_0_63", 1.0, 1e-3, "6007:0", false}),
                         [](const auto& p) { return std::string(p.param.list); });

// ---- one defect at a time

Pair with_defect(bool host::Defects::*defect) {
  host::Cia402Axis::Settings theirs = plain_drive();
  if (defect != nullptr) theirs.defects.*defect = true;
  return {theirs, matching(theirs)};
}

TEST(Cia402Defects, EveryOneArmsWithTheRightTorque) {
  using host::Defects;
  for (bool Defects::*defect :
       {static_cast<bool Defects::*>(nullptr), &Defects::no_6072, &Defects::no_1029,
        &Defects::rtr_bit_required, &Defects::torque_offset_left, &Defects::no_rpdo_deadline}) {
    Pair p = with_defect(defect);
    p.arm();
    ASSERT_EQ(p.refused(), "");
    EXPECT_EQ(p.axis.torque_limit_unread(), defect == &Defects::no_6072);
    expect_torque(p, 0.5);
    EXPECT_EQ(p.drive.value(0x60B2, 0), 0U);
  }
}

TEST(Cia402Defects, EachTpdoCobIdCarriesBit30) {
  Pair p = with_defect(nullptr);
  p.arm();
  ASSERT_EQ(p.tpdo_cob_ids.size(), 6U) << "two PDOs off and on, two off";
  for (const std::uint32_t id : p.tpdo_cob_ids) EXPECT_NE(id & 0x4000'0000U, 0U) << std::hex << id;
}

TEST(Cia402Defects, AnOffsetThatWasLeftWouldAct) {
  host::Cia402Axis::Settings theirs = plain_drive();
  theirs.defects.torque_offset_left = true;
  Pair p(theirs, matching(theirs));
  p.arm();
  p.give(sdo(0x600 + drive_node, 0x2B, 0x60B2, 0, 100));
  for (int i = 0; i < 3; ++i) p.tick(0.25F);
  EXPECT_NEAR(p.drive.joint_torque(), 0.25 + 0.05, 0.0006 * 0.5) << "the emulated drive adds it";
}

/// The heartbeat goes on, the torque frames do not arrive: with 1400:5 the drive fails after 10 ms (and the
/// half period of slack), without it the last torque stays.
TEST(Cia402Defects, WithoutOurRpdoTheDeadlineEndsTheTorque) {
  for (const bool monitored : {true, false}) {
    Pair p = with_defect(monitored ? nullptr : &host::Defects::no_rpdo_deadline);
    p.arm();
    expect_torque(p, 0.5);
    for (int i = 0; i < 10; ++i) p.tick(0.0F, false);
    EXPECT_NEAR(p.drive.joint_torque(), 0.25, 1e-3) << "not before its deadline";
    for (int i = 0; i < 2; ++i) p.tick(0.0F, false);
    EXPECT_EQ(p.drive.error(), monitored ? 0x8250U : 0U);
    EXPECT_EQ(p.drive.joint_torque() == 0.0, monitored);
    if (!monitored) continue;
    EXPECT_TRUE(p.axis.error());
    for (int i = 0; i < 600 && !p.axis.ready(); ++i) p.tick();
    EXPECT_TRUE(p.axis.ready()) << "the next frames let it be armed again";
  }
}

}  // namespace
}  // namespace esmc::test
