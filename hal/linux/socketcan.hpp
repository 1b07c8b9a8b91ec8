#pragma once
/// SocketCAN: the Linux kernel's CAN as a CanBus. Non-blocking; classic and FD frames.

#include <cstdint>
#include <string>
#include <system_error>

#include "hal/can.hpp"

namespace esmc::hal {

/// A CAN interface of Linux.
class SocketCan {
 public:
  /// Opens a raw socket on an interface ("can0", "vcan0"). On failure `error` says why and is_open() is
  /// false: no_such_device (no such interface), network_down, not_supported (this kernel has no CAN), ...
  static SocketCan open(const std::string& interface, std::error_code& error);

  /// Adopts a descriptor that carries struct canfd_frame or can_frame per packet; the tests use a socket
  /// pair.
  explicit SocketCan(int fd) : fd_(fd) {}
  SocketCan(SocketCan&& other) noexcept : fd_(other.fd_), bus_off_(other.bus_off_) { other.fd_ = -1; }
  SocketCan& operator=(SocketCan&& other) noexcept;
  SocketCan(const SocketCan&) = delete;
  SocketCan& operator=(const SocketCan&) = delete;
  ~SocketCan();

  [[nodiscard]] bool is_open() const { return fd_ >= 0; }
  [[nodiscard]] int descriptor() const { return fd_; }

  [[nodiscard]] SendStatus try_send(const CanFrame& f);
  /// Error frames are taken in: bus-off makes every later try_send say so until recover().
  [[nodiscard]] bool try_receive(CanFrame& f);
  /// How long the frame received last had been waiting, by the kernel's time stamp, us; 0 where there is
  /// none.
  [[nodiscard]] std::uint32_t frame_age_us() const { return frame_age_us_; }
  /// The controller has been restarted (ip link set ... up); an operator's decision, never automatic.
  void recover() { bus_off_ = false; }

 private:
  int fd_ = -1;
  bool bus_off_ = false;
  std::uint32_t frame_age_us_ = 0;
};

static_assert(TimesFrames<SocketCan>);

}  // namespace esmc::hal
