/// Random orders of a console, validly sealed and not, to link, controller and plant in lockstep: torque,
/// pose and speed never leave the limits further than it takes to come to rest, and what is silent ends.
/// usage: random_commands COMMANDS SEED

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "firmware/cycle/linked.hpp"
#include "tests/support/control_loop.hpp"
#include "tests/support/link_bytes.hpp"

namespace {

using namespace esmc;
using test::ControlLoop;
using test::Desk;

constexpr double tick = 1e-3, torque_max = 2.0, speed = 0.4, acceleration = 6.0, gap = 2e-3;
constexpr double left = -0.06, right = 0.06, low = 0.13, high = 0.22;
constexpr double homing_torque = 0.2, homing_speed = 0.6;
constexpr std::uint32_t halt_ticks = 100, silence = 60, age = 5;

link::LinkConfig link_config() {
  link::LinkConfig c;
  c.base_id = 0x780;
  c.session = 9;
  c.command_age_ticks_max = 50;
  c.status_ticks = 3;
  c.telemetry_ticks = 7;
  c.table_ticks = 200;
  c.period_ns = 1'000'000;
  const auto f = [](double v) { return static_cast<float>(v); };
  c.position = {link::Bounds{f(left), f(right)}, link::Bounds{f(low), f(high)}};
  c.parameters = link::Parameters(
      {40, 40, 150, 150, f(tick), f(torque_max), f(torque_max), 20, f(speed), f(acceleration), age, silence},
      {link::Bounds{10, 60}, link::Bounds{10, 60}, link::Bounds{50, 300}, link::Bounds{50, 300}});
  return c;
}

test::LoopSetup setup() {
  test::LoopSetup s;
  s.truth = s.believed = test::b7_mechanism(0.0);
  s.torque_limit = torque_max;
  s.radius = 0.04;
  s.speed = 5.0;
  s.start = host::V2{0.03, 0.17};
  s.effects = {host::ViscousFriction{{0.02, 0.02, 0.02, 0.02}},
               host::EndStops{{-0.4, 0.2}, {1.8, 2.4}, 2000.0, 0.5}};
  s.homing = {{homing_speed, -homing_speed}, {homing_torque, homing_torque}, {0.08, 0.08}, 2.0, 0.02, 0.01};
  s.adjust = [](ControllerConfig<FiveBar<double>>& c) {
    c.halt_ticks = halt_ticks;
    c.after_halt = AfterHalt::hold;
    c.join_ticks = 300;
    c.setpoint_speed = speed;
    c.setpoint_acceleration = acceleration;
    c.limits.joint_speed = 20.0;
    c.limits.workspace_x = {left - 0.01, right + 0.01};
    c.limits.workspace_y = {low - 0.01, high + 0.01};
  };
  return s;
}

/// From power-up to a pose from which it cannot be armed again, or for long enough.
class Episode {
 public:
  Episode(std::mt19937_64& random, std::uint64_t commands)
      : random_(random),
        left_(commands),
        link_(link_config()),
        memory_(below(2) == 0 ? 0 : 100),
        loop_(setup()) {
    desk_.session = link_config().session;
    link_.capture_into(memory_);
    link_.offer_homing(true);
    loop_.supervisor() = Supervisor(loop_.controller().supervision());
  }

  /// Commands sent. Throws a text where an invariant is broken.
  std::uint64_t run() {
    for (int n = 0; n < 20'000 && sent_ < left_ && stuck_ < 300; ++n) step();
    return sent_;
  }
  std::uint64_t moved = 0, homing = 0, faults = 0, lost = 0;  ///< ticks, and what began

 private:
  using Plant = ControlLoop::Plant;

  [[nodiscard]] unsigned below(unsigned n) { return static_cast<unsigned>(random_() % n); }
  [[nodiscard]] int between(int a, int b) {
    return a + static_cast<int>(below(static_cast<unsigned>(b - a + 1)));
  }

  void send(const hal::CanFrame& f) {
    const link::Outcome o = link_.receive(f);
    if (o != link::Outcome::bad_crc && o != link::Outcome::bad_counter) quiet_ = 0;
    ++sent_;
  }
  void point(unsigned message) {
    send(desk_.pair(message, between(-80'000, 80'000), between(110'000, 240'000), below(20) == 0 ? 1 : 0));
  }
  /// A walk that the interface may follow, from where the mechanism is.
  void walk() {
    const auto at = loop_.effector();
    walk_ = {at[0], at[1]};
    walk_rate_ = {0.0, 0.0};
    walking_ = between(1, 300);
  }
  void stream() {
    for (std::size_t i = 0; i < 2; ++i) {
      const double push = between(-9, 9) * 0.1 * acceleration * tick;
      walk_rate_[i] = std::clamp(walk_rate_[i] + push, -speed, speed);
      walk_[i] += walk_rate_[i] * tick;
    }
    const auto micro = [](double v, double unit) { return static_cast<int>(std::lround(v / unit)); };
    const auto position = desk_.pair(Desk::position, micro(walk_[0], 1e-6), micro(walk_[1], 1e-6));
    desk_.counter[Desk::velocity] = static_cast<std::uint8_t>((position.data[1] - 1) & 15);
    send(position);
    send(desk_.pair(Desk::velocity, micro(walk_rate_[0], 1e-5), micro(walk_rate_[1], 1e-5)));
    --walking_;
  }
  /// Anything, with a checksum that is right.
  void forged() {
    const std::uint64_t payload = random_();
    send(desk_.make(below(6), payload & 0xFFFF'FFFF'FFFFU, below(4) == 0 ? below(16) : below(2)));
  }
  /// What an operator would do next.
  void sensible() {
    switch (loop_.supervisor().state()) {
      case State::disabled:
        send(desk_.order(below(4) == 0 ? Desk::reference : Desk::stream));
        return send(desk_.order(below(8) == 0 ? Desk::home : Desk::arm));
      case State::fault:
      case State::holding:
        return send(desk_.order(Desk::reset));
      case State::running:
        return below(2) == 0 ? walk() : point(Desk::point);
      default:
        return;
    }
  }
  void command() {
    if (below(2) == 0) return sensible();
    switch (below(16)) {
      case 0:
      case 1:
        return send(desk_.order(Desk::arm));
      case 2:
        return send(desk_.order(below(3) == 0 ? Desk::reference : Desk::stream));
      case 3:
        return send(desk_.order(Desk::hold));
      case 4:
        return send(desk_.order(below(4) == 0 ? Desk::off : Desk::disarm));
      case 5:
      case 6:
        return send(desk_.order(Desk::reset));
      case 7:
        return send(desk_.set_gain(below(5), static_cast<float>(between(-10, 310))));
      case 8:
        return send(desk_.ask(below(4), below(14)));
      case 9:
        return walk();
      case 10:
        return point(Desk::position);
      case 11:
        return forged();
      case 12:
        return send(desk_.order(below(13)));
      case 13:
        gone_ = between(1, 150);
        return;
      default:
        return point(Desk::point);
    }
  }

  void step() {
    link_.begin_tick();
    ++quiet_;
    if (gone_ > 0) {
      --gone_;
    } else {
      if (below(3) == 0) {
        send(desk_.order(Desk::none));
        --sent_;  // is none
      }
      if (walking_ > 0) stream();
      if (below(walking_ > 0 ? 100 : 12) == 0) command();
    }
    const bool faulty = loop_.supervisor().fault() != Fault::none;
    const Command c = apply_requests(link_, loop_.controller(), 0.0);
    if (link_.lost()) loop_.supervisor().raise(Fault::command_lost);
    const auto r = loop_.tick(c, {true, true});
    faults += !faulty && r.fault != Fault::none ? 1U : 0U;
    lost += !faulty && r.fault == Fault::command_lost ? 1U : 0U;
    check(r);
    link_.transmit(loop_.supervisor(), report_of(loop_.controller(), r, loop_.sample()),
                   [&](const hal::CanFrame& f) {
                     desk_.hear(f);
                     return true;
                   });
    if (desk_.heard.size() > 100) desk_.heard.clear();
  }

  void require(bool good, const std::string& what) const {
    if (!good)
      throw what + ", in tick " + std::to_string(loop_.ticks()) + " of an episode, state " +
          name(loop_.supervisor().state()) + ", fault " + name(loop_.supervisor().fault());
  }
  void check(const TickResult<FiveBar<double>>& r) {
    const Supervisor& s = loop_.supervisor();
    for (int i = 0; i < 4; ++i) {
      require(std::abs(r.torque[i]) <= torque_max, "a torque beyond its limit");
      require(s.powered() || r.torque[i] == 0.0, "torque in a state without");
    }
    const auto truth = loop_.truth();
    const auto at = loop_.effector();
    const double v = std::hypot(truth.qd[0], truth.qd[1]);
    if (!s.powered()) {  // it coasts, and is pushed back by nobody
      const bool outside = beyond(at) > 0.0 || s.state() == State::fault;
      stuck_ = outside && s.state() == State::fault && quiet_ > 0 && beyond(at) > 0.0 ? stuck_ + 1 : 0;
      room_ = 0.0;
      return;
    }
    moved += v > 1e-3 ? 1U : 0U;
    if (s.homing()) return check_homing(r, v);
    if (s.running()) {
      room_ = v * 0.5 * halt_ticks * tick;
      require(quiet_ <= silence + 2, "running without a sign of life");
      require(beyond(at) <= gap, "running beyond the workspace");
    }
    require(beyond(at) <= room_ + 2.0 * gap, "further beyond the workspace than it takes to come to rest");
    for (const std::size_t i : {2U, 4U})
      require(std::abs(truth.qd[i]) <= 20.5, "a joint faster than allowed");
    rest_ = s.running() ? 0 : rest_ + 1;
    require(rest_ < 4 * halt_ticks || v < 0.02, "not at rest");
  }
  void check_homing(const TickResult<FiveBar<double>>& r, double v) {
    ++homing;
    const auto truth = loop_.truth();
    for (int i = 0; i < 4; ++i)
      require(std::abs(r.torque[i]) <= homing_torque, "more than the homing torque");
    for (const std::size_t i : {2U, 4U})
      require(std::abs(truth.qd[i]) <= 4.1 * homing_speed, "a joint faster than homing allows");
    const bool seeks = loop_.supervisor().state() == State::testing;
    require(!seeks || quiet_ <= silence + 2, "homing without a sign of life");
    rest_ = seeks ? 0 : rest_ + 1;
    require(rest_ < 4 * halt_ticks || v < 0.02, "homing does not come to rest");
    room_ = 1.0;  // it has left the workspace, and is let go
  }
  /// m outside of limits.workspace; 0 within.
  static double beyond(const Vec2<double>& p) {
    return std::max({left - 0.01 - p[0], p[0] - right - 0.01, low - 0.01 - p[1], p[1] - high - 0.01, 0.0});
  }

  std::mt19937_64& random_;
  std::uint64_t left_, sent_ = 0;
  Desk desk_;
  link::CommandLink link_;
  std::vector<link::CaptureRecord> memory_;
  ControlLoop loop_;
  std::uint32_t quiet_ = 0;
  int gone_ = 0, walking_ = 0, stuck_ = 0;
  std::uint32_t rest_ = 0;
  double room_ = 0.0;
  std::array<double, 2> walk_{}, walk_rate_{};
};

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) return 2;
  const std::uint64_t commands = std::strtoull(argv[1], nullptr, 10),
                      seed = std::strtoull(argv[2], nullptr, 10);
  std::mt19937_64 random(seed);
  std::uint64_t sent = 0, moved = 0, homing = 0, faults = 0, lost = 0, episodes = 0;
  try {
    for (; sent < commands; ++episodes) {
      Episode e(random, commands - sent);
      sent += e.run();
      moved += e.moved;
      homing += e.homing;
      faults += e.faults;
      lost += e.lost;
    }
  } catch (const std::string& what) {
    std::printf("episode %llu of seed %llu: %s\n", static_cast<unsigned long long>(episodes),
                static_cast<unsigned long long>(seed), what.c_str());
    return 1;
  }
  std::printf(
      "%llu commands in %llu episodes: in motion for %llu ticks, homing for %llu, %llu faults, %llu of them "
      "a lost console\n",
      static_cast<unsigned long long>(sent), static_cast<unsigned long long>(episodes),
      static_cast<unsigned long long>(moved), static_cast<unsigned long long>(homing),
      static_cast<unsigned long long>(faults), static_cast<unsigned long long>(lost));
  // A test that sends into a controller that never moves shows nothing.
  return moved * 4 > sent && homing > 0 && faults > 0 && lost > 0 && episodes < sent / 100 + 2 ? 0 : 1;
}
