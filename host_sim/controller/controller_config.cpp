#include "host_sim/controller/controller_config.hpp"

#include <algorithm>
#include <array>
#include <limits>
#include <numbers>
#include <utility>

#include "firmware/cycle/four_motors.hpp"

namespace esmc::host {
namespace {

PhaseClock phase_clock(double phase, double speed, double tick) {
  const auto turns = [](double angle) {  // nearest 2^-64 turn of the angle modulo one turn
    const double t = angle / (2.0 * std::numbers::pi);
    return static_cast<std::uint64_t>(static_cast<std::int64_t>(std::ldexp(t - std::round(t), 63))) * 2U;
  };
  return {turns(phase), turns(speed * tick)};
}

Vec2<double> vec(const std::array<double, 2>& a) { return {a[0], a[1]}; }

Motion2<double> at_rest(const std::array<double, 2>& p) { return {vec(p), {0, 0}, {0, 0}}; }

/// Rest-to-rest segments through corners, each lasting a whole number of ticks.
class RestPath {
 public:
  explicit RestPath(double tick) : tick_(tick) {}
  void add(const std::array<double, 2>& from, const std::array<double, 2>& to, double seconds) {
    const auto ticks = static_cast<std::uint32_t>(std::max(1.0, std::round(seconds / tick_)));
    segments_.push_back({now_, 0.0, Quintic<double>::between(at_rest(from), at_rest(to), ticks * tick_)});
    now_ += ticks;
  }
  [[nodiscard]] std::uint32_t ticks() const { return now_; }
  [[nodiscard]] std::vector<PathSegment<double>> take() { return std::move(segments_); }

 private:
  double tick_;
  std::uint32_t now_ = 0;
  std::vector<PathSegment<double>> segments_;
};

/// Velocities and accelerations at the points of a table from natural cubic splines, then quintics between.
std::vector<PathSegment<double>> through_points(const std::vector<PathPoint>& points, double tick) {
  const std::size_t n = points.size();
  std::vector<Vec2<double>> m(n, Vec2<double>::Zero()), rhs(n, Vec2<double>::Zero());
  std::vector<double> upper(n, 0.0);
  const auto value = [&](std::size_t i) { return Vec2<double>(points[i].x, points[i].y); };
  const auto span = [&](std::size_t i) { return points[i + 1].t - points[i].t; };
  for (std::size_t i = 1; i + 1 < n; ++i) {  // Thomas algorithm for the second derivatives, zero at both ends
    const double a = span(i - 1), c = span(i), b = 2.0 * (a + c) - a * upper[i - 1];
    const Vec2<double> d = 6.0 * ((value(i + 1) - value(i)) / c - (value(i) - value(i - 1)) / a);
    upper[i] = c / b;
    rhs[i] = (d - a * rhs[i - 1]) / b;
  }
  for (std::size_t i = n - 1; i-- > 1;) m[i] = rhs[i] - upper[i] * m[i + 1];
  const auto motion = [&](std::size_t i) {
    const std::size_t k = std::min(i, n - 2);
    const double h = span(k);
    const Vec2<double> chord = (value(k + 1) - value(k)) / h;
    const Vec2<double> v = i == k ? Vec2<double>(chord - h / 6.0 * (2.0 * m[k] + m[k + 1]))
                                  : Vec2<double>(chord + h / 6.0 * (m[k] + 2.0 * m[k + 1]));
    return Motion2<double>{value(i), v, m[i]};
  };
  std::vector<PathSegment<double>> out;
  for (std::size_t i = 0; i + 1 < n; ++i) {
    const auto start = static_cast<std::uint32_t>(std::ceil(points[i].t / tick - 1e-9));
    out.push_back({start, std::max(0.0, start * tick - points[i].t),
                   Quintic<double>::between(motion(i), motion(i + 1), span(i))});
  }
  return out;
}

/// Makes tick `first` the first one.
void skip(ReferenceBundle<double>& b, std::uint32_t first, double tick) {
  for (PhaseClock& c : b.reference.phase.items) c.start += c.per_tick * first;
  if (b.path.empty()) return;
  const std::uint32_t round = b.reference.repeat_ticks;
  if (round > 0) {  // for as long as a part of the scene may last
    const std::vector<PathSegment<double>> one = b.path;
    first %= round;
    for (std::uint32_t begin = round; begin < first + 1000U; begin += round) {
      for (PathSegment<double> s : one) {
        s.start_tick += begin;
        b.path.push_back(s);
      }
    }
    b.reference.repeat_ticks = 0;
  }
  while (b.path.size() > 1 && b.path[1].start_tick <= first) b.path.erase(b.path.begin());
  for (PathSegment<double>& s : b.path) {
    if (s.start_tick <= first) s.offset += (first - s.start_tick) * tick;
    s.start_tick = s.start_tick <= first ? 0 : s.start_tick - first;
  }
}

static_assert(static_cast<int>(LawChoice::pd) == static_cast<int>(LawKind::pd) &&
              static_cast<int>(ReachingChoice::implicit) == static_cast<int>(Reaching::implicit));

/// A scene without a law of its own (open_loop, none) makes no controller that is run.
LawKind law_kind(LawChoice l) { return l <= LawChoice::pd ? static_cast<LawKind>(l) : LawKind::pd; }

template <class M>
void set_gains(const Scene& s, double delay, Gains<M>& g) {
  using S = typename M::Scalar;
  const auto layer = [&](double gain, double given) {
    // Without switching gain the layer has no effect, but s / layer is computed: it must not be zero.
    const bool implicit =
        s.reaching == ReachingChoice::implicit || s.reaching == ReachingChoice::implicit_coupled;
    const double width = implicit && gain > 0.0 ? implicit_layer(gain, s.tick(), delay) : given;
    return std::max(static_cast<S>(width),
                    std::numeric_limits<S>::min());  // a scalar type may not hold so small a one
  };
  for (int i = 0; i < M::channels; ++i) {
    const bool angle = M::is_angle(i);
    const double k = angle ? s.gain.angle : s.gain.position;
    g.lambda[i] = static_cast<S>(angle ? s.lambda.angle : s.lambda.position);
    g.k[i] = static_cast<S>(k);
    g.layer[i] = layer(k, angle ? s.layer.angle : s.layer.position);
  }
  const bool angles = !M::has_type2;  // the independent coordinates of RR are its joints
  auto& own = g.independent;
  const double lambda = angles ? s.lambda.angle : s.lambda.position,
               k = angles ? s.gain.angle : s.gain.position;
  own.lambda = static_cast<S>(lambda);
  own.k = static_cast<S>(k);
  own.layer = layer(k, angles ? s.layer.angle : s.layer.position);
  own.kp = static_cast<S>(s.kp.value_or(lambda * lambda));
  own.kd = static_cast<S>(s.kd.value_or(2.0 * lambda));
}

template <class S>
Range<S> range(const std::array<double, 2>& r) {
  return {static_cast<S>(r[0]), static_cast<S>(r[1])};
}

template <class S>
Limits<S> make_limits(const Scene& s) {
  Limits<S> l;
  l.min_abs_sin_type1 = static_cast<S>(s.limits.min_abs_sin_type1);
  l.min_abs_sin_type2 = static_cast<S>(s.type == MechanismType::five_bar ? s.limits.min_abs_sin_type2 : 0.0);
  l.joint_speed = static_cast<S>(s.limits.joint_speed);
  l.closure = static_cast<S>(s.limits.closure);
  l.max_age_ticks = static_cast<std::uint32_t>(s.limits.max_age_ticks);
  l.feedback_jump = static_cast<S>(s.limits.feedback_jump);
  l.join_acceleration = static_cast<S>(s.limits.join_acceleration);
  if (s.limits.workspace) {
    l.workspace_x = range<S>((*s.limits.workspace)[0]);
    l.workspace_y = range<S>((*s.limits.workspace)[1]);
  }
  if (s.limits.joint_angle) {
    for (std::size_t i = 0; i < 2; ++i) l.joint_angle[i] = range<S>((*s.limits.joint_angle)[i]);
  }
  return l;
}

template <class S>
Quintic<S> in_scalar(const Quintic<double>& q) {
  Quintic<S> out;
  out.duration = static_cast<S>(q.duration);
  for (int i = 0; i < 6; ++i) out.c[i] = q.c[i].template cast<S>();
  return out;
}

template <class M>
void set_law(const Scene& scene, Pacing pacing, ControllerConfig<M>& c) {
  using S = typename M::Scalar;
  c.law = law_kind(scene.law);
  if (scene.reaching <= ReachingChoice::implicit) c.reaching = static_cast<Reaching>(scene.reaching);
  if (scene.sliding() && scene.reaching == ReachingChoice::super_twisting) c.reach = &part::super_twisting<M>;
  if (scene.sliding() && scene.reaching == ReachingChoice::implicit_coupled)
    c.reach = &part::implicit_coupled<M>;
  if (scene.law != LawChoice::pd && has_elbow_rotors(scene.believed.value_or(scene.mechanism)))
    c.behind = std::exchange(c.reach, &part::elbow_rotors<M>);
  c.delay_ticks = static_cast<S>(delay_ticks(scene, pacing));
  c.lag_ticks = static_cast<S>(scene.sensor_lag_ticks);
  c.observer_bandwidth = static_cast<S>(scene.disturbance_observer);
  if (scene.disturbance_observer > 0.0) c.observer = &part::momentum_observer<M>;
  if (scene.predictor) c.predict = &part::predictor<M>;
  set_gains(scene, borne_delay(scene, pacing), c.gains);
}

template <class M>
void set_procedures(const Scene& scene, Pacing pacing, ControllerConfig<M>& c) {
  using S = typename M::Scalar;
  const auto ticks = [&](double seconds) {
    return static_cast<std::uint32_t>(std::llround(seconds * scene.rate_hz));
  };
  c.ramp_ticks = ticks(scene.torque_ramp.value_or(pacing == Pacing::realtime ? 0.2 : 0.0));
  c.halt_ticks = scene.limits.halt_time > 0.0 ? std::max(1U, ticks(scene.limits.halt_time)) : 0U;
  if (scene.drives.sign_test.value_or(scene.hardware && !scene.all_motors))
    c.sign_test_move = static_cast<S>(scene.drives.sign_test_move);
  if (scene.command) {
    c.guide_speed = static_cast<S>(scene.command->speed);
    c.guide_acceleration = static_cast<S>(scene.command->acceleration);
  }
  c.lower_ticks = ticks(scene.limits.lower_time);
  c.after_halt = scene.limits.after_halt;
}

template <class M>
void set_motors_and_sensors(const Scene& scene, ControllerConfig<M>& c) {
  using S = typename M::Scalar;
  c.torque_lead = static_cast<S>(scene.drives.torque_lead);
  c.motors = scene.all_motors ? Motors::all : Motors::base;
  c.sensors = scene.all_sensors ? Sensors::all : Sensors::base;
  if (c.law != LawKind::pd) c.allocate = allocation_for<M>(c.motors);  // pd: base motors alone
  if constexpr (M::joints == 4) {
    for (int i = 0; i < 4 && !scene.encoder_sigma.empty(); ++i) {
      const double sigma = scene.encoder_sigma[static_cast<std::size_t>(i)] / scene.encoder_sigma[0];
      c.encoder_variance[i] = static_cast<S>(sigma * sigma);
      c.fuse = &part::closure_projection<M>;
    }
  }
  for (int i = 0; i < c.motor_count(); ++i) {
    const auto u = static_cast<std::size_t>(i);
    const int joint = ControllerConfig<M>::joint_of(i, c.motor_count());
    const double limit = scene.torque_limit[u];
    if (!scene.preload.empty()) c.preload[joint] = static_cast<S>(scene.preload[u]);
    c.torque_limit[joint] = static_cast<S>(limit);
    c.torque_weight[joint] =
        static_cast<S>(scene.torque_weight.empty() ? 1.0 / (limit * limit) : scene.torque_weight[u]);
  }
}

}  // namespace

FiveBarParams<double> believed_mechanism(const Scene& scene) {
  const ModelFactors& f = scene.model;
  FiveBarParams<double> p = scene.believed.value_or(scene.mechanism);
  p.l0 *= f.half_base;
  p.m0 *= f.effector_mass;
  p.g *= f.gravity;
  PerJoint viscous = f.viscous, coulomb = f.coulomb, asymmetry = f.asymmetry;
  if (f.exact_friction) {
    viscous = find_effect<ViscousFriction>(scene.effects).value_or(ViscousFriction{}).coefficient;
    const CoulombFriction dry = find_effect<CoulombFriction>(scene.effects).value_or(CoulombFriction{});
    coulomb = dry.torque;
    asymmetry = dry.asymmetry;
  }
  for (std::size_t j = 0; j < 2; ++j) {
    LegParams<double>& leg = p.legs[j];
    for (const LegKey& k : leg_keys) leg.*k.value *= f.*k.factor;
    leg.d1 = viscous[2 * j];
    leg.d2 = viscous[2 * j + 1];
    leg.gamma1 = coulomb[2 * j];
    leg.gamma2 = coulomb[2 * j + 1];
    leg.asymmetry1 = asymmetry[2 * j];
    leg.asymmetry2 = asymmetry[2 * j + 1];
  }
  return p;
}

bool same_lengths(const FiveBarParams<double>& a, const FiveBarParams<double>& b) {
  bool same = a.l0 == b.l0;
  for (std::size_t j = 0; j < 2; ++j)
    same = same && a.legs[j].l1 == b.legs[j].l1 && a.legs[j].l2 == b.legs[j].l2;
  return same;
}

template <>
ReferenceBundle<double> make_reference<double>(const Scene& scene, Pacing pacing) {
  const ReferenceScene& r = scene.reference;
  ReferenceBundle<double> out;
  Reference<double>& ref = out.reference;
  const double tick = scene.tick();
  out.join_ticks = static_cast<std::uint32_t>(
      std::llround(r.join.value_or(pacing == Pacing::realtime ? 1.0 : 0.0) * scene.rate_hz));
  switch (r.type) {
    case ReferenceType::circle:
      ref.kind = ReferenceKind::circle;
      ref.centre = vec(r.center);
      ref.amplitude = {r.radius, r.radius};
      ref.speed = {r.speed, r.speed};
      ref.phase[0] = ref.phase[1] = phase_clock(r.phase, r.speed, tick);
      break;
    case ReferenceType::joint_sine:
      ref.kind = ReferenceKind::sine;
      ref.space = ReferenceSpace::base_joints;
      ref.centre = vec(r.offset);
      ref.amplitude = vec(r.amplitude);
      ref.speed = vec(r.omega);
      for (int i = 0; i < 2; ++i) {
        const auto u = static_cast<std::size_t>(i);
        ref.phase[i] = phase_clock(r.phases[u], r.omega[u], tick);
      }
      break;
    case ReferenceType::line:
    case ReferenceType::polyline: {
      ref.kind = ReferenceKind::path;
      RestPath path(tick);
      const bool line = r.type == ReferenceType::line;
      const auto side = [&](std::size_t a, std::size_t b) {
        const double length = std::hypot(r.points[b][0] - r.points[a][0], r.points[b][1] - r.points[a][1]);
        path.add(r.points[a], r.points[b], line ? r.duration : length / r.speed);
      };
      for (std::size_t i = 0; i + 1 < r.points.size(); ++i) side(i, i + 1);
      if (r.repeat) {
        side(r.points.size() - 1, 0);
        ref.repeat_ticks = path.ticks();
      }
      out.path = path.take();
      break;
    }
    case ReferenceType::file:
      ref.kind = ReferenceKind::path;
      out.path = through_points(r.table, tick);
      break;
    case ReferenceType::hold:
      if (r.position) {
        ref.kind = ReferenceKind::path;  // an empty path rests at the centre
        ref.centre = vec(*r.position);
      }
      break;
    case ReferenceType::none:
      break;
  }
  if (r.first_tick > 0) skip(out, r.first_tick, tick);
  return out;
}

template <>
ReferenceBundle<float> make_reference<float>(const Scene& scene, Pacing pacing) {
  const ReferenceBundle<double> exact = make_reference<double>(scene, pacing);
  const Reference<double>& r = exact.reference;
  ReferenceBundle<float> out;
  out.reference = {r.kind,  r.space, r.centre.cast<float>(), r.amplitude.cast<float>(), r.speed.cast<float>(),
                   r.phase, {},      r.repeat_ticks};
  for (const PathSegment<double>& s : exact.path)
    out.path.push_back({s.start_tick, static_cast<float>(s.offset), in_scalar<float>(s.curve)});
  out.join_ticks = exact.join_ticks;
  return out;
}

template <class M>
ControllerConfig<M> controller_without_design(const Scene& scene, Pacing pacing,
                                              const ReferenceBundle<typename M::Scalar>& reference) {
  using S = typename M::Scalar;
  ControllerConfig<M> c;
  c.mechanism = make_mechanism(believed_mechanism(scene), static_cast<M*>(nullptr));
  c.mode = mode_of(scene, static_cast<M*>(nullptr));
  c.reference = reference.get();
  c.join_ticks = reference.join_ticks;
  c.limits = make_limits<S>(scene);
  c.sample_time = static_cast<S>(scene.tick());
  set_law(scene, pacing, c);
  set_procedures(scene, pacing, c);
  set_motors_and_sensors(scene, c);
  return c;
}

#define ESMC_INSTANCE(M, S) \
  template ControllerConfig<M<S>> controller_without_design(const Scene&, Pacing, const ReferenceBundle<S>&);
ESMC_EACH_CONTROLLER(ESMC_INSTANCE)
#undef ESMC_INSTANCE

}  // namespace esmc::host
