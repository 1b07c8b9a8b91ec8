#include "host_sim/scene/edit.hpp"

#include <filesystem>

#include "host_sim/error.hpp"
#include "host_sim/scene/toml_text.hpp"

namespace esmc::host {

toml::table leg_table(const LegParams<double>& leg) {
  toml::table t;
  for (const LegKey& k : leg_keys) t.insert(k.name, leg.*k.value);
  t.is_inline(true);
  return t;
}

toml::array number_array(const std::vector<double>& values) {
  toml::array out;
  for (const double v : values) out.push_back(v);
  return out;
}

toml::table& sub_table(toml::table& of, const std::string& name) {
  if (of[name].as_table() == nullptr) of.insert_or_assign(name, toml::table{});
  return *of[name].as_table();
}

void set_elbow_rotors(toml::table& mechanism, MechanismType type, const FiveBarParams<double>& p) {
  mechanism.erase("rotor_inertia");
  if (!has_elbow_rotors(p)) return;
  toml::array rotors{0.0, p.legs[0].rotor2};
  if (type == MechanismType::five_bar) rotors.insert(rotors.end(), {0.0, p.legs[1].rotor2});
  mechanism.insert("rotor_inertia", rotors);
}

void set_mechanism(toml::table& mechanism, MechanismType type, const FiveBarParams<double>& p, bool masses) {
  if (masses) {
    mechanism.insert_or_assign("gravity", p.g);
    set_elbow_rotors(mechanism, type, p);
  }
  if (type == MechanismType::rr) {
    mechanism.insert_or_assign("leg", leg_table(p.legs[0]));
    return;
  }
  mechanism.insert_or_assign("half_base", p.l0);
  if (masses) mechanism.insert_or_assign("effector_mass", p.m0);
  mechanism.erase("leg");
  mechanism.insert_or_assign("legs", toml::array{leg_table(p.legs[0]), leg_table(p.legs[1])});
}

std::string edited_scene(toml::table scene, const std::string& file) {
  const auto absolute = [&](toml::node_view<toml::node> section, const char* key) {
    if (const auto path = section[key].value<std::string>()) {
      const std::filesystem::path whole =
          std::filesystem::absolute(std::filesystem::path(file).parent_path() / *path);
      section.as_table()->insert_or_assign(key, whole.lexically_normal().string());
    }
  };
  absolute(scene["reference"], "path");
  absolute(scene["drives"], "endpoints");
  absolute(scene["control"]["model"], "mechanism");
  std::string text = toml_text(scene);
  try {
    (void)read_scene_text(text, "the new scene", {});
  } catch (const InputError& e) {
    refuse("--write: the scene does not fit the values found: {}", e.what());
  }
  return text;
}

void refuse_overwrite(const std::string& option, const std::string& file,
                      const std::vector<std::string>& inputs) {
  for (const std::string& input : inputs) {
    std::error_code error;
    if (!file.empty() && !input.empty() && std::filesystem::equivalent(file, input, error) && !error)
      refuse("{}: {} is an input of this command", option, file);
  }
}

std::vector<std::string> files_of(const Scene& scene) {
  std::vector<std::string> out{scene.file};
  for (const Companion& c : scene.companions) out.push_back(c.source);
  return out;
}

}  // namespace esmc::host
