#include "host_sim/commands/controller_config.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>

#include "host_sim/drives/placed_axes.hpp"

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

LegParams<double> scaled(LegParams<double> p, const ModelFactors& f) {
  p.l1 *= f.l1;
  p.l2 *= f.l2;
  p.lg1 *= f.lg1;
  p.lg2 *= f.lg2;
  p.m1 *= f.m1;
  p.m2 *= f.m2;
  p.J1 *= f.J1;
  p.J2 *= f.J2;
  return p;
}

LawKind law_kind(LawChoice l) {
  switch (l) {
    case LawChoice::esmc:
      return LawKind::esmc;
    case LawChoice::esmc_projected:
      return LawKind::esmc_projected;
    case LawChoice::smc:
      return LawKind::smc;
    case LawChoice::ctc:
      return LawKind::ctc;
    case LawChoice::pd:
    case LawChoice::open_loop:
    case LawChoice::none:
      break;
  }
  return LawKind::pd;
}

template <class M>
void set_gains(const Scene& s, double delay, Gains<M>& g) {
  using S = typename M::Scalar;
  const auto layer = [&](double gain, double given) {
    // Without switching gain the layer does nothing, but it must not be zero: s / layer is taken.
    return s.reaching == ReachingChoice::implicit && gain > 0.0 ? implicit_layer(gain, s.tick(), delay)
                                                                : given;
  };
  for (int i = 0; i < M::channels; ++i) {
    const bool angle = M::is_angle(i);
    const double k = angle ? s.gain.angle : s.gain.position;
    g.lambda[i] = static_cast<S>(angle ? s.lambda.angle : s.lambda.position);
    g.k[i] = static_cast<S>(k);
    g.layer[i] = static_cast<S>(layer(k, angle ? s.layer.angle : s.layer.position));
  }
  const bool angles = !M::has_type2;  // the independent coordinates of RR are its joints
  auto& own = g.independent;
  const double lambda = angles ? s.lambda.angle : s.lambda.position,
               k = angles ? s.gain.angle : s.gain.position;
  own.lambda = static_cast<S>(lambda);
  own.k = static_cast<S>(k);
  own.layer = static_cast<S>(layer(k, angles ? s.layer.angle : s.layer.position));
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
  if (s.limits.workspace) {
    l.workspace_x = range<S>((*s.limits.workspace)[0]);
    l.workspace_y = range<S>((*s.limits.workspace)[1]);
  }
  if (s.limits.joint_angle) {
    for (std::size_t i = 0; i < 2; ++i) l.joint_angle[i] = range<S>((*s.limits.joint_angle)[i]);
  }
  return l;
}

Reference<double> in_scalar(const ReferenceBundle<double>& b, const double*) { return b.get(); }
Reference<float> in_scalar(const ReferenceBundle<double>& b, const float*) {
  if (!b.path.empty()) throw std::logic_error("references with a path exist in double only");
  const Reference<double>& r = b.reference;
  return {r.kind, r.space, r.centre.cast<float>(), r.amplitude.cast<float>(), r.speed.cast<float>(), r.phase,
          {},     0};
}

}  // namespace

FiveBarParams<double> believed_mechanism(const Scene& scene) {
  const ModelFactors& f = scene.model;
  FiveBarParams<double> p = scene.mechanism;
  p.l0 *= f.half_base;
  p.m0 *= f.effector_mass;
  p.g *= f.gravity;
  const auto friction = find_effect<ViscousFriction>(scene.effects);
  const auto dry = find_effect<CoulombFriction>(scene.effects);
  for (std::size_t j = 0; j < 2; ++j) {
    p.legs[j] = scaled(p.legs[j], f);
    if (f.exact_friction && friction) {
      p.legs[j].d1 = friction->coefficient[2 * j];
      p.legs[j].d2 = friction->coefficient[2 * j + 1];
    }
    if (f.exact_friction && dry) {
      p.legs[j].gamma1 = dry->torque[2 * j];
      p.legs[j].gamma2 = dry->torque[2 * j + 1];
    }
  }
  return p;
}

ReferenceBundle<double> make_reference(const Scene& scene, Pacing pacing) {
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
  return out;
}

template <class M>
ControllerConfig<M> make_controller(const Scene& scene, Pacing pacing,
                                    const ReferenceBundle<double>& reference) {
  using S = typename M::Scalar;
  ControllerConfig<M> c;
  c.mechanism = make_mechanism(believed_mechanism(scene), static_cast<M*>(nullptr));
  c.mode = mode_of(scene, static_cast<M*>(nullptr));
  c.law = law_kind(scene.law);
  switch (scene.reaching) {
    case ReachingChoice::sign:
      c.reaching = Reaching::sign;
      break;
    case ReachingChoice::saturation:
      c.reaching = Reaching::saturation;
      break;
    case ReachingChoice::tanh:
      c.reaching = Reaching::tanh;
      break;
    case ReachingChoice::implicit:
      c.reaching = Reaching::implicit;
      break;
  }
  set_gains(scene, delay_ticks(scene, pacing), c.gains);
  c.reference = in_scalar(reference, static_cast<const S*>(nullptr));
  c.join_ticks = reference.join_ticks;
  const auto ticks = [&](double seconds) { return static_cast<std::uint32_t>(std::llround(seconds * scene.rate_hz)); };
  c.ramp_ticks = ticks(scene.torque_ramp.value_or(pacing == Pacing::realtime ? 0.2 : 0.0));
  c.halt_ticks = scene.limits.halt_time > 0.0 ? std::max(1U, ticks(scene.limits.halt_time)) : 0U;
  if (scene.drives.sign_test.value_or(scene.hardware && !scene.all_motors)) {
    c.sign_test_move = static_cast<S>(scene.drives.sign_test_move);
  }
  if (scene.command) {
    c.guide_speed = static_cast<S>(scene.command->speed);
    c.guide_acceleration = static_cast<S>(scene.command->acceleration);
  }
  c.torque_lead = static_cast<S>(scene.drives.torque_lead);
  c.lower_ticks = ticks(scene.limits.lower_time);
  c.after_halt = scene.limits.after_halt == AfterHalt::hold
                     ? esmc::AfterHalt::hold
                     : (scene.limits.after_halt == AfterHalt::lower ? esmc::AfterHalt::lower
                                                                    : esmc::AfterHalt::release);
  c.limits = make_limits<S>(scene);
  c.motors = scene.all_motors ? Motors::all : Motors::base;
  c.sensors = scene.all_sensors ? Sensors::all : Sensors::base;
  c.sample_time = static_cast<S>(scene.tick());
  for (int i = 0; i < c.motor_count(); ++i) {
    const auto u = static_cast<std::size_t>(i);
    const int joint = ControllerConfig<M>::joint_of(i, c.motor_count());
    const double limit = scene.torque_limit[u];
    c.torque_limit[joint] = static_cast<S>(limit);
    c.torque_weight[joint] =
        static_cast<S>(scene.torque_weight.empty() ? 1.0 / (limit * limit) : scene.torque_weight[u]);
  }
  return c;
}

namespace {

/// In the scene motors come first; in the cycle axes stand in the order of their joints.
[[nodiscard]] std::size_t axis_of(const Scene& scene, std::size_t i) {
  const bool mixed = scene.all_sensors && !scene.all_motors;
  return mixed ? (i < 2 ? 2 * i : 2 * (i - 2) + 1) : i;
}

[[nodiscard]] drive::AxisConfig mount(const DriveScene& d, std::size_t i) {
  return {static_cast<std::uint8_t>(d.nodes[i]), static_cast<float>(d.direction[i]),
          static_cast<float>(d.gear_ratio[i]), static_cast<float>(d.offset[i])};
}

/// What a supervisor computer may ask for, and what it is told.
link::LinkConfig make_link(const Scene& scene, Pacing pacing, ReferenceSpace space) {
  const CommandScene& k = *scene.command;
  const auto real = [](double v) { return static_cast<float>(v); };
  const auto ticks = [&](double seconds) { return std::ceil(seconds * scene.rate_hz); };
  const auto count = [](int n) { return static_cast<std::uint32_t>(n); };
  link::LinkConfig c;
  c.base_id = count(k.base_id);
  // A recording of one run is worth nothing in the next; in lockstep runs are to be repeatable.
  const std::uint32_t draw = pacing == Pacing::realtime ? std::random_device{}() : static_cast<std::uint32_t>(scene.seed);
  c.session = static_cast<std::uint8_t>(draw % 255U + 1U);
  c.counter_jump_max = static_cast<std::uint8_t>(k.counter_jump);
  c.command_age_ticks_max = static_cast<std::uint16_t>(std::min(ticks(k.order_age), 65535.0 / 2.0));
  c.status_ticks = count(k.status_ticks);
  c.telemetry_ticks = count(k.telemetry_ticks);
  c.table_ticks = static_cast<std::uint32_t>(std::max(1.0, ticks(1.0)));
  c.period_ns = static_cast<std::uint32_t>(std::llround(1e9 / scene.rate_hz));
  c.source = static_cast<link::Source>(k.source);
  const bool joints = space == ReferenceSpace::base_joints;
  c.space = joints ? link::Space::base_joints : link::Space::effector;
  const auto& box = joints ? scene.limits.joint_angle : scene.limits.workspace;
  for (std::size_t i = 0; i < 2; ++i) {
    c.position[i] = box ? link::Bounds{real((*box)[i][0]), real((*box)[i][1])} : link::Bounds{-1e3F, 1e3F};
  }
  const auto bounds = [&](const std::array<double, 2>& r) { return link::Bounds{real(r[0]), real(r[1])}; };
  const link::Parameters::Values values{
      real(scene.lambda.position), real(scene.lambda.angle), real(scene.gain.position), real(scene.gain.angle),
      real(scene.tick()), real(scene.torque_limit[0]), real(scene.torque_limit[static_cast<std::size_t>(scene.motors()) / 2]),
      real(scene.limits.joint_speed), real(k.speed), real(k.acceleration), static_cast<float>(k.stream_age_ticks),
      real(ticks(k.timeout))};
  c.parameters = link::Parameters(values, {bounds(k.lambda), bounds(k.lambda), bounds(k.gain), bounds(k.gain)});
  return c;
}
static_assert(static_cast<int>(link::Source::hold) == static_cast<int>(CommandSource::hold) &&
              static_cast<int>(link::Source::reference) == static_cast<int>(CommandSource::reference) &&
              static_cast<int>(link::Source::stream) == static_cast<int>(CommandSource::stream));

/// A cycle of axes that `make_axis(i)` makes, i in the order of the scene.
template <class C, class MakeAxis>
C cycle_of(const Scene& scene, Pacing pacing, const ReferenceBundle<double>& reference, const MakeAxis& make_axis,
           const decltype(C::Config::line)& line = {}) {
  typename C::Config c;
  c.line = line;
  c.controller = make_controller<typename C::Mechanism>(scene, pacing, reference);
  c.axis_count = static_cast<int>(scene.drives.nodes.size());
  c.heartbeat_age_ticks_max = static_cast<std::uint32_t>(std::ceil(scene.drives.heartbeat_timeout * scene.rate_hz));
  using S = typename C::S;
  c.torque_mismatch = static_cast<S>(scene.drives.torque_mismatch);
  c.torque_time = static_cast<S>(scene.drives.torque_time);
  c.samples_timed = pacing == Pacing::realtime;
  // Emulated drives know their angle, whatever the scene's real ones do.
  c.zero_absolute = scene.drives.zero == Zero::absolute || !scene.hardware;
  for (int i = 0, n = c.controller.sensor_count(); i < n; ++i) {
    const int joint = ControllerConfig<typename C::Mechanism>::joint_of(i, n);
    const auto at = static_cast<std::size_t>(i);
    c.zero_pose[joint] = static_cast<S>(scene.drives.zero_pose.empty()
                                            ? scene.start_angle[static_cast<std::size_t>(joint)]
                                            : scene.drives.zero_pose[at]);
  }
  if (scene.command) {
    c.link = make_link(scene, pacing, c.controller.reference.space);
    c.delay_ticks = static_cast<S>(delay_ticks(scene, pacing));
  }
  for (std::size_t i = 0; i < scene.drives.nodes.size(); ++i) c.axes[axis_of(scene, i)] = make_axis(i);
  return C(c);
}

/// What the configuration of motor i must hold, as far as the scene says it and the table of endpoints has it.
[[nodiscard]] drive::OdriveTable odrive_table(const Scene& scene, std::size_t i) {
  drive::OdriveTable t;
  const DriveScene& d = scene.drives;
  if (!d.endpoints) return t;
  t.check_version = true;
  t.firmware = d.endpoints->firmware;
  constexpr float most = std::numeric_limits<float>::max();
  constexpr double slack = 1e-3;  // of numbers that somebody typed
  const auto check = [&](const OdriveEndpoint& e, float lower, float upper) {
    t.checks[t.count++] = {e.id, e.type, lower, upper};
  };
  for (const OdriveEndpoint& e : d.endpoints->list) {
    switch (e.value) {
      case OdriveValue::enable_watchdog:
      case OdriveValue::overspeed_error:
        check(e, 1.0F, 1.0F);
        break;
      case OdriveValue::watchdog_timeout:
        check(e, 1e-3F, static_cast<float>(d.watchdog_timeout * (1.0 + slack)));
        break;
      case OdriveValue::control_mode:
        check(e, drive::odrive::control_mode_torque, drive::odrive::control_mode_torque);
        break;
      case OdriveValue::input_mode:
        check(e, drive::odrive::input_mode_passthrough, drive::odrive::input_mode_passthrough);
        break;
      case OdriveValue::torque_mode_limit:
        check(e, 0.0F, 0.0F);
        break;
      case OdriveValue::vel_limit:
        check(e, static_cast<float>(odrive_vel_limit(scene, i) * (1.0 - slack)), most);
        break;
      case OdriveValue::torque_constant:
        if (d.torque_constant.empty()) break;
        check(e, static_cast<float>(d.torque_constant[i] * (1.0 - 10.0 * slack)),
              static_cast<float>(d.torque_constant[i] * (1.0 + 10.0 * slack)));
        break;
      case OdriveValue::current_limit:
        if (d.torque_constant.empty()) break;
        check(e, static_cast<float>(odrive_current(scene, i, d.torque_constant[i]) * (1.0 - slack)), most);
        break;
    }
  }
  return t;
}
static_assert(odrive_values.size() <= drive::OdriveTable::checks_max);

[[nodiscard]] drive::Cia402Settings cia402_settings(const Scene& scene, std::size_t i) {
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
  s.sdo_ticks = ticks(0.1);
  return s;
}

}  // namespace

template <class M>
AnyCycle<M> make_cycle(const Scene& scene, Pacing pacing, const ReferenceBundle<double>& reference) {
  const DriveScene& d = scene.drives;
  const auto retry = static_cast<std::uint32_t>(std::max(1.0, std::round(0.15 * scene.rate_hz)));
  switch (d.protocol) {
    case Protocol::odrive:
    case Protocol::odrive_0_5:
      break;
    case Protocol::cia402:
      return cycle_of<Cia402Cycle<M>>(
          scene, pacing, reference, [&](std::size_t i) { return drive::Cia402Axis(mount(d, i), cia402_settings(scene, i)); },
          {static_cast<std::uint8_t>(d.controller_node), heartbeat_ticks(scene)});
    case Protocol::mit:
      return cycle_of<MitCycle<M>>(scene, pacing, reference, [&](std::size_t i) {
        drive::MitAxis::Settings s;
        s.ranges = {static_cast<float>(d.position_range[i]), static_cast<float>(d.velocity_range[i]),
                    static_cast<float>(d.torque_range[i])};
        s.dialect = dialect_of(scene);
        s.master_id = static_cast<std::uint16_t>(d.master_id[i]);
        s.retry_ticks = std::max(3U, retry);
        return drive::MitAxis(mount(d, i), s);
      });
  }
  const auto version =
      d.protocol == Protocol::odrive ? drive::odrive::Version::v0_6 : drive::odrive::Version::v0_5_6;
  return cycle_of<OdriveCycle<M>>(scene, pacing, reference, [&](std::size_t i) {
    const bool motor = i < static_cast<std::size_t>(scene.motors());
    drive::OdriveAxis axis(mount(d, i), version, retry, motor ? odrive_table(scene, i) : drive::OdriveTable{});
    // In lockstep a drive without its torque would keep everybody waiting.
    if (motor && pacing == Pacing::realtime && d.watchdog_test.value_or(scene.hardware)) {
      axis.prove_watchdog(watchdog_proof_ticks(d, scene.rate_hz));
    }
    return axis;
  });
}

template ControllerConfig<FiveBar<double>> make_controller<FiveBar<double>>(const Scene&, Pacing,
                                                                            const ReferenceBundle<double>&);
template ControllerConfig<FiveBar<float>> make_controller<FiveBar<float>>(const Scene&, Pacing,
                                                                          const ReferenceBundle<double>&);
template ControllerConfig<Rr<float>> make_controller<Rr<float>>(const Scene&, Pacing,
                                                                const ReferenceBundle<double>&);
template ControllerConfig<Rr<double>> make_controller<Rr<double>>(const Scene&, Pacing,
                                                                  const ReferenceBundle<double>&);
template AnyCycle<FiveBar<double>> make_cycle<FiveBar<double>>(const Scene&, Pacing,
                                                               const ReferenceBundle<double>&);
template AnyCycle<Rr<double>> make_cycle<Rr<double>>(const Scene&, Pacing, const ReferenceBundle<double>&);

}  // namespace esmc::host
