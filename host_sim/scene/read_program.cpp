#include <fmt/format.h>

#include <algorithm>

#include "host_sim/plant/kinematics.hpp"
#include "host_sim/scene/fields.hpp"

namespace esmc::host {
namespace {

constexpr std::size_t moves_max = 1000;

MoveScene read_move(Section& s, const Scene& scene) {
  MoveScene m;
  m.kind = s.choice<MoveKind>("move");
  const std::string own = fmt::format("reference.moves[{}]", name(m.kind));
  m.where[""] = s.where();
  for (const char* key :
       {"to", "via", "through", "blend", "speed", "acceleration", "jerk", "time", "working_mode"})
    if (s.has(key)) m.where[key] = s.where(key);
  if (m.kind != MoveKind::line) s.use_schema(own);
  if (m.kind == MoveKind::dwell) {
    m.time = s.number("time");
    s.finish();
    return m;
  }
  if (m.kind == MoveKind::arc) m.via = s.pair("via");
  if (m.kind == MoveKind::spline) {
    if (!s.has("through")) s.fail("", "move = \"spline\" needs through = [[x, y], ...], m");
    m.through = s.pairs("through", s.has("to") ? 1 : 2);
  }
  if (m.kind == MoveKind::joint && s.has("working_mode"))
    m.working_mode = s.signs("working_mode", scene.type == MechanismType::five_bar ? 2 : 1);
  s.use_schema("reference.moves");
  if (const auto to = s.optional_numbers("to", {2})) {
    m.to = {(*to)[0], (*to)[1]};
  } else if (!m.through.empty()) {
    m.to = m.through.back();
    m.through.pop_back();
  } else {
    s.fail("", "move = \"{}\" needs to = {}", name(m.kind),
           m.kind == MoveKind::joint ? "[angle, angle] of the base joints, rad" : "[x, y], m");
  }
  m.blend = s.number("blend");
  m.speed = s.optional_number("speed");
  m.acceleration = s.optional_number("acceleration");
  m.jerk = s.optional_number("jerk");
  if (!s.is_word("time", "optimal")) m.time = s.optional_number("time");
  s.finish();
  return m;
}

/// A blend joins two moves that are timed together.
void check_blend(const Section& s, const std::vector<MoveScene>& moves, std::size_t i) {
  const MoveScene& m = moves[i];
  if (m.blend == 0.0) return;
  if (i + 1 == moves.size())
    s.fail("blend", "has no corner: the last move ends at rest, and the program may then begin again");
  if (moves[i + 1].kind == MoveKind::dwell)
    s.fail("blend", "has no corner: the next move is a dwell, at rest");
  if (m.time.has_value() != moves[i + 1].time.has_value())
    s.fail("blend", "joins moves that are timed together: both need time = \"optimal\", or both a time in s");
}

}  // namespace

void read_program(Section& s, Scene& scene) {
  ProgramScene& p = scene.reference.program;
  if (s.has("from")) p.from = s.pair("from");
  std::vector<Section> given = s.sections("moves", "reference.moves");
  if (given.empty() || given.size() > moves_max)
    s.fail("moves", "must be 1 to {} tables [[reference.moves]]", moves_max);
  bool moving = false;
  for (Section& one : given) {
    p.moves.push_back(read_move(one, scene));
    moving = moving || p.moves.back().kind != MoveKind::dwell;
  }
  if (!moving) s.fail("moves", "only dwell: type = \"hold\" rests");
  for (std::size_t i = 0; i < given.size(); ++i) check_blend(given[i], p.moves, i);
}

void complete_program(Scene& scene) {
  ProgramScene& p = scene.reference.program;
  const auto& q = scene.start_angle;
  const V2 tip = leg_tip(scene.mechanism.legs[0], {q[0], q[1]});
  const bool five_bar = scene.type == MechanismType::five_bar;
  const auto last =
      std::find_if(p.moves.rbegin(), p.moves.rend(), [](const auto& m) { return m.kind != MoveKind::dwell; });
  const bool ends_there = scene.initial.at_reference && last->kind != MoveKind::joint;
  p.start = p.from       ? *p.from
            : ends_there ? last->to
                         : std::array{tip.x + (five_bar ? scene.mechanism.l0 : 0.0), tip.y};
  p.start_base = {q[0], q[five_bar ? 2 : 1]};
  p.friction = friction_of(scene.effects);
  if (const auto f = find_effect<Payload>(scene.effects)) p.payload = f->mass;
  if (const auto f = find_effect<TorqueSaturation>(scene.effects)) p.drive_torque = f->limit;
  if (const auto f = find_effect<ThermalLimit>(scene.effects))
    p.drive_torque = std::min(p.drive_torque, f->continuous);
}

}  // namespace esmc::host
