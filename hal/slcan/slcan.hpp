#pragma once
/// slcan: classic CAN frames as lines of text on a serial line, the protocol of LAWICEL's and most USB
/// adapters. Standard library only; no heap, no operating system, bounded work per call.

#include <algorithm>
#include <array>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <span>

#include "hal/can.hpp"

namespace esmc::hal {

/// Longest line: kind, 29-bit identifier, length, 8 bytes, time stamp, CR.
inline constexpr int slcan_line_max = 1 + 8 + 1 + 16 + 4 + 1;
inline constexpr char slcan_end = '\r';    ///< ends every line; alone: an adapter's positive answer
inline constexpr char slcan_error = '\a';  ///< an adapter's negative answer, without CR

/// Writes the line of a classic frame with its CR, upper case, and returns its length, 6..27; 0, `line`
/// untouched, for an FD frame or one not well formed. t, T: data; r, R: remote; capitals: 29-bit identifier.
[[nodiscard]] constexpr int slcan_encode(const CanFrame& f, std::array<char, slcan_line_max>& line) {
  if (!well_formed(f) || f.fd || f.bit_rate_switch) return 0;
  int length = 0;
  const auto put = [&](char c) { line[static_cast<std::size_t>(length++)] = c; };
  const auto put_hex = [&](std::uint32_t value, int digits) {
    for (int shift = 4 * (digits - 1); shift >= 0; shift -= 4) {
      const std::uint32_t v = (value >> static_cast<unsigned>(shift)) & 0xFU;
      put(static_cast<char>(v < 10U ? '0' + static_cast<int>(v) : 'A' + static_cast<int>(v) - 10));
    }
  };
  put(f.remote ? (f.extended ? 'R' : 'r') : (f.extended ? 'T' : 't'));
  put_hex(f.id, f.extended ? 8 : 3);
  put_hex(f.size, 1);
  if (!f.remote) {
    for (const std::uint8_t byte : f.payload()) put_hex(byte, 2);
  }
  put(slcan_end);
  return length;
}

/// Reads a number of 1 to 8 hexadecimal digits, either case. False, `out` untouched: anything else.
[[nodiscard]] constexpr bool slcan_hex(std::span<const char> digits, std::uint32_t& out) {
  if (digits.empty() || digits.size() > 8) return false;
  std::uint32_t value = 0;
  for (const char c : digits) {
    const int letter = c | 0x20;  // lower case
    const bool decimal = c >= '0' && c <= '9';
    if (!decimal && !(letter >= 'a' && letter <= 'f')) return false;
    const auto v = static_cast<std::uint32_t>(decimal ? c - '0' : letter - 'a' + 10);
    value = (value << 4U) | v;
  }
  out = value;
  return true;
}

/// Reads a line without its CR as a frame. False, `out` untouched: identifier out of range, length above 8,
/// digits missing or left over. Four digits behind the data are a time stamp, checked and dropped.
[[nodiscard]] constexpr bool slcan_decode(std::span<const char> line, CanFrame& out) {
  if (line.empty()) return false;
  CanFrame f;
  f.remote = line[0] == 'r' || line[0] == 'R';
  f.extended = line[0] == 'T' || line[0] == 'R';
  if (!f.remote && !f.extended && line[0] != 't') return false;
  const std::size_t id_digits = f.extended ? 8 : 3, data_at = 1 + id_digits + 1;
  std::uint32_t size = 0, value = 0;
  if (line.size() < data_at || !slcan_hex(line.subspan(1, id_digits), f.id) ||
      !slcan_hex(line.subspan(1 + id_digits, 1), size)) {
    return false;
  }
  f.size = static_cast<std::uint8_t>(size);
  const std::size_t stamp_at = data_at + (f.remote ? 0U : 2U * size);
  const bool stamped = line.size() == stamp_at + 4;
  if (!well_formed(f) || (line.size() != stamp_at && !stamped)) return false;
  if (stamped && !slcan_hex(line.subspan(stamp_at, 4), value)) return false;
  for (std::size_t i = 0; data_at + 2 * i < stamp_at; ++i) {
    if (!slcan_hex(line.subspan(data_at + 2 * i, 2), value)) return false;
    f.data[i] = static_cast<std::uint8_t>(value);
  }
  out = f;
  return true;
}

/// Decoder of a stream of bytes into frames. A line that is no frame, as an answer of the other end, is
/// skipped up to its CR.
class SlcanDecoder {
 public:
  /// Takes a byte of the line. True: it completed the frame in `out`; false: `out` is untouched.
  [[nodiscard]] constexpr bool feed(char byte, CanFrame& out) {
    if (byte == slcan_error && length_ == 0) return false;
    if (byte != slcan_end) {
      // Of a line that is too long, the length alone is kept.
      if (length_ < line_.size()) line_[length_] = byte;
      length_ = std::min(length_ + 1, line_.size());
      return false;
    }
    const std::span<const char> line{line_.data(), length_};
    length_ = 0;
    return slcan_decode(line, out);
  }

 private:
  std::array<char, slcan_line_max> line_{};  // full without CR: longer than any frame
  std::size_t length_ = 0;
};

/// A serial port: try_write takes all bytes or none, try_read one byte if there is one. Neither call blocks.
template <class P>
concept BytePort = requires(P& p, std::span<const char> out, char& in) {
  { p.try_write(out) } -> std::same_as<bool>;  // all of it or nothing
  { p.try_read(in) } -> std::same_as<bool>;
};

/// A port that can be lost: gone() is true for good once an adapter is unplugged or a socket closed.
template <class P>
concept LosablePort = BytePort<P> && requires(const P& p) {
  { p.gone() } -> std::same_as<bool>;
};

/// A CanBus on a serial port, which must outlive it. The caller opens the adapter (command `O`).
template <BytePort P>
class SlcanBus {
 public:
  /// Most bytes that one try_receive reads: eight of the longest lines. Without a frame in them it returns
  /// false, and the next call continues.
  static constexpr int bytes_per_receive = 8 * slcan_line_max;

  explicit constexpr SlcanBus(P& port) : port_(&port) {}

  /// Sends f. bus_full: the port does not take it now; refused: no classic frame; bus_off: the port is gone.
  constexpr SendStatus try_send(const CanFrame& f) {
    std::array<char, slcan_line_max> line{};
    const int length = slcan_encode(f, line);
    if (length == 0) return SendStatus::refused;
    if constexpr (LosablePort<P>) {
      if (port_->gone()) return SendStatus::bus_off;
    }
    const bool taken = port_->try_write(std::span<const char>{line.data(), static_cast<std::size_t>(length)});
    if constexpr (LosablePort<P>) {
      if (!taken && port_->gone()) return SendStatus::bus_off;
    }
    return taken ? SendStatus::ok : SendStatus::bus_full;
  }

  /// Takes the next frame. False: none among the available bytes; `f` untouched.
  [[nodiscard]] constexpr bool try_receive(CanFrame& f) {
    char byte = 0;
    for (int n = 0; n < bytes_per_receive && port_->try_read(byte); ++n) {
      if (decoder_.feed(byte, f)) return true;
    }
    return false;
  }

 private:
  P* port_;
  SlcanDecoder decoder_;
};

}  // namespace esmc::hal
