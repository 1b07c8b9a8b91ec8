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
  static constexpr double step = 0;  ///< N m: torques are floats
  static constexpr bool passive_encoders = true;  ///< a drive without a motor says its angle

  static Axis axis(std::size_t i, unsigned choice) {
    const auto& m = mountings[i];
    drive::OdriveTable table;
    if (choice == 3) {
      table.checks[0] = {77, drive::odrive::ValueType::f32, 0.5F, 1.5F};
      table.count = 1;
      table.check_version = true;
      table.firmware = {0, 6, 10};
    }
    Axis a({m.node, static_cast<float>(m.direction), static_cast<float>(m.gear), static_cast<float>(m.offset)},
           choice % 4 == 1 ? Axis::Version::v0_5_6 : Axis::Version::v0_6, 8, table);
    if (choice == 4) a.prove_watchdog(6);
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

    template <class Push>
    void speak(double angle, double rate, bool beats, Push&& push) {
      if (watchdog != 0 && state == test::axis_closed_loop && ++fed > 3) {
        error = watchdog;
        state = test::axis_idle;
      }
      for (const CanFrame& f : answers) push(f);
      answers.clear();
      if (beats) push(test::heartbeat(node, state, error));
      push(test::encoder(node, static_cast<float>(angle / test::turn), static_cast<float>(rate / test::turn)));
    }
    void hear(const CanFrame& f) {
      if (test::node_of(f) != node) return;
      switch (test::command_of(f)) {
        case test::cmd_axis_state:
          state = static_cast<std::uint8_t>(test::word(f, 0));
          fed = 0;
          break;
        case test::cmd_clear_errors: error = 0; break;
        case test::cmd_torque: fed = 0; break;
        case 0: {
          CanFrame a = test::message(node, 0, 2, 0x000A0600);
          answers.push_back(a);
          break;
        }
        case 4: answers.push_back(test::message(node, 5, (f.data[1] + 256U * f.data[2]) * 256U, std::bit_cast<std::uint32_t>(1.0F))); break;
        default: break;
      }
    }
    template <class Push>
    void defect(fuzz::Bytes& in, Push&& push) {
      switch (in.below(5)) {
        case 0: state = in.u8(); break;
        case 1: error = in.u32(); break;
        case 2: push(test::encoder(node, in.f32(), in.f32())); break;
        case 3: push(test::message(node, 2, 0, 0, 0)); break;
        default: push(test::heartbeat(node, in.u8(), in.u32())); break;
      }
    }
  };
  static Drive drive(std::size_t i, unsigned choice) {
    Drive d;
    d.node = mountings[i].node;
    d.watchdog = choice == 4 ? 0x1000000U : 0U;
    return d;
  }
  static bool unscaled(const Drive&) { return false; }

  /// To one of our nodes.
  static CanFrame addressed(fuzz::Bytes& in) {
    const unsigned what = in.u8();
    return in.frame(mountings[what / 64].node * 32U + what % 32);
  }
  static bool is_torque_command(const CanFrame& f) {
    const bool first = test::node_of(f) == mountings[0].node || test::node_of(f) == mountings[1].node;
    return first && test::command_of(f) == test::cmd_torque && !f.extended && !f.remote;
  }
  static Said read(const CanFrame& f, std::size_t axes) {
    Said s;
    while (s.axis < axes && mountings[s.axis].node != test::node_of(f)) ++s.axis;
    if (s.axis == axes) return s;
    switch (test::command_of(f)) {
      case test::cmd_torque:
        s.kind = f.size == 8 ? Said::Kind::torque : Said::Kind::unknown;
        s.shaft = static_cast<double>(test::real(f, 0));
        break;
      case test::cmd_axis_state: s.kind = test::word(f, 0) == 8 ? Said::Kind::enabling : Said::Kind::releasing; break;
      case test::cmd_mode:
      case test::cmd_clear_errors:
      case 0:
      case 4: s.kind = Said::Kind::enabling; break;
      default: break;
    }
    return s;
  }
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  return fuzz::fuzz_cycle<Odrive>(data, size);
}
