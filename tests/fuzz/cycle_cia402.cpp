/// The whole cycle with CiA 402 drives.

#include "firmware/drive/cia402_axis.hpp"
#include "tests/fuzz/cycle.hpp"
#include "tests/support/canopen_bytes.hpp"

namespace {

using namespace esmc;
using fuzz::Said;
using hal::CanFrame;
using test::little;

struct Cia402 {
  using Axis = drive::Cia402Axis;
  static constexpr auto& mountings = test::mountings;
  static constexpr double step = 2e-3 * 0.51;  ///< N m: half a thousandth of the rated torque
  static constexpr bool passive_encoders = false;
  static constexpr unsigned counts = 65536, master = 100;
  static constexpr double velocity_unit = 0.01;

  static Axis axis(std::size_t i, unsigned choice) {
    const auto& m = mountings[i];
    Axis::Settings s;
    s.rated_torque = 2.0F;
    s.torque_limit = 2.5F;
    s.counts_per_turn = counts;
    s.velocity_unit = static_cast<float>(velocity_unit);
    s.heartbeat_ms = 8;
    s.consumer_ms = 15;
    s.master_node = master;
    s.retry_ticks = 12;
    s.sdo_ticks = 3;
    s.period_us = choice % 2 == 0 ? 1000 : 250;
    return {{m.node, static_cast<float>(m.direction), static_cast<float>(m.gear), static_cast<float>(m.offset)}, s};
  }
  static Axis::Line line() { return {master, 4}; }

  struct Drive {
    test::Slave slave;
    int torque = 0;

    template <class Push>
    void speak(double angle, double rate, bool beats, Push&& push) {
      for (const CanFrame& f : std::exchange(slave.waiting, {})) push(f);
      if (beats) push(test::heartbeat_of(slave.node, slave.state));
      if (slave.state != 5) return;
      const auto whole = [](double v) { return std::fabs(v) < 2e9 ? static_cast<std::int32_t>(v) : 0; };
      push(test::report_of(slave.node, slave.status, whole(angle / test::turn * counts), slave.torque));
      push(test::motion_of(slave.node, whole(rate / velocity_unit), slave.mode));
    }
    void hear(const CanFrame& f) {
      slave.take(f);
      slave.reads.clear();
      slave.writes.clear();
    }
    template <class Push>
    void defect(fuzz::Bytes& in, Push&& push) {
      const unsigned node = slave.node;
      switch (in.below(8)) {
        case 0: slave.status = in.u16(); break;
        case 1: slave.mode = in.u8(); break;
        case 2: slave.state = in.yes() ? 0x7F : in.u8(); break;
        case 3: push(test::emergency_of(node, in.u16())); break;
        case 4: push(test::report_of(node, in.u16(), static_cast<std::int32_t>(in.u32()), static_cast<std::int16_t>(in.u16()))); break;
        case 5: push(test::motion_of(node, static_cast<std::int32_t>(in.u32()), in.u8())); break;
        case 6: slave.obeys = in.yes(); break;
        default: push(in.frame(0x580 + node)); break;
      }
    }
  };
  static Drive drive(std::size_t i, unsigned) {
    Drive d;
    d.slave.node = mountings[i].node;
    d.slave.objects[test::entry(0x1014, 0)] = 0x80U + mountings[i].node;
    return d;
  }
  /// Without the scale a drive is told nothing, whatever is wanted.
  static bool unscaled(const Drive& d) { return d.slave.state != 5; }

  static CanFrame addressed(fuzz::Bytes& in) {
    const unsigned what = in.u8();
    return in.frame(mountings[what / 64].node + what % 16 * 0x80U);
  }
  static bool is_torque_command(const CanFrame& f) {
    const bool first = f.id == 0x200U + mountings[0].node || f.id == 0x200U + mountings[1].node;
    return first && !f.extended && !f.remote;
  }
  static Said read(const CanFrame& f, std::size_t axes) {
    Said s;
    if ((f.id == 0x080 && f.size == 0) || (f.id == 0x700 + master && f.size == 1 && f.data[0] == 5)) {
      s.kind = Said::Kind::line;
      return s;
    }
    const unsigned node = f.id == 0 ? f.data[1] : f.id % 0x80U;
    while (s.axis < axes && mountings[s.axis].node != node) ++s.axis;
    if (s.axis == axes) return s;
    if (f.id == 0 && f.size == 2) {
      if (f.data[0] == 1) s.kind = Said::Kind::enabling;
      if (f.data[0] == 0x80) s.kind = Said::Kind::line;  // while enabling and while releasing
    } else if (f.id / 0x80U == 0x600 / 0x80U && f.size == 8) {
      s.kind = Said::Kind::enabling;
    } else if (f.id / 0x80U == 0x200 / 0x80U && f.size == 4) {
      s.kind = Said::Kind::torque;
      s.shaft = static_cast<std::int16_t>(little(f, 2, 2)) * 2e-3;
    }
    return s;
  }
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  return fuzz::fuzz_cycle<Cia402>(data, size);
}
