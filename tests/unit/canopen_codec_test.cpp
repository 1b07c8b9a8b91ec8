/// CANopen and CiA 402 on the wire, against bytes derived by hand from the message layouts.

#include <gtest/gtest.h>

#include <bit>
#include <cstdint>
#include <vector>

#include "firmware/drive/cia402.hpp"
#include "tests/support/canopen_bytes.hpp"

namespace {

using esmc::hal::CanFrame;
using esmc::test::can;
using namespace esmc::drive::canopen;
namespace cia402 = esmc::drive::cia402;

/// The frame as another length, remote and FD: none of them is the message.
std::vector<CanFrame> spoilt(const CanFrame& f) {
  std::vector<CanFrame> out;
  for (std::uint8_t size = 0; size <= 8; ++size) {
    if (size == f.size) continue;
    out.push_back(f);
    out.back().size = size;
  }
  out.push_back(f);
  out.back().remote = true;
  out.push_back(f);
  out.back().fd = true;
  return out;
}

TEST(CanopenCodec, NetworkManagement) {
  EXPECT_EQ(encode_nmt(NmtCommand::start, 3), can(0x000, {0x01, 3}));
  EXPECT_EQ(encode_nmt(NmtCommand::stop, 127), can(0x000, {0x02, 127}));
  EXPECT_EQ(encode_nmt(NmtCommand::enter_pre_operational, 0), can(0x000, {0x80, 0}));
  EXPECT_EQ(encode_nmt(NmtCommand::reset_node, 1), can(0x000, {0x81, 1}));
  EXPECT_EQ(encode_nmt(NmtCommand::reset_communication, 1), can(0x000, {0x82, 1}));
  EXPECT_EQ(encode_sync(), can(0x080, {}));
  const auto d = decode_nmt(can(0x000, {0x81, 5}));
  ASSERT_TRUE(d);
  EXPECT_EQ(d->command, NmtCommand::reset_node);
  EXPECT_EQ(d->node, 5);
  for (const CanFrame& f : spoilt(can(0x000, {0x81, 5}))) EXPECT_FALSE(decode_nmt(f));
}

TEST(CanopenCodec, HeartbeatHasFourStatesAndNoOther) {
  EXPECT_EQ(encode_heartbeat(5, NmtState::operational), can(0x705, {0x05}));
  EXPECT_EQ(encode_heartbeat(127, NmtState::pre_operational), can(0x77F, {0x7F}));
  for (int state = 0; state < 256; ++state) {
    const auto s = decode_heartbeat(can(0x705, {state}));
    const bool exists = state == 0 || state == 4 || state == 5 || state == 0x7F;
    ASSERT_EQ(s.has_value(), exists) << state;
    if (exists) {
      EXPECT_EQ(static_cast<int>(*s), state);
    }
  }
  for (const CanFrame& f : spoilt(can(0x705, {5}))) EXPECT_FALSE(decode_heartbeat(f));
}

TEST(CanopenCodec, Emergency) {
  const CanFrame f = can(0x085, {0x30, 0x81, 0x11, 0, 0, 0, 0, 0});
  EXPECT_EQ(encode_emergency(5, {0x8130, 0x11}), f);
  const auto e = decode_emergency(f);
  ASSERT_TRUE(e);
  EXPECT_EQ(e->code, 0x8130);
  EXPECT_EQ(e->error_register, 0x11);
  for (const CanFrame& other : spoilt(f)) EXPECT_FALSE(decode_emergency(other));
}

TEST(CanopenCodec, SdoRequests) {
  EXPECT_EQ(encode_sdo_read(5, {0x6071, 0}), can(0x605, {0x40, 0x71, 0x60, 0, 0, 0, 0, 0}));
  EXPECT_EQ(encode_sdo_write(5, {0x6060, 0}, 10, 1), can(0x605, {0x2F, 0x60, 0x60, 0, 0x0A, 0, 0, 0}));
  EXPECT_EQ(encode_sdo_write(5, {0x1017, 0}, 0x1234, 2), can(0x605, {0x2B, 0x17, 0x10, 0, 0x34, 0x12, 0, 0}));
  EXPECT_EQ(encode_sdo_write(5, {0x1016, 1}, 0x007F'000A, 4),
            can(0x605, {0x23, 0x16, 0x10, 1, 0x0A, 0, 0x7F, 0}));
  EXPECT_EQ(encode_sdo_write(5, {0x6060, 0}, 0xFFFF'FF0A, 1),
            can(0x605, {0x2F, 0x60, 0x60, 0, 0x0A, 0, 0, 0}))
      << "what is not data stays zero";

  auto r = decode_sdo_request(can(0x605, {0x40, 0x71, 0x60, 2, 9, 9, 9, 9}));
  ASSERT_TRUE(r);
  EXPECT_EQ(r->kind, SdoKind::read);
  EXPECT_EQ(r->object, (Object{0x6071, 2}));
  struct Case {
    int command;
    unsigned size;
    std::uint32_t value;
  };
  for (const Case c : {Case{0x2F, 1, 0x11}, Case{0x2B, 2, 0x2211}, Case{0x27, 3, 0x33'2211},
                       Case{0x23, 4, 0x4433'2211}, Case{0x22, 0, 0x4433'2211}}) {
    r = decode_sdo_request(can(0x605, {c.command, 0x71, 0x60, 0, 0x11, 0x22, 0x33, 0x44}));
    ASSERT_TRUE(r);
    EXPECT_EQ(r->kind, SdoKind::write) << c.command;
    EXPECT_EQ(r->size, c.size);
    EXPECT_EQ(r->value, c.value);
  }
  r = decode_sdo_request(can(0x605, {0x80, 0x71, 0x60, 0, 0x00, 0x00, 0x04, 0x05}));
  EXPECT_EQ(r->kind, SdoKind::abort);
  EXPECT_EQ(r->value, 0x0504'0000U);
  for (const int command : {0x00, 0x21, 0x20, 0x41, 0x60, 0xA0, 0xC2, 0xFF}) {
    EXPECT_EQ(decode_sdo_request(can(0x605, {command, 0, 0, 0, 0, 0, 0, 0}))->kind, SdoKind::other)
        << command;
  }
  for (const CanFrame& f : spoilt(encode_sdo_read(5, {0x6071, 0}))) EXPECT_FALSE(decode_sdo_request(f));
}

TEST(CanopenCodec, SdoReplies) {
  EXPECT_EQ(encode_sdo_value(5, {0x6060, 0}, 10, 1), can(0x585, {0x4F, 0x60, 0x60, 0, 0x0A, 0, 0, 0}));
  EXPECT_EQ(encode_sdo_value(5, {0x1017, 0}, 0x1234, 2), can(0x585, {0x4B, 0x17, 0x10, 0, 0x34, 0x12, 0, 0}));
  EXPECT_EQ(encode_sdo_value(5, {0x6076, 0}, 0x0102'0304, 4), can(0x585, {0x43, 0x76, 0x60, 0, 4, 3, 2, 1}));
  EXPECT_EQ(encode_sdo_written(5, {0x1A00, 3}), can(0x585, {0x60, 0x00, 0x1A, 3, 0, 0, 0, 0}));
  EXPECT_EQ(encode_sdo_abort(5, {0x6071, 0}, abort_no_object),
            can(0x585, {0x80, 0x71, 0x60, 0, 0, 0, 0x02, 0x06}));
  auto r = decode_sdo_reply(can(0x585, {0x60, 0x00, 0x1A, 3, 9, 9, 9, 9}));
  ASSERT_TRUE(r);
  EXPECT_EQ(r->kind, SdoKind::written);
  EXPECT_EQ(r->object, (Object{0x1A00, 3}));
  struct Case {
    int command;
    unsigned size;
    std::uint32_t value;
  };
  for (const Case c : {Case{0x4F, 1, 0x11}, Case{0x4B, 2, 0x2211}, Case{0x47, 3, 0x33'2211},
                       Case{0x43, 4, 0x4433'2211}, Case{0x42, 0, 0x4433'2211}}) {
    r = decode_sdo_reply(can(0x585, {c.command, 0x71, 0x60, 0, 0x11, 0x22, 0x33, 0x44}));
    ASSERT_TRUE(r);
    EXPECT_EQ(r->kind, SdoKind::value) << c.command;
    EXPECT_EQ(r->size, c.size);
    EXPECT_EQ(r->value, c.value);
  }
  r = decode_sdo_reply(can(0x585, {0x80, 0x71, 0x60, 0, 0x11, 0x00, 0x09, 0x06}));
  EXPECT_EQ(r->kind, SdoKind::abort);
  EXPECT_EQ(r->value, abort_no_sub_index);
  for (const int command : {0x00, 0x41, 0x40, 0x20, 0xA0, 0xFF}) {
    EXPECT_EQ(decode_sdo_reply(can(0x585, {command, 0, 0, 0, 0, 0, 0, 0}))->kind, SdoKind::other) << command;
  }
  for (const CanFrame& f : spoilt(encode_sdo_written(5, {0x6071, 0}))) EXPECT_FALSE(decode_sdo_reply(f));
}

/// No byte but its own is read or written: while compiling, a shift or an index too far is an error.
constexpr CanFrame reply_sdo(int command) {
  return {.id = 0x585,
          .size = 8,
          .data = {static_cast<std::uint8_t>(command), 0x71, 0x60, 2, 0x11, 0x00, 0x09, 0x06}};
}
static_assert(encode_sdo_abort(5, {0x6071, 2}, 0x0609'0011) == reply_sdo(0x80));
static_assert(decode_sdo_reply(reply_sdo(0x80))->value == 0x0609'0011);
static_assert(decode_sdo_request(reply_sdo(0x80))->value == 0x0609'0011);
static_assert(decode_sdo_reply(reply_sdo(0x42))->value == 0x0609'0011);
static_assert(cia402::decode_report({.id = 0x183, .size = 8, .data = {1, 2, 3, 4, 5, 6, 7, 8}})->position ==
              0x0605'0403);

TEST(CanopenCodec, WhatHasNoValueHasNoneAndAnAbortHasFourBytes) {
  for (const int command : {0x40, 0x60, 0xA0}) {
    for (const auto& s : {decode_sdo_request(reply_sdo(command)), decode_sdo_reply(reply_sdo(command))}) {
      ASSERT_TRUE(s);
      EXPECT_EQ(s->value, 0U);
      EXPECT_EQ(s->size, 0);
    }
  }
  EXPECT_EQ(decode_sdo_request(reply_sdo(0x80))->size, 4);
  EXPECT_EQ(decode_sdo_reply(reply_sdo(0x80))->size, 4);
  EXPECT_EQ(Object{}, (Object{0, 0}));
}

TEST(Cia402Codec, ProcessData) {
  EXPECT_EQ(cia402::encode_command(3, {0x0F, 1000}), can(0x203, {0x0F, 0x00, 0xE8, 0x03}));
  EXPECT_EQ(cia402::encode_command(127, {0x80, -32768}), can(0x27F, {0x80, 0x00, 0x00, 0x80}));
  const auto r = cia402::decode_report(can(0x183, {0x37, 0x12, 0xFE, 0xFF, 0xFF, 0xFF, 0x18, 0xFC}));
  ASSERT_TRUE(r);
  EXPECT_EQ(r->status, 0x1237);
  EXPECT_EQ(r->position, -2);
  EXPECT_EQ(r->torque, -1000);
  const auto m = cia402::decode_motion(can(0x283, {0x00, 0x00, 0x00, 0x80, 0xFF}));
  ASSERT_TRUE(m);
  EXPECT_EQ(m->velocity, -2147483647 - 1);
  EXPECT_EQ(m->mode, -1);
  for (const CanFrame& f : spoilt(can(0x183, {0, 0, 0, 0, 0, 0, 0, 0})))
    EXPECT_FALSE(cia402::decode_report(f));
  for (const CanFrame& f : spoilt(can(0x283, {0, 0, 0, 0, 0}))) EXPECT_FALSE(cia402::decode_motion(f));
  EXPECT_EQ(cia402::mapped({0x6064, 0}, 32), 0x6064'0020U);
  EXPECT_EQ(cia402::mapped({0x1234, 0x56}, 0x78), 0x1234'5678U);
  EXPECT_EQ(cia402::encode_command(3, {0x1234, 0x5678}), can(0x203, {0x34, 0x12, 0x78, 0x56}));
}

}  // namespace
