#pragma once
/// Reports of the drives in words: reasons not to arm, and their part in a fault.

#include <fmt/format.h>

#include <string>
#include <vector>

#include "host_sim/controller/axes_config.hpp"
#include "host_sim/record/recorder.hpp"

namespace esmc::host {

/// Texts about the axes (drives, passive encoders) of a controller of mechanism C, scene of `World`.
template <class World, class C = typename World::Mechanism>
class DriveReports {
 public:
  using Torques = Vec<double, World::Mechanism::joints>;

  /// Both must outlive this.
  DriveReports(const Scene& scene, const AnyCycle<C>& cycle)
      : scene_(scene), cycle_(cycle), nodes_(scene.drives.nodes.size()), motor_(nodes_.size()) {
    for (std::size_t i = 0; i < nodes_.size(); ++i) {
      nodes_[axis_of(scene, i)] = scene.drives.nodes[i];
      motor_[axis_of(scene, i)] = i < static_cast<std::size_t>(scene.motors());
    }
  }

  /// Name of the joint whose encoder contradicts the others, after a fault loop_not_closed; empty: unknown.
  [[nodiscard]] std::string odd_encoder() const;
  /// Reason why the controller did not arm: the fault, with node and object where a drive reports one.
  [[nodiscard]] std::string refusal() const;
  /// "node 1, node 2": the motors' drives that have not confirmed torque control.
  [[nodiscard]] std::string unready() const {
    return motors([](const auto& a) { return a.ready() ? nullptr : (a.alive() ? "" : " (silent)"); });
  }
  /// "node 1, node 2": the drives that had no object for their torque limit, so that it was not read back.
  [[nodiscard]] std::string limits_unread() const {
    return motors([](const auto& a) -> const char* {
      if constexpr (requires { a.torque_limit_unread(); }) return a.torque_limit_unread() ? "" : nullptr;
      return nullptr;
    });
  }
  /// Adds node, drive error and values that the axes report to a fault. `expected`: torques after the lag of
  /// TorqueFeedbackCheck, N m at the joints.
  void add_details(const Torques& expected, FaultRecord& f) const;

 private:
  /// Calls f(axis, place in the cycle) for every axis.
  template <class F>
  void for_each_axis(const F& f) const {
    std::visit(
        [&](const auto& c) {
          for (std::size_t i = 0; i < nodes_.size(); ++i) f(c.axis(static_cast<int>(i)), i);
        },
        cycle_);
  }
  /// "node 1, node 2 (silent)": the motors of which `remark(axis)` is not null, with it.
  template <class Remark>
  [[nodiscard]] std::string motors(const Remark& remark) const {
    std::string out;
    for_each_axis([&](const auto& a, std::size_t i) {
      const char* text = motor_[i] ? remark(a) : nullptr;
      if (text != nullptr) out += fmt::format("{}node {}{}", out.empty() ? "" : ", ", nodes_[i], text);
    });
    return out;
  }
  template <class Axis>
  [[nodiscard]] std::string reported(const Axis& a, bool motor) const;
  /// Adds what axis i knows of the fault.
  template <class Axis>
  void add_details(const Axis& a, std::size_t i, const Torques& expected, FaultRecord& f) const;
  [[nodiscard]] std::string endpoint_path(std::uint16_t id) const;

  const Scene& scene_;
  const AnyCycle<C>& cycle_;
  std::vector<int> nodes_;   // per axis
  std::vector<bool> motor_;  // per axis
};

}  // namespace esmc::host
