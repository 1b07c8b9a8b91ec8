#pragma once
/// What a campaign has to know of a drive protocol: which frame is which, and the frames strangers send. One
/// table per protocol; a null entry: it has no such thing.

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "hal/can.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

/// A frame or two.
struct FewFrames {
  std::array<hal::CanFrame, 2> frame{};
  std::size_t count = 1;
  [[nodiscard]] std::span<const hal::CanFrame> all() const { return {frame.data(), count}; }
};

struct ProtocolTraits {
  using Frame = hal::CanFrame;
  bool (*is_sample)(const Frame&, int node);  ///< of the frames of a drive, one with angle or speed
  bool (*is_heartbeat)(const Frame&, int node);
  bool (*is_torque)(const Frame&,
                    int node);  ///< of the frames of a controller, the torque command of a drive
  std::uint8_t (*wrong_size)(const Frame& sample, std::uint64_t any);  ///< that a sample never has
  /// Overwrites the angle (0) or the speed (1) in a sample; null: the format carries no such number.
  void (*put_number)(Frame&, int which, float value);
  /// Sets a number of a sample to an end of its range; null: floats have none.
  void (*put_end)(Frame&, unsigned choice);
  FewFrames (*disarm)(int node);      ///< takes the drive out of torque control
  FewFrames (*fail)(int node);        ///< puts the drive into an error
  Frame (*emergency_stop)(int node);  ///< from anybody, heard by all
  Frame (*foreign_torque)(const Scene&, std::size_t motor, double joint_torque);
  /// Other commands that only a controller sends; `choice` any number.
  Frame (*foreign_command)(int node, unsigned choice);
  /// N m at the joint between two torques that a command can say next to each other; 0: no such steps.
  double (*torque_step)(const Scene&, std::size_t motor);
  bool zero_is_a_step;   ///< false: the torques next to zero are half a step away from it
  bool tells_its_state;  ///< false: a drive that lets go of its motor says nothing of it
  int ticks_to_let_go;   ///< more, until a drive that is told to let go of its motor has done so
  /// Of the frames of a controller, the one that its watchdog watches, and that may be for all drives; null:
  /// a command to it.
  bool (*is_sign_of_life)(const Scene&, const Frame&);
  bool samples_on_demand;  ///< a request of the controller asks for the next sample
  bool remote_is_nothing;  ///< a remote frame with the identifier of a sample is nobody's
};

[[nodiscard]] const ProtocolTraits& dialect(Protocol p);

}  // namespace esmc::host
