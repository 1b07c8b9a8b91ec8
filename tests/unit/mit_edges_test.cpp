/// A command in MIT mode of cubemars_v3, written bit by bit: kp 12, kd 12, position 16, velocity 12,
/// torque 12.

#include <gtest/gtest.h>

#include "firmware/drive/mit.hpp"

namespace {

using namespace esmc::drive::mit;

TEST(MitFrameEdges, ACommandOfV3IsWrittenBitByBit) {
  for (unsigned bit = 0; bit < 64; ++bit) {
    const std::uint64_t number = std::uint64_t{1} << bit;
    const Command c{
        static_cast<std::uint16_t>(number >> 24 & 0xFFFF), static_cast<std::uint16_t>(number >> 12 & 0xFFF),
        static_cast<std::uint16_t>(number >> 52 & 0xFFF), static_cast<std::uint16_t>(number >> 40 & 0xFFF),
        static_cast<std::uint16_t>(number & 0xFFF)};
    const esmc::hal::CanFrame f = encode_command(3, c, Dialect::cubemars_v3);
    EXPECT_EQ(f.id, 0x803U);
    EXPECT_TRUE(f.extended);
    std::uint64_t written = 0;
    for (std::size_t i = 0; i < 8; ++i) written = written << 8 | f.data[i];
    EXPECT_EQ(written, number) << bit;
  }
}

}  // namespace
