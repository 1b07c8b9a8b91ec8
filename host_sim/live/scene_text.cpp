#include <algorithm>
#include <iterator>

#include "host_sim/live/live_api.hpp"
#include "host_sim/live/session.hpp"
#include "host_sim/loop/halves.hpp"
#include "host_sim/record/recorder.hpp"

namespace esmc::host {
namespace {

/// The tables of `[{ a }, { b }]` without their braces.
std::vector<std::string> inline_tables(const std::string& list) {
  std::vector<std::string> out;
  int depth = 0;
  std::size_t begin = 0;
  for (std::size_t i = 0; i < list.size(); ++i) {
    if (list[i] == '{' && depth++ == 0) begin = i + 1;
    if (list[i] == '}' && --depth == 0) out.push_back(list.substr(begin, i - begin));
  }
  for (std::string& s : out) {
    s.erase(0, s.find_first_not_of(' '));
    s.erase(s.find_last_not_of(' ') + 1);
  }
  return out;
}

/// `mass = 0.3, type = 'payload'` in its two parts.
EffectText in_parts(std::string text) {
  constexpr std::string_view key = "type = ";
  const std::size_t at = std::min(text.find(key), text.size()),
                    end = std::min(text.find(", ", at), text.size());
  EffectText out;
  if (at + key.size() + 1 < end)
    out.type = text.substr(at + key.size() + 1, end - at - key.size() - 2);  // without its quotes
  text.erase(at, std::min(end + 2, text.size()) - at);
  if (text.ends_with(", ")) text.erase(text.size() - 2);
  out.parameters = text;
  return out;
}

}  // namespace

std::vector<EffectText> effect_texts(const std::string& toml) {
  constexpr std::string_view in_line = "effects = [", heading = "[[effects]]";
  std::vector<std::string> found;
  bool inside = false;
  for (std::size_t at = 0; at < toml.size();) {
    const std::size_t end = std::min(toml.find('\n', at), toml.size());
    const std::string line = toml.substr(at, end - at);
    at = end + 1;
    if (line.starts_with(in_line)) {
      found = inline_tables(line);
      break;
    }
    if (line == heading) {
      found.emplace_back();
      inside = true;
    } else if (line.starts_with("[")) {
      inside = false;
    } else if (inside && !line.empty()) {
      found.back() += (found.back().empty() ? "" : ", ") + line;
    }
  }
  std::vector<EffectText> out;
  std::ranges::transform(found, std::back_inserter(out), in_parts);
  return out;
}

std::vector<std::string> with_set(std::vector<std::string> sets, const std::string& set) {
  const std::string key = set.substr(0, std::min(set.find('='), set.size()));
  std::erase_if(sets, [&](const std::string& s) { return s.substr(0, s.find('=')) == key; });
  sets.push_back(set);
  return sets;
}

Hand usual_hand(const Scene& scene) {
  const LegParams<double>& leg = scene.mechanism.legs[0];
  const double reach = leg.l1 + leg.l2;
  constexpr double share = 0.5, stretch = 0.15, damped = 0.02;  // of the torque; of the reach; s
  Hand h;
  h.most = share * *std::ranges::min_element(scene.torque_limit) / reach;
  h.stiffness = h.most / (stretch * reach);
  h.damping = damped * h.stiffness;
  return h;
}

std::shared_ptr<const Scene> read_live_scene(const RunOptions& o) {
  RunOptions paced = o;
  paced.realtime = o.bus != "virtual";  // as the controller on the other end is made
  auto scene = std::make_shared<Scene>(read_loop_scene(paced));
  prepare_live_scene(*scene, paced.realtime);
  require_confirmed(*scene);
  if (scene->type == MechanismType::five_bar) {
    require_reachable<FiveBarWorld>(*scene, Pacing::lockstep);
  } else {
    require_reachable<RrWorld>(*scene, Pacing::lockstep);
  }
  return scene;
}

}  // namespace esmc::host
