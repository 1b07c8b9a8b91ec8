#include <algorithm>
#include <cmath>

#include "host_sim/error.hpp"
#include "host_sim/plant/kinematics.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {
namespace {

/// First point of the reference: an effector position, or base joint angles for joint_sine.
struct FirstPoint {
  bool joints = false;
  std::array<double, 2> value{};
};

FirstPoint first_point(const ReferenceScene& r, const std::string& where) {
  switch (r.type) {
    case ReferenceType::circle:
      return {false,
              {r.center[0] + r.radius * std::cos(r.phase), r.center[1] + r.radius * std::sin(r.phase)}};
    case ReferenceType::line:
    case ReferenceType::polyline:
      return {false, r.points.front()};
    case ReferenceType::joint_sine:
      return {true,
              {r.offset[0] + r.amplitude[0] * std::sin(r.phases[0]),
               r.offset[1] + r.amplitude[1] * std::sin(r.phases[1])}};
    case ReferenceType::hold:
      if (r.position) return {false, *r.position};
      throw InputError(where,
                       "the start is not given: reference.type = \"hold\" without a position holds the "
                       "start, so [initial] needs position or joints");
    case ReferenceType::program: {  // without a start of its own where it ends
      const auto& moves = r.program.moves;
      const auto last =
          std::find_if(moves.rbegin(), moves.rend(), [](const auto& m) { return m.kind != MoveKind::dwell; });
      if (r.program.from) return {false, *r.program.from};
      return {last->kind == MoveKind::joint, last->to};
    }
    case ReferenceType::file:
      return {false, {r.table.front().x, r.table.front().y}};
    case ReferenceType::none:
      break;
  }
  throw InputError(where, "the start is not given: [initial] needs position or joints");
}

/// All four rates from those of the base joints: U v = (l1 sin(theta2) rate)_j, then each leg's own.
std::vector<double> closed_rates(const Scene& scene, const std::string& where, const std::array<double, 4>& q,
                                 const std::vector<double>& base) {
  if (base[0] == 0.0 && base[1] == 0.0) return {0.0, 0.0, 0.0, 0.0};
  const double a = q[0] + q[1], b = q[2] + q[3], d2 = type2_sine(q);
  const double r1 = scene.mechanism.legs[0].l1 * std::sin(q[1]) * base[0];
  const double r2 = scene.mechanism.legs[1].l1 * std::sin(q[3]) * base[1];
  const V2 v{(std::sin(b) * r1 - std::sin(a) * r2) / d2, (std::cos(a) * r2 + std::cos(b) * r1) / d2};
  const auto outer = [&](std::size_t j, V2 tip) {
    const LegParams<double>& leg = scene.mechanism.legs[j];
    const double phi2 = q[2 * j] + q[2 * j + 1];
    const double across = -std::sin(phi2) * tip.x + std::cos(phi2) * tip.y;
    return (across - leg.l1 * std::cos(q[2 * j + 1]) * base[j]) / leg.l2 - base[j];
  };
  const std::vector<double> out{base[0], outer(0, v), base[1], outer(1, {-v.x, v.y})};
  for (const double w : out) {
    if (!std::isfinite(w))
      throw InputError(where, "base joint rates do not fix the motion at a type-2 singularity");
  }
  return out;
}

void start_at_position(Scene& scene, const std::string& where, V2 p, V2 v) {
  const auto take = [&](const auto& theta) {
    if (!theta) {
      refuse_at(where,
                "({}, {}) cannot be reached: every leg needs |l1 - l2| <= distance from its base <= l1 + l2",
                p.x, p.y);
    }
    scene.start_angle.assign(theta->begin(), theta->end());
  };
  if (scene.type == MechanismType::five_bar)
    take(reach(scene.mechanism, p, scene.working_mode));
  else
    take(reach(scene.mechanism.legs[0], p, scene.working_mode[0]));
  scene.start_rate.assign(scene.start_angle.size(), 0.0);
  if (v.x == 0.0 && v.y == 0.0) return;
  for (std::size_t j = 0; j < scene.start_angle.size() / 2; ++j) {
    const std::array<double, 2> theta{scene.start_angle[2 * j], scene.start_angle[2 * j + 1]};
    const auto w = joint_rates(scene.mechanism.legs[j], theta, j == 0 ? v : V2{-v.x, v.y});
    if (!std::isfinite(w[0]) || !std::isfinite(w[1]))
      throw InputError(where, "no such velocity at a type-1 singularity");
    scene.start_rate[2 * j] = w[0];
    scene.start_rate[2 * j + 1] = w[1];
  }
}

void start_at_joints(Scene& scene, const std::string& where, const std::vector<double>& q,
                     const std::vector<double>& qd) {
  if (scene.type == MechanismType::rr || q.size() == 4) {
    scene.start_angle = q;
    scene.start_rate = qd;
    if (q.size() != 4) return;
    const V2 a = leg_tip(scene.mechanism.legs[0], {q[0], q[1]}),
             b = leg_tip(scene.mechanism.legs[1], {q[2], q[3]});
    const double gap = std::hypot(scene.mechanism.l0 + a.x - (-scene.mechanism.l0 - b.x), a.y - b.y);
    if (gap <= 1e-6) return;
    refuse_at(where, "the four joint angles do not close: the leg tips are {:.3g} m apart (allowed: 1e-6)",
              gap);
  }
  if (scene.assembly_mode == 0) {
    throw InputError(
        where, "base joints alone do not fix the pose: give mechanism.assembly_mode, or all four joints");
  }
  const auto theta = close(scene.mechanism, {q[0], q[1]}, scene.assembly_mode);
  if (!theta) throw InputError(where, "the legs cannot be closed at these base joint angles");
  scene.start_angle.assign(theta->begin(), theta->end());
  scene.start_rate = closed_rates(scene, where, *theta, qd);
}

void check_modes(Scene& scene, const std::string& where) {
  const auto& q = scene.start_angle;
  for (std::size_t j = 0; j < q.size() / 2; ++j) {
    if (scene.closed_loop() && !(std::sin(q[2 * j + 1]) * scene.working_mode[j] > 0.0))
      refuse_at(where, "at the start leg {} does not bend as mechanism.working_mode says", j + 1);
  }
  if (scene.type != MechanismType::five_bar) return;
  const double d2 = type2_sine({q[0], q[1], q[2], q[3]});
  const int sign = d2 > 0.0 ? 1 : -1;
  if (scene.assembly_mode == 0) scene.assembly_mode = sign;
  if (scene.assembly_mode != sign) {
    refuse_at(where,
              "at the start sin(phi12 + phi22) = {:.3g}: mechanism.assembly_mode must be \"{}\", or start "
              "elsewhere",
              d2, sign > 0 ? "+" : "-");
  }
}

}  // namespace

void set_start(Scene& scene, const std::string& initial, const std::string& reference) {
  const InitialScene& i = scene.initial;
  const std::string& where = i.at_reference ? reference : initial;
  if (i.position) {
    start_at_position(scene, where, {(*i.position)[0], (*i.position)[1]}, {i.velocity[0], i.velocity[1]});
  } else if (!i.joints.empty()) {
    start_at_joints(scene, where, i.joints, i.joint_rates);
  } else {
    const FirstPoint p = first_point(scene.reference, initial);
    if (p.joints) {
      start_at_joints(scene, where, {p.value[0], p.value[1]}, {0.0, 0.0});
    } else {
      start_at_position(scene, where, {p.value[0], p.value[1]}, {});
    }
  }
  check_modes(scene, where);
}

}  // namespace esmc::host
