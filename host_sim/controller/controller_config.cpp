#include "host_sim/controller/controller_config.hpp"

#include <algorithm>
#include <array>
#include <limits>
#include <utility>

#include "firmware/cycle/four_motors.hpp"

namespace esmc::host {
namespace {

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
  l.rest_speed = static_cast<S>(s.drives.speed_step);  // half a step is what MIT drives tell at rest
  if (s.limits.workspace) {
    l.workspace_x = range<S>((*s.limits.workspace)[0]);
    l.workspace_y = range<S>((*s.limits.workspace)[1]);
  }
  if (s.limits.joint_angle) {
    for (std::size_t i = 0; i < 2; ++i) l.joint_angle[i] = range<S>((*s.limits.joint_angle)[i]);
  }
  return l;
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
  if (!scene.model.plain_motors()) c.correct = &part::motor_map<M>;
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
    c.setpoint_speed = static_cast<S>(scene.command->speed);
    c.setpoint_acceleration = static_cast<S>(scene.command->acceleration);
    static_assert(CommandScene::jerk_ticks_max == MovingAverage<S>::length_max);
    c.setpoint_jerk_ticks = ticks(scene.command->jerk_time);
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
    c.motor_map.factor[joint] = static_cast<S>(scene.model.torque_factor[u]);
    c.motor_map.amplitude[joint] = static_cast<S>(scene.model.ripple_amplitude[u]);
    c.motor_map.per_turn[joint] = static_cast<S>(scene.model.ripple_per_turn[u]);
    c.motor_map.phase[joint] = static_cast<S>(scene.model.ripple_phase[u]);
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
  for (LegParams<double>& leg : p.legs)
    for (const LegKey& k : leg_keys) leg.*k.value *= f.*k.factor;
  set_friction(p, f.exact_friction ? friction_of(scene.effects).value_or(JointFriction{}) : f.friction);
  return p;
}

FiveBarParams<double> with_payload(FiveBarParams<double> p, bool arm, double payload) {
  p.m0 += payload;
  if (LegParams<double>& bar = p.legs[0]; arm && payload > 0.0) {
    const double mass = bar.m2 + payload, centre = (bar.m2 * bar.lg2 + payload * bar.l2) / mass;
    const double own = bar.lg2 - centre, load = bar.l2 - centre;
    bar.J2 += bar.m2 * own * own + payload * load * load;
    bar.m2 = mass;
    bar.lg2 = centre;
  }
  return p;
}

bool same_lengths(const FiveBarParams<double>& a, const FiveBarParams<double>& b) {
  bool same = a.l0 == b.l0;
  for (std::size_t j = 0; j < 2; ++j)
    same = same && a.legs[j].l1 == b.legs[j].l1 && a.legs[j].l2 == b.legs[j].l2;
  return same;
}

template <class M>
ControllerConfig<M> controller_without_design(const Scene& scene, Pacing pacing,
                                              const ReferenceBundle<typename M::Scalar>& reference) {
  using S = typename M::Scalar;
  ControllerConfig<M> c;
  c.mechanism = M(params_of<M>(believed_mechanism(scene)));
  c.mode = mode_of<M>(scene);
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
