#include <fmt/format.h>

#include <algorithm>
#include <limits>

#include "firmware/cycle/controller.hpp"
#include "host_sim/check/linear_loop.hpp"
#include "host_sim/check/margins.hpp"
#include "host_sim/controller/robust.hpp"
#include "host_sim/effects/shaft_sensor.hpp"
#include "host_sim/error.hpp"
#include "host_sim/plant/engine.hpp"
#include "host_sim/record/recorder.hpp"
#include "host_sim/record/run_options.hpp"

namespace esmc::host {
namespace {

/// Joints with a sensor, in the order of the model.
template <class M>
std::vector<std::size_t> sensed_joints(const Scene& s) {
  const int n = s.all_sensors ? M::joints : 2;
  std::vector<std::size_t> out(static_cast<std::size_t>(n));
  for (int i = 0; i < n; ++i)
    out[static_cast<std::size_t>(i)] = static_cast<std::size_t>(ControllerConfig<M>::joint_of(i, n));
  return out;
}

/// What of the effects moves the plant and is smooth at rest: gears without play, no dry friction, no stops.
std::vector<Effect> smooth_effects(const Scene& scene) {
  std::vector<Effect> out = scene.effects;
  std::erase_if(out, [](const Effect& e) {
    const auto* dry = std::get_if<CoulombFriction>(&e);
    return (dry != nullptr && dry->regularised == 0.0) || std::holds_alternative<EndStops>(e) ||
           std::holds_alternative<TorqueRipple>(e);
  });
  for (Effect& e : out) {
    if (auto* play = std::get_if<Backlash>(&e)) play->gap = 0.0;
  }
  return out;
}

/// The states x of linear_plant as the integrators have them; zeros where the pose is out of reach.
template <class World, class System, class M>
typename System::State state_of(const Scene& scene, const System& system, const M& mechanism,
                                const VectorXd& x) {
  using Plant = typename World::Plant;
  typename System::State y{};
  typename Plant::Joints angle{}, rate{};
  const auto d = desired_at_effector(mechanism, mode_of<M>(scene), Vec2<double>(x.head<2>()),
                                     Vec2<double>(x.segment<2>(2)), Vec2<double>::Zero().eval());
  if (!d) return y;  // not within a difference of a pose that is regular
  const Vec<double, M::joints> every = M::angles(d->pose), speed = joints_of<M>(d->rates);
  std::ranges::copy(every, angle.begin());
  std::ranges::copy(speed, rate.begin());
  const typename Plant::State bars = Plant::from_joints(angle, rate);
  System::put(y, bars.angle, bars.rate);
  system.start(y);
  for (Eigen::Index i = 4; i < x.size(); ++i) y[System::work + 1 + static_cast<std::size_t>(i - 4)] = x[i];
  return y;
}

/// The plant at rest: from motor torques to angle and rate at each sensor, in continuous time. States:
/// position and velocity of the effector, which are regular at type 2, then those of the drivetrains.
template <class World>
StateSpace linear_plant(const Scene& scene, const Moment& at) {
  using M = typename World::Mechanism;
  using Plant = typename World::Plant;
  using System = LoadedSystem<Plant>;
  const double t = at.tick * scene.tick();
  const auto payload = find_effect<Payload>(scene.effects);
  const bool loaded = payload && t >= payload->from && t < payload->to;
  const Plant plant = World::plant(scene, loaded ? payload->mass : 0.0);
  const auto attached = attach(smooth_effects(scene), scene.motor_joints(), nullptr, false);
  attached->loads.begin(t + 0.5 * scene.tick());
  System system(plant, *attached);
  const M mechanism(params_of<M>(scene.mechanism));
  const auto motors = static_cast<Eigen::Index>(scene.motors());
  const auto drives = static_cast<Eigen::Index>(system.size() - System::work - 1);
  constexpr std::size_t of_drives = System::work + 1;

  const Eigen::Index n = 4 + drives;
  const auto slope = [&](const VectorXd& xu) {  // of the states, then the outputs
    const typename System::State y = state_of<World>(scene, system, mechanism, xu.head(n));
    typename System::State dy{};
    MotorTorques<typename Plant::Joints> torque{};
    for (std::size_t i = 0; i < static_cast<std::size_t>(motors); ++i)
      torque.held[scene.motor_joints()[i]] = xu[n + static_cast<Eigen::Index>(i)];
    system.set_torques(torque);
    system.slope(t, y, dy);
    const V2 acceleration = plant.effector_point(System::angles(y), System::rates(dy)).rate;  // at rest
    const std::vector<std::size_t> sensed = sensed_joints<M>(scene);
    VectorXd out(n + 2 * static_cast<Eigen::Index>(sensed.size()));
    out.head<4>() << xu[2], xu[3], acceleration.x, acceleration.y;
    for (Eigen::Index i = 4; i < n; ++i) out[i] = dy[of_drives + static_cast<std::size_t>(i - 4)];
    Eigen::Index to = n;
    for (const std::size_t joint : sensed) {
      const Shaft shaft = system.shaft(joint, y);
      out[to++] = shaft.angle;
      out[to++] = shaft.rate;
    }
    return out;
  };

  VectorXd x = VectorXd::Zero(n + motors);
  x.head<2>() = mechanism.pose(Vec<double, M::joints>(at.angle.data())).effector;
  const typename System::State y = state_of<World>(scene, system, mechanism, x.head(4));
  for (Eigen::Index i = 4; i < n; ++i) x[i] = y[of_drives + static_cast<std::size_t>(i - 4)];
  constexpr double by = 1e-6;
  for (int pass = 0; pass < 3; ++pass) {  // the torques and the twist of the gears that hold the pose
    const VectorXd residual = slope(x).head(n);
    const MatrixXd j = jacobian(slope, x, by).topRightCorner(n, x.size() - 4);
    x.tail(x.size() - 4) -= j.completeOrthogonalDecomposition().solve(residual);
  }
  return linearised(slope, x, n, by);
}

/// The drives' readings of angle and rate, one sensor after the other, tick by tick: their observers, without
/// steps, noise and delay.
StateSpace linear_sensors(const Scene& scene, std::size_t count) {
  SensorEffects effects(scene.effects);
  if (effects.encoder) effects.noise = SensorNoise{0.0, effects.encoder->bandwidth};
  if (effects.noise) effects.noise->sigma = 0.0;
  effects.encoder.reset();
  effects.bias.reset();
  effects.delay.reset();
  const auto read = [&](const VectorXd& x) {
    ShaftSensor shaft(effects, scene.tick(), 1.0, 0, 0);
    const auto states = shaft.states();
    for (Eigen::Index i = 0; i < 4; ++i) *states[static_cast<std::size_t>(i)] = x[i];
    const ShaftReading r = shaft.read({x[4], x[5]});
    VectorXd out(6);
    for (Eigen::Index i = 0; i < 4; ++i) out[i] = *states[static_cast<std::size_t>(i)];
    out.tail<2>() << r.position_rev, r.velocity_rev_s;
    return out;
  };
  const StateSpace one = linearised(read, VectorXd::Zero(6), 4, 1.0);
  StateSpace all = one;
  for (std::size_t i = 1; i < count; ++i) all = parallel(all, one);
  return all;
}

/// The controller of the scene without limits, holding the effector where it is.
template <class M>
ControllerConfig<M> resting_controller(const Scene& scene, const ReferenceBundle<double>& reference) {
  ControllerConfig<M> c = make_controller<M>(scene, Pacing::lockstep, reference);
  c.reference = {};
  c.join_ticks = c.ramp_ticks = 0;
  c.sign_test_move = 0.0;
  c.limits = {};
  c.limits.joint_speed = c.limits.closure = std::numeric_limits<double>::max();
  c.torque_limit *= 1e6;
  if (scene.sliding() && c.reaching == Reaching::sign) {  // as if it were as steep as a tick allows
    c.reaching = Reaching::saturation;
    c.gains.layer = c.gains.k * c.sample_time;
    c.gains.independent.layer = c.gains.independent.k * c.sample_time;
  }
  return c;
}

/// The controller at rest on the pose, tick by tick: from readings to the torques of the motors. Its
/// reference is the pose as it sees it, so that a wrong model leaves no error. Throws RunError where it does
/// not run there.
template <class M>
StateSpace linear_controller(const Scene& with_friction, const Moment& at) {
  Scene scene = with_friction;  // at rest, dry friction that the controller believes in has no slope
  scene.whole = std::make_shared<const Scene>(with_friction);
  scene.model.friction.dry = {};
  scene.model.ripple_amplitude = {};  // nor is the plant's cogging in linear_plant()
  std::erase_if(scene.effects, [](const Effect& e) { return std::holds_alternative<CoulombFriction>(e); });
  const auto reference = make_reference(scene, Pacing::lockstep);
  const ControllerConfig<M> c = resting_controller<M>(scene, reference);
  Sample<M> sample;
  sample.angle = Vec<double, M::joints>(at.angle.data());
  Controller<M> controller(c);
  const auto memory_of = [&](Controller<M>& of) {
    std::vector<double*> out;
    if (c.reach == nullptr && c.observer == nullptr && c.predict == nullptr) return out;
    of.memory().each_state([&](auto& v) {
      for (int i = 0; i < v.size(); ++i) out.push_back(&v[i]);
    });
    return out;
  };
  for (double* v : memory_of(controller)) *v = 0.0;  // also of parts that this scene has not
  Supervisor supervisor(controller.supervision());
  supervisor.begin_tick(Command::enable, {});
  constexpr int filled = 12;  // ticks after which every memory is
  for (int n = 0; n < filled; ++n) {
    supervisor.begin_tick(Command::none, {true, false});
    (void)controller.tick(sample, supervisor);
  }
  if (!supervisor.running())
    throw RunError(fmt::format("at t = {:.3f} s the controller ends in the fault {}", at.tick * scene.tick(),
                               name(supervisor.fault())));

  const std::vector<double*> memory = memory_of(controller);
  const auto n = static_cast<Eigen::Index>(memory.size());
  const std::vector<std::size_t> sensed = sensed_joints<M>(scene), motors = scene.motor_joints();
  VectorXd x = VectorXd::Zero(n + 2 * static_cast<Eigen::Index>(sensed.size()));
  for (Eigen::Index i = 0; i < n; ++i) x[i] = *memory[static_cast<std::size_t>(i)];
  const auto tick = [&](const VectorXd& moved) {
    Controller<M> copy = controller;
    Supervisor copy_of_supervisor = supervisor;
    const std::vector<double*> own = memory_of(copy);
    for (Eigen::Index i = 0; i < n; ++i) *own[static_cast<std::size_t>(i)] = moved[i];
    Sample<M> seen = sample;
    Eigen::Index from = n;
    for (const std::size_t joint : sensed) {
      seen.angle[static_cast<int>(joint)] += moved[from++];
      seen.rate[static_cast<int>(joint)] = moved[from++];
    }
    const TickResult<M> r = copy.tick(seen, copy_of_supervisor);
    VectorXd out(n + static_cast<Eigen::Index>(motors.size()));
    for (Eigen::Index i = 0; i < n; ++i) out[i] = *own[static_cast<std::size_t>(i)];
    for (std::size_t i = 0; i < motors.size(); ++i)
      out[n + static_cast<Eigen::Index>(i)] = r.torque[static_cast<int>(motors[i])];
    return out;
  };
  return linearised(tick, x, n, 1e-8);
}

}  // namespace

double loop_delay(const Scene& scene) {
  constexpr double ticks_most = 50.0;  // each is a state of every motor
  const auto readings = find_effect<SensorDelay>(scene.effects);
  const double out = torque_delay(scene) + (readings ? readings->ticks * scene.tick() : 0.0);
  if (out > ticks_most * scene.tick())
    throw InputError(
        scene.control_where,
        fmt::format("the effects of the scene delay its loop by {:.3g} ticks; margins are for at "
                    "most {:g}",
                    out / scene.tick(), ticks_most));
  return out;
}

namespace {

/// The first ticks, after `join`, in which a payload or an outside force has come or gone.
std::vector<std::uint32_t> ticks_of_loads(const Scene& scene, std::uint32_t join) {
  std::vector<std::uint32_t> out;
  const auto add = [&](double t) {
    const double tick = std::ceil(t * scene.rate_hz - 1e-6);
    if (tick > join && tick < tick_count(scene)) out.push_back(static_cast<std::uint32_t>(tick));
  };
  for (const Effect& e : scene.effects) {
    if (const auto* load = std::get_if<Payload>(&e)) add(load->from), add(load->to);
    if (const auto* force = std::get_if<ExternalForce>(&e)) add(force->from), add(force->to);
  }
  return out;
}

/// Ticks after the join: `poses` of them, spread over the reference; at rest one, and one for each load.
std::vector<std::uint32_t> ticks_of_poses(const Scene& scene, std::uint32_t poses) {
  const std::uint32_t ticks = tick_count(scene),
                      join = std::min(ticks, make_reference(scene, Pacing::lockstep).join_ticks);
  std::vector<std::uint32_t> out;
  if (scene.reference.type == ReferenceType::hold) {
    out = ticks_of_loads(scene, join);
    out.insert(out.begin(), join);
    return out;
  }
  const std::uint32_t count = std::clamp(ticks - join, 1U, poses);
  for (std::uint32_t i = 0; i < count; ++i)
    out.push_back(join + static_cast<std::uint32_t>((ticks - join) * std::uint64_t{i} / count));
  return out;
}

}  // namespace

void for_each_pose(const Scene& scene, std::uint32_t poses,
                   const std::function<void(const Moment&, const StateSpace&, const StateSpace&)>& f) {
  for (const std::uint32_t tick : ticks_of_poses(scene, poses)) {
    if (stop_requested()) throw Interrupted("interrupted");
    const auto at = moment_at(scene, tick);
    if (!at)
      throw InputError(scene.reference_where,
                       fmt::format("the reference leaves the reach of the mechanism at t = {:.3f} s",
                                   tick * scene.tick()));
    with_world(scene, [&]<class World>(World) {
      using M = typename World::Mechanism;
      const std::size_t sensors = sensed_joints<M>(scene).size();
      f(*at, linear_plant<World>(scene, *at),
        series(linear_sensors(scene, sensors), linear_controller<M>(scene, *at)));
    });
  }
}

}  // namespace esmc::host
