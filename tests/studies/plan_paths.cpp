// Random programs on which every pose can be held with 80 % of the torque or less: each must get a timing,
// and its table must keep all limits. usage: plan_paths COUNT [FIRST_SEED]

#include <cstdio>
#include <cstdlib>

#include "host_sim/plan/limits.hpp"
#include "tests/support/program_problem.hpp"

namespace esmc::test {
namespace {

using host::MoveKind;
using host::plan::Problem;
using host::plan::Refused;

template <class M>
Vec2<double> random_point(Random& r, const Problem<M>& p) {
  if constexpr (M::joints == 4) {
    (void)p;
    return {r.in<double>(-0.11, 0.11), r.in<double>(0.11, 0.23)};
  } else {
    const double radius = r.in<double>(0.15, 0.5), angle = r.in<double>(-3.1, 3.1);
    (void)p;
    return {radius * std::cos(angle), radius * std::sin(angle)};
  }
}

template <class M>
Problem<M> random_program(Random& r) {
  auto p = at_rest<M>(0.0, 0.0, 1e6, r.chance(0.3));
  auto vary = [&](double v) { return v * r.in<double>(0.7, 1.4); };
  auto leg = [&](LegParams<double> l) {
    for (double LegParams<double>::*v :
         {&LegParams<double>::lg1, &LegParams<double>::lg2, &LegParams<double>::m1, &LegParams<double>::m2,
          &LegParams<double>::J1, &LegParams<double>::J2})
      l.*v = vary(l.*v);
    return l;
  };
  if constexpr (M::joints == 4) {
    FiveBarParams<double> m = five_bar_example();
    m.legs = {leg(m.legs[0]), leg(m.legs[1])};
    m.g = r.chance(0.3) ? 0.0 : 9.8;
    p.controller.mechanism = M(m);
    if (r.chance(0.4)) p.controller.mode = {{{r.sign(), r.sign()}}, r.sign()};
  } else {
    RrParams<double> m = rr_example();
    m.arm = leg(m.arm);
    m.g = r.chance(0.3) ? 0.0 : 9.8;
    p.controller.mechanism = M(m);
    p.controller.mode = {r.sign()};
  }
  if (r.chance(0.5))
    p.friction.viscous = {0.02 * r.in<double>(0, 1), 0.005, 0.02 * r.in<double>(0, 1), 0.005};
  if (r.chance(0.3)) p.friction.dry = {0.02, 0.005, 0.02, 0.005};
  p.start = random_point(r, p);
  const int moves = 1 + static_cast<int>(r.in<double>(0, 3.99));
  for (int i = 0; i < moves; ++i) {
    const Vec2<double> to = random_point(r, p), on = random_point(r, p);
    const double draw = r.in<double>(0, 1);
    host::MoveScene m = move(MoveKind::line, to.x(), to.y());
    if (draw > 0.7) m.kind = MoveKind::arc;
    if (draw > 0.85) m.kind = MoveKind::spline;
    m.via = {on.x(), on.y()};
    if (m.kind == MoveKind::spline) m.through = {{on.x(), on.y()}};
    if (draw < 0.25) {  // joint: to the pose of that point
      const auto pose = p.controller.mechanism.inverse(to, p.controller.mode);
      if (pose) {
        const Vec2<double> q = M::base_angles(*pose);
        m = move(MoveKind::joint, q[0], q[1]);
      }
    }
    if (i + 1 < moves && r.chance(0.6)) m.blend = r.in<double>(0.001, 0.02);
    if (r.chance(0.2)) m.acceleration = r.in<double>(5, 50);
    if (r.chance(0.2)) m.speed = r.in<double>(0.2, 3);
    p.moves.push_back(m);
  }
  return p;
}

/// Largest torque, N m, that a pose of the path takes at rest, every `step` of 10 s per move; negative: the
/// path is impossible.
template <class M>
double at_rest_along(Problem<M> p, double step) {
  p.controller.torque_limit.setConstant(1e6);
  for (auto& m : p.moves) {
    m.time = 10.0;
    m.speed = m.acceleration = std::nullopt;
  }
  p.friction = {};
  p.tick = step;
  double most = 0.0;
  try {
    const auto plan = host::plan::plan(p);
    Reference<double> path;
    path.kind = ReferenceKind::path;
    path.path = plan.path;
    for (std::uint32_t n = 0; n <= plan.ticks; ++n) {
      const auto pose = p.controller.mechanism.inverse(path.at(n, p.tick).position, p.controller.mode);
      if (!pose) return -1.0;
      const auto w = p.controller.mechanism.force(M::Channels::Zero().eval(), M::Rates::Zero());
      most = std::max(most, p.controller.mechanism.base_torque(*pose, w).cwiseAbs().maxCoeff());
    }
  } catch (const Refused&) {
    return -1.0;
  }
  return most;
}

/// Largest share of the torque at the ticks of a plan, each of them looked at.
template <class M>
double share_of_ticks(const Problem<M>& p, const host::plan::Plan& plan) {
  const host::plan::MotorLimits<M> motors(p);
  Reference<double> path;
  path.kind = ReferenceKind::path;
  path.path = plan.path;
  double most = 0.0;
  for (std::uint32_t n = 0; n <= plan.ticks; ++n) {
    const auto m = path.at(n, p.tick);
    const auto d = desired_at_effector(p.controller.mechanism, p.controller.mode, m.position, m.velocity,
                                       m.acceleration);
    if (!d) return 1e9;
    if (m.velocity.norm() == 0.0) continue;  // dry friction has no direction
    const auto [rest, drag, push] = motors.split(motors.models().back(), *d, motors.scale(d->pose));
    for (std::size_t i = 0; i < static_cast<std::size_t>(motors.count()); ++i)
      most = std::max(most, std::abs(rest[i] + drag[i] + push[i]));
  }
  return most;
}

struct Count {
  long tried = 0, solved = 0, kept = 0;
};

template <class M>
bool one(std::uint64_t seed, Count& count) {
  Random r(seed);
  Problem<M> p = random_program<M>(r);
  const double hold = at_rest_along(p, 0.02);
  if (hold < 0.0) return false;
  const double dry = 0.2 * (M::joints == 4 ? 0.3 : 3.0);  // moves where no weight is
  p.controller.torque_limit.setConstant(std::max(hold / 0.8, dry) * (1.0 + r.in<double>(0, 3)) + 0.2);
  ++count.tried;
  try {
    const auto plan = host::plan::plan(p);
    ++count.solved;
    double share = share_of_ticks(p, plan) - 1e-5;
    for (const auto& kind : plan.use) {
      for (const auto& use : kind) share = std::max(share, use.share);
    }
    count.kept += share <= 1.0 + 1e-9 ? 1 : 0;
    if (share > 1.0 + 1e-9)
      std::printf("seed %llu: share %.6f\n", static_cast<unsigned long long>(seed), share);
  } catch (const Refused& e) {
    if (at_rest_along(p, 0.0002) < 0.0) {  // it leaves the reach between the places that were looked at
      --count.tried;
      return false;
    }
    std::printf("seed %llu, move %zu: %s\n", static_cast<unsigned long long>(seed), e.move() + 1, e.what());
  }
  return true;
}

}  // namespace
}  // namespace esmc::test

int main(int argc, char** argv) {
  using namespace esmc;
  using namespace esmc::test;
  const long wanted = argc > 1 ? std::atol(argv[1]) : 100;
  Count count;
  for (std::uint64_t seed = argc > 2 ? std::strtoull(argv[2], nullptr, 10) : 1; count.tried < wanted;
       ++seed) {
    if (seed % 2 == 0)
      (void)one<FiveBar<double>>(seed, count);
    else
      (void)one<Rr<double>>(seed, count);
  }
  std::printf("%ld paths: %ld solved, %ld within all limits\n", count.tried, count.solved, count.kept);
  return count.solved == wanted && count.kept == wanted ? 0 : 1;
}
