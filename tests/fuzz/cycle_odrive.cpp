/// The whole cycle with ODrives.

#include "firmware/drive/odrive_axis.hpp"
#include "tests/fuzz/cycle.hpp"
#include "tests/support/odrive_bytes.hpp"

namespace {

using namespace esmc;
using fuzz::Said;
using hal::CanFrame;

struct Odrive {
  using Axis = drive::OdriveAxis;
  static constexpr auto& mountings = test::mountings;
  static double step(unsigned) { return 0; }  ///< N m: torques are floats
  static double torque_most(unsigned) { return std::numeric_limits<double>::infinity(); }
  static constexpr double slack = 1e-6;           ///< of a torque: floats
  static constexpr bool passive_encoders = true;  ///< a drive without a motor says its angle

  /// What is asked of a drive before it is armed, and how it is watched.
  struct Kind {
    bool old = false, proves = false, version = false;
    unsigned checks = 0;
    std::uint32_t retry_ticks = 8;
  };
  static Kind kind(unsigned choice) {
    if (choice < fuzz::Shape::fixed)
      return {choice % 4 == 1, choice == 4, choice == 3, choice == 3 ? 1U : 0U, 8};
    fuzz::Dial d(choice - fuzz::Shape::fixed);
    Kind k;
    k.old = d.turn(2) != 0;
    k.proves = d.turn(2) != 0;
    k.version = d.turn(2) != 0;
    k.checks = d.turn(4);
    k.retry_ticks = d.turn(2) != 0 ? 20 : 8;
    return k;
  }
  static Axis axis(std::size_t i, unsigned choice) {
    using drive::odrive::ValueType;
    const auto& m = mountings[i];
    const Kind k = kind(choice);
    drive::OdriveTable table;
    table.checks = {{{77, ValueType::f32, 0.5F, 1.5F},
                     {78, ValueType::u8, 3.0F, 3.0F},
                     {79, ValueType::u32, 5.0F, 7.0F}}};
    table.count = static_cast<std::uint8_t>(k.checks);
    table.check_version = k.version;
    table.firmware = {0, 6, 10};
    Axis a(
        {m.node, static_cast<float>(m.direction), static_cast<float>(m.gear), static_cast<float>(m.offset)},
        k.old ? Axis::Version::v0_5_6 : Axis::Version::v0_6, k.retry_ticks, table);
    if (k.proves) a.prove_watchdog(6);
    a.restarts_within(k.proves ? 3 : k.retry_ticks);
    return a;
  }
  static Axis::Line line() { return {}; }

  /// Does what it is told; its watchdog expires after three ticks of silence in closed loop.
  struct Drive {
    unsigned node = 0;
    std::uint8_t state = test::axis_idle;
    std::uint32_t error = 0, watchdog = 0;
    unsigned fed = 0;
    std::vector<CanFrame> answers;
    bool mute = false, dumb = false;               ///< no answers; not a word of its torque
    std::uint32_t version = 0x000A0600, flip = 0;  ///< what is wrong with a value
    std::uint32_t beside = 0;                      ///< and with the endpoint
    std::uint8_t size = 8;
    float told = 0, clipped = 0;  ///< N m at the shaft
    bool fd = false, remote = false;

    template <class Push>
    void speak(double angle, double rate, bool beats, Push&& push) {
      if (watchdog != 0 && state == test::axis_closed_loop && ++fed > 3) {
        error = watchdog;
        state = test::axis_idle;
      }
      for (CanFrame f : answers) {
        f.fd = fd;
        f.remote = remote;
        push(f);
      }
      answers.clear();
      if (beats) {
        push(test::heartbeat(node, state, error));
        if (!dumb) push(test::torques(node, told, told + clipped));
      }
      push(
          test::encoder(node, static_cast<float>(angle / test::turn), static_cast<float>(rate / test::turn)));
    }
    void hear(const CanFrame& f) {
      if (test::node_of(f) != node) return;
      switch (test::command_of(f)) {
        case test::cmd_axis_state:
          state = static_cast<std::uint8_t>(test::word(f, 0));
          fed = 0;
          break;
        case test::cmd_clear_errors:
          error = 0;
          break;
        case test::cmd_torque:
          fed = 0;
          told = test::real(f, 0);
          break;
        case 0:
          if (!mute) answers.push_back(test::message(node, 0, 2, version, size));
          break;
        case 4: {
          const std::uint32_t endpoint = f.data[1] + 256U * f.data[2];
          const std::uint32_t value = endpoint == 77   ? std::bit_cast<std::uint32_t>(1.0F)
                                      : endpoint == 78 ? 3U
                                                       : 6U;
          if (!mute)
            answers.push_back(test::message(node, 5, (endpoint ^ beside) * 256U, value ^ flip, size));
          break;
        }
        default:
          break;
      }
    }
    /// Of what it answers, and of what it is.
    void tamper(fuzz::Bytes& in) {
      in.one_of(
          6,
          [&] {
            const unsigned b = in.u8();
            mute = (b & 1U) != 0;
            dumb = (b & 6U) == 6U;
          },
          [&] { version = in.u32(); },
          [&] {
            flip = in.u32();
            clipped = std::bit_cast<float>(flip);
          },
          [&] {
            size = static_cast<std::uint8_t>(in.below(9));
            fd = in.yes();
            remote = in.yes();
          },
          [&] { beside = in.below(4); }, [&] { watchdog = in.yes() ? in.u32() : 0U; });
    }
    template <class Push>
    void defect(fuzz::Bytes& in, Push&& push) {
      in.one_of(
          5, [&] { state = in.u8(); }, [&] { error = in.u32(); },
          [&] { push(test::encoder(node, in.f32(), in.f32())); },
          [&] { push(test::message(node, 2, 0, 0, 0)); },
          [&] { push(test::heartbeat(node, in.u8(), in.u32())); });
    }
  };
  static Drive drive(std::size_t i, unsigned choice) {
    Drive d;
    d.node = mountings[i].node;
    const Kind k = kind(choice);
    d.watchdog = !k.proves ? 0U : k.old ? 0x800U : 0x1000000U;
    return d;
  }

  /// To one of our nodes.
  static CanFrame addressed(fuzz::Bytes& in) {
    const unsigned what = in.u8();
    return in.frame(mountings[what / 64].node * 32U + what % 32);
  }
  static bool is_torque_command(const CanFrame& f, std::size_t axis, unsigned) {
    return test::node_of(f) == mountings[axis].node && test::command_of(f) == test::cmd_torque &&
           !f.extended && !f.remote;
  }
  static Said read(const CanFrame& f, std::size_t axes, unsigned) {
    Said s;
    while (s.axis < axes && mountings[s.axis].node != test::node_of(f)) ++s.axis;
    if (s.axis == axes) return s;
    switch (test::command_of(f)) {
      case test::cmd_torque:
        s.kind = f.size == 8 ? Said::Kind::torque : Said::Kind::unknown;
        s.shaft = static_cast<double>(test::real(f, 0));
        break;
      case test::cmd_axis_state:
        s.kind = test::word(f, 0) == 8 ? Said::Kind::enabling : Said::Kind::releasing;
        break;
      case test::cmd_mode:
      case test::cmd_clear_errors:
      case 0:
      case 4:
        s.kind = Said::Kind::enabling;
        break;
      default:
        break;
    }
    return s;
  }
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  return fuzz::fuzz_cycle<Odrive>(data, size);
}
