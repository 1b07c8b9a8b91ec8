/// Every wire format by itself, without state: what is accepted is written again as it was read, and read as
/// the tests' own layouts read it. Small inputs, many executions.

#include <array>
#include <cmath>

#include "firmware/drive/cia402.hpp"
#include "firmware/drive/mit.hpp"
#include "firmware/drive/odrive.hpp"
#include "firmware/link/codec.hpp"
#include "tests/fuzz/bytes.hpp"
#include "tests/support/canopen_bytes.hpp"
#include "tests/support/link_bytes.hpp"
#include "tests/support/mit_bytes.hpp"
#include "tests/support/odrive_bytes.hpp"

namespace {

using namespace esmc;
using fuzz::require;
using hal::CanFrame;
using test::entry;
using test::little;

constexpr unsigned node = 3;
constexpr std::array<float, 8> half_widths{12.5F, 50.0F, 18.0F, 0.5F, 95.5F, 1e4F, 1e-3F, 6.2831853F};

/// Codes and values of any width of range, and frames as the digits of one number.
void mit(fuzz::Bytes& in) {
  const float range = half_widths[in.below(8)];
  const std::uint16_t c16 = in.u16(), c12 = in.u16() & 0xFFF;
  using drive::mit::code;
  using drive::mit::value;
  require(code(value(c16, range, 0xFFFF), range, 0xFFFF) == c16, "a code of 16 bits comes back");
  require(code(value(c12, range, 0xFFF), range, 0xFFF) == c12, "a code of 12 bits comes back");
  const float v = in.f32();
  const std::uint16_t c = code(v, range, 0xFFF);
  require(c <= 0xFFF, "a code fits its field");
  const double w = static_cast<double>(range), back = (2.0 * c - 4095) / 4095 * w;
  if (std::isnan(v)) {
    require(c == 0x800, "no number: the middle");
  } else {
    const double wanted = std::fmin(std::fmax(static_cast<double>(v), -w), w);
    require(std::fabs(back - wanted) <= w / 4095 * 1.001, "the nearest code");
  }
  require(code(v, in.f32(), 0xFFF) <= 0xFFF, "whatever the range, a code fits its field");
  const auto cmd = drive::mit::encode_command(3, {c16, c12, c, 0x5A5, 0xA5A});
  require(cmd == test::mit_command(3, c16, c12, c, 0x5A5, 0xA5A), "a command, digit by digit");
  const auto d = drive::mit::decode_command(cmd);
  require(d.position == c16 && d.velocity == c12 && d.kp == c && d.kd == 0x5A5 && d.torque == 0xA5A,
          "a command comes back");
}

/// Whatever bytes arrive: what is accepted is written again as it was read.
void canopen(fuzz::Bytes& in) {
  namespace co = drive::canopen;
  const CanFrame f = in.frame(0x580 + node);
  const bool eight = f.size == 8 && !f.remote && !f.fd;
  const auto reply = co::decode_sdo_reply(f);
  require(reply.has_value() == eight, "an SDO reply has eight bytes");
  if (reply) {
    const unsigned command = f.data[0];
    require(entry(reply->object.index, reply->object.sub) == entry(f.data[1] + 256U * f.data[2], f.data[3]),
            "object");
    CanFrame again = f;
    std::size_t n = 8;
    if (reply->kind == co::SdoKind::written) again = co::encode_sdo_written(node, reply->object), n = 4;
    if (reply->kind == co::SdoKind::abort) again = co::encode_sdo_abort(node, reply->object, reply->value);
    if (reply->kind == co::SdoKind::value && reply->size > 0) {
      again = co::encode_sdo_value(node, reply->object, reply->value, reply->size);
      n = 4U + reply->size;
    }
    if (reply->kind == co::SdoKind::value)
      require(command / 32 == 2 && (command & 2U) != 0, "expedited upload");
    require(fuzz::same_bytes(again, f, n), "an SDO reply is written as it is read");
  }
  const auto request = co::decode_sdo_request(f);
  require(request.has_value() == eight, "an SDO request has eight bytes");
  if (request && request->kind == co::SdoKind::write && request->size > 0) {
    const auto again = co::encode_sdo_write(node, request->object, request->value, request->size);
    require(fuzz::same_bytes(again, f, 4U + request->size), "an SDO write is written as it is read");
  }
  if (const auto e = co::decode_emergency(f)) {
    require(eight && fuzz::same_bytes(co::encode_emergency(node, *e), f, 3),
            "an emergency is written as it is read");
  }
  if (const auto h = co::decode_heartbeat(f)) {
    require(f.size == 1 && co::encode_heartbeat(node, *h).data[0] == f.data[0],
            "a heartbeat is written as it is read");
  }
  if (const auto n = co::decode_nmt(f)) {
    require(f.size == 2 && fuzz::same_bytes(co::encode_nmt(n->command, n->node), f, 2),
            "NMT is written as it is read");
  }
  if (const auto r = drive::cia402::decode_report(f)) {
    require(test::report_of(node, r->status, r->position, r->torque).data == f.data || !eight || f.size != 8,
            "TPDO1");
  }
  if (const auto m = drive::cia402::decode_motion(f)) {
    require(f.size == 5 && m->velocity == static_cast<std::int32_t>(little(f, 0, 4)) &&
                static_cast<std::uint8_t>(m->mode) == f.data[4],
            "TPDO2");
  }
}

void odrive(fuzz::Bytes& in) {
  namespace od = drive::odrive;
  const bool newer = in.yes();
  const CanFrame f = in.frame(node * 32U + in.below(32));
  const bool eight = f.size == 8 && !f.remote && !f.fd, data = !f.remote && !f.fd;
  const auto h = od::decode_heartbeat(f, newer ? od::Version::v0_6 : od::Version::v0_5_6);
  require(h.has_value() == eight, "a heartbeat has eight bytes");
  if (h) {
    require(h->axis_error == test::word(f, 0) &&
                fuzz::same_bytes(od::encode_heartbeat(node, h->axis_error, h->axis_state), f, 5),
            "a heartbeat is written as it is read");
    require(
        (h->component_flags != 0) == (!newer && (f.data[5] != 0 || f.data[6] != 0 || f.data[7] % 128 != 0)),
        "flags of components");
  }
  const auto e = od::decode_encoder_estimates(f);
  require(e.has_value() == eight, "a sample has eight bytes");
  if (e)
    require(fuzz::same_bytes(od::encode_encoder_estimates(node, e->position_rev, e->velocity_rev_s), f, 8),
            "a sample comes back");
  const auto both = od::decode_torques(f);
  require(both.has_value() == eight, "two torques have eight bytes");
  if (both) require(fuzz::same_bytes(od::encode_torques(node, *both), f, 8), "torques come back");
  if (const auto t = od::decode_torque(f)) {
    require(data && f.size >= 4 && fuzz::same_bytes(od::encode_torque(node, *t), f, 4),
            "a torque is written as it is read");
  }
  if (const auto s = od::decode_axis_state_request(f))
    require(data && f.size >= 4 && *s == test::word(f, 0), "a state comes back");
  if (const auto m = od::decode_controller_mode(f))
    require(eight && m->control == test::word(f, 0) && m->input == test::word(f, 4), "modes");
  if (const auto v = od::decode_version(f))
    require(eight && fuzz::same_bytes(od::encode_version(node, *v),
                                      test::message(node, 0, 2, test::word(f, 4) & 0xFFFFFFU), 8),
            "a version");
  require(od::endpoint_of(f) == f.data[1] + 256U * f.data[2], "an endpoint");
  const auto type = static_cast<od::ValueType>(in.below(3));
  const auto value = od::decode_value(f, type);
  require(value.has_value() == (data && f.size >= (type == od::ValueType::u8 ? 5 : 8)),
          "a value is as long as its type");
  if (!value) return;
  if (type == od::ValueType::u8) require(*value == static_cast<float>(f.data[4]), "a byte");
  if (type == od::ValueType::u32)
    require(std::fabs(static_cast<double>(*value) - test::word(f, 4)) <= 128,
            "a whole number, rounded to float");
  if (type == od::ValueType::f32)
    require(std::bit_cast<std::uint32_t>(*value) == test::word(f, 4), "a float, bit by bit");
}

/// Two's complement of 24 bits, by arithmetic.
double number24(const CanFrame& f, std::size_t at) {
  const double v = f.data[at] + 256.0 * f.data[at + 1] + 65536.0 * f.data[at + 2];
  return v < 8388608 ? v : v - 16777216;
}
void command_link(fuzz::Bytes& in) {
  const CanFrame f = in.frame(0x780 + in.below(6));
  if (const auto c = link::decode_command(f)) {
    require(f.data[1] < 16 && (f.data[2] < 12 || f.data[2] == 19 || f.data[2] == 20),
            "an order that there is");
    require(static_cast<unsigned>(c->order) == f.data[2] && c->percent == f.data[3] &&
                c->tick == little(f, 4, 2) && c->parameters == little(f, 6, 2),
            "an order");
  }
  if (const auto p = link::decode_pair(f, link::position_unit)) {
    require(f.data[1] < 32 && static_cast<unsigned>(p->space) == f.data[1] / 16U, "a space that there is");
    for (std::size_t i = 0; i < 2; ++i) {
      const double wanted = number24(f, 2 + 3 * i) * 1e-6;
      require(std::fabs(static_cast<double>(p->value[i]) - wanted) <= 2e-7 * std::fabs(wanted),
              "micrometres or microradians");
    }
  }
  if (const auto w = link::decode_parameter_write(f)) {
    require(
        f.data[3] == 0 && w->index == f.data[2] && std::bit_cast<std::uint32_t>(w->value) == little(f, 4, 4),
        "a value, bit by bit");
  }
  if (const auto r = link::decode_request(f))
    require(f.data[2] < 4 && r->index == f.data[3] && little(f, 4, 4) == 0, "a request");
  const link::Status s{static_cast<State>(in.below(state_count)),
                       static_cast<Fault>(in.below(fault_count)),
                       static_cast<link::Reacted>(in.below(3)),
                       static_cast<link::Source>(in.below(3)),
                       in.yes(),
                       in.u32(),
                       in.u8()};
  const unsigned counter = in.u8();
  const CanFrame out = link::encode_status(0x780, s, static_cast<std::uint8_t>(counter));
  require(out.id == 0x790 && out.size == 8 &&
              out.data[1] == counter % 16 + 16 * static_cast<unsigned>(s.state) &&
              out.data[2] == static_cast<unsigned>(s.fault) && little(out, 4, 3) == s.tick % 0x1000000U &&
              out.data[7] == s.session,
          "Status");
  require(link::intact(out, s.session), "Status has its checksum");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  fuzz::Bytes in(data, size);
  in.one_of(
      4, [&] { odrive(in); }, [&] { canopen(in); }, [&] { mit(in); }, [&] { command_link(in); });
  return 0;
}
