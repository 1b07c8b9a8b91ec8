/// The whole cycle with drives in MIT mode.

#include "firmware/drive/mit_axis.hpp"
#include "tests/fuzz/cycle.hpp"
#include "tests/support/mit_bytes.hpp"

namespace {

using namespace esmc;
using fuzz::Said;
using hal::CanFrame;

struct Mit {
  using Axis = drive::MitAxis;
  static constexpr std::array<test::Mounting, 4> mountings{
      {{1, 1.0, 1.0, 0.125}, {2, -1.0, 3.0, -0.25}, {3, -1.0, 0.5, 0.5}, {4, 1.0, 2.0, 0.0}}};
  /// N m at the shaft: of a drive like a human hand, and of one that is too small for what is asked of it.
  static double torque_most(unsigned choice) { return free(choice) && choice / 12 % 2 != 0 ? 0.1 : 18.0; }
  static double step(unsigned choice) {
    return torque_most(choice) / 4095 * 1.001;
  }  ///< half a code, and zero is none
  static bool free(unsigned choice) { return choice >= fuzz::Shape::fixed; }
  static constexpr double slack = 1e-6;  ///< of a torque: floats
  static constexpr bool passive_encoders = false;
  static constexpr unsigned master = 0x7E;

  static Axis axis(std::size_t i, unsigned choice) {
    const auto& m = mountings[i];
    Axis::Settings s;
    s.dialect = static_cast<Axis::Dialect>(choice % 3);
    s.master_id = static_cast<std::uint16_t>(choice % 4 == 3 ? m.node : master);
    s.retry_ticks = free(choice) && choice / 24 % 2 != 0 ? 3 : 8;
    s.ranges.torque = static_cast<float>(torque_most(choice));
    return {
        {m.node, static_cast<float>(m.direction), static_cast<float>(m.gear), static_cast<float>(m.offset)},
        s};
  }
  static Axis::Line line() { return {}; }

  /// Answers each command of the tick before.
  struct Drive {
    unsigned node = 0, id = 0, dialect = 0, error = 0, torque = 0x800;
    bool on = false, asked = false;

    template <class Push>
    void speak(double angle, double rate, bool beats, Push&& push) {
      if (!asked || !beats) return;
      asked = false;
      const auto code = [](double v, double range, double most) {
        return static_cast<unsigned>(std::fmin(std::fmax((v / range + 1) / 2 * most + 0.5, 0), most));
      };
      push(reply(code(angle, 12.5, 65535), code(rate, 50, 4095), torque, error));
    }
    [[nodiscard]] CanFrame reply(unsigned p, unsigned v, unsigned t, unsigned e) const {
      const unsigned state = e != 0 ? e : (on ? 1U : 0U);
      CanFrame f =
          test::mit_reply(id, dialect == 2 ? node + state % 16 * 16 : node, p, v, t, dialect == 0 ? 6 : 8);
      if (dialect == 1) f.data[7] = static_cast<std::uint8_t>(e);
      return f;
    }
    void hear(const CanFrame& f) {
      if (f.id != node) return;
      asked = true;
      if (test::is_special(f, 0xFC)) on = true;
      if (test::is_special(f, 0xFD)) on = false;
      if (test::mit_number(f, 0, 2) == 0x8000)
        torque = static_cast<unsigned>(test::mit_number(f, 6, 2) % 4096);
    }
    template <class Push>
    void defect(fuzz::Bytes& in, Push&& push) {
      in.one_of(
          4, [&] { error = in.u8(); }, [&] { on = in.yes(); },
          [&] { push(reply(in.u16(), in.u16() & 0xFFFU, in.u16() & 0xFFFU, in.u8())); },
          [&] { push(in.frame(id)); });
    }
    /// Of what it is.
    void tamper(fuzz::Bytes& in) {
      in.one_of(
          3,
          [&] {
            asked = in.yes();  // a command is lost, or another one has come
          },
          [&] { dialect = in.below(3); }, [&] { torque = in.u16() & 0xFFFU; });
    }
  };
  static Drive drive(std::size_t i, unsigned choice) {
    Drive d;
    d.node = mountings[i].node;
    d.id = choice % 4 == 3 ? d.node : master;
    d.dialect = choice % 3;
    return d;
  }

  static CanFrame addressed(fuzz::Bytes& in) {
    const unsigned what = in.u8();
    return in.frame(what % 5 == 4 ? master : mountings[what % 4].node);
  }
  /// Where replies come on the node's own identifier, nothing but a reply shows what a frame is.
  static bool is_torque_command(const CanFrame& f, std::size_t axis, unsigned choice) {
    return f.id == mountings[axis].node && !f.extended && !f.remote && (f.size == 0 || choice % 4 != 3);
  }
  static Said read(const CanFrame& f, std::size_t axes, unsigned choice) {
    Said s;
    while (s.axis < axes && mountings[s.axis].node != f.id) ++s.axis;
    if (s.axis == axes || f.size != 8) return s;
    if (test::is_special(f, 0xFC)) {
      s.kind = Said::Kind::enabling;
    } else if (test::is_special(f, 0xFD)) {
      s.kind = Said::Kind::releasing;
    } else if (test::mit_number(f, 0, 2) == 0x8000 && test::mit_number(f, 2, 4) / 256 == 0x800000 &&
               test::mit_number(f, 5, 2) / 16 == 0) {
      s.kind = Said::Kind::torque;
      s.shaft =
          (2.0 * static_cast<double>(test::mit_number(f, 6, 2) % 4096) - 4095) / 4095 * torque_most(choice);
    }
    return s;
  }
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  return fuzz::fuzz_cycle<Mit>(data, size);
}
