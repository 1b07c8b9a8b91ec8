/// Every message of the command interface, to the byte: bytes from docs/command-interface.md and
/// docs/esmc.dbc.

#include "firmware/link/codec.hpp"

#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace {

using namespace esmc;
using namespace esmc::link;
using Bytes = std::vector<unsigned>;

constexpr std::uint32_t base = 0x720;

/// Bytes of a frame of the block; empty unless it is a classic data frame of eight bytes with this
/// identifier.
Bytes bytes_of(const hal::CanFrame& f, std::uint32_t id) {
  if (f.id != id || f.size != 8 || f.extended || f.remote || f.fd) return {};
  return {f.data.begin(), f.data.begin() + 8};
}
hal::CanFrame frame_of(const Bytes& bytes, std::uint32_t id = base) {
  hal::CanFrame f;
  f.id = id;
  f.size = 8;
  for (std::size_t i = 0; i < 8; ++i) f.data[i] = static_cast<std::uint8_t>(bytes.at(i));
  return f;
}

TEST(LinkCodec, Orders) {
  const auto order = [](unsigned tag, unsigned what, unsigned reserved) {
    return decode_command(frame_of({0, tag, what, reserved, 0x34, 0x12, 0x78, 0x56}));
  };
  ASSERT_TRUE(order(0x0F, 10, 0));
  EXPECT_EQ(order(0x0F, 10, 0)->order, Order::forget);
  EXPECT_EQ(order(0, 0, 0)->order, Order::none);
  EXPECT_EQ(order(0, 1, 0)->tick, 0x1234);
  EXPECT_EQ(order(0, 1, 0)->parameters, 0x5678);
  EXPECT_FALSE(order(0x10, 1, 0));
  EXPECT_EQ(order(0, 11, 0)->order, Order::home);
  EXPECT_FALSE(order(0, 12, 0));
  EXPECT_EQ(order(0, 19, 100)->percent, 100) << "override";
  EXPECT_FALSE(order(0, 19, 101));
  EXPECT_FALSE(order(0, 20, 1)) << "no other order has a percentage";
  EXPECT_TRUE(order(0, 20, 0));
  EXPECT_FALSE(order(0, 18, 0));
  EXPECT_FALSE(order(0, 21, 0));
  const CommandFrame none;
  EXPECT_TRUE(none.order == Order::none && none.tick == 0 && none.parameters == 0);
}

TEST(LinkCodec, PairsAreSignedNumbersOf24Bits) {
  const auto pair = [](unsigned tag, float unit) {
    return decode_pair(frame_of({0, tag, 0x40, 0x42, 0x0F, 0xFF, 0xFF, 0x7F}), unit);
  };
  ASSERT_TRUE(pair(0x05, position_unit));
  EXPECT_EQ(pair(0x05, position_unit)->space, Space::effector);
  EXPECT_FLOAT_EQ(pair(0, position_unit)->value[0], 1.0F);
  EXPECT_FLOAT_EQ(pair(0, position_unit)->value[1], 8.388607F);
  EXPECT_FLOAT_EQ(pair(0, velocity_unit)->value[0], 10.0F);
  EXPECT_EQ(pair(0x1F, position_unit)->space, Space::base_joints);
  EXPECT_FALSE(pair(0x20, position_unit));
  EXPECT_FALSE(pair(0x80, position_unit));
  const auto low = decode_pair(frame_of({0, 0, 0xFF, 0xFF, 0xFF, 0x00, 0x00, 0x80}), position_unit);
  EXPECT_FLOAT_EQ(low->value[0], -1e-6F);
  EXPECT_FLOAT_EQ(low->value[1], -8.388608F);
  const Pair none;
  EXPECT_TRUE(none.space == Space::effector && none.value[0] == 0.0F && none.value[1] == 0.0F);
}

TEST(LinkCodec, WritesAndQuestions) {
  const auto write = [](unsigned tag, unsigned reserved) {
    return decode_parameter_write(frame_of({0, tag, 11, reserved, 0x00, 0x00, 0x20, 0x41}));
  };
  ASSERT_TRUE(write(0x0F, 0));
  EXPECT_EQ(write(0, 0)->index, 11);
  EXPECT_EQ(write(0, 0)->value, 10.0F);
  EXPECT_FALSE(write(0x10, 0));
  EXPECT_FALSE(write(0, 1));
  const ParameterWrite nothing;
  EXPECT_TRUE(nothing.index == 0 && nothing.value == 0.0F);

  const auto ask = [](unsigned tag, unsigned subject, const Bytes& rest) {
    return decode_request(frame_of({0, tag, subject, 9, rest[0], rest[1], rest[2], rest[3]}));
  };
  ASSERT_TRUE(ask(0x0F, 2, {0, 0, 0, 0}));
  EXPECT_EQ(ask(0, 2, {0, 0, 0, 0})->subject, Subject::table);
  EXPECT_EQ(ask(0, 1, {0, 0, 0, 0})->index, 9);
  EXPECT_FALSE(ask(0x10, 1, {0, 0, 0, 0}));
  EXPECT_EQ(ask(0, 3, {0, 0, 0, 0})->subject, Subject::capture);
  EXPECT_FALSE(ask(0, 4, {0, 0, 0, 0}));
  for (std::size_t i = 0; i < 4; ++i) {
    Bytes rest(4, 0);
    rest[i] = 1;
    EXPECT_FALSE(ask(0, 1, rest)) << i;
  }
  const RequestFrame question;
  EXPECT_TRUE(question.subject == Subject::faults && question.index == 0);
}

TEST(LinkCodec, StatusSaysAllOfTheState) {
  Status s{State::halting, Fault::drive_error, Reacted::halt, Source::stream, true, 0xA1B2C3D4U, 0x5A};
  const Bytes b = bytes_of(encode_status(base, s, 0x37), base + 0x10);
  ASSERT_EQ(b.size(), 8U);
  EXPECT_EQ(b[1], 0x47U) << "counter 7, state 4";
  EXPECT_EQ(b[2], static_cast<unsigned>(Fault::drive_error));
  EXPECT_EQ(b[3], 2U | (2U << 2U) | 0x10U);
  EXPECT_EQ(Bytes(b.begin() + 4, b.end()), (Bytes{0xD4, 0xC3, 0xB2, 0x5A}));
  EXPECT_TRUE(intact(encode_status(base, s, 0x37), 0x5A));
  EXPECT_FALSE(intact(encode_status(base, s, 0x37), 0x5B));
  s.pace = Pace::held;
  EXPECT_EQ(bytes_of(encode_status(base, s, 0x37), base + 0x10)[3], 2U | (2U << 2U) | 0x10U | (2U << 6U));
  s.zero_unknown = true;
  EXPECT_EQ(bytes_of(encode_status(base, s, 0x37), base + 0x10)[3],
            2U | (2U << 2U) | 0x10U | 0x20U | (2U << 6U));
  s.zero_unknown = false;
  s.pace = Pace::full;
  s.streaming = false;
  s.source = Source::reference;
  s.reaction = Reacted::zero_torque;
  EXPECT_EQ(bytes_of(encode_status(base, s, 0), base + 0x10)[3], 1U | (1U << 2U));
  for (unsigned counter = 0; counter < 16; ++counter)
    EXPECT_EQ(bytes_of(encode_status(base, s, static_cast<std::uint8_t>(counter)), base + 0x10)[1],
              0x40U + counter);
  const Status at_power_up;
  EXPECT_EQ(bytes_of(encode_status(base, at_power_up, 0), base + 0x10)[1], 0U);
  EXPECT_TRUE(at_power_up.fault == Fault::none && at_power_up.reaction == Reacted::none &&
              at_power_up.source == Source::reference && !at_power_up.streaming && at_power_up.tick == 0 &&
              at_power_up.session == 1 && at_power_up.pace == Pace::full);
}

TEST(LinkCodec, FaultsAreTwoFrames) {
  const FaultRecord r{Fault::bus_off, 3, 0x0201, 0x06050403U, 0x0D0C0B0AU};
  const auto fault = static_cast<unsigned>(Fault::bus_off);
  EXPECT_EQ(bytes_of(encode_fault_record(base, r), base + 0x11), (Bytes{fault, 3, 1, 2, 3, 4, 5, 6}));
  EXPECT_EQ(bytes_of(encode_fault_detail(base, r), base + 0x12),
            (Bytes{fault, 3, 0, 0, 0x0A, 0x0B, 0x0C, 0x0D}));
  const FaultRecord end;
  EXPECT_EQ(bytes_of(encode_fault_record(base, end), base + 0x11), (Bytes{0, 255, 0, 0, 0, 0, 0, 0}));
  EXPECT_EQ(end.drive_error, 0U);
}

TEST(LinkCodec, ParametersAndTheirTable) {
  EXPECT_EQ(bytes_of(encode_parameter_value(base, 7, Answer::out_of_bounds, true, 10.0F), base + 0x13),
            (Bytes{7, 3, 1, 0, 0x00, 0x00, 0x20, 0x41}));
  EXPECT_EQ(bytes_of(encode_parameter_value(base, 7, Answer::ok, false, 10.0F), base + 0x13)[2], 0U);
  EXPECT_EQ(bytes_of(encode_parameter_table(base, 0x04030201U, 12), base + 0x14),
            (Bytes{1, 2, 3, 4, 12, 0, 0, 0}));
  EXPECT_EQ(bytes_of(encode_parameter_slots(base, {StoreState::forgetting,
                                                   2,
                                                   {SlotContent::damaged, SlotContent::out_of_bounds},
                                                   0x04030201U}),
                     base + 0x1D),
            (Bytes{4, 2, 2, 5, 1, 2, 3, 4}));
  const StoreStatus none;
  EXPECT_EQ(bytes_of(encode_parameter_slots(base, none), base + 0x1D), Bytes(8, 0));
}

TEST(LinkCodec, CountersAndFloats) {
  EXPECT_EQ(bytes_of(encode_counters(base, {0x0201, 0x0403, 0x0605, 0x0807}), base + 0x15),
            (Bytes{1, 2, 3, 4, 5, 6, 7, 8}));
  EXPECT_EQ(bytes_of(encode_counters(base, {}), base + 0x15), Bytes(8, 0));
  EXPECT_EQ(bytes_of(encode_floats(base, 0x1A, 10.0F, -2.0F), base + 0x1A),
            (Bytes{0x00, 0x00, 0x20, 0x41, 0x00, 0x00, 0x00, 0xC0}));
}

TEST(LinkCodec, IdentityIsCheckedWhole) {
  EXPECT_EQ(encode_identity(base, 1, true).data[5], 1);
  const hal::CanFrame f = encode_identity(base, 0x04030201U, false);
  EXPECT_EQ(bytes_of(f, base + 0x1C), (Bytes{1, 2, 3, 4, 1, 0, 0, 0}));
  EXPECT_EQ(decode_identity(f, base)->scene, 0x04030201U);
  EXPECT_FALSE(decode_identity(f, base + 32));
  for (int kind = 0; kind < 5; ++kind) {
    hal::CanFrame g = f;
    if (kind == 0) g.id += 1;
    if (kind == 1) g.extended = true;
    if (kind == 2) g.remote = true;
    if (kind == 3) g.fd = true;
    if (kind == 4) g.size = 7;
    EXPECT_FALSE(decode_identity(g, base)) << kind;
  }
}

/// The checksum itself has the values of the catalogue, in link_test; here: over identifier, session, bytes 1
/// to 7. frame.
TEST(LinkCodec, TheChecksumCoversIdentifierSessionAndBytes) {
  hal::CanFrame f = frame_of({0, 1, 2, 3, 4, 5, 6, 7}, 0x7A5);
  const std::uint8_t good = checksum(f, 9);
  f.data[0] = good;
  EXPECT_TRUE(intact(f, 9));
  EXPECT_FALSE(intact(f, 10));
  for (std::size_t i = 0; i < 8; ++i) {
    hal::CanFrame g = f;
    g.data[i] ^= 1U;
    EXPECT_FALSE(intact(g, 9)) << i;
  }
  for (const std::uint32_t flip : {1U, 0x100U}) {
    hal::CanFrame g = f;
    g.id ^= flip;
    EXPECT_FALSE(intact(g, 9));
  }
  EXPECT_EQ(counter_of(frame_of({0, 0xAB, 0, 0, 0, 0, 0, 0})), 0x0B);
}

TEST(LinkCodec, NamesOfTheStore) {
  const std::vector<std::string> states{"none",       "idle",      "storing", "stored",
                                        "forgetting", "forgotten", "failed"};
  for (std::size_t i = 0; i < states.size(); ++i) EXPECT_EQ(name(static_cast<StoreState>(i)), states[i]);
  const std::vector<std::string> contents{"empty",        "valid",       "damaged",
                                          "other_format", "other_scene", "out_of_bounds"};
  for (std::size_t i = 0; i < contents.size(); ++i) EXPECT_EQ(name(static_cast<SlotContent>(i)), contents[i]);
}

}  // namespace
