#pragma once
/// The bus of an episode, with faults, in lockstep with its ticks: frames of a tick arrive within it, one
/// after the other.

#include <cstddef>
#include <cstdint>
#include <deque>
#include <utility>
#include <vector>

#include "hal/can.hpp"
#include "host_sim/campaign/injections.hpp"

namespace esmc::host {

class FaultyBus {
 public:
  /// `nodes` of the drives, motors first; all references outlive the bus. `bitrate`: bit/s; `fast_bit`: time
  /// of a bit of CAN FD data, in bit times.
  FaultyBus(const Injection& injection, const ProtocolTraits& traits, const std::vector<int>& nodes,
            double bitrate = 1e6, double fast_bit = 1.0)
      : injection_(&injection),
        traits_(&traits),
        nodes_(&nodes),
        draw_(injection.bits),
        bits_per_ms_(bitrate / 1e3),
        fast_bit_(fast_bit) {}

  /// Begins a tick. `active`: the fault acts in this tick.
  void begin_tick(bool active);

  /// A frame of drive `axis` (in the order of `nodes`), which the acting fault may lose, delay or change.
  void from_drive(std::size_t axis, const hal::CanFrame& f);
  /// A frame of the supervisor computer, which no fault of the bus loses or delays.
  void from_computer(const hal::CanFrame& f) { orders_.push_back(f); }
  /// A frame of another node, which the controller and the drives receive.
  void from_stranger(const hal::CanFrame& f);
  /// Brings delayed frames and the flood of other nodes; call in each tick after the drives' frames.
  void inject_foreign_frames();
  /// Brings what other nodes send after the tick, if that fault acts: an emergency stop, or `foreign`.
  void inject_foreign_frames_after_tick(const hal::CanFrame& foreign);

  /// The controller's access; satisfies hal::CanBus.
  [[nodiscard]] hal::SendStatus try_send(const hal::CanFrame& f);
  [[nodiscard]] bool try_receive(hal::CanFrame& f);

  /// A frame to the drives in this tick.
  struct Delivery {
    hal::CanFrame frame;
    double ms;  ///< after the beginning of the tick
    bool ours;  ///< from the controller under test
  };
  [[nodiscard]] const std::vector<Delivery>& to_drives() const { return to_drives_; }
  /// Removes the frames that the drives have received.
  void taken() { to_drives_.clear(); }
  /// Whether a drive receives frames now.
  [[nodiscard]] bool hears(std::size_t axis) const {
    return !(active_ && injection_->kind() == Injected::drive_bus_off && axis == injection_->drive);
  }

 private:
  [[nodiscard]] int node() const { return (*nodes_)[injection_->drive]; }  ///< of the afflicted drive
  void up(const hal::CanFrame& f) { to_controller_.push_back(f); }
  void faulty(const hal::CanFrame& f);
  hal::CanFrame mangled(hal::CanFrame f);

  const Injection* injection_;
  const ProtocolTraits* traits_;
  const std::vector<int>* nodes_;
  Draw draw_;
  double bits_per_ms_, fast_bit_;
  bool active_ = false;
  std::uint64_t tick_ = 0;
  double ms_ = 0.0;
  std::deque<hal::CanFrame> orders_, to_controller_;
  std::vector<Delivery> to_drives_;
  std::deque<std::pair<std::uint64_t, hal::CanFrame>> late_;  ///< tick in which it is due; frame
};

}  // namespace esmc::host
