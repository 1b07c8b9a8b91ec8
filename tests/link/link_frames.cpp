/// The firmware's codec of the command interface for tests in another language.
///
///   link_frames encode     frames from the controller, one line each: MESSAGE ID HEX SIGNAL=VALUE...
///   link_frames decode     reads frames to the controller, ID HEX, and prints INTACT SIGNAL=VALUE...
///   link_frames tables     names of enumerators: TABLE NUMBER NAME

#include <cinttypes>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <initializer_list>
#include <string>
#include <utility>

#include "firmware/link/command_link.hpp"

namespace {

using namespace esmc;
using namespace esmc::link;

constexpr std::uint32_t base = 0x780;

/// Every value of an enumeration that has a name.
template <class E>
void table(const char* title) {
  for (int i = 0; i < 256; ++i) {
    const char* w = name(static_cast<E>(i));
    if (std::strcmp(w, "unknown") == 0) return;
    std::printf("%s %d %s\n", title, i, w);
  }
}

using Signals = std::initializer_list<std::pair<const char*, double>>;

void print(const char* message, const hal::CanFrame& f, const Signals& signals) {
  std::printf("%s %" PRIu32 " ", message, f.id);
  for (unsigned i = 0; i < f.size; ++i) std::printf("%02x", f.data[i]);
  for (const auto& [signal, value] : signals) std::printf(" %s=%.17g", signal, value);
  std::printf("\n");
}
double number(auto v) { return static_cast<double>(v); }

void encode() {
  for (unsigned i = 0; i < 40; ++i) {
    const Status s{static_cast<State>(i % state_count),
                   static_cast<Fault>(i % fault_count),
                   static_cast<Reacted>(i % 3),
                   static_cast<Source>(i / 3 % 3),
                   i % 2 == 1,
                   i * 0x0123'4567U,
                   static_cast<std::uint8_t>(1 + 6 * i),
                   static_cast<Pace>(i / 5 % 3),
                   i / 2 % 2 == 1};
    const hal::CanFrame f = encode_status(base, s, static_cast<std::uint8_t>(i));
    print("Status", f,
          {{"Crc", number(f.data[0])},
           {"Counter", number(i % 16)},
           {"State", number(s.state)},
           {"Fault", number(s.fault)},
           {"Reaction", number(s.reaction)},
           {"Source", number(s.source)},
           {"Streaming", number(s.streaming)},
           {"Pace", number(s.pace)},
           {"Zero_Unknown", number(s.zero_unknown)},
           {"Tick", number(s.tick % (1U << 24U))},
           {"Session", number(s.session)}});
    const FaultRecord r{s.fault, static_cast<std::uint8_t>(255 - 6 * i), static_cast<std::uint16_t>(1639 * i),
                        i * 0x0678'9ABCU, ~(i * 0x0654'3210U)};
    print("Fault_Record", encode_fault_record(base, r),
          {{"Fault", number(r.fault)},
           {"Axis", number(r.axis)},
           {"Count", number(r.count)},
           {"Time", number(r.time_us)}});
    print("Fault_Detail", encode_fault_detail(base, r),
          {{"Fault", number(r.fault)}, {"Axis", number(r.axis)}, {"Drive_Error", number(r.drive_error)}});
    const float x = (static_cast<float>(i) - 17.5F) * 1.37e3F, y = 1.0F / (static_cast<float>(i) - 9.3F);
    const auto index = static_cast<std::uint8_t>(i % parameter_count);
    print("Parameter_Value", encode_parameter_value(base, index, static_cast<Answer>(i % 5), i % 3 == 0, x),
          {{"Index", number(index)},
           {"Answer", number(i % 5)},
           {"Writable", i % 3 == 0 ? 1.0 : 0.0},
           {"Value", number(x)}});
    print("Parameter_Table", encode_parameter_table(base, r.drive_error, static_cast<std::uint8_t>(6 * i)),
          {{"Crc32", number(r.drive_error)}, {"Count", number(6 * i)}});
    print("Identity", encode_identity(base, ~r.drive_error, i % 2 == 0),
          {{"Scene", number(~r.drive_error)},
           {"Version", number(protocol_version)},
           {"Unattended", i % 2 == 0 ? 1.0 : 0.0}});
    const CapturePart part{static_cast<std::uint8_t>(6 * i), 0, 1, 2, 3, 255};
    print("Capture", encode_capture(base, static_cast<std::uint16_t>(1640 * i + 3), part),
          {{"Part", number(3)}, {"Record", number(410 * i)}, {"Bytes", number(6 * i + 0xFF03'0201'0000)}});
    const StoreStatus t{static_cast<StoreState>(i % 7),
                        static_cast<std::uint8_t>(i % 3),
                        {static_cast<SlotContent>(i % 6), static_cast<SlotContent>((i + 2) / 3 % 6)},
                        ~r.drive_error};
    print("Parameter_Slots", encode_parameter_slots(base, t),
          {{"Store", number(t.state)},
           {"Used", number(t.used)},
           {"Slot_1", number(t.slots[0])},
           {"Slot_2", number(t.slots[1])},
           {"Sequence", number(t.sequence)}});
    const Counters c{static_cast<std::uint16_t>(1680 * i), static_cast<std::uint16_t>(65535 - i),
                     static_cast<std::uint16_t>(i), static_cast<std::uint16_t>(256 * i)};
    print("Link_Counters", encode_counters(base, c),
          {{"Obeyed", number(c.obeyed)},
           {"Bad_Crc", number(c.bad_crc)},
           {"Bad_Counter", number(c.bad_counter)},
           {"Refused", number(c.refused)}});
    const auto floats = [&](const char* message, Message m, unsigned more, const char* a, const char* b) {
      print(message, encode_floats(base, static_cast<std::uint8_t>(static_cast<unsigned>(m) + more), x, y),
            {{a, number(x)}, {b, number(y)}});
    };
    floats("Effector", Message::effector, 0, "X", "Y");
    floats("Tracking_Error", Message::tracking_error, 0, "X", "Y");
    floats("Joint_1", Message::joint_1, 0, "Angle", "Torque");
    floats("Joint_2", Message::joint_1, 1, "Angle", "Torque");
    floats("Joint_3", Message::joint_1, 2, "Angle", "Torque");
    floats("Joint_4", Message::joint_1, 3, "Angle", "Torque");
  }
}

void say(const char* signal, double value) { std::printf(" %s=%.17g", signal, value); }

void decode(const hal::CanFrame& f, std::uint8_t session) {
  std::printf("%d Crc=%d Counter=%d", intact(f, session) ? 1 : 0, f.data[0], counter_of(f));
  const auto pair = [&](float unit, const char* a, const char* b) {
    if (const auto p = decode_pair(f, unit)) {
      say("Space", number(p->space));
      say(a, number(p->value[0]));
      say(b, number(p->value[1]));
    }
  };
  switch (static_cast<Message>(f.id - base)) {
    case Message::command:
      if (const auto c = decode_command(f)) {
        say("Order", number(c->order));
        say("Percent", number(c->percent));
        say("Tick", number(c->tick));
        say("Parameters", number(c->parameters));
      }
      break;
    case Message::set_point:
    case Message::stream_position:
      pair(position_unit, "Position_1", "Position_2");
      break;
    case Message::stream_velocity:
      pair(velocity_unit, "Velocity_1", "Velocity_2");
      break;
    case Message::parameter_write:
      if (const auto w = decode_parameter_write(f)) {
        say("Index", number(w->index));
        say("Value", number(w->value));
      }
      break;
    case Message::request:
      if (const auto r = decode_request(f)) {
        say("Subject", number(r->subject));
        say("Index", number(r->index));
      }
      break;
    default:
      std::printf(" not to the controller");
      break;
  }
  std::printf("\n");
}

}  // namespace

int main(int argc, char** argv) {
  const std::string mode = argc == 2 ? argv[1] : "";
  if (mode == "encode") {
    encode();
    return 0;
  }
  if (mode == "tables") {
    table<State>("State");
    table<Fault>("Fault");
    table<StoreState>("Store");
    table<SlotContent>("Slot_1");
    table<SlotContent>("Slot_2");
    return 0;
  }
  if (mode != "decode") return 2;
  hal::CanFrame f;
  f.size = 8;
  unsigned session = 0;
  std::uint64_t data = 0;  // byte 0 first
  while (std::scanf("%" SCNu32 " %u %" SCNx64, &f.id, &session, &data) == 3) {
    for (unsigned i = 0; i < 8; ++i) f.data[i] = static_cast<std::uint8_t>(data >> (8U * (7U - i)));
    decode(f, static_cast<std::uint8_t>(session));
  }
  return 0;
}
