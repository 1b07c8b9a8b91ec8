#include "tests/benchmarks/batch_yardstick.hpp"

#include "firmware/cycle/estimate.hpp"
#include "host_sim/plant/five_bar_plant.hpp"
#include "host_sim/sweep/lanes/controller.hpp"

namespace esmc::host {

/// As the sines of one angle, several.
template <int N, class Tag, std::size_t K>
[[nodiscard]] auto sin_cos(const std::array<Lanes<N, Tag>, K>& angle) {
  struct {
    std::array<Lanes<N, Tag>, K> sin, cos;
  } out;
  for (std::size_t i = 0; i < K; ++i) {
    const auto a = ieee::sin_cos_in_range(angle[i]);
    out.sin[i] = a.sin;
    out.cos[i] = a.cos;
  }
  return out;
}

}  // namespace esmc::host

#include "tests/benchmarks/straight_line.hpp"

namespace esmc::bench {
namespace {

struct Isa {};
using L = host::Lanes<batch_lanes, Isa>;
using M = FiveBar<L>;
using Plant = host::FiveBarPlantOf<host::BothLegs<L>, L>;
using State = std::array<L, 8>;  // angles and rates of the bars

/// `to` becomes the number of each lane, `of` being a struct of numbers.
template <class To, class F>
To gather(const F& of) {
  constexpr std::size_t numbers = sizeof(To) / sizeof(L);  // NOLINT(bugprone-sizeof-expression)
  std::array<L, numbers> out;
  for (int lane = 0; lane < batch_lanes; ++lane) {
    const auto from = std::bit_cast<std::array<double, numbers>>(of(lane));
    for (std::size_t i = 0; i < numbers; ++i) out[i].v[lane] = from[i];
  }
  return std::bit_cast<To>(out);
}

Gains<M> gains(const host::LaneCase* cases) {
  Gains<M> out;
  for (int i = 0; i < M::channels; ++i) {
    out.lambda[i] = gather<L>([&](int l) { return cases[l].controller.gains.lambda[i]; });
    out.k[i] = gather<L>([&](int l) { return cases[l].controller.gains.k[i]; });
    out.layer[i] = gather<L>([&](int l) { return cases[l].controller.gains.layer[i]; });
  }
  return out;
}

inline void slope(const Plant& plant, const State& y, const std::array<L, 4>& torque, State& dy) {
  const auto a = plant.acceleration({y[0], y[1], y[2], y[3]}, {y[4], y[5], y[6], y[7]}, torque);
  for (std::size_t i = 0; i < 4; ++i) {
    dy[i] = y[4 + i];
    dy[4 + i] = a[i];
  }
}

inline void rk4(const Plant& plant, double h, const std::array<L, 4>& torque, bool restored, State& y) {
  State k1, k2, k3, k4, at;
  slope(plant, y, torque, k1);
  for (std::size_t i = 0; i < 8; ++i) at[i] = y[i] + 0.5 * h * k1[i];
  slope(plant, at, torque, k2);
  for (std::size_t i = 0; i < 8; ++i) at[i] = y[i] + 0.5 * h * k2[i];
  slope(plant, at, torque, k3);
  for (std::size_t i = 0; i < 8; ++i) at[i] = y[i] + h * k3[i];
  slope(plant, at, torque, k4);
  for (std::size_t i = 0; i < 8; ++i) y[i] += h / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]);
  if (!restored) return;
  std::array<L, 4> angle{y[0], y[1], y[2], y[3]}, rate{y[4], y[5], y[6], y[7]};
  plant.project(angle, rate);
  for (std::size_t i = 0; i < 4; ++i) {
    y[i] = angle[i];
    y[4 + i] = rate[i];
  }
}

}  // namespace

#ifdef ESMC_ROUNDED
constexpr bool rounded = true;
#define batch_yardstick batch_rounded  // NOLINT(cppcoreguidelines-macro-usage)
#else
constexpr bool rounded = false;
#endif

[[gnu::flatten]] void batch_yardstick(const host::LaneSettings& s, const host::LaneCase* cases,
                                      BatchScore& out) {
  const auto believed = gather<FiveBarParams<L>>([&](int lane) { return cases[lane].believed; });
  const M mechanism(believed);
  const Plant plant(gather<FiveBarParams<L>>([&](int lane) { return cases[lane].plant; }));
  const test::StraightEsmc<L> law(believed, gains(cases));
  const M::Mode mode{{s.working_mode[0], s.working_mode[1]}, s.assembly_mode};
  const auto limit = gather<std::array<L, 2>>([&](int lane) {
    return std::array<double, 2>{cases[lane].controller.torque_limit[0],
                                 cases[lane].controller.torque_limit[2]};
  });
  State y = gather<State>([&](int lane) {
    std::array<double, 8> start{};
    for (std::size_t i = 0; i < 4; ++i) {
      start[i] = cases[lane].angle[i];
      start[4 + i] = cases[lane].rate[i];
    }
    return start;
  });
  L sum(0.0);
  for (std::uint32_t tick = 0; tick < s.ticks; ++tick) {
    const Motion2<double> r = cases->reference.at(tick);  // one for all
    Tracking<M> t;
    const auto theta = Plant::joint_angles({y[0], y[1], y[2], y[3]}),
               w = Plant::joint_rates({y[4], y[5], y[6], y[7]});
    (void)estimate_from_base(mechanism, mode, Vec2<L>(theta[0], theta[2]), Vec2<L>(w[0], w[2]), t.pose,
                             t.rates);
    (void)desired_at_effector(mechanism, mode, Vec2<L>(r.position[0], r.position[1]),
                              Vec2<L>(r.velocity[0], r.velocity[1]),
                              Vec2<L>(r.acceleration[0], r.acceleration[1]), t.desired_pose, t.desired_rates,
                              t.desired_acceleration);
    const auto asked = law(t);
    std::array<L, 4> torque{L(0.0), L(0.0), L(0.0), L(0.0)};
    for (std::size_t i = 0; i < 2; ++i) {
      const L bound = limit[i];
      torque[2 * i] = choose(asked[i] > bound, bound, choose(asked[i] < -bound, -bound, asked[i]));
    }
    const auto at = plant.effector_point({y[0], y[1], y[2], y[3]}, {y[4], y[5], y[6], y[7]}).position;
    const host::Planar<L> miss = at - host::Planar<L>{L(r.position[0]), L(r.position[1])};
    sum += dot(miss, miss);
    for (int i = 0; i < s.steps; ++i) rk4(plant, s.step, torque, rounded, y);
  }
  sum.store(out.data());
}

}  // namespace esmc::bench
