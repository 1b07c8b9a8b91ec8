#pragma once
/// [reference] type = "program": a sequence of moves. Plain values.

#include <array>
#include <cstddef>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "host_sim/names.hpp"
#include "host_sim/scene/friction.hpp"

namespace esmc::host {

/// Shapes of a move.
enum class MoveKind {
  joint,   ///< straight in the base joints
  line,    ///< straight in the plane
  arc,     ///< circle through a point
  spline,  ///< cubic spline through points
  dwell,   ///< rest
};
template <>
inline constexpr auto names_of<MoveKind> = std::array{"joint", "line", "arc", "spline", "dwell"};

/// One move of a program.
struct MoveScene {
  MoveKind kind = MoveKind::line;
  std::array<double, 2> to{};                       ///< effector, m; joint: base joints, rad
  std::array<double, 2> via{};                      ///< arc: m
  std::vector<std::array<double, 2>> through;       ///< spline: points before `to`, m
  double blend = 0.0;                               ///< m, largest deviation at the corner to the next move
  std::optional<double> speed, acceleration, jerk;  ///< of the effector, m; joint: of each base joint, rad
  std::optional<double> time;                       ///< s; unset: as fast as all limits allow
  std::vector<int> working_mode;                    ///< joint: at the end, per leg; empty: not stated
  std::map<std::string, std::string> where;         ///< FILE:LINE of each key; "": of the move

  /// FILE:LINE of a key, or of the move where the key is absent.
  [[nodiscard]] std::string place(const std::string& key) const {
    const auto found = where.find(key);
    return found != where.end() ? found->second : where.at("");
  }
};

/// A program and the values of the file that it is planned with: a plant drawn at random keeps the plan.
struct ProgramScene {
  std::optional<std::array<double, 2>> from;  ///< effector, m; unset: where the scene starts
  std::vector<MoveScene> moves;
  std::array<double, 2> start{}, start_base{};  ///< effector, m, and base joints, rad
  std::optional<JointFriction> friction;        ///< of the effects; unset: the believed friction
  double payload = 0.0;                         ///< kg, of the effect
  double drive_torque = std::numeric_limits<double>::infinity();  ///< N m that every drive can give for ever
};

}  // namespace esmc::host
