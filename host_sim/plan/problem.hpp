#pragma once
/// What a program is planned with.

#include <fmt/format.h>

#include <array>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "firmware/cycle/instances.hpp"
#include "host_sim/design/extremes.hpp"
#include "host_sim/scene/program.hpp"

namespace esmc::host::plan {

/// A program that cannot be driven: which move (index from 0), which of its keys, and why.
class Refused : public std::runtime_error {
 public:
  /// `why` is formatted with the values.
  template <class... T>
  Refused(std::size_t move, std::string key, fmt::format_string<T...> why, T&&... values)
      : std::runtime_error(fmt::format(why, std::forward<T>(values)...)), move_(move), key_(std::move(key)) {}
  [[nodiscard]] std::size_t move() const { return move_; }
  [[nodiscard]] const std::string& key() const { return key_; }

 private:
  std::size_t move_;
  std::string key_;
};

/// Input of a plan: the believed mechanism and the limits. Nothing of the plant.
template <class M>
struct Problem {
  ControllerConfig<M> controller;  ///< mechanism (without friction), mode, limits, motors
  std::optional<M> loaded;         ///< with the payload: limits hold with and without it
  JointFriction friction;
  std::vector<MoveScene> moves;
  bool repeat = false;
  Vec2<double> start = Vec2<double>::Zero();       ///< of the effector, m
  Vec2<double> start_base = Vec2<double>::Zero();  ///< of the base joints there, rad, not wrapped
  double tick = 1e-3;                              ///< s
  std::size_t grid = 100;                          ///< points of a stretch between two rests, about
  bool bound = false;                              ///< Plan::bound and limit_curve are asked for
  std::optional<design::Problem<M>> uncertain;     ///< torque is left for the worst plant of it
};

}  // namespace esmc::host::plan
