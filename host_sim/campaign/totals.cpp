#include "host_sim/campaign/totals.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

namespace esmc::host {

using Json = nlohmann::ordered_json;

void Times::add(double ms) {
  ++bins_[static_cast<int>(std::ceil(ms / bin_ms - 1e-9))];
  longest_ = std::max(longest_, ms);
}

std::uint64_t Times::count() const {
  std::uint64_t n = 0;
  for (const auto& bin : bins_) n += bin.second;
  return n;
}

std::vector<Bar> Times::bars() const {
  std::vector<Bar> out;
  for (const auto& [bin, n] : bins_)
    out.push_back({std::max(0.0, (bin - 1) * bin_ms), bin * bin_ms, static_cast<double>(n)});
  return out;
}

Json Times::json() const {
  Json out = Json::array();
  for (const auto& [bin, n] : bins_) out.push_back({{"up_to_ms", bin * bin_ms}, {"count", n}});
  return out;
}

void CampaignTotals::add(const EpisodeResult& e) {
  ++episodes_;
  ticks_us_ += static_cast<std::uint64_t>(std::llround(static_cast<double>(e.ticks) * e.tick_s * 1e6));
  digest_ += e.digest * (2 * e.seed + 1);  // sums know no order
  FaultTotals& f = faults_[std::string(e.injection.row->name)];
  ++f.episodes;
  f.under_torque += e.ran ? 1U : 0U;
  ++f.phases[static_cast<std::size_t>(e.injection.phase)];
  ++f.drives.at(e.injection.drive);
  ++protocols_[std::string(e.protocol)];
  ++f.latched[std::string(e.first_fault.empty() ? std::string_view("none") : e.first_fault)];
  const bool demanded = e.injection.notice_ticks != InjectionRow::not_demanded && e.ran;
  if (demanded && e.reaction.notice_ms >= 0.0) f.notice.add(e.reaction.notice_ms);
  if (e.reaction.safe_ms >= 0.0) f.safe.add(e.reaction.safe_ms);
  if (e.injection.stale && e.ran && e.reaction.notice_ms >= 0.0) stale_.add(e.reaction.notice_ms);
  if (e.injection.stale && e.reaction.safe_ms >= 0.0 && e.injection.kind() != Injected::babbling) {
    safe_.add(e.reaction.safe_ms);
  }
  if (e.reaction.death_ms >= 0.0) death_.add(e.reaction.death_ms);
  if (e.verdict.invariant.empty()) return;
  ++violation_count_;
  violations_[e.seed] = {e.verdict.tick, e.digest, std::string(e.injection.row->name),
                         name(e.injection.phase), std::string(e.verdict.invariant)};
  if (violations_.size() > violations_max) violations_.erase(std::prev(violations_.end()));
}

Json CampaignTotals::json() const {
  Json j;
  j["episodes"] = episodes_;
  j["violations"] = Json::array();
  for (const auto& [seed, v] : violations_) {
    j["violations"].push_back({{"seed", seed},
                               {"fault", v.fault},
                               {"invariant", v.invariant},
                               {"phase", v.phase},
                               {"tick", v.tick},
                               {"digest", fmt::format("{:016x}", v.digest)}});
  }
  j["violation_count"] = violation_count_;
  j["reaction_ms"] = {
      {"stale_max", stale_.longest()}, {"safe_max", safe_.longest()}, {"host_death_max", death_.longest()}};
  j["simulated_s"] = simulated_s();
  j["histograms"] = {{"stale", stale_.json()}, {"safe", safe_.json()}, {"host_death", death_.json()}};
  j["protocols"] = Json::object();
  for (const auto& [key, n] : protocols_) j["protocols"][key] = n;
  j["faults"] = Json::object();
  for (const auto& [key, f] : faults_) {
    Json phases, latched;
    for (std::size_t i = 0; i < phase_count; ++i) phases[name(static_cast<Phase>(i))] = f.phases[i];
    for (const auto& [fault, n] : f.latched) latched[fault] = n;
    j["faults"][key] = {{"episodes", f.episodes},
                        {"under_torque", f.under_torque},
                        {"phases", phases},
                        {"drives", f.drives},
                        {"latched", latched},
                        {"notice_max_ms", f.notice.longest()},
                        {"safe_max_ms", f.safe.longest()},
                        {"notice_ms", f.notice.json()},
                        {"safe_ms", f.safe.json()}};
  }
  j["digest"] = fmt::format("{:016x}", digest_);
  return j;
}

std::string CampaignTotals::text() const {
  std::string out = fmt::format("{} episodes, {:.1f} s simulated, {} violations\n", episodes_, simulated_s(),
                                violation_count_);
  out += fmt::format("stale feedback: noticed within {:.3f} ms, torque zero within {:.3f} ms ({} episodes)\n",
                     stale_.longest(), safe_.longest(), safe_.count());
  out += fmt::format("controller death: torque zero within {:.3f} ms of its last command ({} episodes)\n",
                     death_.longest(), death_.count());
  for (int left = 10; const auto& [seed, v] : violations_) {
    if (left-- == 0) break;
    out += fmt::format("violation: seed {} {} in {}: {} at tick {} (see --replay {})\n", seed, v.fault,
                       v.phase, v.invariant, v.tick, seed);
  }
  return out + fmt::format("digest {:016x}\n", digest_);
}

TextTable CampaignTotals::fault_rows() const {
  TextTable rows{{"fault", "episodes", "at drive 1, 2, 3, 4", "under torque", "noticed at most, ms",
                  "zero torque at most, ms", "latched"}};
  const auto most = [](const Times& t) {
    return t.count() > 0 ? fmt::format("{:.3f}", t.longest()) : std::string("");
  };
  for (const auto& [key, f] : faults_) {
    std::string latched;
    for (const auto& [fault, n] : f.latched)
      latched += fmt::format("{}{} {}", latched.empty() ? "" : ", ", fault, n);
    rows.push_back({key, std::to_string(f.episodes), fmt::format("{}", fmt::join(f.drives, ", ")),
                    std::to_string(f.under_torque), most(f.notice), most(f.safe), latched});
  }
  return rows;
}

std::vector<std::pair<const char*, const Times*>> CampaignTotals::reactions() const {
  return {{"stale feedback to latched fault", &stale_},
          {"stale feedback to zero torque at the drives", &safe_},
          {"last command of a dead controller to zero torque", &death_}};
}

std::string CampaignTotals::page(const std::string& command, std::uint64_t wanted) const {
  StudyVerdict out;
  const bool cut = episodes_ < wanted;
  out.level = violation_count_ > 0    ? StudyVerdict::Level::bad
              : cut || episodes_ == 0 ? StudyVerdict::Level::warn
                                      : StudyVerdict::Level::ok;
  out.headline = fmt::format("{} violations of an invariant in {} episodes", violation_count_, episodes_);
  if (cut) out.detail = fmt::format("Interrupted: {} episodes were asked for", wanted);
  const auto time = [&](const char* name, const Times& t) {
    out.tiles.push_back({name, t.count() > 0 ? fmt::format("{:.3f} ms", t.longest()) : "–",
                         fmt::format("{} episodes", t.count())});
  };
  out.tiles.push_back({"Simulated", fmt::format("{:.1f} s", simulated_s()),
                       fmt::format("{} kinds of fault", faults_.size())});
  time("Stale feedback noticed within", stale_);
  time("Torque zero within", safe_);
  time("Controller dead: torque zero within", death_);
  out.tiles.push_back({"Digest", fmt::format("{:016x}", digest_), ""});
  std::vector<std::string> drawings;
  for (const auto& [title, times] : reactions())
    drawings.push_back(bar_svg(std::string("From ") + title, "ms; heights: episodes", times->bars()));
  std::string body;
  if (!violations_.empty()) {
    TextTable rows{{"fault", "phase", "invariant", "tick", "seed for --replay"}};
    for (const auto& [seed, v] : violations_)
      rows.push_back({v.fault, v.phase, v.invariant, std::to_string(v.tick), std::to_string(seed)});
    body += table_html("Violations", rows);
  }
  return study_page("Fault-injection campaign", command,
                    body + figures_html(drawings) + table_html("Faults", fault_rows()), out);
}

std::string CampaignTotals::markdown() const {
  std::string out = markdown_table(fault_rows());
  for (const auto& [title, times] : reactions()) {
    TextTable bins{{fmt::format("{}, ms", title), "episodes"}};
    for (const Bar& b : times->bars())
      bins.push_back({fmt::format("{:.2f} to {:.2f}", b.from, b.to), fmt::format("{:.0f}", b.count)});
    out.append("\n").append(markdown_table(bins));
  }
  return out;
}

}  // namespace esmc::host
