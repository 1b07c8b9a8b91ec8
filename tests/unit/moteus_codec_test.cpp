/// Registers of a moteus on the wire: the vendor's examples, what this program sends, and frames of any kind.

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>
#include <utility>
#include <vector>

#include "firmware/drive/moteus.hpp"
#include "tests/support/moteus_bytes.hpp"

namespace {

using namespace esmc::drive::moteus;
using esmc::hal::CanFrame;
using esmc::test::digits_of;
using esmc::test::fd_frame;

const float nan = std::numeric_limits<float>::quiet_NaN();

TEST(MoteusCodec, UnitsOfTheMappings) {
  const std::vector<std::pair<std::uint32_t, std::vector<double>>> table = {
      {reg::position, {0.01, 1e-4, 1e-5}},
      {reg::position_command, {0.01, 1e-4, 1e-5}},
      {reg::stop_position, {0.01, 1e-4, 1e-5}},
      {reg::velocity, {0.1, 2.5e-4, 1e-5}},
      {reg::velocity_command, {0.1, 2.5e-4, 1e-5}},
      {reg::velocity_limit, {0.1, 2.5e-4, 1e-5}},
      {reg::torque, {0.5, 0.01, 0.001}},
      {reg::feedforward_torque, {0.5, 0.01, 0.001}},
      {reg::max_torque, {0.5, 0.01, 0.001}},
      {reg::watchdog_timeout, {0.01, 0.001, 1e-6}},
      {reg::kp_scale, {1 / 127.0, 1 / 32767.0, 1 / 2147483647.0}},
      {reg::kd_scale, {1 / 127.0, 1 / 32767.0, 1 / 2147483647.0}},
      {reg::mode, {1, 1, 1}},
      {reg::map_version, {1, 1, 1}}};
  for (const auto& [name, units] : table) {
    for (int t = 0; t < 3; ++t)
      EXPECT_FLOAT_EQ(unit(name, static_cast<Type>(t)),
                      static_cast<float>(units[static_cast<std::size_t>(t)]))
          << name;
    EXPECT_EQ(unit(name, Type::f32), 1.0F);
  }
}

// What the vendor's own encoder makes of a position command, and of the query behind it.
TEST(MoteusCodec, BuildsTheVendorsFrame) {
  CanFrame f;
  Builder b(f, 0x8001);
  b.begin(Kind::write, Type::i8, 1, reg::mode);
  b.value(Type::i8, mode_position);
  b.begin(Kind::write, Type::f32, 3, reg::position_command);
  b.value(nan);
  b.value(0.0F);
  b.value(1.5F);
  b.begin(Kind::write, Type::i8, 2, reg::kp_scale);
  b.value(Type::i8, 0);
  b.value(Type::i8, 0);
  b.begin(Kind::write, Type::f32, 1, reg::max_torque);
  b.value(3.0F);
  b.begin(Kind::read, Type::i8, 1, reg::mode);
  b.begin(Kind::read, Type::f32, 3, reg::position);
  b.begin(Kind::read, Type::i8, 3, 0x0D);
  EXPECT_EQ(digits_of(f), "01000a0f200000c07f000000000000c03f022300000d250000404011001f01130d");
  b.pad();
  EXPECT_EQ(f.size, 48);
  EXPECT_EQ(digits_of(f).substr(66), "505050505050505050505050505050");
  EXPECT_TRUE(f.fd && f.bit_rate_switch && f.extended);
}

TEST(MoteusCodec, OwnFrames) {
  CanFrame f;
  put_query(f, 7, false);
  EXPECT_EQ(f.id, 0x8007U);
  EXPECT_EQ(digits_of(f), "11001f01110f118202110c50") << "12 bytes are a size";
  put_query(f, 7, true);
  EXPECT_EQ(f.id, 0x8007U);
  EXPECT_EQ(digits_of(f), "01000011001f01110f118202110c5050");
  put_torque(f, 1, 1.5F, {.torque = 300, .time = 10}, false);
  EXPECT_EQ(f.size, torque_size);
  EXPECT_EQ(digits_of(f), "01000a022080000d220000c03f0223000005252c0105270a0011001f01110f50");
  put_torque(f, 1, 1.5F, {.torque = 300, .time = 10}, true);
  EXPECT_EQ(digits_of(f), "01000a03208000000223000005252c0105270a0011001f01110f152515275050") << "no torque";
  Builder e(f, 0x100);
  e.error(true, 0x27, 1);
  e.error(false, 0x102, 2);
  e.pad();
  EXPECT_FALSE(f.extended);
  EXPECT_EQ(digits_of(f), "31270130820202") << "7 bytes are a size";
}

// The example of the vendor's protocol page: 16-bit integers, then 8-bit ones.
TEST(MoteusCodec, DecodesTheVendorsReply) {
  const auto r = decode_reply(fd_frame(0x100, "2404000a005000000170ff230d181400"));
  ASSERT_TRUE(r);
  EXPECT_EQ(r->mode, 10.0F);
  EXPECT_FLOAT_EQ(r->position, 0.008F);
  EXPECT_FLOAT_EQ(r->velocity, 0.064F);
  EXPECT_FLOAT_EQ(r->torque, -1.44F);
  EXPECT_EQ(r->fault, 0.0F);
  EXPECT_EQ(r->refused, no_register);
  EXPECT_TRUE(std::isnan(r->version) && std::isnan(r->home) && std::isnan(r->max_torque) &&
              std::isnan(r->time));
}

TEST(MoteusCodec, ReadsTheVendorsCommand) {
  const CanFrame f = fd_frame(0x8001, "01000a07206000200150ff140400130d");
  Subframes in(f);
  Subframe s;
  ASSERT_TRUE(in.next(s));
  EXPECT_TRUE(s.kind == Kind::write && s.type == Type::i8 && s.count == 1 && s.first == reg::mode &&
              s.at == 2);
  ASSERT_TRUE(in.next(s));
  EXPECT_TRUE(s.kind == Kind::write && s.type == Type::i16 && s.count == 3 &&
              s.first == reg::position_command);
  EXPECT_FLOAT_EQ(value_at(f, s.at, s.type, reg::position_command), 0.0096F);
  EXPECT_FLOAT_EQ(value_at(f, 7, s.type, reg::velocity_command), 0.072F);
  EXPECT_FLOAT_EQ(value_at(f, 9, s.type, reg::feedforward_torque), -1.76F);
  ASSERT_TRUE(in.next(s));
  EXPECT_TRUE(s.kind == Kind::read && s.type == Type::i16 && s.count == 4 && s.first == 0);
  ASSERT_TRUE(in.next(s));
  EXPECT_TRUE(s.kind == Kind::read && s.count == 3 && s.first == 0x0D);
  EXPECT_FALSE(in.next(s));
  EXPECT_FALSE(in.malformed());
}

TEST(MoteusCodec, TheMostNegativeIntegerIsNotANumber) {
  const CanFrame f = fd_frame(0, "80 0080 00000080 81 0180 ffffff7f");
  EXPECT_TRUE(std::isnan(value_at(f, 0, Type::i8, reg::torque)));
  EXPECT_TRUE(std::isnan(value_at(f, 1, Type::i16, reg::torque)));
  EXPECT_TRUE(std::isnan(value_at(f, 3, Type::i32, reg::torque)));
  EXPECT_FLOAT_EQ(value_at(f, 7, Type::i8, reg::torque), -63.5F);
  EXPECT_FLOAT_EQ(value_at(f, 8, Type::i16, reg::torque), -327.67F);
  EXPECT_FLOAT_EQ(value_at(f, 10, Type::i32, reg::torque), 2147483.647F);
}

TEST(MoteusCodec, ReadsReadBackErrorsAndPadding) {
  const auto reply = [](const std::string& more) {
    return decode_reply(esmc::test::MoteusReply{.mode = 10, .position = 0.25F, .more = more}.frame(1));
  };
  const auto r = reply("50 2525c800 2527 0a00 21820205 210c01 31270150");
  ASSERT_TRUE(r);
  EXPECT_EQ(r->position, 0.25F);
  EXPECT_FLOAT_EQ(r->max_torque, 2.0F);
  EXPECT_FLOAT_EQ(r->time, 0.01F);
  EXPECT_EQ(r->version, 5.0F);
  EXPECT_EQ(r->home, 1.0F);
  EXPECT_EQ(r->refused, 0x27U);
  EXPECT_EQ(reply("30 25 02")->refused, 0x25U);
  EXPECT_TRUE(reply("11 00")) << "a question in a reply says nothing";
  for (const char* bad : {"51", "32", "40", "60", "ff", "31", "3127", "31ff", "2d25", "2d25000000", "20",
                          "2000", "2041", "20ff", "2102", "218080808010", "2180808080800000"})
    EXPECT_FALSE(reply(bad)) << bad;
  EXPECT_TRUE(reply("21808080800f00")) << "32 bits";
  const CanFrame f = fd_frame(0x100, "51 2100");
  Subframes in(f);
  Subframe s;
  EXPECT_FALSE(in.next(s));
  EXPECT_FALSE(in.next(s)) << "nothing is found behind";
}

TEST(MoteusCodec, RepliesThatLackSomethingAreMalformed) {
  const CanFrame good = esmc::test::MoteusReply{.mode = 10}.frame(1);
  ASSERT_EQ(good.size, reply_size);
  ASSERT_TRUE(decode_reply(good));
  for (std::uint8_t size = 0; size < good.size; ++size) {
    CanFrame f = good;
    f.size = size;
    EXPECT_FALSE(decode_reply(f)) << int{size};
  }
  CanFrame f = good;
  f.fd = false;
  EXPECT_FALSE(decode_reply(f));
  EXPECT_FALSE(decode_reply(fd_frame(0x100, "2080"))) << "128 values";
  // A mode or fault that is no byte: i8 -1, f32 NaN, 256 and 1e9.
  for (const char* mode : {"2100ff", "2d000000c07f", "2d0000008043", "2d00286b6e4e"}) {
    EXPECT_FALSE(decode_reply(fd_frame(0x100, std::string(mode) + "2f01000000000000000000000000210f00")))
        << mode;
    std::string fault(mode);
    fault.replace(2, 2, "0f");
    EXPECT_FALSE(decode_reply(fd_frame(0x100, "21000a2f01000000000000000000000000" + fault))) << mode;
  }
}

TEST(MoteusCodec, RandomBytesAreReadWithinTheFrame) {
  std::mt19937 random(22);
  int decoded = 0;
  for (int n = 0; n < 200'000; ++n) {
    CanFrame f = esmc::test::MoteusReply{.mode = 10, .more = "2525c80025270a00"}.frame(1);
    if (n % 3 == 0) {
      for (auto& b : f.data) b = static_cast<std::uint8_t>(random());
      f.size = static_cast<std::uint8_t>(random() % 256);
    } else {
      for (int k = 0; k < n % 4; ++k)
        f.data[random() % f.size] ^= static_cast<std::uint8_t>(1U << random() % 8);
    }
    Subframes in(f);
    std::uint32_t bytes = 0;
    for (Subframe s; in.next(s);) {
      if (s.kind == Kind::read || s.kind == Kind::error) continue;
      bytes += s.count * width(s.type);
      ASSERT_LE(s.at + s.count * width(s.type), std::min<unsigned>(f.size, 64));
    }
    ASSERT_LE(bytes, 64U);
    const auto r = decode_reply(f);
    if (!r) continue;
    ++decoded;
    ASSERT_TRUE(r->mode >= 0.0F && r->mode <= 255.0F && r->fault >= 0.0F && r->fault <= 255.0F);
  }
  EXPECT_GT(decoded, 20'000);
}

TEST(CanFdSize, IsTheNextOneThatThereIs) {
  for (unsigned n = 0; n <= 64; ++n) {
    unsigned want = n;
    while (want > 8 && want != 12 && want != 16 && want != 20 && want != 24 && want != 32 && want != 48 &&
           want != 64)
      ++want;
    EXPECT_EQ(esmc::hal::can_fd_size(static_cast<std::uint8_t>(n)), want);
  }
}

}  // namespace
