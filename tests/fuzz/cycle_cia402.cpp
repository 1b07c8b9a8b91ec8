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
  static constexpr double slack = 0.0102;  ///< of a torque: 1 % that the rated torque may be off
  static constexpr bool passive_encoders = false;
  static constexpr unsigned master = 100;
  static constexpr double velocity_unit = 0.01;

  /// N m per LSB of the rated torque: of a large drive, of one that is too small for what is asked of it, of
  /// a plausible one.
  static double unit(unsigned choice) {
    constexpr std::array<double, 3> units{1e-3, 1e-6, 1e3};
    return choice < fuzz::Shape::fixed ? units[0] : units[choice % 3];
  }
  /// N m that a thousandth stands for, and half of it; what a drive's object may be off is 1 %.
  static double thousandth(unsigned choice) { return 2 * unit(choice); }
  static double step(unsigned choice) { return thousandth(choice) * 0.51; }
  static double torque_most(unsigned choice) { return thousandth(choice) * 32767; }

  /// Of the shaft; one is enough for an angle that is anywhere.
  static unsigned counts(unsigned choice) {
    return choice >= fuzz::Shape::fixed && choice / 12 % 4 == 3 ? 1 : 65536;
  }

  static Axis axis(std::size_t i, unsigned choice) {
    constexpr std::array<std::uint32_t, 4> periods{1000, 250, 1234, 3'000'000'000};
    const auto& m = mountings[i];
    Axis::Settings s;
    s.rated_torque_unit = static_cast<float>(unit(choice));
    s.rated_torque = 2000.0F * s.rated_torque_unit;
    s.torque_limit = 1.25F * s.rated_torque;
    s.counts_per_turn = counts(choice);
    s.velocity_unit = static_cast<float>(velocity_unit);
    s.heartbeat_ms = 8;
    s.consumer_ms = 15;
    s.master_node = master;
    s.retry_ticks = 12;
    s.sdo_ticks = 3;
    s.period_us = periods[choice < fuzz::Shape::fixed ? choice % 2 : choice / 3 % 4];
    return {
        {m.node, static_cast<float>(m.direction), static_cast<float>(m.gear), static_cast<float>(m.offset)},
        s};
  }
  static Axis::Line line() { return {master, 4}; }

  struct Drive {
    test::Slave slave;
    unsigned counts = 65536;

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
      in.one_of(
          8, [&] { slave.status = in.u16(); }, [&] { slave.mode = in.u8(); },
          [&] { slave.state = in.yes() ? 0x7F : in.u8(); }, [&] { push(test::emergency_of(node, in.u16())); },
          [&] {
            push(test::report_of(node, in.u16(), static_cast<std::int32_t>(in.u32()),
                                 static_cast<std::int16_t>(in.u16())));
          },
          [&] { push(test::motion_of(node, static_cast<std::int32_t>(in.u32()), in.u8())); },
          [&] { slave.obeys = in.yes(); }, [&] { push(in.frame(0x580 + node)); });
    }
    /// What it says of its objects from now on. The rated torque is the scale of all torques: of what would
    /// be believed, the right one only, so that torques can be read from frames.
    void tamper(fuzz::Bytes& in) {
      const auto& object = drive::cia402::setup[in.below(drive::cia402::setup.size())].object;
      const std::uint32_t entry = test::entry(object.index, object.sub);
      const bool scale = object == drive::cia402::rated_torque;
      in.one_of(
          6, [&] { slave.says[entry] = !scale     ? in.u32()
                                       : in.yes() ? in.u32() | 0x10000U
                                                  : in.below(256); },
          [&] {
            constexpr std::array<std::uint32_t, 2> none{0x0602'0000, 0x0609'0011};  // object, sub-index
            slave.aborts[entry] = in.yes() ? none[in.below(2)] : in.u32();
          },
          [&] {
            constexpr std::array<int, 5> values{0x42, 0x43, 0x47, 0x4B,
                                                0x4F};  // without its size, of four bytes to one
            slave.command[entry] = in.yes() ? values[in.below(5)] : scale ? 0x80 : in.u8();
          },
          [&] { slave.silent.insert(entry); }, [&] { slave.torque = static_cast<std::int16_t>(in.u16()); },
          [&] {
            slave.says.clear();
            slave.aborts.clear();
            slave.command.clear();
            slave.silent.clear();
          });
    }
  };
  static Drive drive(std::size_t i, unsigned choice) {
    Drive d;
    d.counts = counts(choice);
    d.slave.node = mountings[i].node;
    d.slave.objects[test::entry(0x1014, 0)] = 0x80U + mountings[i].node;
    return d;
  }

  static CanFrame addressed(fuzz::Bytes& in) {
    const unsigned what = in.u8();
    return in.frame(mountings[what / 64].node + what % 16 * 0x80U);
  }
  static bool is_torque_command(const CanFrame& f, std::size_t axis, unsigned) {
    return f.id == 0x200U + mountings[axis].node && !f.extended && !f.remote;
  }
  static Said read(const CanFrame& f, std::size_t axes, unsigned choice) {
    Said s;
    const bool sync = f.id == 0x080 && f.size == 0,
               heartbeat = f.id == 0x700 + master && f.size == 1 && f.data[0] == 5;
    if (sync || heartbeat) {
      s.kind = sync ? Said::Kind::asking : Said::Kind::alive;
      return s;
    }
    const unsigned node = f.id == 0 ? f.data[1] : f.id % 0x80U;
    while (s.axis < axes && mountings[s.axis].node != node) ++s.axis;
    if (s.axis == axes) return s;
    if (f.id == 0 && f.size == 2) {
      if (f.data[0] == 1 || f.data[0] == 0x80) s.kind = Said::Kind::enabling;
      if (f.data[0] == 2) s.kind = Said::Kind::releasing;
    } else if (f.id / 0x80U == 0x600 / 0x80U && f.size == 8) {
      s.kind = Said::Kind::enabling;
    } else if (f.id / 0x80U == 0x200 / 0x80U && f.size == 4) {
      s.kind = Said::Kind::torque;
      s.enables = f.data[0] % 16 == 15;  // enable operation
      s.shaft = static_cast<std::int16_t>(little(f, 2, 2)) * thousandth(choice);
    }
    return s;
  }
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  return fuzz::fuzz_cycle<Cia402>(data, size);
}
