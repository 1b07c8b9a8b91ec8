/// The whole control cycle on two drives of tests/examples/acme_axis.hpp, which the bench holds where they
/// are.

#include <array>
#include <cstdio>
#include <deque>

#include "firmware/cycle/instances.hpp"
#include "tests/examples/acme_axis.hpp"

using Arm = esmc::Rr<double>;
using Node = esmc::Cycle<Arm, acme::AcmeAxis>;

/// A bus with the drives at its other end: every command is answered by a reply, from an angle that does not
/// change.
struct Bench {
  std::array<float, 2> angle{-1.0F, 1.5F}, torque{};
  std::deque<esmc::hal::CanFrame> replies;

  esmc::hal::SendStatus try_send(const esmc::hal::CanFrame& f) {
    const std::size_t drive = f.id - 0x101U;
    std::uint32_t bits = 0;
    for (unsigned i = 0; i < 4; ++i) bits |= static_cast<std::uint32_t>(f.data[1 + i]) << 8 * i;
    torque.at(drive) = std::bit_cast<float>(bits);
    reply(drive, f.data[0]);
    return esmc::hal::SendStatus::ok;
  }
  bool try_receive(esmc::hal::CanFrame& f) {
    if (replies.empty()) return false;
    f = replies.front();
    replies.pop_front();
    return true;
  }
  void reply(std::size_t drive, std::uint8_t mode) {
    esmc::hal::CanFrame f;
    f.id = 0x181U + static_cast<std::uint32_t>(drive);
    f.size = 8;
    const auto bits = std::bit_cast<std::uint32_t>(angle.at(drive));
    for (unsigned i = 0; i < 4; ++i) f.data[i] = static_cast<std::uint8_t>(bits >> 8 * i);
    f.data[6] = mode;
    replies.push_back(f);
  }
};

int main() {
  Node::Config config;
  esmc::ControllerConfig<Arm>& c = config.controller;
  c.mechanism = Arm(
      {.arm =
           {.l1 = 0.30, .l2 = 0.25, .lg1 = 0.15, .lg2 = 0.11, .m1 = 1.2, .m2 = 0.8, .J1 = 0.01, .J2 = 0.0045},
       .g = 9.8});
  c.mode.working = +1;
  c.gains.lambda.setConstant(30.0);
  c.gains.k.setConstant(80.0);
  c.gains.layer.setConstant(esmc::implicit_layer(80.0, 1e-3, 0.0));
  c.limits.min_abs_sin_type1 = 0.05;
  c.limits.joint_speed = 20.0;
  c.torque_limit = {15.0, 6.0};
  c.sample_time = 1e-3;
  config.axes = {acme::AcmeAxis({.node = 1}), acme::AcmeAxis({.node = 2})};
  config.heartbeat_age_ticks_max = 3;

  Node node(config);
  Bench bench;
  node.command(esmc::Command::enable);
  for (int tick = 0; tick < 20; ++tick) {
    node.receive(bench);
    node.tick(bench);
  }
  std::printf("%s: %.4f %.4f N m\n", esmc::name(node.supervisor().state()),
              static_cast<double>(bench.torque[0]), static_cast<double>(bench.torque[1]));
  return node.supervisor().state() == esmc::State::running ? 0 : 1;
}
