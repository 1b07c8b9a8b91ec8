#pragma once
/// Properties of a drive protocol for the campaign: kinds of frames, and frames of foreign nodes. A null
/// entry: the protocol has none.

#include <cstddef>
#include <cstdint>
#include <vector>

#include "hal/can.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

struct ProtocolTraits {
  using Frame = hal::CanFrame;
  // Frames of a drive: with angle or speed; heartbeat. Of a controller: torque command.
  bool (*is_sample)(const Frame&, int node);
  bool (*is_heartbeat)(const Frame&, int node) = nullptr;
  bool (*is_torque)(const Frame&, int node);
  std::uint8_t (*wrong_size)(const Frame& sample, std::uint64_t any);  ///< a size that no sample has
  void (*put_number)(Frame&, int which, float value) = nullptr;        ///< overwrites angle (0) or speed (1)
  void (*put_end)(Frame&, unsigned choice) = nullptr;  ///< sets a number of a sample to an end of its range
  std::vector<Frame> (*disarm)(int node);              ///< takes the drive out of torque control
  std::vector<Frame> (*fail)(int node) = nullptr;      ///< puts the drive into an error
  Frame (*emergency_stop)(int node) = nullptr;
  Frame (*foreign_torque)(const Scene&, std::size_t motor, double joint_torque);
  /// Another command that only a controller sends.
  Frame (*foreign_command)(int node, unsigned choice);
  /// Resolution of a torque command, N m at the joint; 0: a float.
  double (*torque_step)(const Scene&, std::size_t motor);
  bool zero_is_a_step = true;   ///< false: the torques next to zero are half a step away from it
  bool tells_its_state = true;  ///< drives report when they leave torque control
  int ticks_to_let_go = 0;      ///< additional ticks from the disarm command to the end of torque control
  /// The controller's frame that feeds the watchdogs; null: a command to the drive.
  bool (*is_sign_of_life)(const Scene&, const Frame&) = nullptr;
  /// A torque command alone brings a stopped drive into torque control: another controller's torque acts as
  /// long as it sends.
  bool torque_arms = false;
  bool samples_on_demand = false;  ///< drives send a sample when the controller requests it
  bool remote_is_nothing = false;  ///< a remote frame with the identifier of a sample is ignored
};

[[nodiscard]] const ProtocolTraits& protocol_traits(Protocol p);

}  // namespace esmc::host
