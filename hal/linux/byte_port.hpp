#pragma once
/// A serial line of Linux as a BytePort: a tty, or a stream socket that stands for one.

#include <array>
#include <cstddef>
#include <span>
#include <string>
#include <utility>

#include "hal/slcan/slcan.hpp"

namespace esmc::hal {

/// Never blocks once it is open. When the other end is gone (end of file, hang-up) it stays so.
class SerialPort {
 public:
  /// ENDPOINT: the path of a tty, with `@BAUD` behind it where the speed matters (default 115200; an adapter
  /// on USB ignores it), unix:PATH or tcp:HOST:PORT, for which it waits 5 s at most. A tty is locked and made
  /// raw, 8N1, without flow control. On failure is_open() is false and `why` says why; else `why` is empty.
  static SerialPort open(const std::string& endpoint, std::string& why);

  /// Adopts a descriptor that does not block; the tests use a socket pair.
  explicit SerialPort(int fd);
  SerialPort(SerialPort&& other) noexcept { *this = std::move(other); }
  SerialPort& operator=(SerialPort&& other) noexcept;
  SerialPort(const SerialPort&) = delete;
  SerialPort& operator=(const SerialPort&) = delete;
  /// What is still unsent is dropped.
  ~SerialPort();

  [[nodiscard]] bool is_open() const { return fd_ >= 0; }
  [[nodiscard]] int descriptor() const { return fd_; }

  /// All of it or nothing, `out` up to 64 bytes: a rest that the line does not take at once goes out before
  /// the next.
  [[nodiscard]] bool try_write(std::span<const char> out);
  [[nodiscard]] bool try_read(char& in);
  [[nodiscard]] bool gone() const { return gone_; }

  /// Bytes that have been read from the system and wait here: nobody who polls the descriptor hears of them.
  [[nodiscard]] bool has_input() const { return next_ < filled_; }
  /// A rest to be sent, by flush() once the descriptor is writable.
  [[nodiscard]] bool has_output() const { return sent_ < unsent_; }
  void flush();

 private:
  /// Bytes that the system took.
  std::size_t write_some(std::span<const char> out);

  int fd_ = -1;
  bool socket_ = false, gone_ = false;
  std::array<char, 64> rest_{};
  std::size_t sent_ = 0, unsent_ = 0;
  std::array<char, 1024> input_{};
  std::size_t next_ = 0, filled_ = 0;
};

static_assert(LosablePort<SerialPort>);

/// The digit of slcan's command for a bit rate, bit/s (S8 is 1 Mbit/s); -1 where it has none.
[[nodiscard]] int slcan_speed(int bits_per_second);

/// An adapter on a serial line, with its CAN channel open from the constructor to the destructor. It says no
/// times and takes no errors in: bus_off is the port's end.
class SlcanAdapter {
 public:
  /// `speed`: of slcan_speed().
  SlcanAdapter(SerialPort port, int speed);
  SlcanAdapter(const SlcanAdapter&) = delete;
  SlcanAdapter& operator=(const SlcanAdapter&) = delete;
  ~SlcanAdapter();

  [[nodiscard]] SerialPort& port() { return port_; }
  [[nodiscard]] const SlcanDecoder& decoder() const { return bus_.decoder(); }
  SendStatus try_send(const CanFrame& f) { return bus_.try_send(f); }
  [[nodiscard]] bool try_receive(CanFrame& f) { return bus_.try_receive(f); }

 private:
  void command(std::span<const char> line);

  SerialPort port_;
  SlcanBus<SerialPort> bus_{port_};
};

static_assert(CanBus<SlcanAdapter>);

}  // namespace esmc::hal
