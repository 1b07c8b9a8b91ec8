#pragma once
/// SocketCAN: the Linux kernel's CAN as a CanBus. Non-blocking; classic and FD frames.

#include <cstdint>
#include <string>
#include <system_error>

#include "hal/can.hpp"
#include "hal/id_filters.hpp"
#include "hal/linux/descriptor.hpp"

namespace esmc::hal {

/// A CAN interface of Linux.
class SocketCan {
 public:
  /// Opens a raw socket on an interface ("can0", "vcan0"). On failure `error` is set (no_such_device,
  /// network_down, not_supported: a kernel without CAN, message_size: `fd` and a classic interface, ...) and
  /// is_open() is false.
  static SocketCan open(const std::string& interface, std::error_code& error, bool fd = false);

  /// Adopts a descriptor and closes it, with a canfd_frame or can_frame per packet: a socket pair in tests.
  explicit SocketCan(int fd) : fd_(fd) {}

  [[nodiscard]] bool is_open() const { return fd_.is_open(); }
  [[nodiscard]] int descriptor() const { return fd_.get(); }  ///< for poll(); -1: not open

  /// Lets the kernel drop the frames that `filters` does not match; an empty list passes all frames. False:
  /// the kernel refused, and the previous filters stay.
  [[nodiscard]] bool set_filters(const IdFilters& filters);

  /// Sends f. refused: not well formed, or FD on a classic bus; bus_off: for good, or interface down.
  [[nodiscard]] SendStatus try_send(const CanFrame& f);
  /// Takes the next frame; false: none. An error frame of bus-off makes try_send fail from then on.
  [[nodiscard]] bool try_receive(CanFrame& f);
  /// Waiting time of the frame received last, by the kernel's time stamp, us; 0 without a stamp.
  [[nodiscard]] std::uint32_t frame_age_us() const { return frame_age_us_; }

 private:
  Descriptor fd_;
  bool bus_off_ = false;
  std::uint32_t frame_age_us_ = 0;
};

static_assert(TimesFrames<SocketCan>);

}  // namespace esmc::hal
