#pragma once
/// Frames that all CANopen drives of a bus share: SYNC and the heartbeat of the controller.

#include <cstdint>

#include "firmware/drive/canopen.hpp"

namespace esmc::drive {

/// Sender of SYNC and of the heartbeat of the controller, once per bus; `send`: as for Drive.
class CanopenLine {
 public:
  CanopenLine() = default;
  /// `node`: ours, 1..127. `heartbeat_ticks`: between two heartbeats, > 0.
  CanopenLine(std::uint8_t node, std::uint32_t heartbeat_ticks)
      : node_(node), heartbeat_ticks_(heartbeat_ticks) {}

  /// Sends SYNC, on which every drive samples and reports.
  template <class Send>
  void request(Send&& send) {
    send(canopen::encode_sync());
  }
  /// Sends the heartbeat when due, only if `good` (no fault): without it drives stop. Call once per tick.
  template <class Send>
  void end_tick(Send&& send, bool good) {
    if (wait_ticks_ > 0) --wait_ticks_;
    if (!good || wait_ticks_ > 0) return;
    if (send(canopen::encode_heartbeat(node_, canopen::NmtState::operational)))
      wait_ticks_ = heartbeat_ticks_;
  }

 private:
  std::uint8_t node_ = 127;
  std::uint32_t heartbeat_ticks_ = 1;
  std::uint32_t wait_ticks_ = 0;
};

}  // namespace esmc::drive
