#include "host_sim/controller/robust.hpp"

#include <numbers>

#include "host_sim/controller/numbers.hpp"
#include "host_sim/error.hpp"
#include "host_sim/stop.hpp"

namespace esmc::host {
namespace {

using design::Point;
using design::Problem;

constexpr std::uint32_t stretch_points = 1024;     ///< of the way onto a reference, and of one period of it
constexpr std::uint32_t segment_points = 64;       ///< of a piece of a path, where that makes more
constexpr std::uint32_t reference_points = 32768;  ///< at most
constexpr int grid = 14;                           ///< places of a workspace per axis

template <class M>
Motion2<double> start_of(const Scene& scene, const ControllerConfig<M>& c) {
  Vec2<double> angle, rate;
  for (int i = 0; i < 2; ++i) {
    const auto joint = static_cast<std::size_t>(ControllerConfig<M>::joint_of(i, 2));
    angle[i] = scene.start_angle[joint];
    rate[i] = scene.start_rate[joint];
  }
  if (c.reference.space == ReferenceSpace::base_joints) return {angle, rate, Vec2<double>::Zero()};
  typename M::Pose pose;
  typename M::Rates rates;
  if (!estimate_from_base(c.mechanism, c.mode, angle, rate, pose, rates)) {
    throw InputError(scene.control_where,
                     "the mechanism that the controller believes cannot stand where the scene starts");
  }
  return {pose.effector, c.mechanism.tip_rate(pose, rates), Vec2<double>::Zero()};
}

/// Ticks after which a reference begins again; 0: never.
std::uint32_t period_of(const Reference<double>& r, double tick) {
  const auto turn = [&](double speed) {
    return std::ceil(2.0 * std::numbers::pi / (std::abs(speed) * tick));
  };
  double ticks = 0.0;
  if (r.kind == ReferenceKind::path) ticks = r.repeat_ticks;
  if (r.kind == ReferenceKind::circle && r.speed[0] != 0.0) ticks = turn(r.speed[0]);
  if (r.kind == ReferenceKind::sine) {
    const double slow = std::min(std::abs(r.speed[0]), std::abs(r.speed[1])),
                 fast = std::max(std::abs(r.speed[0]), std::abs(r.speed[1]));
    for (int n = 1; n <= 32 && slow > 0.0 && ticks == 0.0;
         ++n) {  // the fast one turns whole times in n slow turns
      const double turns = n * fast / slow;
      if (std::abs(turns - std::round(turns)) < 1e-9 * turns) ticks = n * turn(slow);
    }
    if (slow == 0.0 && fast > 0.0) ticks = turn(fast);
  }
  return ticks < 4e9 ? static_cast<std::uint32_t>(ticks) : 0U;
}

/// The way onto the reference, then one period of it.
template <class M>
void along_reference(const Scene& scene, Problem<M>& p, std::uint32_t join_ticks) {
  const auto& c = p.controller;
  JoinedReference<double> reference(c.reference, join_ticks, c.sample_time);
  reference.start(p.start.position, p.start.velocity);
  const auto late = 1U + static_cast<std::uint32_t>(std::ceil(p.told_ticks));
  // Ticks that are left out are unevenly spaced: an even spacing may be in step with the motion.
  const auto look = [&](std::uint32_t from, std::uint32_t to, std::uint32_t most) {
    const double width = std::max(1.0, static_cast<double>(to - from) / most);
    constexpr double golden = 0.6180339887498949;
    for (std::uint32_t k = 0; k * width < to - from; ++k) {
      const double uneven = width > 1.0 && k > 0 ? k * golden - std::floor(k * golden) : 0.0;
      const auto n = std::min(to - 1U, from + static_cast<std::uint32_t>((k + uneven) * width));
      p.points.push_back({n * scene.tick(), reference.at(n), reference.at(n > late ? n - late : 0)});
    }
  };
  const std::uint32_t ticks = std::max(1U, tick_count(scene)), joined = std::min(join_ticks, ticks),
                      period = period_of(c.reference, c.sample_time);
  look(0, joined, stretch_points);
  p.joining = p.points.size();
  // `late` more: until then torques of the way there still act.
  const std::uint32_t end = period > 0 && period + late < ticks - joined ? joined + period + late : ticks;
  const double pieces = period == 0 && c.reference.kind == ReferenceKind::sine
                            ? (end - joined) * c.sample_time * c.reference.speed.cwiseAbs().maxCoeff() / 6.28
                            : static_cast<double>(c.reference.path.size());
  look(joined, end,
       std::max(stretch_points,
                static_cast<std::uint32_t>(std::min<double>(pieces * segment_points, reference_points))));
  Tracking<M> t;
  for (const Point& at : p.points) {
    if (desired(p, at.now, t)) continue;
    refuse_at(scene.reference_where, "the reference leaves the reach of the mechanism at t = {:.3f} s",
              at.time);
  }
}

/// Every place of the workspace within the limits, with the reference's highest speed and acceleration.
template <class M>
void over_workspace(const Scene& scene, Problem<M>& p) {
  auto& c = p.controller;
  double speed = 0.0, push = 0.0, reach = 0.0;
  Tracking<M> t;
  for (const Point& at : p.points) {
    if (!desired(p, at.now, t)) continue;
    const Vec2<double> v = c.mechanism.tip_rate(t.desired_pose, t.desired_rates);
    Motion2<double> next = at.now;  // acceleration of the tip, by a difference along the motion
    constexpr double dt = 1e-6;
    next.position += at.now.velocity * dt + at.now.acceleration * (0.5 * dt * dt);
    next.velocity += at.now.acceleration * dt;
    Tracking<M> later;
    if (!desired(p, next, later)) continue;
    const Vec2<double> a = (c.mechanism.tip_rate(later.desired_pose, later.desired_rates) - v) / dt;
    speed = std::max(speed, std::sqrt(dot(v, v)));
    push = std::max(push, std::sqrt(dot(a, a)));
  }
  for (const auto& leg : p.believed.legs) reach = std::max(reach, leg.l1 + leg.l2);
  std::array<std::array<double, 2>, 2> box{{{-reach, reach}, {-reach, reach}}};
  if (scene.limits.workspace) {  // within reach: the grid of a large one would miss the mechanism
    for (std::size_t i = 0; i < 2; ++i)
      box[i] = {std::max(box[i][0], (*scene.limits.workspace)[i][0]),
                std::min(box[i][1], (*scene.limits.workspace)[i][1])};
  }
  c.reference.space = ReferenceSpace::effector;
  p.points.clear();
  p.joining = 0;
  p.along_time = false;
  p.bounds = {speed, push, c.sample_time * (1.0 + std::ceil(p.told_ticks))};
  for (int i = 0; i <= grid; ++i) {
    for (int j = 0; j <= grid; ++j) {
      const Vec2<double> x(box[0][0] + (box[0][1] - box[0][0]) * i / grid,
                           box[1][0] + (box[1][1] - box[1][0]) * j / grid);
      bool within = true;
      for (int k = 0; k < 8 && within; ++k) {
        within =
            desired(p, {x, design::towards(std::numbers::pi * k / 4.0) * speed, Vec2<double>::Zero()}, t);
        if (!within) break;
        const Vec2<double> rate = M::base(t.desired_rates);
        within = M::min_abs_sin_type1(t.desired_pose) >= 2.0 * c.limits.min_abs_sin_type1 &&
                 M::sin_type2_in_mode(t.desired_pose, c.mode) >= 2.0 * c.limits.min_abs_sin_type2 &&
                 std::abs(rate[0]) <= c.limits.joint_speed && std::abs(rate[1]) <= c.limits.joint_speed;
      }
      const Motion2<double> there{x, Vec2<double>::Zero(), Vec2<double>::Zero()};
      if (within) p.points.push_back({0.0, there, there});
    }
  }
}

/// All numbers that a design depends on: equal lists, equal designs.
template <class M>
std::vector<double> numbers_of(const Problem<M>& p) {
  const auto& c = p.controller;
  const auto& own = c.gains.independent;
  const UncertaintyScene& u = p.uncertainty;
  std::vector<double> out;
  put(out, c.law, c.reaching, c.sample_time, p.told_ticks, p.lag, c.motors, c.sensors, c.reference.space,
      c.limits.min_abs_sin_type1, c.limits.min_abs_sin_type2, p.along_time, static_cast<double>(p.joining),
      p.bounds.speed, p.bounds.acceleration, p.bounds.late, c.gains.lambda, c.gains.layer, own.lambda,
      own.layer, c.torque_limit, c.torque_weight, c.preload, p.believed, u, u.tube, u.reaching_time);
  if constexpr (M::joints == 4) {
    put(out, c.mode.working[0], c.mode.working[1], c.mode.assembly);
  } else {
    put(out, c.mode.working);
  }
  for (const Point& at : p.points) {
    for (const Motion2<double>& m : {at.now, at.before}) put(out, m.position, m.velocity, m.acceleration);
  }
  return out;
}

}  // namespace

template <class M>
Problem<M> design_problem(const Scene& scene, Pacing pacing) {
  Problem<M> p;
  const ReferenceBundle<double> reference = make_reference(scene, pacing);
  p.controller = controller_without_design<M>(scene, pacing, reference);
  p.controller.torque_limit = p.controller.torque_given();
  p.believed = believed_mechanism(scene);
  p.uncertainty = *scene.uncertainty;
  p.told_ticks = borne_delay(scene, pacing);
  p.lag = scene.sensor_lag_ticks * scene.tick();
  p.start = start_of(scene, p.controller);
  along_reference(scene, p, reference.join_ticks);
  if (scene.uncertainty->workspace) over_workspace(scene, p);
  p.between = [] {
    if (stop_requested()) throw Interrupted("interrupted while gains were designed");
  };
  p.controller.reference.path = {};  // of `reference`, which ends here; the points hold what is needed
  return p;
}

template <class M>
RobustGains<M> robust_gains(const Scene& scene, Pacing pacing) {
  struct Answer {
    std::string refused;
    RobustGains<M> gains;
  };
  static Known<Answer> known;  // a sweep makes its controller thousands of times
  const Problem<M> p = design_problem<M>(scene, pacing);
  const Answer answer = known.get(numbers_of(p), [&] {
    const design::Design<M> d = design::design(p);
    Answer made{d.refused, {p.controller.gains, d.stiffness}};
    if (d.refused.empty()) design::apply(p, d, made.gains.gains);
    return made;
  });
  if (!answer.refused.empty()) refuse_at(scene.uncertainty_where, "gain = \"robust\": {}", answer.refused);
  return answer.gains;
}

template <class M>
ControllerConfig<M> make_controller(const Scene& scene, Pacing pacing,
                                    const ReferenceBundle<typename M::Scalar>& reference) {
  using S = typename M::Scalar;
  ControllerConfig<M> c = controller_without_design<M>(scene, pacing, reference);
  if (!scene.robust_gain) return c;
  using Designed = std::conditional_t<M::has_type2, FiveBar<double>, Rr<double>>;
  const Scene& whole = scene.whole ? *scene.whole : scene;
  const Gains<Designed> d = robust_gains<Designed>(whole, pacing).gains;
  c.gains.k = d.k.template cast<S>();
  c.gains.layer = d.layer.template cast<S>();
  c.gains.independent.k = static_cast<S>(d.independent.k);
  c.gains.independent.layer = static_cast<S>(d.independent.layer);
  if (scene.tick() == whole.tick() || c.reaching != Reaching::implicit) return c;
  // The layer of the implicit law counts ticks, and this part of the whole has longer ones.
  const auto widen = [&](double k, S& layer) {
    if (k > 0.0) layer = static_cast<S>(implicit_layer(k, scene.tick(), borne_delay(scene, pacing)));
  };
  for (int i = 0; i < M::channels; ++i) widen(d.k[i], c.gains.layer[i]);
  widen(d.independent.k, c.gains.independent.layer);
  return c;
}

template Problem<FiveBar<double>> design_problem(const Scene&, Pacing);
template Problem<Rr<double>> design_problem(const Scene&, Pacing);
template RobustGains<FiveBar<double>> robust_gains(const Scene&, Pacing);
template RobustGains<Rr<double>> robust_gains(const Scene&, Pacing);

#define ESMC_INSTANCE(M, S) \
  template ControllerConfig<M<S>> make_controller(const Scene&, Pacing, const ReferenceBundle<S>&);
ESMC_EACH_CONTROLLER(ESMC_INSTANCE)
#undef ESMC_INSTANCE

}  // namespace esmc::host
