#include "host_sim/check/probe.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "firmware/safety/faults.hpp"
#include "host_sim/controller/controller_config.hpp"
#include "host_sim/loop/run.hpp"
#include "host_sim/plant/system.hpp"
#include "host_sim/scene/frame_steps.hpp"
#include "host_sim/turns.hpp"

namespace esmc::host {
namespace {

/// Moves the instants of effects: they count from the beginning of the part.
struct Shift {
  double by;
  void operator()(Payload& e) const { e.from -= by, e.to -= by; }
  void operator()(ExternalForce& e) const { e.from -= by, e.to -= by; }
  template <class Other>
  void operator()(Other&) const {}
};

/// The scene from a moment on its reference, in motion with it.
Scene part_of(const Scene& scene, const Moment& from, std::uint32_t ticks) {
  Scene s = scene;
  s.whole = std::make_shared<const Scene>(scene);
  s.duration = ticks * s.tick();
  s.reference.first_tick = from.tick;
  s.reference.join = 0.0;
  s.torque_ramp = 0.0;
  s.start_angle = from.angle;
  s.start_rate = from.rate;
  for (Effect& e : s.effects) std::visit(Shift{from.tick * s.tick()}, e);
  std::erase_if(s.effects, acts_on_bus);
  if (find_effect<BitTiming>(scene.effects)) {
    std::erase_if(s.effects, [](const Effect& e) { return std::holds_alternative<ComputeDelay>(e); });
    s.effects.emplace_back(ComputeDelay{torque_delay(scene, true)});
  }
  if (s.accuracy) {
    const bool stiff = find_effect<JointFlexibility>(s.effects) || find_effect<Backlash>(s.effects);
    s.method = stiff ? Method::radau5 : Method::rk4;
    s.accuracy.reset();
  }
  return s;
}

/// Ticks [from, to) of a run.
struct Stretch {
  std::size_t from, to;
  [[nodiscard]] double size() const { return static_cast<double>(to - from); }
};

/// Mean over the motors of |change of torque| / torque_limit.
double mean_change(const Scene& s, const Trace& t, const Stretch& over) {
  const auto motors = static_cast<std::size_t>(s.motors());
  double sum = 0.0;
  for (std::size_t n = over.from; n < over.to; ++n) {
    for (std::size_t i = 0; i < motors; ++i)
      sum += std::abs(t.torque[n * motors + i] - t.torque[(n - 1) * motors + i]) / s.torque_limit[i];
  }
  return over.size() > 0.0 ? sum / (over.size() * static_cast<double>(motors)) : 0.0;
}

/// True if the mechanism is in the other assembly mode than a controller with encoders at the base takes it
/// to be in: it has passed type 2 between two ticks. `q`: of final_state.
bool passed_type2_unseen(const Scene& s, const std::vector<double>& q) {
  return guarded_type2(s) && with_mechanism<double>(s, [&]<class M>(const M*) {
           if constexpr (M::has_type2) {
             const M m(params_of<M>(s.mechanism));
             const auto joints = q.end() - M::joints;
             return !(M::sin_type2_in_mode(m.pose(Vec<double, M::joints>(&*joints)), mode_of<M>(s)) > 0.0);
           }
           return false;
         });
}

/// The last 30 % of the ticks count, the 30 % before them say whether it grows or dies away.
ProbePart run_part(const Scene& s, std::uint32_t begins, ProbePart::Kind kind) {
  const Trace t = probe(s, kind != ProbePart::Kind::slow);
  ProbePart out{.t = begins * s.tick(), .ticks = tick_count(s), .rate_hz = s.rate_hz, .kind = kind};
  if (!t.end.faults.empty()) out.fault = t.end.faults.front().name;
  std::size_t ran = t.saturated.size();
  if (const auto fault = t.statistics.fault_time()) {
    ran = static_cast<std::size_t>(std::llround(*fault * s.rate_hz));
    out.fault_t = out.t + *fault;
  }
  const std::size_t first = std::max<std::size_t>(1, ran * 2 / 5), second = std::max(first, ran * 7 / 10);
  const Stretch before{first, second}, last{second, std::max(ran, second)};
  out.change = mean_change(s, t, last);
  const double earlier = mean_change(s, t, before);
  if (earlier > 0.0 && out.change > 0.0) out.growth = std::pow(out.change / earlier, 1.0 / last.size());
  const Stretch counted = kind == ProbePart::Kind::slow ? Stretch{0, std::max<std::size_t>(ran, 1)} : last;
  for (std::size_t n = counted.from; n < std::min(counted.to, t.saturated.size()); ++n)
    out.saturated += t.saturated[n] ? 1.0 / counted.size() : 0.0;
  const auto& errors = t.statistics.sums().effector;
  out.error = kind == ProbePart::Kind::slow ? errors.settled().largest : errors.all().largest;
  if (!std::isfinite(t.end.q.front())) {
    out.diverged = out.t + static_cast<double>(t.saturated.size()) * s.tick();
  } else if (out.fault.empty() && passed_type2_unseen(s, t.end.q)) {
    out.fault = name(Fault::type2_singularity);
    out.fault_t = out.t + s.duration;
  }
  return out;
}

constexpr double steepest = 0.5;  ///< lambda times a tick at the lower rate, at most

/// Ticks of a scene per tick at a lower rate, which is 50 Hz at least: longer ones are too long for an arm
/// that moves. Empty: no such rate is lower; without a switching gain nothing holds against the errors of it;
/// or it would change the reference, as a program is planned for its rate.
std::optional<double> slowing(const Scene& scene) {
  constexpr double longest = 20.0, least = 2.0, slowest_hz = 50.0;
  const double most = std::min(longest, scene.rate_hz / slowest_hz);
  const bool held =
      !scene.sliding() || scene.robust_gain || std::max(scene.gain.position, scene.gain.angle) > 0.0;
  if (!held || most < least || scene.reference.type == ReferenceType::program) return std::nullopt;
  return std::clamp(scene.duration * scene.rate_hz / slow_ticks, 1.0, most);
}

/// The scene with ticks that are `longer` times as long: for what takes longer than a part. Without
/// what only a fast loop shows: delays, the drives' observers, noise, gears; with the lambda that such a loop
/// bears, and the implicit law for others with a layer.
Scene slowed(const Scene& scene, double longer) {
  Scene s = scene;
  s.whole = std::make_shared<const Scene>(scene);
  s.rate_hz = scene.rate_hz / longer;
  s.step = std::min(s.step, scene.tick());
  std::erase_if(s.effects, [](const Effect& e) {
    return acts_on_bus(e) || std::holds_alternative<Encoder>(e) || std::holds_alternative<SensorNoise>(e) ||
           std::holds_alternative<SensorDelay>(e) || std::holds_alternative<ComputeDelay>(e) ||
           std::holds_alternative<Jitter>(e) || std::holds_alternative<TorqueLag>(e) ||
           std::holds_alternative<JointFlexibility>(e) || std::holds_alternative<Backlash>(e);
  });
  s.delay_ticks.reset();
  s.sensor_lag_ticks = 0.0;
  s.predictor = false;
  s.limits.feedback_jump = 0.0;  // a prediction by the rate says nothing over so long a tick
  s.disturbance_observer = std::min(s.disturbance_observer, 0.3 * s.rate_hz);
  for (double* lambda : {&s.lambda.position, &s.lambda.angle})
    *lambda = std::min(*lambda, steepest * s.rate_hz);
  if (s.sliding() && s.reaching != ReachingChoice::super_twisting) s.reaching = ReachingChoice::implicit;
  if (s.accuracy) {
    s.method = Method::rk4;
    s.accuracy.reset();
  }
  return s;
}

/// s, when the first load after `t` begins in the scene; empty: none.
std::optional<double> next_load(const Scene& scene, double t) {
  std::optional<double> out;
  const auto look = [&](double from) {
    if (from > t && from < scene.duration) out = std::min(from, out.value_or(from));
  };
  for (const Effect& e : scene.effects) {
    if (const auto* load = std::get_if<Payload>(&e)) look(load->from);
    if (const auto* force = std::get_if<ExternalForce>(&e)) look(force->from);
  }
  return out;
}

/// The state on the reference at a tick, on the turn of the reference; empty: out of reach.
std::optional<Moment> on_reference(const Scene& scene, const Margins& m, std::uint32_t tick, double least) {
  auto from = moment_at(scene, tick, least);
  for (std::size_t k = 0; from && k < 2; ++k) {
    double& base = from->angle[k * from->angle.size() / 2];
    base = nearest_turn(base, 0.5 * (m.angle[k].low + m.angle[k].high));
  }
  return from;
}

constexpr std::uint32_t load_ticks = 30;  ///< at the lower rate, from just before a late load

/// The scene at a lower rate, from its start and, if a load begins after that, from just before it.
void run_slowed(const Scene& slow, std::optional<double> load, const Margins& m,
                std::vector<ProbePart>& out) {
  constexpr std::uint32_t before = 10;
  Scene first = slow;
  first.duration = slow_ticks * slow.tick();
  out.push_back(run_part(first, 0, ProbePart::Kind::slow));
  if (!load) return;
  const auto at = static_cast<std::uint32_t>(*load * slow.rate_hz) - before;
  if (const auto from = on_reference(slow, m, at, 0.0)) {
    const std::uint32_t ticks = std::min(load_ticks, tick_count(slow) - at);
    out.push_back(run_part(part_of(slow, *from, ticks), at, ProbePart::Kind::slow));
  }
}

}  // namespace

std::vector<ProbePart> probe_scene(const Scene& scene, const Margins& m) {
  using enum ProbePart::Kind;
  const std::uint32_t last = m.ticks, join = make_reference(scene, Pacing::lockstep).join_ticks;
  const bool all = last <= join + probe_ticks;
  const auto longer = m.off_reference ? std::nullopt : slowing(scene);
  const auto load = longer ? next_load(scene, slow_ticks * *longer * scene.tick()) : std::nullopt;
  constexpr std::uint32_t start = 20, places = 3;
  const std::uint32_t rest = probe_ticks - start - (m.off_reference || longer ? slow_ticks : 0) -
                             (load ? load_ticks : 0),
                      each = rest / places;
  Scene first = scene;
  first.whole = std::make_shared<const Scene>(scene);
  // Where the start is far off, the way onto the reference says more than all of it at a lower rate.
  first.duration = (all               ? std::min(last, probe_ticks)
                    : m.off_reference ? start + slow_ticks
                                      : start) *
                   scene.tick();
  std::vector<ProbePart> out{run_part(first, 0, all ? typical : begin)};
  if (all) return out;
  if (longer) run_slowed(slowed(scene, *longer), load, m, out);
  // From a push a good loop recovers, with the torque that the reference leaves.
  const double push = 1.0 - 0.1 * std::clamp(2.0 * (1.0 - m.share), 0.0, 1.0);
  for (std::uint32_t i = 0; i < places; ++i) {
    const std::uint32_t at =
        join + static_cast<std::uint32_t>((2 * i + 1) * std::uint64_t{last - join} / (2 * places));
    auto from = on_reference(scene, m, std::clamp(at, join + 1, last - each), m.tick_speed);
    if (!from) continue;
    for (double& rate : from->rate) rate *= push;
    out.push_back(run_part(part_of(scene, *from, each), from->tick, typical));
  }
  return out;
}

namespace {

/// False for a part at a lower rate, where that rate made it ring (`smooth`: change of torque per tick, as
/// share of torque_limit) or meet a fault of its own.
bool counts(const ProbePart& p, double smooth = 0.1) {
  constexpr double enough_ticks = 10.0;
  constexpr Fault of_the_way[] = {Fault::type1_singularity, Fault::type2_singularity, Fault::working_mode};
  if (p.kind != ProbePart::Kind::slow) return true;
  if (!(p.change < smooth) || p.diverged) return false;
  return p.fault.empty() || p.fault == name(Fault::join_infeasible) ||
         ((p.fault_t - p.t) * p.rate_hz >= enough_ticks &&
          std::ranges::any_of(of_the_way, [&](Fault f) { return p.fault == name(f); }));
}

void judge_join(const Scene& scene, const Margins& m, Findings& f) {
  // At rest onto a moving reference, a join of T seconds at speed v runs up over about 0.2 v T.
  const double join = scene.reference.join.value_or(0.0);
  f.error(Code::limit_crossed, "reference.join",
          "the way onto the reference in reference.join = {:g} s takes more than the limits "
          "(join_infeasible): {}",
          join,
          0.2 * m.start_speed * join > m.start_off
              ? "the run-up for the reference's speed grows with it; a shorter one, or 0"
              : "a longer one, or a start nearer to the reference");
}

/// Parts that a fault ends, or whose integration does not hold.
void judge_ends(const Scene& scene, const Margins& m, const std::vector<ProbePart>& parts, Findings& f) {
  const auto lost = std::ranges::find_if(
      parts, [](const ProbePart& p) { return p.diverged.has_value() && p.kind != ProbePart::Kind::slow; });
  // A step that a scene leaves to the program is not its own.
  if (lost != parts.end() && !scene.accuracy) {
    f.error(Code::step_too_long, "simulation.step",
            "simulated from t = {:.3f} s, the state is not finite from t = {:.3f} s on: a simulation.step "
            "below {:g} s{} or simulation.accuracy",
            lost->t, *lost->diverged, scene.step,
            set_valued(scene.effects) ? "" : ", integrator = \"radau5\"");
  }
  for (const ProbePart& p : parts) {
    if (p.fault.empty() || !counts(p)) continue;
    if (p.fault == name(Fault::join_infeasible)) {
      if (!f.refused_for(Code::limit_crossed)) judge_join(scene, m, f);
    } else if (!f.refused_for(Code::limit_crossed)) {
      f.error(Code::limit_crossed, m.off_reference ? "reference.join" : "limits",
              "simulated from t = {:.3f} s{}, the loop ends in the fault {} at t = {:.3f} s{}", p.t,
              p.kind == ProbePart::Kind::slow ? fmt::format(" at {:.3g} Hz", p.rate_hz) : "", p.fault,
              p.fault_t, m.off_reference ? ": reference.join (s) leads onto the reference" : "");
    }
  }
}

/// Whether a law with the scene's own gains is still on its reference in what takes longer than a part.
void judge_slow(const Scene& scene, const Margins& m, const std::vector<ProbePart>& parts, Findings& f) {
  if (f.has(Code::not_followed) || (scene.sliding() && !f.has(Code::torque_exceeded))) return;
  for (const ProbePart& p : parts) {
    if (p.kind != ProbePart::Kind::slow || !counts(p) || !p.fault.empty()) continue;
    const bool own_gains = std::max(scene.lambda.position, scene.lambda.angle) <= steepest * p.rate_hz;
    if (!own_gains || !(m.path() > 0.0) || !(p.error > m.path())) continue;
    f.warning(Code::not_followed, "control",
              "simulated at {:.3g} Hz, for what takes long, the effector leaves the reference by {:.3g} mm, "
              "{:.0f} % of the path",
              p.rate_hz, 1e3 * p.error, 100.0 * p.error / m.path());
    return;
  }
}

/// The steps in which the drives' frames report the joints, for the law amplifies them.
std::string frame_steps_of(const Scene& s) {
  const FrameSteps at_shaft = frame_steps(s.drives, 0);
  if (!(at_shaft.position > 0.0)) return "";
  const double gear = s.drives.gear_ratio[0];
  return fmt::format("; drive 1 reports its joint in steps of {:.3g} rad and {:.3g} rad/s",
                     at_shaft.position / gear, at_shaft.velocity / gear);
}

/// Mean change of torque per tick and motor over the whole run, as a share of torque_limit: of the parts that
/// are typical. What clearly dies away, by all parts together, is spread over the ticks of the run; not where
/// much is left of it, for a limit cycle may be what it falls to.
double change_of_run(const std::vector<const ProbePart*>& parts, std::uint32_t ticks) {
  double change = 0.0, rate = 0.0, spread = 0.0, moving = 0.0;
  for (const ProbePart* p : parts) {
    change += p->change / static_cast<double>(parts.size());
    if (!(p->change > 0.0)) continue;
    rate += std::log(p->growth);
    ++moving;
  }
  if (moving == 0.0) return 0.0;
  rate /= moving;
  for (const ProbePart* p : parts) spread += p->change > 0.0 ? std::pow(std::log(p->growth) - rate, 2) : 0.0;
  const double error = moving > 1.0 ? std::sqrt(spread / (moving - 1.0) / moving) : 0.0;
  constexpr double left = 0.3;  // near the limit torques do not fall as those of a linear loop
  return rate + 3.0 * error < -0.01 && change < left ? std::min(change, change / (-std::expm1(rate) * ticks))
                                                     : change;
}

}  // namespace

std::optional<double> saturated_ticks(const Scene& scene, const std::vector<ProbePart>& parts) {
  const auto slow = std::ranges::find(parts, ProbePart::Kind::slow, &ProbePart::kind);
  constexpr double smooth = 0.2;
  const bool whole = slow != parts.end() && slow->ticks / slow->rate_hz > 0.9 * scene.duration;
  return whole && slow->fault.empty() && counts(*slow, smooth) ? std::optional(slow->saturated)
                                                               : std::nullopt;
}

void judge_probe(const Scene& scene, const Margins& m, const std::vector<ProbePart>& parts, Findings& f) {
  // Of a mean of few ticks less than the limit may be the limit.
  constexpr double ringing = 0.05;
  // Where the reference takes nearly all the torque, the way onto it may saturate for longer than a part.
  const double half = m.share > 0.95 ? 0.9 : 0.4;
  double saturated = 0.0, ticks = 0.0;
  std::vector<const ProbePart*> typical;
  for (const ProbePart& p : parts) {
    if (p.kind != ProbePart::Kind::slow) ticks += p.ticks;
    if (p.kind == ProbePart::Kind::typical) typical.push_back(&p);
  }
  if (typical.empty()) return judge_ends(scene, m, parts, f);
  for (const ProbePart* p : typical) saturated += p->saturated / static_cast<double>(typical.size());
  const double change = change_of_run(typical, m.ticks);
  if (change > ringing && !f.has(Code::loop_rings)) {
    const ProbePart* rings = *std::ranges::max_element(typical, {}, &ProbePart::change);
    f.error(Code::loop_rings, "control",
            "simulated for {} ticks, the loop rings: from tick to tick the torque changes by {:.2g} % of "
            "torque_limit, most from t = {:.3f} s on{}",
            ticks, 100.0 * change, rings->t, frame_steps_of(scene));
  }
  if (saturated > half && !f.refused_for(Code::torque_exceeded)) {
    f.error(Code::torque_exceeded, "control.torque_limit",
            "simulated for {} ticks in {} places, the motors are saturated in {:.0f} % of the last third",
            ticks, typical.size(), 100.0 * saturated);
  }
  judge_slow(scene, m, parts, f);
  judge_ends(scene, m, parts, f);
}

}  // namespace esmc::host
