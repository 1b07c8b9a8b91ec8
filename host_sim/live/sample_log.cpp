#include "host_sim/live/sample_log.hpp"

#include "host_sim/record/recording.hpp"

namespace esmc::host {

std::vector<std::string> sample_columns(const Scene& scene) {
  const auto joints = joint_names(scene.type);
  std::vector<std::string> out{"t", "x", "y"};
  out.insert(out.end(), joints.begin(), joints.end());
  for (const std::size_t joint : scene.motor_joints()) out.push_back("tau" + joints[joint].substr(5));
  for (const char* name : {"x_ref", "y_ref", "s_1", "s_2", "force_x", "force_y", "state"})
    out.emplace_back(name);
  return out;
}

std::vector<double> sample_values(const LiveSample& s, const Scene& scene) {
  const std::size_t first = scene.type == MechanismType::five_bar ? 2 : 0, joints = first == 2 ? 4 : 2;
  std::vector<double> out{s.t, s.effector[0], s.effector[1]};
  for (std::size_t i = 0; i < joints; ++i) out.push_back(s.q[first + i]);
  for (std::size_t i = 0; i < static_cast<std::size_t>(scene.motors()); ++i) out.push_back(s.torque[i]);
  for (const auto& pair : {s.desired, s.sliding, s.force}) out.insert(out.end(), pair.begin(), pair.end());
  return out;
}

}  // namespace esmc::host
