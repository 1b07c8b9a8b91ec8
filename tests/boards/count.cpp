/// Image of an emulated board that counts its own instructions: whole ticks of the cycle, frames in to frames
/// out, in random states of all working and assembly modes, law by law. Prints
/// a line per law, a line per optional part, then "done".

#include <cstdint>
#include <cstring>
#include <iterator>
#include <new>
#include <optional>

#include "scene.hpp"
#include "tests/boards/mps2_console.hpp"
#include "tests/support/odrive_bytes.hpp"

namespace {

using namespace esmc;
using S = baked::Scalar;
using M = baked::Mechanism;
using Node = baked::Node;

/// Frames wait in an array: the cost of a CAN controller's registers is not the cycle's.
class ArrayBus {
 public:
  /// Written down: a frame that nobody reads is one that the compiler does not make.
  hal::SendStatus try_send(const hal::CanFrame& f) {
    hal::CanFrame& to = out[sent++ % 8U];
    to.id = f.id;
    to.size = f.size;
    std::memcpy(to.data.data(), f.data.data(), hal::can_classic_size_max);
    return hal::SendStatus::ok;
  }
  bool try_receive(hal::CanFrame& f) {
    if (next == end) return false;
    const hal::CanFrame& from = *next++;  // as many bytes as a classic controller hands over
    f.id = from.id;
    f.extended = f.remote = f.fd = f.bit_rate_switch = false;
    f.size = from.size;
    std::memcpy(f.data.data(), from.data.data(), hal::can_classic_size_max);
    return true;
  }
  void offer(const hal::CanFrame& f) { *end++ = f; }
  void clear() { next = end = in; }
  hal::CanFrame in[8], out[8];
  hal::CanFrame *next = in, *end = in;
  unsigned sent = 0;
};

/// Numerical Recipes' quick generator: enough to scatter states.
class Random {
 public:
  S between(S a, S b) {
    state_ = 1664525U * state_ + 1013904223U;
    return a + (b - a) * S(state_ >> 8U) * S(0x1p-24F);
  }
  bool coin() { return between(S(0), S(1)) < S(0.5F); }

 private:
  std::uint32_t state_ = 1;
};

constexpr S turn = S(6.283185307F);

template <class M>
struct State {
  typename M::Mode mode{};
  Vec<S, M::joints> angle, rate;
};

/// Effector anywhere in reach of the circle's neighbourhood, bars bent either way; not at a singularity.
template <class M>
std::optional<State<M>> draw(const M& m, Random& r) {
  State<M> s;
  Vec2<S> base;
  if constexpr (M::joints == 4) {
    s.mode.working = {{{r.coin() ? 1 : -1, r.coin() ? 1 : -1}}};
    s.mode.assembly = 1;
    const Vec2<S> effector(r.between(S(-0.12F), S(0.12F)), r.between(S(0.05F), S(0.24F)));
    const auto pose = m.inverse(effector, s.mode);
    if (!pose || M::min_abs_sin_type1(*pose) < S(0.1F) || M::abs_sin_type2(*pose) < S(0.2F))
      return std::nullopt;
    s.mode.assembly = pose->sin_type2 > S(0) ? 1 : -1;
    s.angle = M::angles(*pose);
    base = M::base_angles(*pose);
  } else {
    s.mode.working = r.coin() ? 1 : -1;
    s.angle = base = Vec2<S>(r.between(S(-3), S(3)), r.between(S(0.3F), S(2.8F)) * S(s.mode.working));
  }
  // Thrown off the reference, every channel at its limit, or on it, every channel within its layer.
  const S fastest = r.coin() ? S(2) : S(0.002F);
  const Vec2<S> base_rate(r.between(-fastest, fastest), r.between(-fastest, fastest));
  if constexpr (M::joints == 4) {
    typename M::Pose pose;
    typename M::Rates rates;
    if (!estimate_from_base(m, s.mode, base, base_rate, pose, rates)) return std::nullopt;
    s.rate << rates.leg[0], rates.leg[1];
  } else {
    s.rate = base_rate;
  }
  return s;
}

/// Motors alone, or four axes on all joints.
void offer(ArrayBus& bus, const State<M>& s, int axes, std::uint8_t state, bool heartbeat) {
  bus.clear();
  for (int i = 0; i < axes; ++i) {
    const auto node = static_cast<unsigned>(i) + 1U;
    const int joint = ControllerConfig<M>::joint_of(i, axes);
    if (heartbeat) bus.offer(test::heartbeat(node, state));
    bus.offer(test::encoder(node, static_cast<float>(s.angle[joint] / turn),
                            static_cast<float>(s.rate[joint] / turn)));
  }
}

struct Counts {
  std::uint32_t states = 0, most = 0, least = 0xFFFF'FFFFU;
  std::uint64_t sum = 0;
  void add(std::uint32_t timer_counts) {
    const std::uint32_t instructions = (timer_counts * 5U) / 8U;
    ++states;
    sum += instructions;
    most = instructions > most ? instructions : most;
    least = instructions < least ? instructions : least;
  }
};

/// Timer counts of a tick. It lies where an image has its loop: in the fast memory, without far calls
/// (boards/cortex_m/sections.ld).
[[gnu::noinline, gnu::section(".text._ZN4esmc9TimedLoop.tick")]] std::uint32_t counts_of_tick(
    Node& node, ArrayBus& bus, const Timer& timer) {
  const std::uint32_t begin = timer.now();
  node.receive(bus);
  node.tick(bus);
  return timer.now() - begin;
}

/// One tick in a state of the run that follows `arming` others; false: it did not get there.
bool measure(const Node::Config& config, const State<M>& s, ArrayBus& bus, const Timer& timer,
             Counts& counts) {
  static Node* node = nullptr;
  alignas(Node) static unsigned char memory[sizeof(Node)];
  node = ::new (static_cast<void*>(memory)) Node(config);
  node->command(Command::enable);
  for (int n = 0; n < 12; ++n) {
    offer(bus, s, config.axis_count, n < 1 ? test::axis_idle : test::axis_closed_loop, true);
    node->receive(bus);
    node->tick(bus);
    if (node->supervisor().fault() != Fault::none) return false;
    if (node->supervisor().running() && node->controller().config().join_ticks == 0 && n >= 4) break;
  }
  if (!node->supervisor().running()) return false;
  offer(bus, s, config.axis_count, test::axis_closed_loop, true);
  const std::uint32_t counted = counts_of_tick(*node, bus, timer);
  if (!node->supervisor().running()) return false;
  counts.add(counted);
  return true;
}

void print(Text& out, const char* name, std::uint32_t refused, const Counts& counts) {
  out << name << " states " << counts.states << " refused " << refused << " least " << counts.least
      << " mean " << static_cast<std::uint32_t>(counts.sum / (counts.states > 0 ? counts.states : 1U))
      << " most " << counts.most << "\n";
}

/// Counts a tick in each of `states` states and prints a line.
void report(Text& out, const char* name, Node::Config& config, std::uint32_t states, ArrayBus& bus,
            const Timer& timer) {
  Counts counts;
  Random random;
  std::uint32_t drawn = 0, refused = 0;
  while (drawn < states) {
    const auto s = draw(config.controller.mechanism, random);
    if (!s) continue;
    ++drawn;
    config.controller.mode = s->mode;
    if (!measure(config, *s, bus, timer, counts)) ++refused;
  }
  print(out, name, refused, counts);
}

/// Four axes instead of the two motors.
void on_all_joints(Node::Config& c) {
  c.axis_count = 4;
  for (unsigned i = 0; i < 4; ++i) {
    const drive::AxisConfig mount{static_cast<std::uint8_t>(i + 1U), 1.0F, 1.0F, 0.0F};
    c.axes[i] = drive::OdriveAxis(mount, drive::odrive::Version::v0_6, 150U, {});
    c.axes[i].restarts_within(30U);
  }
  c.controller.torque_limit.setConstant(c.controller.torque_limit[0]);
  c.controller.torque_weight.setConstant(c.controller.torque_weight[0]);
}

/// The optional parts of the controller, with the law esmc.
struct Option {
  const char* name;
  void (*add)(Node::Config&);
};
constexpr auto super_twisting = [](Node::Config& c) { c.controller.reach = &part::super_twisting<M>; };
constexpr auto implicit_coupled = [](Node::Config& c) { c.controller.reach = &part::implicit_coupled<M>; };
constexpr auto elbow_rotors = [](Node::Config& c) {
  auto with_rotors = baked::believed;
  for (auto& leg : with_rotors.legs) leg.rotor2 = S(5e-5F);
  c.controller.mechanism = M(with_rotors);
  c.controller.reach = &part::elbow_rotors<M>;
};
constexpr auto motor_map = [](Node::Config& c) {
  c.controller.correct = &part::motor_map<M>;
  c.controller.motor_map.amplitude.setConstant(S(0.01F));
  c.controller.motor_map.per_turn.setConstant(S(14));
};
constexpr auto momentum_observer = [](Node::Config& c) {
  c.controller.observer = &part::momentum_observer<M>;
  c.controller.observer_bandwidth = S(50);
};
constexpr auto predictor = [](Node::Config& c) {
  c.controller.predict = &part::predictor<M>;
  c.controller.delay_ticks = S(2);
};
constexpr auto closure_projection = [](Node::Config& c) {
  on_all_joints(c);
  c.controller.sensors = Sensors::all;
  c.controller.fuse = &part::closure_projection<M>;
  c.controller.encoder_variance.setOnes();
};
constexpr auto four_motors = [](Node::Config& c) {
  on_all_joints(c);
  c.controller.motors = Motors::all;
  c.controller.allocate = allocation_for<M>(Motors::all);
};
constexpr Option options[] = {{"super_twisting", super_twisting},
                              {"implicit_coupled", implicit_coupled},
                              {"elbow_rotors", elbow_rotors},
                              {"motor_map", motor_map},
                              {"momentum_observer", momentum_observer},
                              {"predictor", predictor},
                              {"closure_projection", closure_projection},
                              {"four_motors", four_motors},
                              {"largest", [](Node::Config& c) {
                                 super_twisting(c);
                                 motor_map(c);
                                 momentum_observer(c);
                                 predictor(c);
                                 closure_projection(c);
                               }}};

/// The generator of set points by itself, in motion, with the longest filter: a new set point, and a tick.
[[gnu::noinline]] void report_set_points(Text& out, std::uint32_t states, const Timer& timer) {
  static SetpointGenerator<S> g;
  g = SetpointGenerator<S>(S(0.5F), S(5), S(1e-3F), {true, true}, 64);
  g.activate(true);
  g.start(Vec2<S>::Zero(), Vec2<S>::Zero());
  Counts fresh, tick;
  Random random;
  static Motion2<S> motion;
  for (std::uint32_t i = 0; i < states; ++i) {
    const Vec2<S> target(random.between(S(-0.3F), S(0.3F)), random.between(S(-0.3F), S(0.3F)));
    // After a stream the filter begins anew: the most that a set point can cost.
    if (random.between(S(0), S(1)) < S(0.1F)) g.follow(target, Vec2<S>(S(0.1F), S(0)));
    const std::uint32_t begin = timer.now();
    g.go_to(target);
    fresh.add(timer.now() - begin);
    for (int n = static_cast<int>(random.between(S(1), S(150))); n > 0; --n) {
      const std::uint32_t from = timer.now();
      motion = g.at();
      asm volatile("" : : "r"(&motion) : "memory");  // all of it is wanted
      g.advance();
      tick.add(timer.now() - from);
    }
  }
  print(out, "new_set_point", 0, fresh);
  print(out, "set_point_tick", 0, tick);
}

}  // namespace

extern "C" {
/// Set by the emulator before the start. The laws to count, one bit each in the order below; 0: all. Random
/// states per law; 0: ESMC_STATES.
[[gnu::section(".noinit"), gnu::used]] volatile std::uint32_t esmc_laws_to_count, esmc_states_to_count;
}

extern "C" [[noreturn]] void esmc_main() {
  static Uart port(0x4000'4000U);
  static ArrayBus bus;
  const Timer timer;
  Text out{port};
  struct Law {
    const char* name;
    LawKind kind;
  };
  const std::uint32_t given = esmc_states_to_count, all_states = given != 0 ? given : ESMC_STATES;
  constexpr Law laws[] = {{"esmc", LawKind::esmc},
                          {"esmc_projected", LawKind::esmc_projected},
                          {"smc", LawKind::smc},
                          {"ctc", LawKind::ctc},
                          {"pd", LawKind::pd}};
  static Node::Config config = baked::config(1);
  config.controller.limits.joint_speed = S(1e3F);
  config.controller.limits.workspace_x = config.controller.limits.workspace_y = {};
  config.controller.limits.joint_angle = {};
  for (std::size_t i = 0; i < std::size(laws); ++i) {
    const Law& law = laws[i];
    if (esmc_laws_to_count != 0 && (esmc_laws_to_count >> i & 1U) == 0) continue;
    config.controller.law = law.kind;
    report(out, law.name, config, all_states, bus, timer);
  }
  config.controller.law = LawKind::esmc;
  const std::uint32_t states = all_states / 50U;
  for (const Option& option : options) {
    if (states == 0) break;
    static Node::Config with;
    with = config;
    option.add(with);
    report(out, option.name, with, states, bus, timer);
  }
  if (states != 0) report_set_points(out, states, timer);
  out << "done\n";
  for (;;) {
  }
}
