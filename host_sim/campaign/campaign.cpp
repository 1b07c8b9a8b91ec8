#include "host_sim/campaign/campaign.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <functional>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>

#include "host_sim/campaign/episode.hpp"
#include "host_sim/campaign/totals.hpp"
#include "host_sim/error.hpp"
#include "host_sim/loop/progress.hpp"
#include "host_sim/loop/run.hpp"
#include "host_sim/parallel.hpp"
#include "host_sim/record/output.hpp"
#include "host_sim/record/run_options.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {
namespace {

using Json = nlohmann::ordered_json;
using Sets = std::vector<std::string>;

/// A loop of the built-in campaign: changes to a scene that `esmc init` prints.
struct Variant {
  const char* scene = "five_bar";
  Sets sets;
  bool passive_encoders = false;
};

/// Start angle of a circle.
std::string phase(double share) { return fmt::format("reference.phase={}", 6.28 * share); }

const std::vector<Variant>& variants() {
  constexpr const char *bar = "five_bar", *arm = "rr";
  constexpr const char* linked =
      R"(command={ base_id=0x780, arm="link", timeout=0.1, speed=0.1, acceleration=1.0 })";
  static const std::vector<Variant> list{
      {bar, {}},
      {bar, {phase(0.1), "reference.speed=3.0", "limits.after_halt=release"}},
      {bar, {phase(0.2), "reference.speed=-6.0", "limits.after_halt=hold"}},
      {bar, {phase(0.3), "reference.speed=-10.0", "control.law=esmc_projected"}},
      {bar, {phase(0.4), "reference.speed=5.0", "control.law=smc"}},
      {bar,
       {phase(0.5), "reference.speed=8.0", "control.law=ctc", "mechanism.gravity=0",
        "limits.after_halt=release"}},
      {bar, {phase(0.6), "control.law=pd", "control.kp=20", "control.kd=0.5", "reference.speed=2.0"}},
      {bar, {phase(0.7), "control.reaching=saturation", "control.layer=0.5"}},
      {bar, {phase(0.8), "control.reaching=tanh", "control.layer=0.5", "reference.speed=-4.0"}},
      {bar, {phase(0.9), "control.reaching=sign", "reference.speed=3.0"}},
      {bar, {phase(0.15), "control.torque_ramp=0.02", "reference.speed=4.0"}},
      {bar, {"reference.type=hold", "initial.position=[0.03, 0.2]", "limits.after_halt=lower"}},
      {bar,
       {phase(0.25), "drives.gear_ratio=[4.0, 9.0]", "drives.direction=[-1, 1]",
        "drives.offset=[0.3, -1.0]"}},
      {bar, {phase(0.35), "limits.halt_time=0", "reference.speed=7.0"}},
      {bar, {phase(0.45), "reference.join=0"}},
      {bar, {phase(0.55), "control.sensors=all", "sensors.nodes=[3, 4]"}, true},
      {bar, {phase(0.65), "control.sensors=all", "control.motors=all", "drives.nodes=[1, 2, 3, 4]"}},
      {bar, {phase(0.75), "drives.sign_test=true"}},
      {bar, {phase(0.85), linked}},
      {bar, {linked, "drives.sign_test=true", "limits.after_halt=hold"}},
      {arm, {}},
      {arm, {"limits.after_halt=hold", "control.law=smc"}},
  };
  return list;
}

/// Runs an episode on one scene.
using Runner = std::function<EpisodeResult(std::uint64_t seed, const Draw& draw, EpisodeTrace* trace,
                                           std::string_view only)>;
template <class Traits>
Runner runner_of(const Scene& scene) {
  const auto kind = std::make_shared<const EpisodeKind<Traits>>(scene);
  return [kind](const auto&... arguments) { return kind->run(arguments...); };
}

Runner make_runner(const Scene& scene) {
  const BusObstacle obstacle = bus_obstacle(scene);
  if (!obstacle.what.empty()) throw InputError(obstacle.where, obstacle.what);
  refuse_bus_effects(scene, "a campaign disturbs its bus by the faults that it draws");
  return scene.type == MechanismType::five_bar ? runner_of<FiveBarTraits>(scene) : runner_of<RrTraits>(scene);
}

/// The drives of the built-in loops.
struct DriveVariant {
  const char* protocol;
  Sets sets;
  bool read_back = false;  ///< ODrive 0.6: its configuration, the watchdog's with it, before each arming
};
const std::vector<DriveVariant>& drive_variants() {
  constexpr const char *mismatch = "drives.torque_mismatch=0.5", *at_once = "drives.torque_time=0";
  constexpr const char *turns = "drives.position_range=40.0", *speeds = "drives.velocity_range=200.0";
  static const std::vector<DriveVariant> list{
      {"odrive", {}},
      {"odrive", {mismatch, at_once}, true},
      {"odrive_0.5", {}},
      {"cia402", {mismatch, at_once}},
      {"mit", {"drives.dialect=mini_cheetah", turns, speeds}},
      {"mit", {"drives.dialect=cubemars", mismatch, at_once, turns, speeds}},
      {"mit", {"drives.dialect=damiao", mismatch, at_once, turns, speeds}},
      {"moteus", {mismatch, at_once}},
  };
  return list;
}
/// Endpoints that no version of the firmware has; the emulated drive gets the same.
OdriveEndpoints some_endpoints() {
  OdriveEndpoints out{{0, 6, 10}, {}};
  for (const OdriveValueName& v : odrive_values) {
    out.list.push_back({v.value, static_cast<std::uint16_t>(300 + out.list.size()), v.type});
  }
  return out;
}
std::string protocol_set(std::string_view protocol) {
  return fmt::format(R"(drives.protocol="{}")", protocol);
}

/// The scenes of a campaign. An episode is a function of its seed and of these.
class Campaign {
 public:
  explicit Campaign(const CampaignOptions& o) : fault_(o.fault) {
    const auto named = [&](const InjectionRow& r) { return r.name == fault_; };
    if (!fault_.empty() && std::ranges::none_of(injection_rows(), named)) {
      std::vector<std::string_view> all;
      for (const InjectionRow& r : injection_rows()) all.push_back(r.name);
      throw InputError("",
                       fmt::format("--fault {}: allowed are {}", printable(fault_), fmt::join(all, ", ")));
    }
    if (!o.scene.empty()) {
      Sets sets = o.sets;
      if (!o.protocol.empty()) sets.push_back(protocol_set(o.protocol));
      runners_.push_back(make_runner(read_scene(o.scene, sets)));
      return;
    }
    for (const DriveVariant& d : drive_variants()) {
      if (!o.protocol.empty() && o.protocol != d.protocol) continue;
      for (const Variant& v : variants()) add(o, d, v);
    }
    if (runners_.empty()) {
      throw InputError("", "--protocol " + printable(o.protocol) +
                               ": allowed are odrive, odrive_0.5, cia402, mit, moteus");
    }
  }
  [[nodiscard]] EpisodeResult run(std::uint64_t seed, EpisodeTrace* trace = nullptr) const {
    Draw draw(seed);
    const std::size_t variant = draw.below(runners_.size());
    EpisodeResult e = runners_[variant](seed, draw, trace, fault_);
    e.variant = variant;
    return e;
  }

 private:
  void add(const CampaignOptions& o, const DriveVariant& d, const Variant& v) {
    if (v.passive_encoders && !std::string_view(d.protocol).starts_with("odrive")) return;
    Sets all{"simulation.step=1e-3", "reference.join=0.05", "limits.halt_time=0.03",
             "limits.lower_time=0.03"};
    for (const Sets* more : {&v.sets, &d.sets, &o.sets}) all.insert(all.end(), more->begin(), more->end());
    all.push_back(protocol_set(d.protocol));
    Scene scene = read_scene_text(std::string(starting_scene(v.scene)), "built-in scene", all);
    // Drives as delivered would be refused.
    if (d.read_back && !scene.drives.endpoints && scene.drives.confirmed.value_or(true)) {
      scene.drives.endpoints = some_endpoints();
    }
    runners_.push_back(make_runner(scene));
  }

  std::vector<Runner> runners_;
  std::string fault_;
};

CampaignTotals run_all(const Campaign& campaign, const CampaignOptions& o) {
  std::mutex mutex;
  CampaignTotals totals;
  Progress progress(o.episodes);
  run_each(o.jobs > 0 ? o.jobs : processors(), o.episodes, [&](std::uint64_t i) {
    if (stop_requested()) return false;
    const EpisodeResult e = campaign.run(o.seed + i);
    const std::lock_guard lock(mutex);
    totals.add(e);
    progress.at(totals.episodes());
    return true;
  });
  return totals;
}

int replay(const Campaign& campaign, const CampaignOptions& o) {
  EpisodeTrace trace;
  const EpisodeResult e = campaign.run(*o.replay, &trace), again = campaign.run(*o.replay);
  const bool equal = e.digest == again.digest && e.ticks == again.ticks;
  const bool held = e.verdict.invariant.empty();
  Json j;
  j["seed"] = e.seed;
  j["variant"] = e.variant;
  j["fault"] = e.injection.row->name;
  j["phase"] = name(e.injection.phase);
  j["injection"] = describe(e.injection);
  j["invariant"] = held ? Json(nullptr) : Json(e.verdict.invariant);
  j["violation_tick"] = held ? Json(nullptr) : Json(e.verdict.tick);
  j["latched"] = e.first_fault.empty() ? "none" : e.first_fault;
  j["notice_ms"] = e.reaction.notice_ms;
  j["safe_ms"] = e.reaction.safe_ms;
  j["host_death_ms"] = e.reaction.death_ms;
  j["ticks"] = e.ticks;
  j["digest"] = fmt::format("{:016x}", e.digest);
  j["bit_equal"] = equal;
  const std::string lines = fmt::format("{}\n", fmt::join(trace, "\n"));
  OutputDirectory out(o.out);
  out.spare(o.scene);
  if (out.wanted()) {
    out.write("episode.txt", lines);
    out.write("episode.json", document_text(j));
    out.commit();
  }
  if (o.json) {
    fmt::print("{}", document_text(j));
  } else {
    fmt::print("{}seed {} on variant {}: {}\n", lines, e.seed, e.variant, describe(e.injection));
    fmt::print("latched {}; {}\n", j["latched"].get<std::string>(),
               held ? "every invariant held"
                    : fmt::format("{} broken at tick {}", e.verdict.invariant, e.verdict.tick));
    fmt::print("digest {:016x}, run twice: {}\n", e.digest, equal ? "bit-equal" : "different");
  }
  return held && equal ? 0 : 1;
}

}  // namespace

int run_campaign(const CampaignOptions& o) {
  const Campaign campaign(o);
  if (o.replay) return replay(campaign, o);
  OutputDirectory out(o.out);
  out.spare(o.scene);
  const CampaignTotals totals = run_all(campaign, o);
  Json j = totals.json();
  j["seed"] = o.seed;
  j["interrupted"] = totals.episodes() < o.episodes;
  if (out.wanted()) out.write("campaign.md", totals.markdown());
  publish({"campaign", j, totals.text(), [&] { return totals.page(o.command_line, o.episodes); }}, o.json,
          out);
  if (totals.violation_count() > 0) return 1;
  return totals.episodes() == o.episodes ? 0 : exit_interrupted;
}

}  // namespace esmc::host
