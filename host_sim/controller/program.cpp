#include "host_sim/controller/program.hpp"

#include <algorithm>

#include "host_sim/controller/numbers.hpp"
#include "host_sim/error.hpp"

namespace esmc::host {
namespace {

/// A mechanism without friction, with a point mass at its effector.
FiveBarParams<double> frictionless(FiveBarParams<double> p, bool arm, double payload) {
  set_friction(p, {});
  return with_payload(p, arm, payload);
}

/// All numbers that a plan depends on: equal lists, equal plans.
template <class M>
std::vector<double> numbers_of(const Scene& scene, const plan::Problem<M>& p) {
  const auto& c = p.controller;
  std::vector<double> out;
  put(out, M::joints, c.motors, c.sensors, c.torque_limit, c.limits.min_abs_sin_type1,
      c.limits.min_abs_sin_type2, c.limits.joint_speed, p.tick, p.repeat, p.start, p.start_base,
      believed_mechanism(scene), scene.reference.program.payload, p.loaded.has_value(), p.friction.viscous,
      p.friction.dry, p.friction.asymmetry, scene.working_mode, scene.assembly_mode, p.uncertain.has_value());
  for (const auto& r :
       {c.limits.workspace_x, c.limits.workspace_y, c.limits.joint_angle[0], c.limits.joint_angle[1]})
    put(out, r.lower, r.upper);
  for (const MoveScene& m : p.moves) {
    put(out, m.kind, m.to, m.via, m.blend, m.speed, m.acceleration, m.jerk, m.time,
        static_cast<double>(m.through.size()), static_cast<double>(m.working_mode.size()));
    for (const auto& point : m.through) put(out, point);
    for (const int mode : m.working_mode) put(out, mode);
  }
  if (p.uncertain) put(out, c.law, p.uncertain->uncertainty);
  return out;
}

}  // namespace

template <class M>
plan::Problem<M> program_problem(const Scene& scene) {
  const ProgramScene& program = scene.reference.program;
  const bool arm = scene.type == MechanismType::rr;
  const FiveBarParams<double> believed = believed_mechanism(scene);
  plan::Problem<M> p;
  ReferenceBundle<double> nowhere;
  nowhere.reference.kind = ReferenceKind::path;
  p.controller = controller_without_design<M>(scene, Pacing::lockstep, nowhere);
  if (!scene.closed_loop()) {  // there is no controller, but a plan that no torque limits
    p.controller.torque_limit.setConstant(1e9);
    p.controller.torque_weight.setOnes();
  }
  p.controller.reference = {};
  if (scene.closed_loop() && p.controller.allocate != nullptr &&
      program.drive_torque < *std::ranges::max_element(scene.torque_limit))
    refuse_at(scene.control_where,
              "'control.torque_limit' must be at most {:g} N m for every motor, which torque_saturation or "
              "thermal_limit leaves: by it the four motors share what a program takes",
              program.drive_torque);
  p.controller.torque_limit = p.controller.torque_limit.cwiseMin(program.drive_torque);
  p.controller.torque_limit = p.controller.torque_given();
  if (scene.uncertainty && scene.closed_loop() && scene.law != LawChoice::pd) {
    auto& u = p.uncertain.emplace();
    u.controller = p.controller;
    u.believed = believed;
    u.uncertainty = *scene.uncertainty;
  }
  p.controller.mechanism = M(params_of<M>(frictionless(believed, arm, 0.0)));
  if (program.payload > 0.0) p.loaded = M(params_of<M>(frictionless(believed, arm, program.payload)));
  p.friction = program.friction.value_or(friction_of(believed));
  p.moves = program.moves;
  p.repeat = scene.reference.repeat;
  p.start = {program.start[0], program.start[1]};
  p.start_base = {program.start_base[0], program.start_base[1]};
  p.tick = scene.tick();
  return p;
}

template <class M>
plan::Plan planned(const plan::Problem<M>& p) {
  try {
    return plan::plan(p);
  } catch (const plan::Refused& e) {
    const std::string key = e.key().empty() ? "" : "." + e.key();
    refuse_at(p.moves[e.move()].place(e.key()), "'reference.moves[{}]{}' {}", e.move() + 1, key, e.what());
  }
}

std::shared_ptr<const plan::Plan> planned_program(const Scene& scene) {
  static Known<std::shared_ptr<const plan::Plan>> known;  // every look at a reference asks for it
  return with_mechanism<double>(scene, [&]<class M>(const M*) {
    const plan::Problem<M> p = program_problem<M>(scene);
    return known.get(numbers_of(scene, p), [&] { return std::make_shared<const plan::Plan>(planned(p)); });
  });
}

template plan::Problem<FiveBar<double>> program_problem(const Scene&);
template plan::Problem<Rr<double>> program_problem(const Scene&);
template plan::Plan planned(const plan::Problem<FiveBar<double>>&);
template plan::Plan planned(const plan::Problem<Rr<double>>&);

}  // namespace esmc::host
