#include "host_sim/check/check.hpp"
#include "host_sim/check/margins.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "host_sim/bus/response.hpp"
#include "host_sim/bus/wire.hpp"
#include "host_sim/controller/robust.hpp"
#include "host_sim/plant/system.hpp"

namespace esmc::host {
namespace {

/// Delay from a measurement to the torque computed from it, in ticks.
struct Delay {
  double certain = 0.0;  ///< compute_delay and delay
  double bus = 0.0;      ///< from sample to torque at worst, with bit_timing
  double lag = 0.0;      ///< of the drive's observer, as a delay of slower signals
  double drive = 0.0;    ///< of torque_lag, likewise: its pole alone makes no implicit law ring
};
Delay delay_of(const Scene& s) {
  Delay d;
  const auto late = find_effect<ComputeDelay>(s.effects);
  d.certain = (late ? late->time : 0.0) * s.rate_hz;
  d.bus = torque_delay(s) * s.rate_hz - d.certain;
  if (const auto e = find_effect<SensorDelay>(s.effects)) d.certain += e->ticks;
  const auto encoder = find_effect<Encoder>(s.effects);
  const auto noise = find_effect<SensorNoise>(s.effects);
  // Two poles at the bandwidth: each is late by its inverse.
  if (encoder || noise) d.lag += 2.0 / (encoder ? encoder->bandwidth : noise->bandwidth) * s.rate_hz;
  if (const auto e = find_effect<TorqueLag>(s.effects)) d.drive = e->time_constant * s.rate_hz;
  return d;
}

/// Largest K / layer + lambda, 1/s.
double stiffness(const Scene& s) {
  if (!s.robust_gain) {
    return std::max(s.gain.position / s.layer.position + s.lambda.position,
                    s.gain.angle / s.layer.angle + s.lambda.angle);
  }
  const auto of = [&]<class M>(const M*) { return robust_gains<M>(s, Pacing::lockstep).stiffness; };
  return with_mechanism<double>(s, of);
}

/// If momentum is measured later than assumed, the observer oscillates from omega late = pi/2 on.
void judge_observer(const Scene& s, const Delay& d, Findings& f) {
  const double late = d.certain + d.lag + d.drive - s.delay_ticks.value_or(0.0),
               turn = s.disturbance_observer * late * s.tick();
  if (turn <= std::numbers::pi / 4.0) return;
  f.warning(
      Code::loop_margin, "control.disturbance_observer",
      "control.disturbance_observer times a delay of {:.2g} ticks that it is not told = {:.3g}, better below "
      "{:.2g}; beyond {:.2g} it rings by itself: a smaller bandwidth, or a faster observer in the drive",
      late, turn, std::numbers::pi / 4.0, std::numbers::pi / 2.0);
}

}  // namespace

double torque_delay(const Scene& s, bool usual) {
  const auto late = find_effect<ComputeDelay>(s.effects);
  const double own = late ? late->time : 0.0;
  if (!find_effect<BitTiming>(s.effects)) return own;
  double bits = 0.0, foreign = 0.0;  // of a tick's loop, half of the stuff bits that there can be; of others
  for (const BusMessage& m : bus_messages(s)) {
    if (m.role != BusMessage::Role::other) bits += 0.5 * (m.least + interframe_bits + m.bits);
    if (m.role == BusMessage::Role::other) foreign += m.bits / m.period;
  }
  const double mostly = bits / s.bitrate / std::max(1e-3, 1.0 - foreign);
  return own + (usual && mostly < s.tick() ? mostly : analyse_bus(s).loop_s.value_or(s.tick()));
}

void judge_gains(const Scene& s, Findings& f) {
  const Delay d = delay_of(s);
  judge_observer(s, d, f);
  if (!s.sliding()) return;
  if (!s.robust_gain && std::max(s.gain.position, s.gain.angle) == 0.0) {
    f.warning(Code::no_gain, "control.gain",
              "control.gain = 0{}: the law holds against nothing, and an error of the start stays",
              s.reaching == ReachingChoice::super_twisting
                  ? ", which is L of super_twisting, the largest rate of what disturbs (docs/reaching.md)"
                  : "");
  }
  if (s.reaching == ReachingChoice::sign)
    f.warning(Code::loop_margin, "control.reaching",
              "reaching = \"sign\" chatters in a sampled loop; \"implicit\" does not");
  const bool bridges = s.predictor || s.reaching == ReachingChoice::super_twisting;
  if (bridges || s.reaching == ReachingChoice::implicit || s.reaching == ReachingChoice::implicit_coupled) {
    const double late = std::round(d.certain + d.lag),
                 told = s.delay_ticks.value_or(0.0) + s.sensor_lag_ticks;
    if (s.predictor && s.delay_ticks.value_or(0.0) > late) {
      f.warning(
          Code::delay_untold, "control.delay_ticks",
          "control.predictor looks control.delay_ticks = {:g} ahead, and this scene is late by about {}: "
          "what it foresees has happened already, and the loop may ring; tell the delay that there is",
          s.delay_ticks.value_or(0.0), late);
    }
    if (late > told) {
      f.warning(
          Code::delay_untold, "control.delay_ticks",
          "sensors and drives of this scene are late by about {} tick{}, the implicit law is told {}: it "
          "will chatter; set control.delay_ticks = {}",
          late, late == 1.0 ? "" : "s", told, late);
    }
    // Its layer makes gain / layer * tick = 1 / (1 + told); the bound is that of the actual delay [F39].
    const double bridged = bridges ? s.delay_ticks.value_or(0.0) : 0.0;
    const double loop = 1.0 / (1.0 + told - bridged) + std::max(s.lambda.position, s.lambda.angle) * s.tick();
    const double bound = 2.0 * std::sin(std::numbers::pi / (4.0 * (std::max(told, late) - bridged) + 2.0));
    if (loop > 0.85 * bound) {
      f.warning(
          Code::loop_margin, "control.lambda",
          "1 / (1 + delay_ticks) + lambda * tick = {:.3g}, better below {:.2g}; beyond {:.2g} the loop rings "
          "by itself: a smaller lambda",
          loop, 0.85 * bound, bound);
    }
    return;
  }
  if (s.reaching != ReachingChoice::sign) judge_layer(s, stiffness(s), f);
}

void judge_layer(const Scene& s, double stiffness, Findings& f) {
  Delay d = delay_of(s);
  // kappa T <= 0.3, and below half of the bound on stability 2 sin(pi/(4 d + 2)) [F39]
  const double kappa_t = stiffness * s.tick();
  const std::string is = fmt::format("(gain / layer + lambda) * tick = {:.3g}", kappa_t);
  const std::string cure =
      "a larger control.layer, a smaller gain or lambda (docs/theory.md, \"Boundary layers and the implicit "
      "law\")";
  d.certain += d.bus;
  if (const double most = design::steepest(d.certain); kappa_t > most) {
    f.warning(
        Code::gain_margin, "control.layer",
        "{}, at most {:.2g}, half of what makes the loop ring by itself with a delay of {:.2g} ticks: {}", is,
        most, d.certain, cure);
  } else if (const double allowed = std::min(0.3, design::steepest(d.certain + d.lag + d.drive));
             kappa_t > allowed) {
    f.warning(Code::loop_margin, "control.layer", "{}, better below {:.2g}: {}", is, allowed, cure);
  }
}

void judge_step(const Scene& s, Findings& f) {
  const auto stops = find_effect<EndStops>(s.effects);
  const bool rigid = set_valued(s.effects);  // which replaces every method but one, and steps over springs
  const Method method = rigid && s.method != Method::event_driven ? Method::moreau_jean : s.method;
  if (s.accuracy || method == Method::radau5 || (rigid && method == Method::event_driven)) return;
  double inertia = std::numeric_limits<double>::infinity();  // about its own joint, of the lightest bar
  for (std::size_t j = 0; j < (s.type == MechanismType::five_bar ? 2U : 1U); ++j) {
    const LegParams<double>& leg = s.mechanism.legs[j];
    for (const double J : {leg.J1 + leg.m1 * leg.lg1 * leg.lg1, leg.J2 + leg.m2 * leg.lg2 * leg.lg2}) {
      if (J > 0.0) inertia = std::min(inertia, J);
    }
  }
  const double step = s.tick() / std::max(1.0, std::ceil(s.tick() / s.step - 1e-9));
  const auto spring = [&](const char* what, double stiffness, double inverse_rotor) {
    const double omega = std::sqrt(stiffness * (inverse_rotor + 1.0 / inertia));
    if (step * omega <= 0.5) return;
    f.warning(
        Code::step_too_long, "simulation.step",
        "{} swings at about {:.3g} rad/s: integration steps of {:.2g} s are too long for {}, take at most "
        "{:.2g} s{} or simulation.accuracy",
        what, omega, step, name(method), 0.5 / omega, rigid ? "" : ", integrator = \"radau5\"");
  };
  const auto gear = find_effect<JointFlexibility>(s.effects);
  if (gear) {
    double omega2 = 0.0, stiffness = 0.0, inverse = 0.0;
    for (std::size_t i = 0; i < static_cast<std::size_t>(s.motors()); ++i) {
      const double own = gear->stiffness[i] * (1.0 / gear->rotor_inertia[i] + 1.0 / inertia);
      if (own <= omega2) continue;
      omega2 = own;
      stiffness = gear->stiffness[i];
      inverse = 1.0 / gear->rotor_inertia[i];
    }
    spring("joint_flexibility", stiffness, inverse);
  }
  if (const auto play = find_effect<Backlash>(s.effects); play && !gear)
    spring("the contact of backlash", play->stiffness, 1.0 / play->rotor_inertia);
  if (stops && stops->stiffness) spring("a joint at its end_stops", *stops->stiffness, 0.0);
}

}  // namespace esmc::host
