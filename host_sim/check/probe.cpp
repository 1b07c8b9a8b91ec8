#include "host_sim/check/probe.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "firmware/safety/faults.hpp"
#include "host_sim/controller/controller_config.hpp"
#include "host_sim/loop/run.hpp"
#include "host_sim/plant/system.hpp"
#include "host_sim/record/verdict.hpp"

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

/// The last 30 % of the ticks count, the 30 % before them say whether it grows or dies away.
ProbePart run_part(const Scene& s, std::uint32_t begins, bool typical) {
  const Trace t = probe(s);
  ProbePart out{.t = begins * s.tick(), .ticks = tick_count(s), .typical = typical};
  if (!t.end.faults.empty()) out.fault = t.end.faults.front().name;
  std::size_t ran = t.saturated.size();
  if (const auto fault = t.statistics.fault_time())
    ran = static_cast<std::size_t>(std::llround(*fault * s.rate_hz));
  const std::size_t first = std::max<std::size_t>(1, ran * 2 / 5), second = std::max(first, ran * 7 / 10);
  const Stretch before{first, second}, last{second, std::max(ran, second)};
  out.change = mean_change(s, t, last);
  const double earlier = mean_change(s, t, before);
  if (earlier > 0.0 && out.change > 0.0) out.growth = std::pow(out.change / earlier, 1.0 / last.size());
  for (std::size_t n = last.from; n < last.to; ++n) out.saturated += t.saturated[n] ? 1.0 / last.size() : 0.0;
  out.error = t.statistics.sums().effector.all().largest;
  // A step that a scene leaves to the program is not its own.
  if (!std::isfinite(t.end.q.front()) && (!s.whole || !s.whole->accuracy))
    out.diverged = out.t + static_cast<double>(t.saturated.size()) * s.tick();
  return out;
}

}  // namespace

std::vector<ProbePart> probe_scene(const Scene& scene, const Margins& m) {
  const std::uint32_t last = m.ticks, join = make_reference(scene, Pacing::lockstep).join_ticks;
  const bool all = last <= join + probe_ticks;
  // The start, where the controller looks along the join; where the torque is largest; and what is typical.
  constexpr std::uint32_t worst = 40, before = 20, others = 4;
  const std::uint32_t start = m.off_reference ? 20 + worst : 20, each = (probe_ticks - 20 - worst) / others;
  Scene first = scene;
  first.whole = std::make_shared<const Scene>(scene);
  first.duration = (all ? std::min(last, probe_ticks) : start) * scene.tick();
  std::vector<ProbePart> out{run_part(first, 0, all)};
  if (all) return out;
  // From a push a good loop recovers, with the torque that the reference leaves.
  const double push = 1.0 - 0.1 * std::clamp(2.0 * (1.0 - m.share), 0.0, 1.0);
  const auto add = [&](std::uint32_t at, std::uint32_t ticks, bool typical) {
    auto from = moment_at(scene, std::clamp(at, join + 1, last - ticks), typical ? m.tick_speed : 0.0);
    if (!from) return;
    for (double& rate : from->rate) rate *= typical ? push : 1.0;
    out.push_back(run_part(part_of(scene, *from, ticks), from->tick, typical));
  };
  if (!m.off_reference) add(m.share_tick > before ? m.share_tick - before : 0, worst, false);
  for (std::uint32_t i = 0; i < others; ++i)
    add(join + static_cast<std::uint32_t>((2 * i + 1) * std::uint64_t{last - join} / (2 * others)), each,
        true);
  return out;
}

namespace {

/// Parts that a fault ends, or whose integration does not hold.
void judge_ends(const Scene& scene, const Margins& m, const std::vector<ProbePart>& parts, Findings& f) {
  const auto lost = std::ranges::find_if(parts, [](const ProbePart& p) { return p.diverged.has_value(); });
  if (lost != parts.end()) {
    f.error(Code::step_too_long, "simulation.step",
            "simulated from t = {:.3f} s, the state is not finite from t = {:.3f} s on: a simulation.step "
            "below {:g} s{} or simulation.accuracy",
            lost->t, *lost->diverged, scene.step,
            set_valued(scene.effects) ? "" : ", integrator = \"radau5\"");
  }
  for (const ProbePart& p : parts) {
    if (p.fault.empty() || f.refused()) continue;
    if (p.fault == name(Fault::join_infeasible)) {
      // At rest onto a moving reference, a join of T seconds at speed v runs up over about 0.2 v T.
      const double join = scene.reference.join.value_or(0.0);
      f.error(Code::limit_crossed, "reference.join",
              "the way onto the reference in reference.join = {:g} s takes more than the limits "
              "(join_infeasible): {}",
              join,
              0.2 * m.start_speed * join > m.start_off
                  ? "the run-up for the reference's speed grows with it; a shorter one, or 0"
                  : "a longer one, or a start nearer to the reference");
      continue;
    }
    f.error(Code::limit_crossed, m.off_reference ? "reference.join" : "limits",
            "simulated from t = {:.3f} s, the loop ends in the fault {}{}", p.t, p.fault,
            m.off_reference ? ": reference.join (s) leads onto the reference" : "");
  }
}

}  // namespace

void judge_probe(const Scene& scene, const Margins& m, const std::vector<ProbePart>& parts, Findings& f) {
  // Of a mean of few ticks less than the limit may be the limit.
  constexpr double ringing = 0.05, dying = 0.98;
  // Where the reference takes nearly all the torque, the way onto it may saturate for longer than a part.
  const double half = m.share > 0.95 ? 0.9 : 0.4;
  double saturated = 0.0, change = 0.0, count = 0.0, ticks = 0.0;
  const ProbePart* rings = nullptr;
  for (const ProbePart& p : parts) {
    ticks += p.ticks;
    if (!p.typical) continue;
    ++count;
    saturated += p.saturated;
    // What dies away is spread over the ticks of the whole run.
    change += p.growth > dying ? p.change : std::min(p.change, p.change / ((1.0 - p.growth) * m.ticks));
    if (rings == nullptr || p.change > rings->change) rings = &p;
  }
  if (rings != nullptr && change > ringing * count && !f.has(Code::loop_rings)) {
    f.error(Code::loop_rings, "control",
            "simulated for {} ticks, the loop rings: from tick to tick the torque changes by {:.2g} % of "
            "torque_limit, most from t = {:.3f} s on",
            ticks, 100.0 * change / count, rings->t);
  }
  if (saturated > half * count && !f.refused_for(Code::torque_exceeded)) {
    f.error(Code::torque_exceeded, "control.torque_limit",
            "simulated for {} ticks in {:g} places, the motors are saturated in {:.0f} % of the last third",
            ticks, count, 100.0 * saturated / count);
  }
  judge_ends(scene, m, parts, f);
  const double path = m.path();
  if (f.refused() || f.has(Code::not_followed) || parts.size() < 2 || !(path > 0.0) ||
      parts[1].error <= error_share * path)
    return;
  f.warning(Code::not_followed, "control",
            "simulated for {} ticks from t = {:.3f} s on the reference, the effector leaves it by {:.3g} mm, "
            "{:.0f} % of the path",
            parts[1].ticks, parts[1].t, 1e3 * parts[1].error, 100.0 * parts[1].error / path);
}

}  // namespace esmc::host
