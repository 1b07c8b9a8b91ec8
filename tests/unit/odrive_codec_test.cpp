/// The ODrive codec against bytes packed by hand from the message table. Nothing here is compared with what
/// the codec itself made.

#include "firmware/drive/odrive.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "tests/support/odrive_bytes.hpp"

namespace {

using esmc::hal::CanFrame;
using namespace esmc::drive::odrive;
namespace test = esmc::test;

std::vector<unsigned> payload(const CanFrame& f) {
  const auto used = f.payload();
  return {used.begin(), used.end()};
}
using Bytes = std::vector<unsigned>;

bool plain(const CanFrame& f) { return !f.extended && !f.remote && !f.fd && !f.bit_rate_switch; }

// ---- golden frames

TEST(OdriveCodec, IdentifierIsNodeTimes32PlusCommand) {
  EXPECT_EQ(identifier(0, Message::heartbeat), 0x001U);
  EXPECT_EQ(identifier(1, Message::heartbeat), 0x021U);
  EXPECT_EQ(identifier(3, Message::set_input_torque), 0x06EU);
  EXPECT_EQ(identifier(0x10, Message::encoder_estimates), 0x209U);
  EXPECT_EQ(identifier(0x3E, Message::clear_errors), 0x7D8U);
  EXPECT_EQ(identifier(0x3E, Message::estop), 0x7C2U);
}

TEST(OdriveCodec, SetAxisStateCarriesTheStateInTheFirstFourBytes) {
  const CanFrame on = encode_set_axis_state(2, AxisState::closed_loop_control);
  const CanFrame off = encode_set_axis_state(2, AxisState::idle);
  EXPECT_EQ(on.id, 0x047U);
  EXPECT_EQ(off.id, 0x047U);
  EXPECT_EQ(test::word(on, 0), 8U);
  EXPECT_EQ(test::word(off, 0), 1U);
  EXPECT_EQ(test::word(on, 4), 0U);
  EXPECT_TRUE(plain(on) && plain(off));
}

TEST(OdriveCodec, SetControllerModeIsTorqueAndPassthrough) {
  const CanFrame f = encode_set_controller_mode(5);
  EXPECT_EQ(f.id, 0x0ABU);
  EXPECT_EQ(payload(f), (Bytes{1, 0, 0, 0, 1, 0, 0, 0}));
  EXPECT_TRUE(plain(f));
}

TEST(OdriveCodec, ClearErrorsHasOneByteIn06AndNoneIn056) {
  EXPECT_EQ(payload(encode_clear_errors(1, Version::v0_6)), Bytes{0});
  EXPECT_EQ(payload(encode_clear_errors(1, Version::v0_5_6)), Bytes{});
  EXPECT_EQ(encode_clear_errors(1, Version::v0_6).id, 0x038U);
}

TEST(OdriveCodec, EstopIsEmpty) {
  EXPECT_EQ(encode_estop(1).id, 0x022U);
  EXPECT_EQ(payload(encode_estop(1)), Bytes{});
}

TEST(OdriveCodec, TorqueIsAFloatLowByteFirst) {
  const struct {
    float value;
    Bytes bytes;
  } golden[] = {
      {1.5F, {0x00, 0x00, 0xC0, 0x3F}},      {-1.5F, {0x00, 0x00, 0xC0, 0xBF}},
      {0.0F, {0x00, 0x00, 0x00, 0x00}},      {-0.0F, {0x00, 0x00, 0x00, 0x80}},
      {0.1F, {0xCD, 0xCC, 0xCC, 0x3D}},      {-123.456F, {0x79, 0xE9, 0xF6, 0xC2}},
      {0x1p-149F, {0x01, 0x00, 0x00, 0x00}}, {0x1.fffffep127F, {0xFF, 0xFF, 0x7F, 0x7F}},
  };
  for (const auto& g : golden) {
    const CanFrame f = encode_torque(3, g.value);
    ASSERT_GE(f.size, 4);
    EXPECT_EQ(f.id, 0x06EU);
    for (std::size_t i = 0; i < 4; ++i) EXPECT_EQ(f.data[i], g.bytes[i]) << g.value << " byte " << i;
    EXPECT_EQ(test::word(f, 4), 0U) << "unused bytes";
    EXPECT_TRUE(plain(f));
  }
}

/// Set_Axis_State and Set_Input_Torque have 8 bytes, 4 used, in the message table, in the vendor's DBC of
/// 0.6.10 and in its own ros_odrive; firmware 0.5.6 does not look at the length, what 0.6 does with 4 is not
/// known.
TEST(OdriveCodec, CommandsHaveTheLengthTheVendorGives) {
  EXPECT_EQ(encode_set_axis_state(1, AxisState::idle).size, 8);
  EXPECT_EQ(encode_torque(1, 1.0F).size, 8);
  EXPECT_EQ(encode_set_controller_mode(1).size, 8);
}

/// A frame is used again and again: nothing of what was in it is left.
TEST(OdriveCodec, ATorqueReplacesAllEightBytes) {
  CanFrame f = test::message(9, test::cmd_axis_state, 0xFFFFFFFF, 0xFFFFFFFF);
  f.size = 5;
  put_torque(f, 3, 1.5F);
  EXPECT_EQ(f.id, 0x06EU);
  EXPECT_EQ(payload(f), (Bytes{0x00, 0x00, 0xC0, 0x3F, 0, 0, 0, 0}));
}

TEST(OdriveCodec, EncodersOfTheDriveSideMatchBytesPackedByHand) {
  const CanFrame e = encode_encoder_estimates(4, 0.25F, -2.0F);
  EXPECT_EQ(e.id, 0x089U);
  EXPECT_EQ(payload(e), (Bytes{0x00, 0x00, 0x80, 0x3E, 0x00, 0x00, 0x00, 0xC0}));
  const CanFrame h = encode_heartbeat(4, 0x04030201, AxisState::closed_loop_control);
  EXPECT_EQ(h.id, 0x081U);
  EXPECT_EQ(payload(h), (Bytes{0x01, 0x02, 0x03, 0x04, 8, 0, 0, 0}));
  EXPECT_TRUE(plain(e) && plain(h));
}

/// While compiling, an index too far is an error.
static_assert(encode_version(1, {6, 7, 8}).data[7] == 0);

/// 0.6: Get_Version, Get_Error and TxSdo, each 8 bytes.
TEST(OdriveCodec, WhatADriveOf06AnswersMatchesBytesPackedByHand) {
  const CanFrame v = encode_version(0x3E, {6, 7, 8});
  EXPECT_EQ(v.id, 0x7C0U);
  EXPECT_EQ(encode_version_request(0x3E).id, 0x7C0U);
  EXPECT_EQ(encode_version_request(0x3E).size, 8) << "what is asked for";
  EXPECT_TRUE(encode_version_request(0x3E).remote);
  EXPECT_EQ(payload(v), (Bytes{2, 0, 0, 0, 6, 7, 8, 0}));
  const CanFrame e = encode_errors(4, 0x01020304, 0xA0B0C0D0);
  EXPECT_EQ(e.id, 0x083U);
  EXPECT_EQ(payload(e), (Bytes{4, 3, 2, 1, 0xD0, 0xC0, 0xB0, 0xA0}));
  const CanFrame a = encode_value(4, 0x1234, 0x3FC00001);
  EXPECT_EQ(a.id, 0x085U);
  EXPECT_EQ(payload(a), (Bytes{0, 0x34, 0x12, 0, 0x01, 0x00, 0xC0, 0x3F}));
  EXPECT_TRUE(plain(v) && plain(e) && plain(a));
}

// ---- decoding

TEST(OdriveCodec, HeartbeatFieldsAreWhereTheTableSays) {
  for (const Version v : {Version::v0_6, Version::v0_5_6}) {
    for (int bit = 0; bit < 32; ++bit) {
      const auto h = decode_heartbeat(test::heartbeat(1, 8, 1U << bit), v);
      ASSERT_TRUE(h);
      EXPECT_EQ(h->axis_error, 1U << bit);
      EXPECT_EQ(h->axis_state, AxisState::closed_loop_control);
      EXPECT_EQ(h->component_flags, 0);
    }
    for (unsigned state = 0; state < 256; ++state) {
      const auto h = decode_heartbeat(test::heartbeat(1, static_cast<std::uint8_t>(state)), v);
      ASSERT_TRUE(h);
      EXPECT_EQ(static_cast<unsigned>(h->axis_state), state);
      EXPECT_EQ(h->axis_error, 0U);
      EXPECT_EQ(h->component_flags, 0);
    }
  }
}

/// 0.5.6: bytes 5, 6 and 7 flag motor, encoder and controller errors, bit 63 is trajectory_done.
TEST(OdriveCodec, ComponentFlagsExistIn056Only) {
  for (std::size_t at = 0; at < 3; ++at) {
    for (unsigned bit = 0; bit < 8; ++bit) {
      std::array<std::uint8_t, 3> rest{};
      rest[at] = static_cast<std::uint8_t>(1U << bit);
      const bool trajectory_done = at == 2 && bit == 7;
      const auto old = decode_heartbeat(test::heartbeat(1, 8, 0, rest), Version::v0_5_6);
      const auto now = decode_heartbeat(test::heartbeat(1, 8, 0, rest), Version::v0_6);
      ASSERT_TRUE(old && now);
      EXPECT_EQ(old->component_flags != 0, !trajectory_done) << "byte " << 5 + at << " bit " << bit;
      EXPECT_EQ(now->component_flags, 0) << "byte " << 5 + at << " bit " << bit;
      EXPECT_EQ(old->axis_error, 0U);
      EXPECT_EQ(static_cast<int>(old->axis_state), 8);
    }
  }
}

TEST(OdriveCodec, EncoderEstimatesAreTwoFloats) {
  CanFrame f;
  f.size = 8;
  const std::uint8_t data[] = {0x00, 0x00, 0xC0, 0x3F, 0xCD, 0xCC, 0xCC, 0x3D};
  std::copy(std::begin(data), std::end(data), f.data.begin());
  const auto e = decode_encoder_estimates(f);
  ASSERT_TRUE(e);
  EXPECT_EQ(e->position_rev, 1.5F);
  EXPECT_EQ(e->velocity_rev_s, 0.1F);
}

TEST(OdriveCodec, TorquesAreTargetAndEstimate) {
  const CanFrame f = test::torques(4, 1.5F, 0.1F);
  const auto t = decode_torques(f);
  ASSERT_TRUE(t);
  EXPECT_EQ(t->target, 1.5F);
  EXPECT_EQ(t->estimate, 0.1F);
  EXPECT_EQ(encode_torques(4, *t), f);
}

TEST(OdriveCodec, NumbersThatAreNoneComeThroughForTheGuardsToSee) {
  const float infinity = std::numeric_limits<float>::infinity();
  const auto e = decode_encoder_estimates(test::encoder(1, NAN, -infinity));
  ASSERT_TRUE(e);
  EXPECT_TRUE(std::isnan(e->position_rev));
  EXPECT_EQ(e->velocity_rev_s, -infinity);
}

/// Every length, and every format a controller may hand over: accepted exactly when it is a classic data
/// frame of the right length. Sizes beyond 8 are what a broken back end might report.
TEST(OdriveCodec, DriveMessagesAreAcceptedOnlyInTheirOwnLengthAndFormat) {
  for (int flags = 0; flags < 8; ++flags) {
    for (unsigned size = 0; size <= 64; ++size) {
      CanFrame f = test::heartbeat(1, 8);
      f.size = static_cast<std::uint8_t>(size);
      f.remote = (flags & 1) != 0;
      f.fd = (flags & 2) != 0;
      f.bit_rate_switch = (flags & 4) != 0;
      const bool right = size == 8 && !f.remote && !f.fd;
      EXPECT_EQ(decode_heartbeat(f, Version::v0_6).has_value(), right) << size << " flags " << flags;
      EXPECT_EQ(decode_heartbeat(f, Version::v0_5_6).has_value(), right) << size << " flags " << flags;
      EXPECT_EQ(decode_encoder_estimates(f).has_value(), right) << size << " flags " << flags;
      EXPECT_EQ(decode_torques(f).has_value(), right) << size << " flags " << flags;
      EXPECT_EQ(decode_controller_mode(f).has_value(), right) << size << " flags " << flags;
    }
  }
}

/// A real drive takes any length that holds the bytes it uses, and never FD or remote frames.
TEST(OdriveCodec, TheDriveSideNeedsTheUsedBytesInAClassicDataFrame) {
  for (int flags = 0; flags < 4; ++flags) {
    for (unsigned size = 0; size <= 8; ++size) {
      CanFrame f = test::message(1, test::cmd_torque, 0x3FC00000, 0);
      f.size = static_cast<std::uint8_t>(size);
      f.remote = (flags & 1) != 0;
      f.fd = (flags & 2) != 0;
      const bool right = size >= 4 && flags == 0;
      EXPECT_EQ(decode_torque(f).has_value(), right) << size << " flags " << flags;
      EXPECT_EQ(decode_axis_state_request(f).has_value(), right) << size << " flags " << flags;
    }
  }
}

/// What any other master sends (vendor tools, ros_odrive, everything built on the DBC): 8 bytes, 4 used.
TEST(OdriveCodec, CommandsAsOtherMastersSendThemAreUnderstoodByTheDriveSide) {
  const auto torque = decode_torque(test::message(1, test::cmd_torque, 0x3FC00000, 0));
  ASSERT_TRUE(torque);
  EXPECT_EQ(*torque, 1.5F);
  const auto state = decode_axis_state_request(test::message(1, test::cmd_axis_state, 0x04030208, 0));
  ASSERT_TRUE(state);
  EXPECT_EQ(*state, 0x04030208U);
  const auto mode = decode_controller_mode(test::message(1, test::cmd_mode, 0x0A0B0C01, 0x02000003));
  ASSERT_TRUE(mode);
  EXPECT_EQ(mode->control, 0x0A0B0C01U);
  EXPECT_EQ(mode->input, 0x02000003U);
}

TEST(OdriveCodec, TheDriveSideUnderstandsWhatTheControllerSends) {
  ASSERT_TRUE(decode_torque(encode_torque(1, -0.75F)));
  EXPECT_EQ(*decode_torque(encode_torque(1, -0.75F)), -0.75F);
  ASSERT_TRUE(decode_axis_state_request(encode_set_axis_state(1, AxisState::closed_loop_control)));
  EXPECT_EQ(*decode_axis_state_request(encode_set_axis_state(1, AxisState::closed_loop_control)), 8U);
  const auto mode = decode_controller_mode(encode_set_controller_mode(1));
  ASSERT_TRUE(mode);
  EXPECT_EQ(mode->control, 1U);
  EXPECT_EQ(mode->input, 1U);
}

}  // namespace
