#include "host_sim/calibrate/calibrated_scene.hpp"

#include <fmt/format.h>

#include <array>
#include <filesystem>

#include "host_sim/controller/controller_config.hpp"
#include "host_sim/error.hpp"
#include "host_sim/scene/reader.hpp"
#include "host_sim/scene/toml_text.hpp"

namespace esmc::host {
namespace {

toml::table leg_table(LegParams<double> p, double l1, double l2) {
  toml::table t{{"l1", l1},   {"l2", l2},   {"lg1", p.lg1}, {"lg2", p.lg2},
                {"m1", p.m1}, {"m2", p.m2}, {"J1", p.J1},   {"J2", p.J2}};
  t.is_inline(true);
  return t;
}

toml::array numbers(const std::vector<double>& values) {
  toml::array out;
  for (const double v : values) out.push_back(v);
  return out;
}

/// The offsets of what [drives] and [sensors] name, in their order; or, where the zero is set in a pose, the
/// angles of that pose.
void correct_offsets(toml::table& into, const Scene& scene, const Unknowns& value) {
  const auto section = [&](const char* name) -> toml::table& {
    if (into[name].as_table() == nullptr) into.insert_or_assign(name, toml::table{});
    return *into[name].as_table();
  };
  const bool five_bar = scene.type == MechanismType::five_bar;
  const std::size_t joints = five_bar ? 4 : 2;
  const auto correction = [&](std::size_t joint) { return value[unknown_o11 + static_cast<int>(joint)]; };
  const bool all = scene.all_sensors || !five_bar;
  if (scene.drives.zero != Zero::absolute) {
    std::vector<double> pose;
    std::size_t sensed = 0;
    for (std::size_t j = 0; j < joints; ++j) {
      if (!all && j % 2 == 1) continue;
      const double was =
          scene.drives.zero_pose.empty() ? scene.start_angle[j] : scene.drives.zero_pose[sensed];
      pose.push_back(was + correction(j));
      ++sensed;
    }
    section("drives").insert_or_assign("zero_pose", numbers(pose));
    return;
  }
  std::vector<double> drives, sensors;
  const std::vector<std::size_t> motors = scene.motor_joints();
  const auto offset = [&](std::size_t i) {
    return i < scene.drives.offset.size() ? scene.drives.offset[i] : 0.0;
  };
  for (std::size_t m = 0; m < motors.size(); ++m) drives.push_back(offset(m) + correction(motors[m]));
  section("drives").insert_or_assign("offset", numbers(drives));
  if (!(five_bar && scene.all_sensors && !scene.all_motors)) return;
  for (std::size_t i = 0; i < 2; ++i) sensors.push_back(offset(2 + i) + correction(2 * i + 1));
  section("sensors").insert_or_assign("offset", numbers(sensors));
}

void correct_lengths(toml::table& mechanism, const Scene& scene, const Unknowns& value) {
  const FiveBarParams<double>& p = scene.mechanism;
  if (scene.type == MechanismType::rr) {
    mechanism.insert_or_assign("leg", leg_table(p.legs[0], value[unknown_l11], value[unknown_l12]));
    return;
  }
  mechanism.insert_or_assign("half_base", value[unknown_l0]);
  mechanism.erase("leg");
  mechanism.insert_or_assign("legs",
                             toml::array{leg_table(p.legs[0], value[unknown_l11], value[unknown_l12]),
                                         leg_table(p.legs[1], value[unknown_l21], value[unknown_l22])});
}

}  // namespace

std::string calibrated_snippet(const Scene& scene, const Unknowns& value) {
  toml::table out{{"mechanism", toml::table{}}};
  correct_lengths(*out["mechanism"].as_table(), scene, value);
  correct_offsets(out, scene, value);
  const std::string text = toml_text(out);
  return text.substr(text.find_first_not_of('\n'));
}

std::string calibrated_scene(const RecordedRun& run, const Unknowns& value) {
  namespace fs = std::filesystem;
  toml::table scene = parse_scene_file(run.scene_file, {});
  correct_lengths(*scene["mechanism"].as_table(), run.scene, value);
  correct_offsets(scene, run.scene, value);
  if (toml::table* model = scene["control"]["model"].as_table()) {
    for (const char* key : {"mechanism", "half_base", "l1", "l2"}) model->erase(key);
    if (model->empty()) scene["control"].as_table()->erase("model");
  }
  const auto absolute = [&](const char* section, const char* key) {  // the new file may stand elsewhere
    if (const auto path = scene[section][key].value<std::string>()) {
      const fs::path whole = fs::absolute(fs::path(run.scene_file).parent_path() / *path);
      scene[section].as_table()->insert_or_assign(key, whole.lexically_normal().string());
    }
  };
  absolute("reference", "path");
  absolute("drives", "endpoints");
  std::string text = toml_text(scene);
  try {
    (void)read_scene_text(text, "calibrated scene", {});
  } catch (const InputError& e) {
    refuse("--write: the scene does not fit its calibrated mechanism: {}", e.what());
  }
  return text;
}

void refuse_overwrite(const std::string& file, const std::vector<std::string>& inputs) {
  for (const std::string& input : inputs) {
    std::error_code error;
    if (!input.empty() && std::filesystem::equivalent(file, input, error) && !error)
      refuse("--write: {} is an input of this calibration", file);
  }
}

}  // namespace esmc::host
