#pragma once
/// A scene of `esmc spatial`.

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "host_sim/scene/names.hpp"
#include "host_sim/spatial/params.hpp"

namespace esmc::host {

struct SpatialScene {
  std::string name, toml;  ///< toml: as run, with every --set
  RigidBodyParams<double> body;
  std::optional<HexapodParams<double>> platform;  ///< its `platform` is `body`
  double gravity = 0.0;

  SpatialLaw law = SpatialLaw::esmc;
  ReachingChoice reaching = ReachingChoice::implicit;  ///< one of the first four
  std::array<double, 2> lambda{}, gain{}, layer{};     ///< of positions, of angles
  double rate_hz = 1000.0, hysteresis = 0.1, force_limit = 0.0, moment_limit = 0.0;
  struct Model {
    double mass = 1.0, inertia = 1.0, legs = 1.0;
  } model;

  struct Reference {
    SpatialReferenceKind type = SpatialReferenceKind::hold;
    Vec<double, 3> position, rotation, axis{0, 0, 1}, second_axis{1, 0, 0},
        shift{0, 0, 0};  ///< axes of length 1
    double angle = 0.0, duration = 1.0, rate = 0.0, second_rate = 0.0, frequency = 1.0;
  } reference;
  struct Initial {
    Vec<double, 3> position, rotation, velocity, turning;
  } initial;
  struct Measurement {
    double position_noise = 0.0, attitude_noise = 0.0, rate_noise = 0.0;
    bool alternate_sign = false;
  } measurement;
  double duration = 0.0, step = 1e-3;

  [[nodiscard]] double tick() const { return 1.0 / rate_hz; }  ///< s
};

/// Reads FILE, then applies each of `sets`, "section.key=value". Throws InputError with file, line and key.
SpatialScene read_spatial_scene(const std::string& file, const std::vector<std::string>& sets);

}  // namespace esmc::host
