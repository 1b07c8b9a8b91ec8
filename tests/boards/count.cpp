/// Image of an emulated board that counts its own instructions: whole ticks of the cycle, frames in to frames
/// out, in random states of all working and assembly modes, law by law. With QEMU's -icount shift=6 an
/// instruction takes 64 ns of virtual time and the 25 MHz timer counts 1.6 per instruction. Prints a line per
/// law, then "done".

#include <cstdint>
#include <cstring>
#include <new>
#include <optional>

#include "boards/mps2/board.hpp"
#include "scene.hpp"
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

class Timer {
 public:
  Timer() {
    reg(base + 8U) = 0xFFFF'FFFFU;
    reg(base + 4U) = 0xFFFF'FFFFU;
    reg(base) = 1U;
  }
  [[nodiscard]] std::uint32_t now() const { return 0xFFFF'FFFFU - reg(base + 4U); }

 private:
  static constexpr std::uint32_t base = 0x4000'0000U;
};

struct Text {
  Uart& port;
  void put(char c) {
    while (!port.try_write({&c, 1})) {
    }
  }
  Text& operator<<(const char* s) {
    for (; *s != '\0'; ++s) put(*s);
    return *this;
  }
  Text& operator<<(std::uint32_t v) {
    if (v >= 10U) *this << v / 10U;
    put(static_cast<char>('0' + v % 10U));
    return *this;
  }
};

constexpr S turn = S(6.283185307F);

template <class M>
struct State {
  typename M::Mode mode{};
  Vec2<S> angle, rate;
};

/// Effector anywhere in reach of the circle's neighbourhood, bars bent either way; not at a singularity.
template <class M>
std::optional<State<M>> draw(const M& m, Random& r) {
  State<M> s;
  if constexpr (M::joints == 4) {
    s.mode.working = {{{r.coin() ? 1 : -1, r.coin() ? 1 : -1}}};
    s.mode.assembly = 1;
    const Vec2<S> effector(r.between(S(-0.12F), S(0.12F)), r.between(S(0.05F), S(0.24F)));
    const auto pose = m.inverse(effector, s.mode);
    if (!pose || M::min_abs_sin_type1(*pose) < S(0.1F) || M::abs_sin_type2(*pose) < S(0.2F))
      return std::nullopt;
    s.mode.assembly = pose->sin_type2 > S(0) ? 1 : -1;
    s.angle = M::base_angles(*pose);
  } else {
    s.mode.working = r.coin() ? 1 : -1;
    s.angle = Vec2<S>(r.between(S(-3), S(3)), r.between(S(0.3F), S(2.8F)) * S(s.mode.working));
  }
  // Thrown off the reference, every channel at its limit, or on it, every channel within its layer.
  const S fastest = r.coin() ? S(2) : S(0.002F);
  s.rate = Vec2<S>(r.between(-fastest, fastest), r.between(-fastest, fastest));
  return s;
}

void offer(ArrayBus& bus, const State<M>& s, std::uint8_t state, bool heartbeat) {
  bus.clear();
  for (unsigned i = 0; i < 2; ++i) {
    if (heartbeat) bus.offer(test::heartbeat(i + 1, state));
    bus.offer(test::encoder(i + 1, static_cast<float>(s.angle[static_cast<int>(i)] / turn),
                            static_cast<float>(s.rate[static_cast<int>(i)] / turn)));
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

/// One tick in a state of the run that follows `arming` others; false: it did not get there.
bool measure(const Node::Config& config, const State<M>& s, ArrayBus& bus, const Timer& timer,
             Counts& counts) {
  static Node* node = nullptr;
  alignas(Node) static unsigned char memory[sizeof(Node)];
  node = ::new (static_cast<void*>(memory)) Node(config);
  node->command(Command::enable);
  for (int n = 0; n < 12; ++n) {
    offer(bus, s, n < 1 ? test::axis_idle : test::axis_closed_loop, true);
    node->receive(bus);
    node->tick(bus);
    if (node->supervisor().fault() != Fault::none) return false;
    if (node->supervisor().running() && node->controller().config().join_ticks == 0 && n >= 4) break;
  }
  if (!node->supervisor().running()) return false;
  offer(bus, s, test::axis_closed_loop, true);
  const std::uint32_t begin = timer.now();
  node->receive(bus);
  node->tick(bus);
  const std::uint32_t end = timer.now();
  if (!node->supervisor().running()) return false;
  counts.add(end - begin);
  return true;
}

}  // namespace

extern "C" [[noreturn]] void esmc_main() {
  static Uart port(0x4000'4000U);
  static ArrayBus bus;
  const Timer timer;
  Text out{port};
  struct Law {
    const char* name;
    LawKind kind;
  };
  constexpr Law laws[] = {{"esmc", LawKind::esmc},
                          {"esmc_projected", LawKind::esmc_projected},
                          {"smc", LawKind::smc},
                          {"ctc", LawKind::ctc},
                          {"pd", LawKind::pd}};
  static Node::Config config = baked::config(1);
  config.controller.limits.joint_speed = S(1e3F);
  config.controller.limits.workspace_x = config.controller.limits.workspace_y = {};
  config.controller.limits.joint_angle = {};
  for (const Law& law : laws) {
    config.controller.law = law.kind;
    Counts counts;
    Random random;
    std::uint32_t drawn = 0, refused = 0;
    while (drawn < ESMC_STATES) {
      const auto s = draw(config.controller.mechanism, random);
      if (!s) continue;
      ++drawn;
      config.controller.mode = s->mode;
      if (!measure(config, *s, bus, timer, counts)) ++refused;
    }
    out << law.name << " states " << counts.states << " refused " << refused << " least " << counts.least
        << " mean " << static_cast<std::uint32_t>(counts.sum / (counts.states > 0 ? counts.states : 1U))
        << " most " << counts.most << "\n";
  }
  out << "done\n";
  for (;;) {
  }
}
