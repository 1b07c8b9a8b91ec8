#pragma once
/// The controller's end of the command interface, a supervisor, and a supervisor computer made of bytes.

#include <gtest/gtest.h>

#include <vector>

#include "firmware/link/command_link.hpp"
#include "tests/support/link_bytes.hpp"

namespace esmc::test {

using namespace link;

inline LinkConfig link_config() {
  LinkConfig c;
  c.base_id = 0x780;
  c.session = 77;
  c.counter_jump_max = 2;
  c.command_age_ticks_max = 50;
  c.status_ticks = 4;
  c.period_ns = 1'000'000;
  c.scene = 0x89ABCDEFU;
  c.position = {Bounds{-0.3F, 0.3F}, Bounds{0.0F, 0.3F}};
  c.parameters = Parameters({40, 40, 150, 300, 1e-3F, 2, 2, 50, 1.0F, 10.0F, 3, 0},
                            {Bounds{10, 80}, Bounds{10, 80}, Bounds{0, 200}, Bounds{0, 0}});
  return c;
}

/// With a console that may be silent for so many ticks.
inline LinkConfig with_silence(float ticks) {
  LinkConfig c = link_config();
  auto values = c.parameters.values();
  values[static_cast<unsigned>(Index::silence)] = ticks;
  c.parameters = Parameters(values, c.parameters.bounds());
  return c;
}

/// Link, supervisor and desk; the drives obey at once.
struct LinkBench {
  explicit LinkBench(const LinkConfig& c = link_config()) : link(c) { desk.session = c.session; }

  /// `bus_takes`: whether frames get out.
  Request tick(const std::vector<hal::CanFrame>& frames = {}, Fault f = Fault::none) {
    link.begin_tick();
    ++now;
    outcomes.clear();
    for (const auto& frame : frames) outcomes.push_back(link.receive(frame));
    const Request r = link.take();
    supervisor.begin_tick(r.command,
                          {supervisor.state() == State::enabling, supervisor.state() == State::stopping});
    supervisor.raise(f);
    if (link.lost()) supervisor.raise(Fault::command_lost);
    link.transmit(supervisor, report, [&](const hal::CanFrame& frame) {
      if (refused > 0 && frame.id == refused_id) return --refused, false;
      if (bus_takes) desk.hear(frame);
      return bus_takes;
    });
    return r;
  }
  /// Quiet ticks until all that is due has been sent, one frame in each.
  void settle() {
    for (int i = 0; i < 8; ++i) tick();
  }
  Outcome one(const hal::CanFrame& f) {
    tick({f});
    return outcomes.at(0);
  }
  void listen() {
    for (int i = 0; i < 8; ++i) tick({desk.ask(2)});
    desk.heard.clear();
  }
  /// Armed with `source`, in its first running tick.
  void run(unsigned source = Desk::stream) {
    listen();
    ASSERT_EQ(one(desk.order(source)), Outcome::obeyed);
    ASSERT_EQ(one(desk.order(Desk::arm)), Outcome::obeyed);
    tick();
    ASSERT_EQ(supervisor.state(), State::running);
  }
  /// A sample in micrometres and 10 um/s.
  std::vector<hal::CanFrame> sample(int x, int y, int vx, int vy) {
    auto p = desk.pair(Desk::position, x, y), v = desk.pair(Desk::velocity, vx, vy);
    return {p, v};
  }

  CommandLink link;
  Supervisor supervisor;
  Desk desk;
  Report report;
  std::vector<Outcome> outcomes;
  unsigned now = 0;  ///< ticks so far
  bool bus_takes = true;
  std::uint32_t refused_id = 0;  ///< the bus does not take the next `refused` frames with this identifier
  int refused = 0;
};

}  // namespace esmc::test
