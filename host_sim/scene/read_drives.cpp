#include "host_sim/scene/reader.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "host_sim/scene/frame_steps.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {
namespace {

/// Extends a list of CAN nodes with the smallest ones that are free, from 1 on.
void add_free_nodes(std::vector<int>& nodes, std::size_t count) {
  for (int node = 1; nodes.size() < count; ++node) {
    if (std::find(nodes.begin(), nodes.end(), node) == nodes.end()) nodes.push_back(node);
  }
}

/// Every axis read so far has a node of its own and a direction.
void check_axes(const Section& s, const DriveScene& d) {
  for (std::size_t i = 0; i < d.nodes.size(); ++i) {
    for (std::size_t k = 0; k < i; ++k) {
      if (d.nodes[i] == d.nodes[k]) s.fail("nodes", "names node {} twice", d.nodes[i]);
    }
    if (std::abs(d.direction[i]) != 1.0) s.fail("direction", "must be 1 or -1 for every axis");
    const bool canopen = d.protocol == Protocol::cia402, moteus = d.protocol == Protocol::moteus;
    const int least = canopen || moteus ? 1 : 0, most = canopen ? 127 : moteus ? 126 : 62;
    if (d.nodes[i] < least || d.nodes[i] > most)
      s.fail("nodes", "names node {}: {} to {} are allowed with this protocol", d.nodes[i], least, most);
    if (canopen && d.nodes[i] == d.controller_node)
      s.fail("nodes", "names node {}, which is drives.controller_node", d.nodes[i]);
  }
}

/// Units of CiA 402 are the drive's choice. Without a torque limit (open_loop, none) no drive is commanded.
void read_cia402(Section& s, const Scene& scene, DriveScene& d) {
  const auto n = static_cast<std::size_t>(scene.motors());
  d.rated_torque.assign(n, 1.0);
  for (std::size_t i = 0; i < scene.torque_limit.size(); ++i)
    d.rated_torque[i] = scene.torque_limit[i] / d.gear_ratio[i];
  if (s.has("rated_torque")) d.rated_torque = s.each("rated_torque", n);
  if (d.protocol != Protocol::cia402) return;
  if (d.watchdog_timeout < 1e-3) {
    s.fail("watchdog_timeout",
           "must be at least 0.001 s with cia402: object 1016 counts whole ms, and 0 switches it off");
  }
  for (const double ratio : d.gear_ratio) {
    const double raw = scene.limits.joint_speed * ratio / d.velocity_unit;
    if (!(raw <= 2147483647.0)) {
      s.fail("velocity_unit",
             "makes limits.joint_speed the number {:g}: at most 2147483647 fits into object 606C, and a "
             "faster joint would not be seen",
             raw);
    }
  }
  for (const double rated : d.rated_torque) {
    const double raw = rated / d.rated_torque_unit;
    if (!(raw >= 100.0 && raw <= 4e9)) {
      s.fail("rated_torque_unit",
             "makes a rated torque of {:g} N m the number {:g}: 100 to 4e9 are allowed in object 6076, so "
             "that it can be told to 1 %",
             rated, raw);
    }
  }
}

/// What must be known of ODrives before they are armed.
void read_odrive(Section& s, Scene& scene) {
  DriveScene& d = scene.drives;
  if (s.has("torque_constant"))
    d.torque_constant = s.each("torque_constant", static_cast<std::size_t>(scene.motors()));
  d.where = s.where();
  const auto name = s.optional_text("endpoints");
  if (!name) return;
  if (d.protocol == Protocol::odrive_0_5)
    s.fail("endpoints", "is for firmware 0.6: 0.5 lets nothing be read back");
  const std::string path = (std::filesystem::path(scene.file).parent_path() / *name).string();
  scene.companions.push_back({endpoints_copy, "", path});
  d.endpoints = read_odrive_endpoints(s.where("endpoints"), path, scene.companions.back().text);
}

/// Keys of MIT drives are read with every protocol, so that --set drives.protocol is enough to compare.
void read_mit(Section& s, Scene& scene) {
  DriveScene& d = scene.drives;
  const auto n = static_cast<std::size_t>(scene.motors());
  for (const double id : s.each("master_id", n)) {
    if (id != std::floor(id)) s.fail("master_id", "must be an integer from 0 to 2047, or one per motor");
    d.master_id.push_back(static_cast<int>(id));
  }
  if (d.protocol != Protocol::mit) return;
  const bool v3 = d.dialect == drive::mit::Dialect::cubemars_v3;
  if (v3 && !s.given("velocity_unit")) {
    s.fail("velocity_unit",
           "must be given for cubemars_v3: rad/s at the output for 10 electrical rpm, that is pi / (3 x pole "
           "pairs x the drive's own gear ratio)");
  }
  const int node_max = d.dialect == drive::mit::Dialect::damiao ? 15 : 62;
  for (std::size_t i = 0; i < n; ++i) {
    if (d.nodes[i] < 1 || d.nodes[i] > node_max)
      s.fail("nodes", "must be from 1 to {} for MIT drives of this dialect", node_max);
    for (std::size_t k = 0; k < n; ++k) {
      if (!v3 && i != k && d.master_id[i] == d.nodes[k]) {
        s.fail("master_id", "is {}, the node of another motor: commands to it would look like replies",
               d.master_id[i]);
      }
    }
    if (scene.closed_loop() && scene.torque_limit[i] > d.torque_range[i] * d.gear_ratio[i]) {
      s.fail("torque_range",
             "must let control.torque_limit through: motor {} may be asked for {} N m at the joint, its "
             "field ends at {}",
             i + 1, scene.torque_limit[i], d.torque_range[i] * d.gear_ratio[i]);
    }
  }
}

/// What goes into 16 bits of a moteus's registers: steps of 0.01 N m and 1 ms.
void check_moteus(const Section& s, const Scene& scene) {
  constexpr double most = 320.0;  // N m at the drive's output
  if (scene.drives.protocol != Protocol::moteus || !scene.closed_loop()) return;
  for (std::size_t i = 0; i < scene.torque_limit.size(); ++i) {
    const double torque = scene.torque_limit[i] / scene.drives.gear_ratio[i];
    if (torque > most)
      s.fail("gear_ratio",
             "makes control.torque_limit {:g} N m at motor {}: at most {:g} can be told to a moteus", torque,
             i + 1, most);
  }
}

/// rad/s at the joint: the step in which the drive of motor i says a speed; 0: in floats.
double speed_step(const DriveScene& d, std::size_t i) { return frame_steps(d, i).velocity / d.gear_ratio[i]; }

/// The end stops are at zero_pose.
void read_homing(Section& s, Scene& scene) {
  DriveScene& d = scene.drives;
  const auto speed = s.optional_numbers("homing_speed", {2}),
             torque = s.optional_numbers("homing_torque", {2});
  if (!speed && !torque) return;
  if (!speed || !torque)
    s.fail(speed ? "homing_speed" : "homing_torque", "needs the other one of homing_speed and homing_torque");
  if (d.zero != Zero::end_stop) s.fail("homing_speed", "is for zero = \"end_stop\"");
  if (d.zero_pose.empty()) s.fail("homing_speed", "needs zero_pose, the angles of the joints on their stops");
  if (scene.all_motors) s.fail("homing_speed", "is for two motors: with four, each moves all the others");
  for (std::size_t i = 0; i < 2; ++i) {
    if (std::abs((*speed)[i]) < 1e-3 || std::abs((*speed)[i]) > scene.limits.joint_speed)
      s.fail("homing_speed", "must be at least 0.001 rad/s and at most limits.joint_speed, either way");
    // A joint stands below an eighth of it, and at rest MIT drives say half a step.
    if (const double least = 5.0 * speed_step(d, i); std::abs((*speed)[i]) < least)
      s.fail("homing_speed",
             "must be at least {:.3g} rad/s at joint {}: five steps of the speed that its drive reports "
             "(velocity_range, velocity_unit, gear_ratio)",
             least, i + 1);
    if (i < scene.torque_limit.size() && (*torque)[i] > scene.torque_limit[i])
      s.fail("homing_torque", "must be at most control.torque_limit");
  }
  d.homing_speed = *speed;
  d.homing_torque = *torque;
}

/// One entry per motor. Lists for the base motors alone are enough where there is no bus.
void read_mounts(Section& s, Scene& scene) {
  DriveScene& d = scene.drives;
  const auto n = static_cast<std::size_t>(scene.motors());
  const std::vector<std::size_t> sizes =
      n == 2 ? std::vector<std::size_t>{2} : std::vector<std::size_t>{n, 2};
  const auto note_missing = [&](std::size_t given) {
    if (given < n) d.missing = "[drives] must name all four motors for control.motors = \"all\"";
  };
  const auto list = [&](const char* key, double rest) {
    std::vector<double> v = s.given(key) ? s.numbers(key, sizes) : std::vector<double>(n, rest);
    note_missing(v.size());
    v.resize(n, rest);
    return v;
  };
  d.direction = list("direction", 1.0);
  d.gear_ratio = list("gear_ratio", 1.0);
  d.offset = list("offset", 0.0);
  if (const auto nodes = s.optional_integers("nodes", sizes)) {
    note_missing(nodes->size());
    d.nodes = *nodes;
  }
  add_free_nodes(d.nodes, n);
}

}  // namespace

void read_drives(Section s, Scene& scene) {
  DriveScene& d = scene.drives;
  s.read_fields(scene);
  if (const auto defect = s.optional_text("defect")) {
    const std::string why = set_defect(d.defects, *defect, name(d.protocol));
    if (!why.empty()) s.fail("defect", "\"{}\": {}", *defect, why);
  }
  if (const auto pose = s.optional_numbers("zero_pose", {2, 4})) {
    if (pose->size() != (scene.all_sensors ? static_cast<std::size_t>(scene.joints()) : 2U))
      s.fail("zero_pose", "must have one angle per sensed joint");
    d.zero_pose = *pose;
  }
  if (d.sign_test.value_or(false) && scene.all_motors)
    s.fail("sign_test", "is for two motors: with four, each moves all the others");
  if (d.torque_mismatch > 0.0 && d.protocol == Protocol::odrive_0_5) {
    s.fail("torque_mismatch",
           "must be 0: this drive does not say its torque (allowed with odrive, cia402, mit, moteus)");
  }
  if (d.torque_mismatch > 0.0 && d.protocol == Protocol::mit && d.dialect == drive::mit::Dialect::cubemars_v3)
    s.fail("torque_mismatch", "must be 0: this drive says a current, not its torque");
  // A slow loop must not trip the default watchdog between two of its ticks.
  d.watchdog_timeout = s.optional_number("watchdog_timeout").value_or(std::max(0.01, 3.0 * scene.tick()));
  read_mounts(s, scene);
  read_cia402(s, scene, d);
  check_axes(s, d);
  read_odrive(s, scene);
  read_mit(s, scene);
  check_moteus(s, scene);
  for (std::size_t i = 0; i < static_cast<std::size_t>(scene.motors()); ++i)
    d.speed_step = std::max(d.speed_step, speed_step(d, i));
  read_homing(s, scene);
  s.finish();
}

void read_sensors(const std::optional<Section>& given, Section& root, Scene& scene) {
  const bool needed = scene.all_sensors && !scene.all_motors;
  DriveScene& d = scene.drives;
  if (!needed) {
    if (given && !given->empty())
      root.fail("sensors", "is only for control.sensors = \"all\" with motors = \"base\"");
    return;
  }
  if (!scene.odrive()) d.missing = "passive encoders ([sensors]) exist for the ODrive protocols only";
  if (!given) {
    d.missing = "control.sensors = \"all\" needs a table [sensors] with the nodes of the passive encoders";
    add_free_nodes(d.nodes, 4);
    d.direction.resize(4, 1.0);
    d.gear_ratio.resize(4, 1.0);
    d.offset.resize(4, 0.0);
    return;
  }
  Section s = *given;
  const std::vector<int> nodes = s.integers("nodes", 2);
  const auto direction = s.optional_numbers("direction", {2}).value_or(std::vector<double>(2, 1.0));
  const auto offset = s.optional_numbers("offset", {2}).value_or(std::vector<double>(2, 0.0));
  for (std::size_t i = 0; i < 2; ++i) {
    d.nodes.push_back(nodes[i]);
    d.direction.push_back(direction[i]);
    d.gear_ratio.push_back(1.0);
    d.offset.push_back(offset[i]);
  }
  check_axes(s, d);
  s.finish();
}

}  // namespace esmc::host
