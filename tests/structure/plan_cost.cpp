// One program, planned once, for callgrind. usage: plan_cost NAME [GRID]; prints its time of motion, s.
// Without a name: all names.

#include <cstdio>
#include <cstdlib>
#include <map>
#include <string>

#include "tests/support/program_problem.hpp"

namespace esmc::test {
namespace {

using host::MoveKind;
using host::plan::Problem;

/// 25 mm up, 200 mm across, 25 mm down, and back; `time`: of each way, s, or 0: the shortest.
Problem<FiveBar<double>> pick_and_place(bool all_motors = false, double time = 0.0) {
  auto p = at_rest<FiveBar<double>>(-0.1, 0.15, 1.5, all_motors);
  for (const double x : {-0.1, 0.1}) {
    p.moves.push_back(move(MoveKind::line, x, 0.175));
    p.moves.push_back(move(MoveKind::line, -x, 0.175));
    p.moves.push_back(move(MoveKind::line, -x, 0.15));
    for (std::size_t i = p.moves.size() - 3; i < p.moves.size(); ++i) {
      if (time > 0.0) p.moves[i].time = time / 3.0;
      if (i + 1 < p.moves.size()) p.moves[i].blend = 0.01;
    }
  }
  p.repeat = true;
  return p;
}

/// Round a rectangle with rounded corners, rounds in one stretch, at a stated speed of the effector.
Problem<FiveBar<double>> rectangle(double speed) {
  auto p = at_rest<FiveBar<double>>(-0.08, 0.14, 1.5);
  for (int round = 0; round < 3; ++round) {
    for (const auto& [x, y] : {std::pair{0.08, 0.14}, {0.08, 0.2}, {-0.08, 0.2}, {-0.08, 0.14}}) {
      p.moves.push_back(move(MoveKind::line, x, y));
      p.moves.back().blend = 0.005;
      if (speed > 0.0) p.moves.back().speed = speed;
    }
  }
  p.moves.back().blend = 0.0;
  return p;
}

Problem<Rr<double>> arm_moves(bool friction) {
  auto p = at_rest<Rr<double>>(0.40, -0.10, 9.0);
  auto arc = move(MoveKind::arc, 0.35, -0.25);
  arc.via = {0.48, -0.05};
  auto spline = move(MoveKind::spline, 0.40, -0.10);
  spline.through = {{0.3, -0.1}, {0.25, 0.1}, {0.35, 0.2}};
  p.moves = {move(MoveKind::line, 0.20, 0.25), move(MoveKind::line, 0.35, 0.10), arc, spline};
  if (friction) {
    p.friction.viscous = {0.2, 0.1, 0.0, 0.0};
    p.friction.dry = {0.3, 0.1, 0.0, 0.0};
  }
  return p;
}

Problem<FiveBar<double>> joint_moves() {
  auto p = at_rest<FiveBar<double>>(-0.08, 0.16, 1.5);
  const auto& c = p.controller;
  p.start_base = FiveBar<double>::base_angles(*c.mechanism.inverse(p.start, c.mode));
  for (const auto& [x, y] : {std::pair{0.08, 0.16}, {0.0, 0.21}, {-0.08, 0.16}}) {
    const Vec2<double> q = FiveBar<double>::base_angles(*c.mechanism.inverse(Vec2<double>(x, y), c.mode));
    p.moves.push_back(move(MoveKind::joint, q[0], q[1]));
  }
  return p;
}

template <class M>
int planned(Problem<M> p, const char* grid) {
  if (grid != nullptr) p.grid = std::strtoull(grid, nullptr, 10);
  const auto plan = host::plan::plan(p);
  std::printf("%.9g %zu\n", plan.duration, plan.path.size());
  return 0;
}

int run(const std::string& name, const char* grid) {
  if (name == "pick_and_place") return planned(pick_and_place(), grid);
  if (name == "four_motors") return planned(pick_and_place(true), grid);
  if (name == "in_time") return planned(pick_and_place(false, 0.6), grid);
  if (name == "rectangle") return planned(rectangle(0.0), grid);
  if (name == "rectangle_at_speed") return planned(rectangle(0.3), grid);
  if (name == "arm") return planned(arm_moves(false), grid);
  if (name == "arm_with_friction") return planned(arm_moves(true), grid);
  if (name == "joint_moves") return planned(joint_moves(), grid);
  std::puts(
      "pick_and_place four_motors in_time rectangle rectangle_at_speed arm arm_with_friction joint_moves");
  return name.empty() ? 0 : 2;
}

}  // namespace
}  // namespace esmc::test

int main(int argc, char** argv) {
  return esmc::test::run(argc > 1 ? argv[1] : "", argc > 2 ? argv[2] : nullptr);
}
