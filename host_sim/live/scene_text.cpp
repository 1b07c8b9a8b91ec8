#include <algorithm>

#include "host_sim/live/live_api.hpp"
#include "host_sim/live/session.hpp"
#include "host_sim/loop/loop_scene.hpp"
#include "host_sim/record/recorder.hpp"
#include "host_sim/scene/toml_text.hpp"

namespace esmc::host {
std::vector<EffectText> effect_texts(const std::string& toml) {
  const toml::table scene = toml::parse(toml);
  std::vector<EffectText> out;
  const toml::array* effects = scene["effects"].as_array();
  if (effects == nullptr) return out;
  for (const toml::node& effect : *effects) {
    EffectText text;
    for (auto&& [key, value] : *effect.as_table()) {
      if (key == "type") {
        text.type = value.value_or(std::string());
        continue;
      }
      const std::string line = toml_text(toml::table{{key, value}});
      text.parameters += (text.parameters.empty() ? "" : ", ") + line.substr(0, line.find('\n'));
    }
    out.push_back(std::move(text));
  }
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
