#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <limits>
#include <nlohmann/json.hpp>
#include <numbers>
#include <vector>

#include "host_sim/check/check.hpp"
#include "host_sim/check/linear_loop.hpp"
#include "host_sim/check/margins.hpp"
#include "host_sim/error.hpp"
#include "host_sim/record/finish.hpp"
#include "host_sim/record/recorder.hpp"

namespace esmc::host {
namespace {

using MarginsJson = nlohmann::ordered_json;

/// A pose at rest and its margins. Empty margins: beyond the range that is searched.
struct LoopMargins {
  double t = 0.0;
  std::vector<double> q;
  bool stable = false;
  std::optional<double> gain, gain_low;  ///< factors on all torques
  std::optional<double> phase;           ///< degrees
  std::optional<double> delay;           ///< s
  double frequency = 0.0;                ///< Hz, where `gain` lets it ring
};

/// Margins of the loop that a plant in continuous time and the feedback of a tick make.
void find_margins(const StateSpace& plant, const StateSpace& feedback, double tick, double delay,
                  LoopMargins& to) {
  constexpr double ringing = 1.0 + 1e-6;  // beyond rounding
  constexpr double gain_most = 1e3, delay_most = 64.0;
  const StateSpace loop = reduced(series(sampled(plant, tick, delay), feedback));
  const MatrixXd gained = loop.B * loop.C;
  if (loop.A.size() == 0 || !loop.A.allFinite() || !gained.allFinite())
    throw RunError(fmt::format("at t = {:.3f} s the loop has no finite slope", to.t));
  const auto stable_at = [&](double gain) {
    return std::abs(leading((loop.A + gain * gained).cast<std::complex<double>>())) < ringing;
  };
  to.stable = stable_at(1.0);
  if (to.stable) {
    to.gain = end_of(stable_at, 1.0, gain_most, 1.2);
    to.gain_low = end_of(stable_at, 1.0, 1.0 / gain_most, 1.0 / 1.3);
    const auto turned = [&](double degrees) {
      const std::complex<double> by = std::polar(1.0, -degrees * std::numbers::pi / 180.0);
      return std::abs(leading(Eigen::MatrixXcd(loop.A + by * gained))) < ringing;
    };
    to.phase = end_of(turned, 0.5, 170.0, 1.2);
    const auto later = [&](double more) {
      const StateSpace l = reduced(series(sampled(plant, tick, delay + more), feedback));
      return std::abs(leading((l.A + l.B * l.C).cast<std::complex<double>>())) < ringing;
    };
    to.delay = end_of(later, tick / 50.0, delay_most * tick, 1.4);
  } else {
    to.gain = end_of([&](double g) { return !stable_at(g); }, 1.0, 1.0 / gain_most, 1.0 / 1.2);
    to.phase = to.delay = 0.0;
  }
  const std::complex<double> critical =
      leading((loop.A + to.gain.value_or(1.0) * gained).cast<std::complex<double>>());
  to.frequency = std::abs(std::arg(critical)) / (2.0 * std::numbers::pi * tick);
}

/// What makes linear theory an estimate in this scene.
std::vector<std::string> not_linear(const Scene& scene) {
  std::vector<std::string> out;
  for (const Effect& e : scene.effects) {
    for (const auto& [type, why] :
         {std::pair{CoulombFriction::type, "dry friction"}, std::pair{Backlash::type, "play"},
          std::pair{Encoder::type, "steps of the encoder"}, std::pair{TorqueRipple::type, "cogging"},
          std::pair{Jitter::type, "a varying delay"}}) {
      if (std::string(type_name(e)) == type) out.push_back(std::string(type) + ": " + why);
    }
  }
  if (scene.sliding() && scene.reaching == ReachingChoice::sign)
    out.emplace_back("reaching = \"sign\": judged with a layer of gain * tick");
  if (scene.sliding() && scene.reaching == ReachingChoice::super_twisting)
    out.emplace_back("reaching = \"super_twisting\": linear within 1.1 * gain * tick^2 of the surface alone");
  return out;
}

std::vector<LoopMargins> margins_along(const Scene& scene) {
  const double delay = loop_delay(scene);
  std::vector<LoopMargins> out;
  for_each_pose(scene, 16, [&](const Moment& at, const StateSpace& plant, const StateSpace& feedback) {
    out.emplace_back();
    out.back().t = at.tick * scene.tick();
    out.back().q = at.angle;
    find_margins(plant, feedback, scene.tick(), delay, out.back());
  });
  return out;
}

MarginsJson margins_json(const LoopMargins& m) {
  const auto known = [](const std::optional<double>& v) {
    return v ? MarginsJson(*v) : MarginsJson(nullptr);
  };
  return {{"t", m.t},
          {"q", m.q},
          {"stable", m.stable},
          {"gain_margin", known(m.gain)},
          {"gain_margin_low", known(m.gain_low)},
          {"phase_margin_deg", known(m.phase)},
          {"delay_margin_s", known(m.delay)},
          {"frequency_hz", m.frequency}};
}

std::string margins_text(const Scene& scene, const std::vector<LoopMargins>& all, const LoopMargins& worst,
                         const std::vector<std::string>& estimate) {
  const auto known = [](const std::optional<double>& v, double unit, const char* none) {
    return v ? fmt::format("{:.3g}", *v * unit) : std::string(none);
  };
  std::string out =
      fmt::format("{}: {}\nworst of {} pose{}: t = {:.3f} s, joints {:.3f} rad\n", printable(scene.name),
                  fmt::format("{}{}", worst.stable ? "the loop is stable" : "the loop rings",
                              estimate.empty() ? "" : ", by an estimate"),
                  all.size(), all.size() == 1 ? "" : "s", worst.t, fmt::join(worst.q, ", "));
  out += fmt::format("gain:  times {}{}\n",
                     known(worst.gain, 1.0, worst.stable ? "more than 1000" : "less than 0.001"),
                     worst.gain_low ? fmt::format(", or times {:.3g}", *worst.gain_low) : "");
  out += fmt::format("phase: {} degrees\ndelay: {} ms\nit would ring at {:.3g} Hz\n",
                     known(worst.phase, 1.0, "more than 170"),
                     known(worst.delay, 1e3, "more than 64 ticks, in"), worst.frequency);
  for (const std::string& why : estimate) out += "estimate: " + why + "\n";
  return out;
}

}  // namespace

void judge_stability(const Scene& scene, Findings& f) {
  const bool layered = scene.reaching == ReachingChoice::saturation || scene.reaching == ReachingChoice::tanh;
  if (scene.sliding() && !layered) return;  // their limit cycles may be small
  constexpr double enough = 5.0;            // e-folds, from the noise of a run to what is seen
  std::vector<std::complex<double>> roots;
  try {
    const double delay = loop_delay(scene);
    for_each_pose(scene, 6, [&](const Moment&, const StateSpace& plant, const StateSpace& feedback) {
      const StateSpace loop = reduced(series(sampled(plant, scene.tick(), delay), feedback));
      const MatrixXd closed = loop.A + loop.B * loop.C;
      if (closed.size() > 0 && closed.allFinite())
        roots.push_back(leading(closed.cast<std::complex<double>>()));
    });
  } catch (const Interrupted&) {
    throw;
  } catch (const std::runtime_error&) {  // no loop at rest to judge: the parts that are simulated tell
    return;
  }
  if (roots.empty()) return;
  // Of a motion the usual pose counts, at rest the worst: its load may stay.
  const auto middle = scene.reference.type == ReferenceType::hold
                          ? roots.end() - 1
                          : roots.begin() + static_cast<std::ptrdiff_t>(roots.size() / 2);
  std::ranges::nth_element(roots, middle, {}, [](const auto& z) { return std::abs(z); });
  const double growth = std::log(std::abs(*middle));
  if (!(growth * tick_count(scene) > enough)) return;
  f.error(Code::loop_rings, "control",
          "the sampled loop is unstable at rest: at {:.3g} Hz a motion grows by {:.2g} % per tick{}",
          std::abs(std::arg(*middle)) / (2.0 * std::numbers::pi * scene.tick()), 100.0 * std::expm1(growth),
          find_effect<CoulombFriction>(scene.effects) ? ", once it is larger than dry friction holds" : "");
  if (scene.sliding()) return;  // beyond its layer a law asks for no more than its gain
  f.error(Code::torque_exceeded, "control.torque_limit",
          "nothing but torque_limit stops an unstable loop from growing: the motors saturate");
}

int run_margins(const RunOptions& o) {
  const Scene scene = read_scene(o.scene, o.sets);
  if (!scene.closed_loop())
    throw InputError(scene.control_where, "'control.law' closes no loop: there are no margins");
  OutputDirectory out(o.out);
  const std::vector<LoopMargins> all = margins_along(scene);
  const LoopMargins& worst = *std::ranges::min_element(all, {}, [](const LoopMargins& m) {
    return m.gain.value_or(m.stable ? std::numeric_limits<double>::infinity() : 0.0);
  });
  const std::vector<std::string> estimate = not_linear(scene);
  MarginsJson j = {{"scene", scene.name},
                   {"estimate", !estimate.empty()},
                   {"estimate_because", estimate},
                   {"worst", margins_json(worst)}};
  j["poses"] = MarginsJson::array();
  for (const LoopMargins& m : all) j["poses"].push_back(margins_json(m));
  if (o.capture != nullptr) {
    o.capture->document = document_text(j);
    return 0;
  }
  if (out.wanted()) {
    write_scene(scene, out);
    out.write("margins.json", document_text(j));
    out.commit();
  }
  fmt::print("{}", o.json ? document_text(j) : margins_text(scene, all, worst, estimate));
  return 0;
}

}  // namespace esmc::host
