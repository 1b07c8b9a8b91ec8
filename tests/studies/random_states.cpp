/// Random and hostile states, inputs, gains and limits through the controller: law, allocation, limits.
/// Whatever comes in, a torque is finite, within its motor's limit, and zero where it must be. Usage:
/// random_states TICKS [SEED]

#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <map>
#include <string>
#include <type_traits>

#include "firmware/cycle/instances.hpp"
#include "firmware/cycle/part_fusion.hpp"

namespace {

using namespace esmc;

/// splitmix64: the study's speed is that of its random numbers otherwise.
class Draw {
 public:
  explicit Draw(std::uint64_t seed) : state_(seed) {}
  std::uint64_t bits() {
    std::uint64_t z = state_ += 0x9E3779B97F4A7C15U;
    z = (z ^ (z >> 30U)) * 0xBF58476D1CE4E5B9U;
    z = (z ^ (z >> 27U)) * 0x94D049BB133111EBU;
    return z ^ (z >> 31U);
  }
  std::uint32_t below(std::uint32_t n) { return static_cast<std::uint32_t>(((bits() >> 32U) * n) >> 32U); }
  bool one_in(std::uint32_t n) { return below(n) == 0; }
  double uniform(double from, double to) {
    return from + (to - from) * static_cast<double>(bits() >> 11U) * 0x1p-53;
  }
  double magnitude(double from, double to) { return std::exp(uniform(std::log(from), std::log(to))); }
  double sign() { return one_in(2) ? 1.0 : -1.0; }

 private:
  std::uint64_t state_;
};

/// Any bit pattern, or one of the values that arithmetic is afraid of.
template <class S>
S hostile(Draw& d) {
  using L = std::numeric_limits<S>;
  constexpr S pi = S(3.14159265358979323846L);
  constexpr std::array special{S(0),     -S(0),       L::quiet_NaN(), L::infinity(),   -L::infinity(),
                               L::max(), L::lowest(), L::min(),       L::denorm_min(), L::epsilon(),
                               pi,       -pi,         pi / S(2),      -pi / S(2),      S(1e15L),
                               S(-1e30L)};
  const std::uint32_t i = d.below(24);
  if (i < special.size()) return special[i];
  using Bits = std::conditional_t<sizeof(S) == 4, std::uint32_t, std::uint64_t>;
  return std::bit_cast<S>(static_cast<Bits>(d.bits()));
}

struct Count {
  std::uint64_t ticks = 0, with_torque = 0, limited = 0, violations = 0;
  std::map<std::string, std::uint64_t> faults;
};

/// What is wrong in one configuration with everything that could be asked of it.
template <class M>
class Episode {
 public:
  using S = typename M::Scalar;
  static constexpr int ticks = 16;

  Episode(std::uint64_t seed, Count& count)
      : seed_(seed), draw_(seed), count_(count), config_(configuration()) {
    Controller<M> controller(config_);
    bool kept = false;
    Sample<M> sample;
    for (int i = 0; i < ticks; ++i) {
      Supervisor supervisor = powered(controller.supervision());
      sample = kept && !draw_.one_in(4) ? near(sample) : anywhere();
      kept = true;
      if (draw_.one_in(6)) spoil(sample);
      const TickResult<M> r = controller.tick(sample, supervisor);
      judge(sample, supervisor, r);
    }
  }

 private:
  S number(double from, double to) { return static_cast<S>(draw_.uniform(from, to)); }
  S size(double from, double to) {
    return draw_.one_in(400) ? hostile<S>(draw_) : static_cast<S>(draw_.magnitude(from, to));
  }

  LegParams<S> leg() {
    LegParams<S> p;
    const bool extreme = draw_.one_in(8);
    p.l1 = extreme ? size(1e-3, 1e3) : number(0.1, 0.4);
    p.l2 = draw_.one_in(4) ? p.l1 : number(0.1, 0.4);
    p.lg1 = p.l1 * number(-0.2, 1.1);
    p.lg2 = p.l2 * number(-0.2, 1.1);
    p.m1 = extreme ? size(1e-6, 1e6) : number(0.05, 1.0);
    p.m2 = extreme ? size(1e-6, 1e6) : number(0.05, 1.0);
    p.J1 = S(0.1) * p.m1 * p.l1 * p.l1;
    p.J2 = S(0.1) * p.m2 * p.l2 * p.l2;
    p.d1 = number(0.0, 0.03);
    p.d2 = number(0.0, 0.03);
    p.gamma1 = number(0.0, 0.05);
    p.gamma2 = number(0.0, 0.05);
    return p;
  }
  M mechanism() {
    const S g = draw_.one_in(3) ? S(0) : S(9.81);
    if constexpr (M::joints == 2) {
      return M({leg(), g});
    } else {
      FiveBarParams<S> p{.l0 = number(0.0, 0.1), .m0 = number(0.0, 1.0), .g = g, .legs = {leg(), leg()}};
      if (draw_.one_in(3)) p.legs[1] = p.legs[0];
      return M(p);
    }
  }

  ControllerConfig<M> configuration() {
    ControllerConfig<M> c;
    c.mechanism = mechanism();
    const auto mode = draw_.below(8);
    if constexpr (M::joints == 2) {
      c.mode = typename M::Mode{(mode & 1U) != 0 ? 1 : -1};
    } else {
      c.mode = {{{(mode & 1U) != 0 ? 1 : -1, (mode & 2U) != 0 ? 1 : -1}}, (mode & 4U) != 0 ? 1 : -1};
      if (draw_.one_in(3)) c.motors = Motors::all;
      c.allocate = allocation_for<M>(c.motors);
      if (draw_.one_in(3)) c.sensors = Sensors::all;
    }
    c.law = static_cast<LawKind>(draw_.below(5));
    c.reaching = static_cast<Reaching>(draw_.below(4));
    for (int i = 0; i < static_cast<int>(c.gains.lambda.size()); ++i) {
      c.gains.lambda[i] = size(1e-2, 1e4);
      c.gains.k[i] = size(1e-3, 1e6);
      c.gains.layer[i] = size(1e-9, 1e3);
    }
    c.gains.independent = {size(1e-2, 1e4), size(1e-3, 1e6), size(1e-9, 1e3), size(1e-3, 1e7),
                           size(1e-3, 1e4)};
    c.reference.kind =
        draw_.one_in(3) ? static_cast<ReferenceKind>(draw_.below(3)) : ReferenceKind::hold_start;
    c.reference.space = draw_.one_in(2) ? ReferenceSpace::effector : ReferenceSpace::base_joints;
    c.reference.centre = {number(-0.3, 0.3), number(-0.3, 0.5)};
    c.reference.amplitude = {number(0.0, 0.1), number(0.0, 0.1)};
    c.reference.speed = {number(-50, 50), number(-50, 50)};
    const bool wide = !draw_.one_in(3);  // as good as no limits, so that the law meets everything
    c.limits.min_abs_sin_type1 = wide ? S(0) : number(0.01, 0.3);
    c.limits.min_abs_sin_type2 = wide ? S(0) : number(0.01, 0.3);
    c.limits.joint_speed = wide ? std::numeric_limits<S>::max() : number(1, 50);
    c.limits.closure = wide ? std::numeric_limits<S>::max() : number(1e-4, 1e-2);
    c.limits.max_age_ticks = draw_.below(4);
    if (!wide && draw_.one_in(2)) c.limits.feedback_jump = number(1e-3, 0.5);
    for (int i = 0; i < M::joints; ++i) {
      c.torque_limit[i] = draw_.one_in(30) ? hostile<S>(draw_) : static_cast<S>(draw_.magnitude(1e-2, 1e7));
      c.torque_weight[i] = size(1e-3, 1e3);
    }
    c.sample_time = static_cast<S>(draw_.magnitude(1e-5, 1e-1));
    c.torque_lead = draw_.one_in(2) ? S(0) : c.sample_time * number(0, 2);
    c.join_ticks = draw_.one_in(2) ? 0 : draw_.below(50);
    c.ramp_ticks = draw_.one_in(2) ? 0 : draw_.below(50);
    c.halt_ticks = draw_.one_in(4) ? 0 : 1 + draw_.below(10);
    c.lower_ticks = draw_.below(10);
    c.after_halt = static_cast<AfterHalt>(draw_.below(3));
    c.sign_test_move = draw_.one_in(3) ? number(1e-3, 0.1) : S(0);
    c.setpoint_speed = c.setpoint_acceleration = number(0.1, 10.0);
    if (draw_.one_in(3)) with_parts(c);
    return c;
  }
  /// Optional parts, in the combinations that a scene can ask for.
  void with_parts(ControllerConfig<M>& c) {
    const bool extended = c.law == LawKind::esmc || c.law == LawKind::esmc_projected;
    c.delay_ticks = static_cast<S>(draw_.below(SuperTwisting<S>::most_delay + 1));
    c.lag_ticks = draw_.one_in(2) ? S(0) : number(0, 4);
    if ((extended || c.law == LawKind::smc) && draw_.one_in(3)) {
      c.reach = &part::super_twisting<M>;
    } else if (extended && draw_.one_in(2)) {
      c.reach = &part::implicit_coupled<M>;
    }
    if (draw_.one_in(2)) {
      c.observer = &part::momentum_observer<M>;
      c.observer_bandwidth = size(1e-2, 1e4);
    }
    if (draw_.one_in(2)) c.predict = &part::predictor<M>;
    if constexpr (M::joints == 4) {
      if (draw_.one_in(2)) {
        c.fuse = &part::closure_projection<M>;
        for (int i = 0; i < 4; ++i) c.encoder_variance[i] = size(1e-4, 1e4);
      }
      if (c.motors == Motors::all && draw_.one_in(2)) {
        for (int i = 0; i < 4; ++i) c.preload[i] = c.torque_limit[i] * number(-1, 1);
      }
    }
  }

  /// In one of the states in which there may be torque.
  Supervisor powered(const Supervisor::Config& config) {
    Supervisor s(config);
    s.begin_tick(Command::enable, {});
    s.begin_tick(Command::none, {.all_ready = true, .all_idle = false});
    if (config.sign_test && draw_.one_in(3)) return s;
    s.begin_tick(Command::none, {}, true);
    if (draw_.one_in(2)) return s;
    if (config.can_halt) s.begin_tick(Command::halt, {});
    if (draw_.one_in(2)) return s;
    s.begin_tick(Command::none, {}, config.after_halt != AfterHalt::release);
    return s;
  }

  /// A pose of the mechanism, mostly in its mode, where the base angles allow one.
  Sample<M> anywhere() {
    Sample<M> s = drawn();
    for (int i = 0; i < 12 && !fits(s); ++i) s = drawn();
    return s;
  }
  bool fits(const Sample<M>& s) const {
    constexpr int second = M::joints / 2;
    const auto e = estimate_from_base(config_.mechanism, config_.mode, Vec2<S>(s.angle[0], s.angle[second]),
                                      Vec2<S>(s.rate[0], s.rate[second]));
    return e && M::in_working_mode(e->pose, config_.mode);
  }
  Sample<M> drawn() {
    Sample<M> s;
    for (int i = 0; i < M::joints; ++i) {
      s.angle[i] = draw_.one_in(8)
                       ? S(1.5707963267948966L) * static_cast<S>(static_cast<int>(draw_.below(9)) - 4)
                       : number(-3.2, 3.2);
      s.rate[i] = draw_.one_in(8) ? S(0) : static_cast<S>(draw_.sign() * draw_.magnitude(1e-6, 1e3));
    }
    if constexpr (M::joints == 4) {
      if (draw_.one_in(4)) s.angle[2] = s.angle[0];  // symmetric: the way to type 2
    }
    close(s);
    return s;
  }
  Sample<M> near(Sample<M> s) {
    for (int i = 0; i < M::joints; ++i) {
      if (!(std::abs(s.rate[i]) < S(1e3))) s.rate[i] = S(0);
      if (!(std::abs(s.angle[i]) < S(10))) s.angle[i] = S(0);
      s.angle[i] += s.rate[i] * config_.sample_time;
      s.rate[i] += number(-0.1, 0.1);
    }
    s.age_ticks = {};
    s.phase = {};
    close(s);
    return s;
  }
  void close(Sample<M>& s) {
    if constexpr (M::joints == 4) {
      const auto e = estimate_from_base(config_.mechanism, config_.mode, Vec2<S>(s.angle[0], s.angle[2]),
                                        Vec2<S>(s.rate[0], s.rate[2]));
      if (!e) return;
      for (int leg = 0; leg < 2; ++leg) {
        const auto& turn = e->pose.leg[leg].turn[1];
        s.angle[2 * leg + 1] = std::atan2(turn.y(), turn.x());
      }
      s.rate[1] = number(-5, 5);
      s.rate[3] = number(-5, 5);
    }
  }
  void spoil(Sample<M>& s) {
    const auto joint = draw_.below(M::joints);
    switch (draw_.below(4)) {
      case 0:
        s.angle[static_cast<int>(joint)] = hostile<S>(draw_);
        break;
      case 1:
        s.rate[static_cast<int>(joint)] = hostile<S>(draw_);
        break;
      case 2:
        s.age_ticks[joint] = draw_.one_in(2) ? draw_.below(8) : static_cast<std::uint32_t>(draw_.bits());
        break;
      default:
        s.phase[joint] = hostile<S>(draw_);
        break;
    }
  }

  void judge(const Sample<M>& sample, const Supervisor& supervisor, const TickResult<M>& r) {
    ++count_.ticks;
    ++count_.faults[name(r.fault)];
    bool some = false, seen = true;
    for (int i = 0; i < M::joints; ++i) {
      const auto u = static_cast<unsigned>(i);
      const bool base = M::joints == 2 || i % 2 == 0;
      if (base || config_.sensors == Sensors::all) {
        seen = seen && std::isfinite(sample.angle[i]) && std::isfinite(sample.rate[i]) &&
               sample.age_ticks[u] <= config_.limits.max_age_ticks;
      }
      const S torque = r.torque[i], limit = config_.torque_limit[i];
      if (!std::isfinite(torque)) violation("is not finite", i, r);
      if (torque != S(0) && !(std::abs(torque) <= limit)) violation("is beyond its limit", i, r);
      if (torque != S(0) && !base && config_.motors != Motors::all) violation("has no motor", i, r);
      some = some || torque != S(0);
    }
    if (some && !seen) violation("comes from a sample that is stale or no number", 0, r);
    if (some && !supervisor.powered()) violation("without power", 0, r);
    if (some) ++count_.with_torque;
    if (r.saturated) ++count_.limited;
  }
  void violation(const char* what, int joint, const TickResult<M>& r) {
    ++count_.violations;
    std::printf("seed %llu: torque %g of joint %d in state %s %s\n", static_cast<unsigned long long>(seed_),
                static_cast<double>(r.torque[joint]), joint, name(r.state), what);
  }

  std::uint64_t seed_;
  Draw draw_;
  Count& count_;
  ControllerConfig<M> config_;
};

template <class M>
Count study(std::uint64_t ticks, std::uint64_t seed) {
  Count count;
  while (count.ticks < ticks) Episode<M>(seed++, count);
  return count;
}

void row(const char* mechanism, const Count& c) {
  std::printf("| %s | %llu | %llu | %llu | %llu |\n", mechanism, static_cast<unsigned long long>(c.ticks),
              static_cast<unsigned long long>(c.with_torque), static_cast<unsigned long long>(c.limited),
              static_cast<unsigned long long>(c.violations));
}

}  // namespace

int main(int argc, char** argv) {
  const std::uint64_t ticks = argc > 1 ? std::strtoull(argv[1], nullptr, 10) : 0;
  const std::uint64_t seed = argc > 2 ? std::strtoull(argv[2], nullptr, 10) : 1;
  if (ticks == 0) {
    std::fputs("usage: random_states TICKS [SEED]\n", stderr);
    return 2;
  }
  const std::array counts{study<FiveBar<double>>(ticks * 3 / 8, seed),
                          study<FiveBar<float>>(ticks * 3 / 8, seed), study<Rr<double>>(ticks / 8, seed),
                          study<Rr<float>>(ticks / 8, seed)};
  const std::array names{"5R, double", "5R, float", "RR, double", "RR, float"};
  std::puts("| mechanism, scalar | ticks | with torque | limited | violations |\n|---|---|---|---|---|");
  std::uint64_t violations = 0, with_torque = 0, limited = 0;
  std::map<std::string, std::uint64_t> faults;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    row(names[i], counts[i]);
    violations += counts[i].violations;
    with_torque += counts[i].with_torque;
    limited += counts[i].limited;
    for (const auto& [fault, n] : counts[i].faults) faults[fault] += n;
  }
  std::puts("\n| fault | ticks |\n|---|---|");
  for (const auto& [fault, n] : faults)
    std::printf("| %s | %llu |\n", fault.c_str(), static_cast<unsigned long long>(n));
  // A study that never reaches the law, or never its limits, shows nothing.
  return violations == 0 && with_torque > ticks / 8 && limited > ticks / 16 ? 0 : 1;
}
