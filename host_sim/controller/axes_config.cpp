#include "host_sim/controller/axes_config.hpp"

#include <algorithm>
#include <array>
#include <limits>
#include <numbers>
#include <random>

#include "host_sim/controller/robust.hpp"
#include "host_sim/drives/placed_axes.hpp"
#include "host_sim/error.hpp"

namespace esmc::host {

constexpr double sdo_time = 0.1;  // s that an answer may take

double enabling_time_max(const Scene& s) {
  const double set_up =
      s.drives.protocol == Protocol::cia402 ? 2.0 * drive::cia402::setup.size() * sdo_time : 0.0;
  return std::max(5.0, 500.0 * s.tick()) + s.drives.boot_time +
         2.0 * (s.drives.watchdog_timeout + s.drives.heartbeat_timeout) + set_up;
}
double waiting_time_max(const Scene& s) {
  constexpr double beats = 6.0;     // from the mode to the second confirmation, and once more
  constexpr double slowest = 0.15;  // s: slower ones are asked again before they can answer
  return s.drives.boot_time + beats * std::min(slowest, s.drives.heartbeat_timeout);
}

std::size_t axis_of(const Scene& scene, std::size_t i) {
  const bool mixed = scene.all_sensors && !scene.all_motors;
  return mixed ? (i < 2 ? 2 * i : 2 * (i - 2) + 1) : i;
}

drive::AxisConfig mount(const Scene& scene, std::size_t i) {
  const DriveScene& d = scene.drives;
  return {static_cast<std::uint8_t>(d.nodes[i]), static_cast<float>(d.direction[i]),
          static_cast<float>(d.gear_ratio[i]), static_cast<float>(d.offset[i])};
}

double homing_bandwidth(const Scene& scene) { return std::min(40.0, 0.1 * scene.rate_hz); }

HomingLoad homing_load(const Scene& scene, std::size_t i) {
  const FiveBarParams<double> p = believed_mechanism(scene);
  const bool arm = scene.type == MechanismType::rr;
  const LegParams<double>& leg = p.legs[arm ? 0 : i];
  if (arm && i == 1) {
    const double weight = std::abs(p.g * leg.m2 * leg.lg2);
    return {leg.J2 + leg.rotor2 + leg.m2 * leg.lg2 * leg.lg2, weight, weight};
  }
  // Moments of a counterweight and of what it balances have opposite signs; the elbow may turn one of them.
  const double own = p.g * leg.m1 * leg.lg1, with_bar = own + p.g * leg.m2 * leg.l1,
               with_all = own + p.g * (p.legs[0].m2 + p.legs[1].m2 + p.m0) * leg.l1;
  return {leg.J1 + leg.m1 * leg.lg1 * leg.lg1 + leg.m2 * leg.l1 * leg.l1, std::abs(with_bar),
          arm ? std::abs(with_bar) + std::abs(p.g * leg.m2 * leg.lg2)
              : std::max(std::abs(own), std::abs(with_all))};
}

namespace {

/// Orders and set points that a supervisor computer may give, and its telemetry.
link::LinkConfig make_link(const Scene& scene, Pacing pacing, ReferenceSpace space) {
  const CommandScene& k = *scene.command;
  const auto real = [](double v) { return static_cast<float>(v); };
  const auto ticks = [&](double seconds) { return std::ceil(seconds * scene.rate_hz); };
  const auto count = [](int n) { return static_cast<std::uint32_t>(n); };
  link::LinkConfig c;
  c.base_id = count(k.base_id);
  c.scene = scene.identity;
  // Frames recorded in one run must be invalid in the next; runs in lockstep must repeat.
  const std::uint32_t draw =
      pacing == Pacing::realtime ? std::random_device{}() : static_cast<std::uint32_t>(scene.seed);
  c.session = static_cast<std::uint8_t>(draw % 255U + 1U);
  c.counter_jump_max = static_cast<std::uint8_t>(k.counter_jump);
  c.command_age_ticks_max = static_cast<std::uint16_t>(std::min(ticks(k.order_age), 65535.0 / 2.0));
  c.status_ticks = count(k.status_ticks);
  c.telemetry_ticks = count(k.telemetry_ticks);
  c.table_ticks = static_cast<std::uint32_t>(std::max(1.0, ticks(1.0)));
  c.period_ns = static_cast<std::uint32_t>(std::llround(1e9 / scene.rate_hz));
  c.source = k.source;
  const bool joints = space == ReferenceSpace::base_joints;
  c.space = joints ? link::Space::base_joints : link::Space::effector;
  const auto& box = joints ? scene.limits.joint_angle : scene.limits.workspace;
  for (std::size_t i = 0; i < 2; ++i)
    c.position[i] = box ? link::Bounds{real((*box)[i][0]), real((*box)[i][1])} : link::Bounds{-1e3F, 1e3F};
  const auto bounds = [&](const std::array<double, 2>& r) { return link::Bounds{real(r[0]), real(r[1])}; };
  const link::Parameters::Values values{
      real(scene.lambda.position),
      real(scene.lambda.angle),
      real(scene.gain.position),
      real(scene.gain.angle),
      real(scene.tick()),
      real(scene.torque_limit[0]),
      real(scene.torque_limit[static_cast<std::size_t>(scene.motors()) / 2]),
      real(scene.limits.joint_speed),
      real(k.speed),
      real(k.acceleration),
      static_cast<float>(k.stream_age_ticks),
      real(ticks(k.timeout))};
  c.parameters =
      link::Parameters(values, {bounds(k.lambda), bounds(k.lambda), bounds(k.gain), bounds(k.gain)});
  c.unattended = scene.reference.unattended;
  return c;
}

/// Of the base joints; none without its keys. Torques are of the joints: a motor that gives another torque
/// than it is asked for (control.model.torque_factor) is asked for another one.
template <class S>
HomingConfig<S> make_homing(const Scene& scene) {
  HomingConfig<S> h;
  if (scene.drives.homing_speed.empty()) return h;
  const double bandwidth = homing_bandwidth(scene);
  double travel = 2.0 * std::numbers::pi;
  if (const auto& range = scene.limits.joint_angle)  // the stops may lie a little outside
    travel = 1.1 * std::max((*range)[0][1] - (*range)[0][0], (*range)[1][1] - (*range)[1][0]);
  for (int i = 0; i < 2; ++i) {
    const auto u = static_cast<std::size_t>(i);
    h.speed[i] = static_cast<S>(scene.drives.homing_speed[u]);
    const double factor = scene.model.torque_factor[u];
    h.torque[i] = static_cast<S>(scene.drives.homing_torque[u] / factor);
    h.damping[i] = static_cast<S>(bandwidth * homing_load(scene, u).inertia / factor);
  }
  h.travel = static_cast<S>(travel);
  h.back_off = static_cast<S>(scene.drives.homing_back_off);
  h.share = static_cast<S>(0.25 * bandwidth * scene.tick());
  return h;
}
/// Homing leaves the zero pose by the back-off, and arming begins there.
template <class C>
void require_homing_pose(const Scene& scene, const typename C::Config& c) {
  using M = typename C::Mechanism;
  using S = typename C::S;
  if (scene.drives.homing_speed.empty()) return;
  if (scene.command && scene.command->timeout == 0.0)
    refuse_at(
        scene.drives.where,
        "'homing_speed': homing needs a command.timeout above 0, or a console that dies does not stop it");
  const ControllerConfig<M>& k = c.controller;
  const Vec2<S> base(c.zero_pose[0], c.zero_pose[M::joints / 2]);
  Vec2<S> off = base;
  for (int i = 0; i < 2; ++i) {
    off[i] -= std::copysign(c.homing.back_off, c.homing.speed[i]);
    constexpr double room = 1.5;  // for friction, and legs that help each other little
    const auto motor = static_cast<std::size_t>(i);
    const double factor = scene.model.torque_factor[motor], given = scene.torque_limit[motor] * factor,
                 least = room * homing_load(scene, motor).hold;
    if (scene.drives.homing_torque[motor] > given)
      refuse_at(scene.drives.where,
                "'homing_torque': motor {} gives {:.3g} N m at control.torque_limit "
                "(control.model.torque_factor = {:g})",
                i + 1, given, factor);
    if (scene.drives.homing_torque[motor] < least)
      refuse_at(scene.drives.where,
                "'homing_torque': joint {} needs at least {:.3g} N m, 1.5 times what its weight may take: "
                "less would hang in the air and take that for an end stop",
                i + 1, least);
    const Range<S>& range = k.limits.joint_angle[static_cast<std::size_t>(i)];
    const S above = range.upper - base[i], below = base[i] - range.lower;
    if (c.homing.speed[i] > S(0) ? above > below : below > above)
      refuse_at(scene.drives.where,
                "'homing_speed': joint {} moves away from the end of limits.joint_angle that its stop, "
                "zero_pose, is at",
                i + 1);
  }
  const auto e = estimate_from_base(k.mechanism, k.mode, off, Vec2<S>::Zero().eval());
  bool fits = e && estimate_from_base(k.mechanism, k.mode, base, Vec2<S>::Zero().eval()) &&
              M::in_working_mode(e->pose, k.mode) && k.limits.joint_angle[0].contains(off[0]) &&
              k.limits.joint_angle[1].contains(off[1]) &&
              M::min_abs_sin_type1(e->pose) >= k.limits.min_abs_sin_type1 &&
              M::sin_type2_in_mode(e->pose, k.mode) >= k.limits.min_abs_sin_type2;
  if constexpr (M::joints == 4) {
    if (k.sensors == Sensors::all)
      fits = fits && estimate_from_all(k.mechanism, c.zero_pose, Vec<S, 4>::Zero().eval()).closure <=
                         k.limits.closure;
  }
  if (!fits)
    refuse_at(scene.drives.where,
              "'zero_pose': the controller could not be armed after homing on these end stops; "
              "'homing_back_off' off them the mechanism must close in its modes, within limits.joint_angle "
              "and away from singularities");
}

constexpr double stopping_time_max = 1.5;  // s; longer than the host's controller waits at its end

constexpr double two_beats = 0.02;  // s; a working drive is never silent for longer

/// Longer without a heartbeat, an axis is lost.
std::uint32_t silence_ticks(const Scene& scene) {
  return static_cast<std::uint32_t>(std::ceil(scene.drives.heartbeat_timeout * scene.rate_hz));
}

/// `make_axis(i)` makes the axis of the scene's drive i.
template <class C, class MakeAxis>
typename C::Config config_of(const Scene& scene, Pacing pacing,
                             const ReferenceBundle<typename C::S>& reference, const MakeAxis& make_axis,
                             const decltype(C::Config::line)& line = {}) {
  typename C::Config c;
  c.line = line;
  c.controller = make_controller<typename C::Mechanism>(scene, pacing, reference);
  c.axis_count = static_cast<int>(scene.drives.nodes.size());
  c.heartbeat_age_ticks_max = silence_ticks(scene);
  const auto ticks = [&](double seconds) {
    return static_cast<std::uint32_t>(std::max(2.0, std::floor(seconds * scene.rate_hz)));
  };
  c.waiting_ticks_max = ticks(waiting_time_max(scene));
  c.controller.enabling_ticks_max = ticks(enabling_time_max(scene));
  c.controller.stopping_ticks_max = ticks(stopping_time_max);
  using S = typename C::S;
  c.torque_mismatch = static_cast<S>(scene.drives.torque_mismatch);
  c.torque_time = static_cast<S>(scene.drives.torque_time);
  c.samples_timed = pacing == Pacing::realtime;
  // Emulated drives know their angle, whatever the scene's real ones do; with homing they do not.
  c.confirmed = !scene.hardware || scene.drives.confirmed.value_or(false);
  c.zero_absolute = scene.drives.zero == Zero::absolute || !(scene.hardware || scene.homes());
  for (int i = 0, n = c.controller.sensor_count(); i < n; ++i) {
    const int joint = ControllerConfig<typename C::Mechanism>::joint_of(i, n);
    const auto at = static_cast<std::size_t>(i);
    c.zero_pose[joint] =
        static_cast<S>(scene.drives.zero_pose.empty() ? scene.start_angle[static_cast<std::size_t>(joint)]
                                                      : scene.drives.zero_pose[at]);
  }
  c.homing = make_homing<S>(scene);
  require_homing_pose<C>(scene, c);
  if (scene.command) {
    c.link = make_link(scene, pacing, c.controller.reference.space);
    const auto& r = c.controller.reference;
    c.link.has_path =
        r.kind != ReferenceKind::hold_start && (r.kind != ReferenceKind::path || !r.path.empty());
    c.delay_ticks = static_cast<S>(borne_delay(scene, pacing));
  }
  for (std::size_t i = 0; i < scene.drives.nodes.size(); ++i) c.axes[axis_of(scene, i)] = make_axis(i);
  return c;
}

/// Checks of the configuration of motor i: of values that the scene and the table of endpoints have.
[[nodiscard]] drive::OdriveTable odrive_table(const Scene& scene, std::size_t i) {
  drive::OdriveTable t;
  const DriveScene& d = scene.drives;
  if (!d.endpoints) return t;
  t.check_version = true;
  t.firmware = d.endpoints->firmware;
  using enum OdriveValue;
  constexpr auto most = static_cast<double>(std::numeric_limits<float>::max());
  constexpr double slack = 1e-3;  // of numbers that an operator typed
  struct Allowed {
    OdriveValue value;
    double lower, upper;
  };
  std::vector<Allowed> all{
      {enable_watchdog, 1, 1},
      {watchdog_timeout, 1e-3, d.watchdog_timeout * (1.0 + slack)},
      {control_mode, drive::odrive::control_mode_torque, drive::odrive::control_mode_torque},
      {input_mode, drive::odrive::input_mode_passthrough, drive::odrive::input_mode_passthrough},
      {torque_mode_limit, 0, 0},
      {vel_limit, odrive_vel_limit(scene, i) * (1.0 - slack), most},
      {overspeed_error, 1, 1},
      {heartbeat_period, 1, 10}};
  if (!d.torque_constant.empty()) {
    const double k = d.torque_constant[i];
    all.push_back({torque_constant, k * (1.0 - 10.0 * slack), k * (1.0 + 10.0 * slack)});
    all.push_back({current_limit, odrive_current(scene, i, k) * (1.0 - slack), most});
  }
  for (const OdriveEndpoint& e : d.endpoints->list) {
    const auto a = std::ranges::find(all, e.value, &Allowed::value);
    if (a != all.end())
      t.checks[t.count++] = {e.id, e.type, static_cast<float>(a->lower), static_cast<float>(a->upper)};
  }
  return t;
}
static_assert(odrive_values.size() <= drive::OdriveTable::checks_max);

[[nodiscard]] std::uint32_t retry_ticks(const Scene& scene) {
  return static_cast<std::uint32_t>(std::max(1.0, std::round(0.15 * scene.rate_hz)));
}

}  // namespace

OdriveSettings odrive_settings(const Scene& scene, Pacing pacing, std::size_t i) {
  const DriveScene& d = scene.drives;
  const bool motor = i < static_cast<std::size_t>(scene.motors());
  OdriveSettings s;
  s.version = d.protocol == Protocol::odrive ? drive::odrive::Version::v0_6 : drive::odrive::Version::v0_5_6;
  s.retry_ticks = retry_ticks(scene);
  s.silence_ticks =
      std::max(silence_ticks(scene), static_cast<std::uint32_t>(std::ceil(two_beats * scene.rate_hz)));
  if (motor) s.table = odrive_table(scene, i);
  // In lockstep the whole loop would wait for a drive without torque.
  if (motor && pacing == Pacing::realtime && d.watchdog_test.value_or(scene.hardware))
    s.proof_ticks = watchdog_proof_ticks(d, scene.rate_hz);
  return s;
}

drive::Cia402Settings cia402_settings(const Scene& scene, std::size_t i) {
  const DriveScene& d = scene.drives;
  const auto ticks = [&](double seconds) {
    return static_cast<std::uint16_t>(std::clamp(std::round(seconds * scene.rate_hz), 1.0, 65535.0));
  };
  drive::Cia402Settings s;
  if (i < d.rated_torque.size()) {  // a motor
    s.rated_torque = static_cast<float>(d.rated_torque[i]);
    s.torque_limit = static_cast<float>(scene.torque_limit[i] / d.gear_ratio[i]);
  }
  s.rated_torque_unit = static_cast<float>(d.rated_torque_unit);
  s.counts_per_turn = static_cast<std::uint32_t>(d.counts_per_turn);
  s.velocity_unit = static_cast<float>(d.velocity_unit);
  s.period_us = static_cast<std::uint32_t>(std::llround(1e6 / scene.rate_hz));
  s.consumer_ms = static_cast<std::uint16_t>(std::ceil(1e3 * d.watchdog_timeout - 1e-9));
  s.master_node = static_cast<std::uint8_t>(d.controller_node);
  s.retry_ticks = ticks(0.5);  // a transition of a real drive may take most of that: brakes, capacitors
  s.sdo_ticks = ticks(sdo_time);
  return s;
}

drive::MitAxis::Settings mit_settings(const Scene& scene, std::size_t i) {
  const DriveScene& d = scene.drives;
  drive::MitAxis::Settings s;
  s.ranges = {static_cast<float>(d.position_range[i]), static_cast<float>(d.velocity_range[i]),
              static_cast<float>(d.torque_range[i])};
  s.dialect = d.dialect;
  s.master_id = static_cast<std::uint16_t>(d.master_id[i]);
  s.retry_ticks = std::max(3U, retry_ticks(scene));
  s.velocity_unit = static_cast<float>(d.velocity_unit);
  return s;
}

drive::MoteusAxis::Settings moteus_settings(const Scene& scene, std::size_t i) {
  const DriveScene& d = scene.drives;
  drive::MoteusAxis::Settings s;
  s.torque_max = static_cast<float>(scene.torque_limit[i] / d.gear_ratio[i]);
  s.watchdog = static_cast<float>(d.watchdog_timeout);
  s.absolute = d.zero == Zero::absolute;
  s.retry_ticks = std::max(3U, retry_ticks(scene));
  return s;
}

template <class M>
AnyCycleConfig<M> make_cycle_config(const Scene& scene, Pacing pacing,
                                    const ReferenceBundle<typename M::Scalar>& reference) {
  switch (scene.drives.protocol) {
    case Protocol::odrive:
    case Protocol::odrive_0_5:
      break;
    case Protocol::cia402:
      return config_of<Cia402Cycle<M>>(
          scene, pacing, reference,
          [&](std::size_t i) { return drive::Cia402Axis(mount(scene, i), cia402_settings(scene, i)); },
          {static_cast<std::uint8_t>(scene.drives.controller_node), heartbeat_ticks(scene)});
    case Protocol::mit:
      return config_of<MitCycle<M>>(scene, pacing, reference, [&](std::size_t i) {
        return drive::MitAxis(mount(scene, i), mit_settings(scene, i));
      });
    case Protocol::moteus:
      return config_of<MoteusCycle<M>>(scene, pacing, reference, [&](std::size_t i) {
        return drive::MoteusAxis(mount(scene, i), moteus_settings(scene, i));
      });
  }
  return config_of<OdriveCycle<M>>(scene, pacing, reference, [&](std::size_t i) {
    const OdriveSettings s = odrive_settings(scene, pacing, i);
    drive::OdriveAxis axis(mount(scene, i), s.version, s.retry_ticks, s.table);
    axis.restarts_within(s.silence_ticks);
    if (s.proof_ticks > 0) axis.prove_watchdog(s.proof_ticks);
    return axis;
  });
}

template <class M>
AnyCycle<M> make_cycle(const Scene& scene, Pacing pacing,
                       const ReferenceBundle<typename M::Scalar>& reference) {
  return std::visit(
      []<class Config>(const Config& c) -> AnyCycle<M> {
        return Cycle<M, typename decltype(c.axes)::value_type>(c);
      },
      make_cycle_config<M>(scene, pacing, reference));
}

#define ESMC_INSTANCE(M, S)                                                                               \
  template AnyCycleConfig<M<S>> make_cycle_config<M<S>>(const Scene&, Pacing, const ReferenceBundle<S>&); \
  template AnyCycle<M<S>> make_cycle<M<S>>(const Scene&, Pacing, const ReferenceBundle<S>&);
ESMC_EACH_CONTROLLER(ESMC_INSTANCE)
#undef ESMC_INSTANCE

}  // namespace esmc::host
