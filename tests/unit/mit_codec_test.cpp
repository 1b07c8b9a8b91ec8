/// MIT mode on the wire. The frames are worked out by hand from the field table.

#include "firmware/drive/mit.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>

#include "tests/support/mit_bytes.hpp"

namespace {

using namespace esmc::drive::mit;
using esmc::hal::CanFrame;
namespace test = esmc::test;

constexpr float nan = std::numeric_limits<float>::quiet_NaN(), inf = std::numeric_limits<float>::infinity();

TEST(MitCodec, ACommandIsTheFieldsOneAfterTheOther) {
  const Command c{.position = 0x1234, .velocity = 0x567, .kp = 0x89A, .kd = 0xBCD, .torque = 0xEF0};
  const CanFrame f = encode_command(0x7FF, c);
  EXPECT_EQ(f, test::bytes(0x7FF, {0x12, 0x34, 0x56, 0x78, 0x9A, 0xBC, 0xDE, 0xF0}));
  EXPECT_EQ(encode_command(1, {}), test::bytes(1, {0x80, 0x00, 0x80, 0x00, 0x00, 0x00, 0x08, 0x00}))
      << "no torque";
}

/// Position 16, velocity, kp, kd and torque 12 bits each; of a driver board V3 kp and kd come first.
TEST(MitCodec, EveryBitOfACommandIsWrittenAndRead) {
  struct Layout {
    Dialect dialect;
    unsigned position, velocity, kp, kd;  ///< lowest bit of each; the torque's is bit 0
  };
  for (const Layout& l :
       {Layout{Dialect::mini_cheetah, 48, 36, 24, 12}, Layout{Dialect::cubemars_v3, 24, 12, 52, 40}}) {
    for (unsigned bit = 0; bit < 64; ++bit) {
      const std::uint64_t number = std::uint64_t{1} << bit;
      const auto field = [&](unsigned from, unsigned mask = 0xFFF) {
        return static_cast<std::uint16_t>(number >> from & mask);
      };
      const Command c{field(l.position, 0xFFFF), field(l.velocity), field(l.kp), field(l.kd), field(0)};
      const CanFrame f = encode_command(3, c, l.dialect);
      EXPECT_EQ(f.extended, l.dialect == Dialect::cubemars_v3);
      EXPECT_EQ(f.id, f.extended ? 0x803U : 3U);
      EXPECT_EQ(test::mit_number(f, 0, 8), number) << bit;
      const Command back = decode_command(f, l.dialect);
      EXPECT_EQ(back.position, c.position) << bit;
      EXPECT_EQ(back.velocity, c.velocity) << bit;
      EXPECT_EQ(back.kp, c.kp) << bit;
      EXPECT_EQ(back.kd, c.kd) << bit;
      EXPECT_EQ(back.torque, c.torque) << bit;
    }
  }
}

/// Two turns, nearly, to each side; a command of 18 N m is the last code.
TEST(MitCodec, DefaultRanges) {
  const Ranges r;
  EXPECT_EQ(r.position, 12.5F);
  EXPECT_EQ(r.velocity, 50.0F);
  EXPECT_EQ(r.torque, 18.0F);
  EXPECT_TRUE(Reply{}.whole_torque);
}

TEST(MitCodec, SpecialFrames) {
  EXPECT_EQ(encode_special(2, Special::enter), test::bytes(2, {255, 255, 255, 255, 255, 255, 255, 0xFC}));
  EXPECT_EQ(encode_special(2, Special::leave), test::bytes(2, {255, 255, 255, 255, 255, 255, 255, 0xFD}));
  EXPECT_EQ(encode_special(2, Special::set_zero), test::bytes(2, {255, 255, 255, 255, 255, 255, 255, 0xFE}));
  for (unsigned last = 0; last < 256; ++last) {
    const auto s = decode_special(test::mit_special(2, last));
    EXPECT_EQ(s.has_value(), last >= 0xFC && last <= 0xFE) << last;
    if (s) {
      EXPECT_EQ(static_cast<unsigned>(*s), last);
    }
    for (std::size_t other = 0; other < 7; ++other) {
      CanFrame f = test::mit_special(2, last);
      f.data[other] = 0xFE;
      EXPECT_FALSE(decode_special(f).has_value());
    }
  }
}

/// (x + range) (2^n - 1) / (2 range), by hand.
TEST(MitCodec, CodesAreTheNearest) {
  EXPECT_EQ(code(1.5F, 18.0F, code_max_12), 2218) << "2218.125";
  EXPECT_EQ(code(-9.0F, 18.0F, code_max_12), 1024) << "1023.75";
  EXPECT_EQ(code(9.0F, 18.0F, code_max_12), 3071) << "3071.25";
  EXPECT_EQ(code(6.25F, 12.5F, code_max_16), 49151) << "49151.25";
  EXPECT_EQ(code(-6.25F, 12.5F, code_max_16), 16384) << "16383.75";
}

/// The two codes beside zero are half a step from it: 18 / 4095 = 4.4 mN m.
TEST(MitCodec, ZeroTorqueIsHalfAStep) {
  EXPECT_EQ(code(0.0F, 18.0F, code_max_12), 2048);
  EXPECT_EQ(code(-0.0F, 18.0F, code_max_12), 2048);
  EXPECT_NEAR(value(2048, 18.0F, code_max_12), 0.0043956, 1e-7);
  EXPECT_NEAR(value(2047, 18.0F, code_max_12), -0.0043956, 1e-7);
}

TEST(MitCodec, WhatIsOutOfRangeIsClampedAndWhatIsNoNumberIsTheMiddle) {
  for (const float range : {0.5F, 12.5F, 200.0F}) {
    for (const float beyond : {1.0F, 1.001F, 2.0F, 1e30F, inf}) {
      EXPECT_EQ(code(beyond * range, range, code_max_12), 4095);
      EXPECT_EQ(code(-beyond * range, range, code_max_12), 0);
      EXPECT_EQ(code(beyond * range, range, code_max_16), 65535);
      EXPECT_EQ(code(-beyond * range, range, code_max_16), 0);
    }
    EXPECT_EQ(code(nan, range, code_max_12), 2048);
    EXPECT_EQ(code(nan, range, code_max_16), 32768);
  }
  for (const float range : {0.0F, -1.0F, nan, -inf}) EXPECT_EQ(code(1.0F, range, code_max_12), 2048) << range;
}

TEST(MitCodec, EveryCodeSurvivesTheWayThereAndBack) {
  for (const float range : {5.0F, 7.3F, 12.5F, 18.0F, 95.5F, 144.0F}) {
    const auto wide = static_cast<double>(range);
    for (unsigned c = 0; c <= 4095; ++c) {
      const float v = value(static_cast<std::uint16_t>(c), range, code_max_12);
      ASSERT_NEAR(static_cast<double>(v), c * (2.0 * wide) / 4095 - wide, 2e-7 * wide) << c;
      ASSERT_EQ(code(v, range, code_max_12), c);
    }
    for (unsigned c = 0; c <= 65535; ++c) {
      ASSERT_EQ(code(value(static_cast<std::uint16_t>(c), range, code_max_16), range, code_max_16), c);
    }
  }
}

/// Half a step at most, over the whole range.
TEST(MitCodec, TheErrorOfACodeIsHalfAStep) {
  for (int i = -10000; i <= 10000; ++i) {
    const double x = 18.0 * i / 10000;
    const double back =
        static_cast<double>(value(code(static_cast<float>(x), 18.0F, code_max_12), 18.0F, code_max_12));
    ASSERT_LE(std::abs(back - x), 18.0 / 4095 + 1e-5) << x;
  }
}

TEST(MitCodec, RepliesOfEveryLength) {
  const CanFrame six = test::bytes(0, {0x05, 0xAB, 0xCD, 0x12, 0x34, 0x56});
  const auto r = decode_reply(six, Dialect::mini_cheetah);
  ASSERT_TRUE(r);
  EXPECT_EQ(r->position, 0xABCD);
  EXPECT_EQ(r->velocity, 0x123);
  EXPECT_EQ(r->torque, 0x456);
  EXPECT_EQ(r->error, 0);
  const auto cut = decode_reply(test::bytes(0, {0x05, 0xAB, 0xCD, 0x12, 0x34}), Dialect::mini_cheetah);
  ASSERT_TRUE(cut);
  EXPECT_EQ(cut->position, 0xABCD);
  EXPECT_EQ(cut->velocity, 0x123);
  EXPECT_EQ(cut->torque, 0x400);
  EXPECT_FALSE(cut->whole_torque);
  CanFrame stale = six;
  stale.size = 5;
  EXPECT_EQ(decode_reply(stale, Dialect::mini_cheetah)->torque, 0x400) << "a byte that is not there";
  const auto seven =
      decode_reply(test::bytes(0, {0x05, 0xAB, 0xCD, 0x12, 0x34, 0x56, 0x99}), Dialect::mini_cheetah);
  ASSERT_TRUE(seven);
  EXPECT_EQ(seven->torque, 0x456);
  const CanFrame eight = test::bytes(0, {0x95, 0xAB, 0xCD, 0x12, 0x34, 0x56, 0x20, 0x07});
  const auto ak = decode_reply(eight, Dialect::cubemars);
  ASSERT_TRUE(ak);
  EXPECT_EQ(ak->position, 0xABCD);
  EXPECT_EQ(ak->error, 7);
  const auto dm = decode_reply(eight, Dialect::damiao);
  ASSERT_TRUE(dm);
  EXPECT_EQ(dm->torque, 0x456);
  EXPECT_EQ(dm->error, 9);
}

TEST(MitCodec, OtherLengthsAndFormatsAreNoReplies) {
  for (std::uint8_t size = 0; size <= 64; ++size) {
    for (const Dialect d : {Dialect::mini_cheetah, Dialect::cubemars, Dialect::damiao}) {
      CanFrame f = test::mit_reply(0, 5, 1, 2, 3);
      f.size = size;
      const bool right = d == Dialect::mini_cheetah ? (size == 5 || size == 6 || size == 7) : size == 8;
      EXPECT_EQ(decode_reply(f, d).has_value(), right) << int{size};
      f.fd = true;
      EXPECT_FALSE(decode_reply(f, d).has_value());
      f.fd = false;
      f.remote = true;
      EXPECT_FALSE(decode_reply(f, d).has_value());
    }
  }
}

TEST(MitCodec, TheFirstByteNamesTheDrive) {
  for (unsigned first = 0; first < 256; ++first) {
    const auto byte = static_cast<std::uint8_t>(first);
    EXPECT_EQ(names(byte, 0x1C, Dialect::mini_cheetah), first == 0x1C);
    EXPECT_EQ(names(byte, 0x1C, Dialect::cubemars), first == 0x1C);
    EXPECT_EQ(names(byte, 0x0C, Dialect::damiao), first % 16 == 0x0C);
  }
}

TEST(MitCodec, ADriveWritesWhatAControllerReads) {
  const Reply r{.position = 0xFEDC, .velocity = 0xBA9, .torque = 0x876, .error = 0xD};
  EXPECT_EQ(encode_reply(0, 5, r, Dialect::mini_cheetah, 6),
            test::bytes(0, {5, 0xFE, 0xDC, 0xBA, 0x98, 0x76}));
  EXPECT_EQ(encode_reply(9, 5, r, Dialect::cubemars, 8),
            test::bytes(9, {5, 0xFE, 0xDC, 0xBA, 0x98, 0x76, 0, 0xD}));
  EXPECT_EQ(encode_reply(9, 0x15, r, Dialect::damiao, 8),
            test::bytes(9, {0xD5, 0xFE, 0xDC, 0xBA, 0x98, 0x76, 0, 0}));
}

/// By hand from the vendor's manual V3 (4.2, 4.3.1) as three open drivers have it: zero is 000 000 8000 800
/// 800; kd 2 of 5 is 666h; 100 deg, 2000 electrical rpm, 5 A, 25 deg C is 03E8 00C8 01F4 19.
TEST(MitCodec, CubemarsV3HasItsOwnOrderIdentifiersAndUnits) {
  const CanFrame zero = encode_command(2, {}, Dialect::cubemars_v3);
  EXPECT_TRUE(zero.extended);
  EXPECT_EQ(zero.id, 0x802U);
  CanFrame wanted = test::bytes(0x802, {0x00, 0x00, 0x00, 0x80, 0x00, 0x80, 0x08, 0x00});
  wanted.extended = true;
  EXPECT_EQ(zero, wanted);
  const Command all{.position = 0x7FFF, .velocity = 0x123, .kp = 0xABC, .kd = 0x666, .torque = 0xDEF};
  const CanFrame f = encode_command(0x68, all, Dialect::cubemars_v3);
  wanted = test::bytes(0x868, {0xAB, 0xC6, 0x66, 0x7F, 0xFF, 0x12, 0x3D, 0xEF});
  wanted.extended = true;
  EXPECT_EQ(f, wanted);
  CanFrame reply = test::bytes(0x2968, {0x03, 0xE8, 0xFF, 0x38, 0x01, 0xF4, 25, 7});
  reply.extended = true;
  const auto r = decode_reply(reply, Dialect::cubemars_v3);
  ASSERT_TRUE(r);
  EXPECT_EQ(r->position, 0x8000 + 1000);
  EXPECT_EQ(r->velocity, 0x8000 - 200);
  EXPECT_EQ(r->error, 7);
  EXPECT_FALSE(r->whole_torque);
  reply.data[4] = reply.data[5] = reply.data[6] = 0;
  EXPECT_EQ(encode_v3_reply(0x68, *r), reply);
  reply.size = 7;
  EXPECT_FALSE(decode_reply(reply, Dialect::cubemars_v3));
}

}  // namespace
