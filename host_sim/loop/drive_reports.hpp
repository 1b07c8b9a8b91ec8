#pragma once
/// Reports of the drives in words: reasons not to arm, and their part in a fault.

#include <string>

#include "host_sim/controller/axes_config.hpp"
#include "host_sim/record/recorder.hpp"

namespace esmc::host {

/// Texts about the axes (drives, passive encoders) of a controller of mechanism C, scene of `World`.
template <class World, class C = typename World::Mechanism>
class DriveReports {
 public:
  using Torques = Vec<double, World::Mechanism::joints>;

  /// `scene` must outlive this.
  explicit DriveReports(const Scene& scene);

  /// Name of the joint whose encoder contradicts the others, after a fault loop_not_closed; empty: unknown.
  [[nodiscard]] std::string odd_encoder(const AnyCycle<C>& cycle) const;
  /// Reason why the controller did not arm: the fault, with node and object where a drive reports one.
  [[nodiscard]] std::string refusal(const AnyCycle<C>& cycle) const;
  /// "node 1, node 2": the motors' drives that have not confirmed torque control.
  [[nodiscard]] std::string unready(const AnyCycle<C>& cycle) const;
  /// "node 1, node 2": the drives that had no object for their torque limit, so that it was not read back.
  [[nodiscard]] std::string limits_unread(const AnyCycle<C>& cycle) const;
  /// Adds node, drive error and values that the axes report to a fault. `expected`: torques after the lag of
  /// TorqueFeedbackCheck, N m at the joints.
  void add_details(const AnyCycle<C>& cycle, const Torques& expected, FaultRecord& f) const;

 private:
  [[nodiscard]] bool is_motor(int axis) const;
  template <class Axis>
  [[nodiscard]] std::string reported(const Axis& a, bool motor) const;
  template <class Axis>
  void add_details(const Axis& a, int i, const Torques& expected, FaultRecord& f) const;
  [[nodiscard]] std::string endpoint_path(std::uint16_t id) const;

  const Scene& scene_;
  std::vector<std::pair<int, int>> motors_;  // axis and node of each
  std::vector<int> nodes_;                   // per axis
};

}  // namespace esmc::host
