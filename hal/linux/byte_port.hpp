#pragma once
/// A serial line of Linux as a BytePort: a tty, or a stream socket in its place.

#include <array>
#include <cstddef>
#include <span>
#include <string>

#include "hal/linux/descriptor.hpp"
#include "hal/slcan/slcan.hpp"

namespace esmc::hal {

/// A serial line that never blocks once it is open. After end of file or hang-up it stays gone().
class SerialPort {
 public:
  /// Opens an endpoint: the path of a tty, optionally with `@BAUD` (default 115200; USB adapters ignore it),
  /// unix:PATH or tcp:HOST:PORT, which may take 5 s. A tty is locked and made raw, 8N1, without flow control.
  /// On failure is_open() is false and `why` is the reason; else `why` is empty.
  static SerialPort open(const std::string& endpoint, std::string& why);

  /// Adopts a non-blocking descriptor, which it closes: a socket pair in tests.
  explicit SerialPort(int fd) : SerialPort(Descriptor(fd)) {}
  SerialPort(SerialPort&&) noexcept = default;
  SerialPort& operator=(SerialPort&&) noexcept = default;
  SerialPort(const SerialPort&) = delete;
  SerialPort& operator=(const SerialPort&) = delete;
  /// Drops unsent bytes.
  ~SerialPort();

  [[nodiscard]] bool is_open() const { return fd_.is_open(); }
  [[nodiscard]] int descriptor() const { return fd_.get(); }  ///< for poll(); -1: not open

  /// True: all of `out` (up to 64 bytes) is taken, of which a rest may wait for flush(). False: nothing is.
  [[nodiscard]] bool try_write(std::span<const char> out);
  [[nodiscard]] bool try_read(char& in);             ///< next byte; false: none, `in` untouched
  [[nodiscard]] bool gone() const { return gone_; }  ///< lost for good: hang-up, error

  /// True if bytes have been read ahead, of which a poll of the descriptor does not know.
  [[nodiscard]] bool has_input() const { return next_ < filled_; }
  /// True if a rest waits for flush(), once the descriptor is writable.
  [[nodiscard]] bool has_output() const { return sent_ < unsent_; }
  void flush();  ///< writes as much of the rest as the line takes, without waiting

 private:
  explicit SerialPort(Descriptor fd);
  /// Returns the number of bytes that the system took.
  std::size_t write_some(std::span<const char> out);

  Descriptor fd_;
  bool socket_ = false, gone_ = false;
  std::array<char, 64> rest_{};
  std::size_t sent_ = 0, unsent_ = 0;
  std::array<char, 1024> input_{};
  std::size_t next_ = 0, filled_ = 0;
};

static_assert(LosablePort<SerialPort>);

/// The digit, 0..8, of slcan's command S for exactly this bit rate, bit/s (8: 1 Mbit/s); -1: there is none.
[[nodiscard]] int slcan_speed(int bits_per_second);

/// An adapter on a serial line; its CAN channel is open from constructor to destructor. It reports neither
/// times nor bus errors: bus_off means that the port is gone.
class SlcanAdapter {
 public:
  /// Opens the CAN channel. `speed`: from slcan_speed(), 0..8, not checked.
  SlcanAdapter(SerialPort port, int speed);
  SlcanAdapter(const SlcanAdapter&) = delete;
  SlcanAdapter& operator=(const SlcanAdapter&) = delete;
  ~SlcanAdapter();

  [[nodiscard]] SerialPort& port() { return port_; }                           ///< the serial line
  SendStatus try_send(const CanFrame& f) { return bus_.try_send(f); }          ///< see SlcanBus
  [[nodiscard]] bool try_receive(CanFrame& f) { return bus_.try_receive(f); }  ///< see SlcanBus

 private:
  void command(std::span<const char> line);

  SerialPort port_;
  SlcanBus<SerialPort> bus_{port_};
};

static_assert(CanBus<SlcanAdapter>);

}  // namespace esmc::hal
