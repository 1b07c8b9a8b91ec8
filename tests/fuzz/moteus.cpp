/// moteus: the axis under received frames of any kind and any order of calls, and the emulated drive under
/// what the axis sends and under anything else. Replies are read here a second time, byte by byte.

#include <array>
#include <cmath>
#include <optional>

#include "firmware/drive/moteus_axis.hpp"
#include "host_sim/drives/moteus_axis.hpp"
#include "tests/fuzz/bytes.hpp"

namespace {

using namespace esmc;
using drive::Received;
using fuzz::require;
using hal::CanFrame;

constexpr unsigned node = 5;

/// Registers 0 to 15 of a reply as numbers; none: not a whole reply.
struct Said {
  std::array<std::optional<double>, 16> value;
  bool refused = false;
};
bool number(const CanFrame& f, unsigned& at, std::uint64_t& v) {
  v = 0;
  for (unsigned k = 0; k < 5; ++k) {
    if (at >= f.size) return false;
    const std::uint64_t byte = f.data[at++];
    v += (byte % 128) << (7 * k);
    if (byte < 128) return v <= 0xFFFF'FFFF;
  }
  return false;
}
double read(const CanFrame& f, unsigned at, unsigned type) {
  std::uint64_t raw = 0;
  const unsigned bytes = type == 3 ? 4 : 1U << type;
  for (unsigned k = bytes; k-- > 0;) raw = raw * 256 + f.data[at + k];
  if (type == 3) return static_cast<double>(std::bit_cast<float>(static_cast<std::uint32_t>(raw)));
  const double whole = std::ldexp(1.0, static_cast<int>(8 * bytes)), v = static_cast<double>(raw);
  if (v == whole / 2) return std::nan("");
  return v < whole / 2 ? v : v - whole;
}
std::optional<Said> said(const CanFrame& f) {
  Said out;
  for (unsigned at = 0; at < f.size;) {
    const unsigned code = f.data[at++], type = code / 4 % 4;
    std::uint64_t count = code % 4, first = 0, last = 0;
    if (code == 0x50) continue;
    if (code > 0x31) return std::nullopt;
    if (code >= 0x30) {
      if (!number(f, at, first) || !number(f, at, last)) return std::nullopt;
      out.refused = true;
      continue;
    }
    if (count == 0 && !number(f, at, count)) return std::nullopt;
    if (count == 0 || count > 64 || !number(f, at, first)) return std::nullopt;
    for (std::uint64_t i = 0; code / 16 != 1 && i < count; ++i) {
      const unsigned bytes = type == 3 ? 4 : 1U << type;
      if (at + bytes > f.size) return std::nullopt;
      const std::uint64_t name = (first + i) % 0x1'0000'0000;
      if (code / 16 == 2 && name < 16) out.value[name] = read(f, at, type);
      at += bytes;
    }
  }
  for (const unsigned name : {0U, 1U, 2U, 3U, 15U}) {
    if (!out.value[name]) return std::nullopt;
  }
  const auto byte = [](double v) { return v >= 0 && v <= 255; };
  return byte(*out.value[0]) && byte(*out.value[15]) ? std::optional(out) : std::nullopt;
}

class Run {
 public:
  explicit Run(fuzz::Bytes& in)
      : in_(in), emulated_({.node = node}, settings(in), host::SensorEffects({}), 0, 1) {
    const float torque = in.yes() ? in.f32() : 2.0F, time = in.yes() ? in.f32() : 0.01F;
    axis_ = drive::MoteusAxis(
        {.node = node, .gear_ratio = 2.0F},
        {.torque_max = torque, .watchdog = time, .absolute = in.yes(), .retry_ticks = in.below(8)});
  }
  void go() {
    while (!in_.empty()) {
      step();
      hold();
    }
  }

 private:
  static host::MoteusAxis::Settings settings(fuzz::Bytes& in) {
    const unsigned wrong = in.u8();
    host::MoteusAxis::Settings s{.torque_max = 7.0, .realtime = (wrong & 1U) != 0};
    s.defects.position_invalid = (wrong & 2U) != 0;
    s.defects.relative_position = (wrong & 4U) != 0;
    s.defects.other_registers = (wrong & 8U) != 0;
    s.defects.refuses_watchdog = (wrong & 16U) != 0;
    s.defects.classic_replies = (wrong & 32U) != 0;
    s.defects.low_max_torque = (wrong & 64U) != 0;
    s.defects.watchdog_off = (wrong & 128U) != 0;
    return s;
  }
  void step() {
    in_.one_of(
        8, [&] { hear(in_.frame()); },
        [&] {
          CanFrame f = in_.frame(node << 8U);
          f.extended = f.remote = false;
          hear(f);
        },
        [&] { tell(in_.frame(0x8000 + node)); },
        [&] {  // our frame or its reply, changed
          CanFrame f = in_.yes() ? sent_ : reply_;
          if (f.size > 0) f.data[in_.u8() % f.size] = in_.u8();
          if (in_.below(4) == 0) f.size = static_cast<std::uint8_t>(in_.u8() % 65);
          (f.id & 0x8000U) != 0 ? tell(f) : hear(f);
        },
        [&] { axis_.disable([](const CanFrame&) { return true; }); }, [&] { wanted_ = in_.f64(); },
        [&] {
          axis_.begin_tick();
          emulated_.publish(0.25, 1.0, [&](const CanFrame& f) { hear(reply_ = f); });
          axis_.enable([&](const CanFrame& f) {
            require(f.size == 12 && f.data[0] == 0x11, "a silent drive is asked, not commanded");
            return in_.yes();
          });
          axis_.put_torque(sent_, wanted_);
          tell(sent_);
        });
  }
  void hear(const CanFrame& f) {
    const bool ours = f.id == node << 8U && !f.extended && !f.remote;
    const Received r = axis_.receive(f);
    if (f.id <= 0xFFFF && f.id % 256 == node)
      return require(r == Received::foreign_command, "a command of others");
    const auto s = ours && f.fd ? said(f) : std::nullopt;
    require((r == Received::accepted) == s.has_value(), "a whole reply is accepted, and nothing else");
    require((r == Received::malformed) == (ours && !s), "a broken one is malformed");
    if (!s) return;
    last_ = s;
    const double mode = std::trunc(*s->value[0]);
    require(axis_.error() == (*s->value[0] == mode && (mode == 1 || mode == 11)), "errors as reported");
    require(axis_.closed_loop() == (*s->value[0] == 10), "the mode as reported");
  }
  void tell(const CanFrame& f) {
    (void)emulated_.receive(f, [&](const CanFrame& g) {
      require(hal::well_formed(g), "replies are frames");
      if (g.id == node << 8U) hear(reply_ = g);
    });
    require(std::fabs(emulated_.joint_torque()) <= 7.0, "within the drive's limit");
    require(emulated_.closed_loop() || emulated_.joint_torque() == 0, "no torque unless wanted");
  }
  void hold() {
    CanFrame f;
    axis_.put_torque(f, wanted_);
    require(f.id == 0x8000 + node && f.extended && f.fd && f.size <= 32, "a command to this drive");
    require(f.data[0] == 1 && f.data[1] == 0, "the mode comes first");
    const bool torque = f.data[2] == 10 && f.data[3] == 2;
    require(torque == axis_.ready(), "torque while it is ready");
    require(!axis_.ready() || (axis_.closed_loop() && !axis_.error() && last_),
            "ready: torque control without error");
    if (!torque) return;
    require(f.data[7] == 0x0D && f.data[8] == 0x22, "the torque follows");
    const double told = read(f, 9, 3), shaft = wanted_ / 2;
    require(
        std::fabs(told) <= 1e4 && (told == 0 || std::fabs(told - shaft) <= 1e-6 * std::fabs(shaft) + 1e-40),
        "the torque that was meant, or none");
  }

  fuzz::Bytes& in_;
  host::MoteusAxis emulated_;
  drive::MoteusAxis axis_;
  CanFrame sent_{}, reply_{};
  std::optional<Said> last_;
  double wanted_ = 1.5;
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  fuzz::Bytes in(data, size);
  Run(in).go();
  return 0;
}
