#pragma once
/// System and method of a motion behind one virtual call per tick.

#include <vector>

#include "host_sim/effects/drivetrain.hpp"
#include "host_sim/plant/inputs.hpp"

namespace esmc::host {

template <class Plant>
class Engine {
 public:
  using Angles = typename Plant::Angles;
  using Joints = typename Plant::Joints;

  virtual ~Engine() = default;
  /// Integrates from t, s, in `steps` steps of `step`, s, each; no load may jump within.
  virtual void run(double t, double step, int steps, const MotorTorques<Joints>& torque) = 0;
  virtual void set_plant(const Plant& plant) = 0;  ///< must outlive this
  virtual void get(Angles& angle, Angles& rate) const = 0;
  [[nodiscard]] virtual double work() const = 0;  ///< of motors and loads since the start, J
  [[nodiscard]] virtual Shaft shaft(std::size_t joint) const = 0;
  [[nodiscard]] virtual std::size_t effect_states() const = 0;   ///< number of them
  [[nodiscard]] virtual std::vector<double> breaks() const = 0;  ///< instants that no step may cross, s
  [[nodiscard]] virtual Method method() const = 0;
  [[nodiscard]] virtual Effort effort() const { return {}; }
};

}  // namespace esmc::host
