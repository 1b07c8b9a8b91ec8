/// A moteus at the edges of its format: bytes behind the frame, numbers of one byte and of two, limits that
/// need rounding, orders repeated where there is nothing to do.

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <utility>

#include "firmware/drive/moteus_axis.hpp"
#include "tests/support/moteus_bytes.hpp"
#include "tests/support/torque_frame.hpp"

namespace esmc::test {
namespace {

using drive::MoteusAxis;
using drive::Received;
using drive::moteus::Builder;
using drive::moteus::Subframe;
using drive::moteus::Subframes;

/// True if these subframes are well-formed to their end.
bool well_formed(const std::string& digits) {
  const hal::CanFrame f = fd_frame(0x100, digits);
  Subframes in(f);
  Subframe s;
  while (in.next(s)) {
  }
  return !in.malformed();
}

TEST(MoteusEdges, SubframesAtTheEdgeOfTheFormat) {
  for (const char* good : {"", "50", "104000", "217f00", "21808080800f00", "307f00", "31ff0100"})
    EXPECT_TRUE(well_formed(good)) << good;
  for (const char* bad : {"100005", "104100", "218080808010 00", "320102", "330102", "400102", "510102"})
    EXPECT_FALSE(well_formed(bad)) << bad;
  const hal::CanFrame stuck = fd_frame(0x100, "51 210005");
  Subframes latched(stuck);
  Subframe s;
  for (int i = 0; i < 3; ++i) EXPECT_FALSE(latched.next(s));
  EXPECT_TRUE(latched.malformed());
  const hal::CanFrame error = fd_frame(0x100, "31 27 05");
  Subframes in(error);
  ASSERT_TRUE(in.next(s));
  EXPECT_EQ(s.count, 0U) << "no registers";
  const Subframe none;
  EXPECT_EQ(none.kind, drive::moteus::Kind::read);
  EXPECT_EQ(none.type, drive::moteus::Type::i8);
  EXPECT_EQ(none.first + none.count + none.at, 0U);
}

TEST(MoteusEdges, BytesBehindTheFrameAreNotRead) {
  for (const char* rest : {"50", "5050", "5050505050505050505050505050505050505050210005", "210005", "ff"}) {
    hal::CanFrame f = fd_frame(0x100, std::string("21000a50") + rest);
    f.size = 4;
    Subframes in(f);
    Subframe s;
    EXPECT_TRUE(in.next(s));
    EXPECT_FALSE(in.next(s)) << rest;
    EXPECT_FALSE(in.malformed()) << rest;
  }
}

TEST(MoteusEdges, NumbersOfOneByteAndOfTwo) {
  hal::CanFrame f;
  Builder b(f, 0x7FF);
  EXPECT_FALSE(f.extended);
  b.error(true, 0x7E, 1);
  b.error(true, 0x7F, 1);
  b.error(true, 0x80, 1);
  b.error(true, 0x81, 1);
  EXPECT_EQ(digits_of(f), "317e01317f01318001013181010" + std::string("1"));
  Builder c(f, 0x800);
  EXPECT_TRUE(f.extended);
}

constexpr std::uint8_t moteus_node = 8;
struct Moteus {
  explicit Moteus(float torque = 2.0F, float watchdog = 0.01F)
      : axis({.node = moteus_node}, {torque, watchdog, true, 10}) {}
  void hear(const MoteusReply& r) {
    axis.begin_tick();
    EXPECT_EQ(axis.receive(r.frame(moteus_node)), Received::accepted);
  }
  void enable() {
    axis.enable([](const hal::CanFrame&) { return true; });
  }
  void make_wanted(const std::string& version = moteus_version) {
    for (int i = 0; i < 2; ++i) hear({.more = version});
    enable();
  }
  void make_ready() {
    make_wanted();
    for (int i = 0; i < 2; ++i) hear({.mode = 10, .more = "2525c80025270a00"});
    EXPECT_TRUE(axis.ready());
  }
  [[nodiscard]] std::string frame() const { return digits_of(torque_frame(axis, 0.5F)); }
  /// What the drive is given: largest torque in 0.01 N m, time in ms.
  [[nodiscard]] std::string limits() const { return frame().substr(frame().find("0525"), 16); }
  MoteusAxis axis;
};

TEST(MoteusEdges, EnablingOnceMoreDoesNotEndTorqueControl) {
  Moteus m;
  m.make_ready();
  for (int i = 0; i < 600; ++i) {
    m.enable();
    m.hear({.mode = 10});
    ASSERT_TRUE(m.axis.ready()) << i;
  }
}

TEST(MoteusEdges, AMismatchStaysUntilItIsDisabled) {
  Moteus m;
  m.make_wanted();
  m.hear({.mode = 10, .more = "2525c900 25270a00"});
  ASSERT_TRUE(m.axis.config_mismatch());
  const std::string before = m.frame();
  for (int i = 0; i < 40; ++i) {
    m.enable();
    EXPECT_EQ(m.frame(), before) << i;
    EXPECT_TRUE(m.axis.config_mismatch());
  }
}

TEST(MoteusEdges, AReplyWithOneOfTheLimitsIsNoMismatch) {
  for (const char* one : {"2525c800", "25270a00"}) {
    Moteus m;
    m.make_wanted();
    for (int i = 0; i < 4; ++i) m.hear({.mode = 10, .more = one});
    EXPECT_FALSE(m.axis.config_mismatch()) << one;
    EXPECT_FALSE(m.axis.ready()) << one;
  }
}

TEST(MoteusEdges, AnAbsolutePositionOfEitherKindWillDo) {
  for (const char* home : {"210c01", "210c02"}) {
    Moteus m;
    m.make_wanted(std::string("21820205") + home);
    EXPECT_FALSE(m.axis.config_mismatch()) << home;
    EXPECT_EQ(m.frame().substr(0, 6), "01000a") << home;
  }
}

/// Whole steps that hold the limit, where a hundred-thousandth is rounding.
TEST(MoteusEdges, LimitsAreRoundedUpToSteps) {
  const auto steps = [](float v) {
    const double ratio = static_cast<double>(v / 0.01F) * static_cast<double>(0.99999F);
    return ratio <= 1 ? 1U : static_cast<unsigned>(std::ceil(ratio));
  };
  for (const float around : {0.01F, 0.0100001F, 0.02F, 0.0200002F, 1.0F}) {
    float v = around;
    for (int i = 0; i < 4; ++i) v = std::nextafter(v, 0.0F);
    for (int i = 0; i < 9; ++i, v = std::nextafter(v, 1e9F)) {
      Moteus m(v);
      m.make_wanted();
      EXPECT_EQ(m.limits(), "0525" + byte_digits(steps(v)) + "0005270a00") << around << ' ' << i;
    }
  }
  for (const auto& [torque, digits] : {std::pair{0.0F, "0100"}, {0.005F, "0100"}, {1e9F, "ff7f"}}) {
    Moteus m(torque);
    m.make_wanted();
    EXPECT_EQ(m.limits().substr(4, 4), digits) << torque;
  }
}

TEST(MoteusEdges, ALimitHalfAStepOffIsAnotherOne) {
  for (const auto& [factor, agrees] : {std::pair{1.5F, false}, {1.49F, true}, {0.5F, false}, {0.51F, true}}) {
    Moteus m(0.01F);
    m.make_wanted();
    for (int i = 0; i < 2; ++i) {
      m.hear({.mode = 10, .more = "2d25" + float_digits(factor * 0.01F) + "25270a00"});
    }
    EXPECT_EQ(m.axis.ready(), agrees) << factor;
    EXPECT_EQ(m.axis.config_mismatch(), !agrees) << factor;
  }
}

TEST(MoteusEdges, ADriveNeverHeardHasNoErrorAndIsAskedAgain) {
  MoteusAxis axis;
  EXPECT_FALSE(axis.error() || axis.must_be_released() || axis.ready() || axis.idle());
  EXPECT_EQ(axis.error_code() + axis.last_error(), 0U);
  for (int tick = 0; tick < 400; ++tick) {
    int asked = 0;
    axis.enable([&](const hal::CanFrame&) { return ++asked, true; });
    EXPECT_EQ(asked, tick % 150 == 0 ? 1 : 0) << tick;
  }
}

TEST(MoteusEdges, AReplyMayHaveItsRegistersInAnyOrder) {
  const std::string motion = "2f01" + float_digits(0.25F) + float_digits(-0.5F) + float_digits(2.0F);
  const auto r = drive::moteus::decode_reply(fd_frame(0x100, motion + "210f21 2500ff00"));
  ASSERT_TRUE(r);
  EXPECT_EQ(r->position, 0.25F);
  EXPECT_EQ(r->velocity, -0.5F);
  EXPECT_EQ(r->torque, 2.0F);
  EXPECT_EQ(r->fault, 33.0F);
  EXPECT_EQ(r->mode, 255.0F) << "the largest byte";
  const std::string separate[] = {"21000a", "2d0100000000", "2d0200000000", "2d0300000000", "210f00"};
  for (int missing = -1; missing < 5; ++missing) {
    std::string digits;
    for (int i = 0; i < 5; ++i) {
      if (i != missing) digits += separate[i];
    }
    EXPECT_EQ(drive::moteus::decode_reply(fd_frame(0x100, digits)).has_value(), missing < 0) << missing;
  }
}

TEST(MoteusEdges, DefaultLimitsAreSmall) {
  const MoteusAxis::Settings s;
  EXPECT_EQ(s.torque_max, 1.0F);
  EXPECT_EQ(s.watchdog, 0.01F);
  EXPECT_TRUE(s.absolute);
  EXPECT_EQ(s.retry_ticks, 150U);
  const drive::moteus::Limits l;
  EXPECT_EQ(l.torque, 1);
  EXPECT_EQ(l.time, 1);
}

}  // namespace
}  // namespace esmc::test
