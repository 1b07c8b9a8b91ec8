#pragma once
/// Controller and plant of a scene as two objects, tick by tick, without a bus: the parts of `esmc sim`.

#include <memory>
#include <span>
#include <string>
#include <vector>

#include "host_sim/scene/scene.hpp"

namespace esmc::host {

/// Result of a controller's tick.
struct PythonTick {
  std::vector<double> torque;                      ///< per motor, N m at the joint
  std::vector<double> s;                           ///< sliding variables of the channels
  std::vector<double> effector, desired_effector;  ///< estimate and reference, m; zeros where there is none
  std::string state, fault;
  bool saturated = false;
};

class PythonController {
 public:
  virtual ~PythonController() = default;
  /// One tick with angles (rad) and rates (rad/s) of all joints, in the order of the model; of those without
  /// a sensor the values are not used. `command`: none, stop, halt, reset or enable.
  virtual PythonTick tick(std::span<const double> angle, std::span<const double> rate,
                          const std::string& command) = 0;
};

class PythonPlant {
 public:
  virtual ~PythonPlant() = default;
  /// Advances by one tick of the scene under `torque` (N m at the joint, per motor), as the drives deliver
  /// it. Throws Diverged where the state is not finite.
  virtual void step(std::span<const double> torque) = 0;
  /// Coordinates and rates as in final_state of the summary: with a five-bar x and y, then the joints.
  virtual void output(std::vector<double>& q, std::vector<double>& qd) const = 0;
  /// Angles or rates, of all joints, of the shafts whose encoders drives read: rad, rad/s.
  virtual std::vector<double> shafts(bool rates) const = 0;
  virtual double energy() const = 0;  ///< kinetic and potential, J
  virtual double t() const = 0;       ///< s
};

/// Both copy the scene.
std::unique_ptr<PythonController> make_python_controller(const Scene& scene);
std::unique_ptr<PythonPlant> make_python_plant(const Scene& scene);

/// The scene's mechanism in a state, as a case of `esmc eval`. `state`: JSON object with "theta" (and
/// "thetad"), rad and rad/s: all joints, or with a five-bar the two base joints, closed in the scene's
/// assembly mode; or with "x", "y", "xd", "yd". Throws InputError for keys of which it would make no use.
std::string model_case(const Scene& scene, const std::string& state);

}  // namespace esmc::host
