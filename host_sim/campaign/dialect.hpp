#pragma once
/// What a campaign has to know of a drive protocol: which frame is which, and the frames strangers send. One
/// table per protocol; a null entry: it has no such thing.

#include <cstdint>

#include "hal/can.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

struct Dialect {
  using Frame = hal::CanFrame;
  bool (*is_sample)(const Frame&, int node);  ///< the frame with angle and speed
  bool (*is_heartbeat)(const Frame&, int node);
  /// Overwrites the angle (0) or the speed (1) in a sample; null: the format carries no such number.
  void (*put_number)(Frame&, int which, float value);
  Frame (*disarm)(int node);          ///< takes the drive out of torque control
  Frame (*fail)(int node);            ///< puts the drive into an error
  Frame (*emergency_stop)(int node);  ///< from anybody, heard by all
  Frame (*foreign_torque)(int node, float shaft_torque);
  /// Other commands that only a controller sends; `choice` any number.
  Frame (*foreign_command)(int node, int choice);
};

[[nodiscard]] const Dialect& dialect(Protocol p);

}  // namespace esmc::host
