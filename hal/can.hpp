#pragma once
/// CAN frames, and the interface of a CAN controller.

#include <array>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>

/// Interfaces of the hardware, and back ends.
namespace esmc::hal {

inline constexpr std::uint8_t can_classic_size_max = 8;
inline constexpr std::uint8_t can_fd_size_max = 64;

/// One CAN or CAN FD data frame, or a classic remote frame (RTR).
struct CanFrame {
  std::uint32_t id = 0;          ///< 11 or 29 identifier bits only; flags live in the fields below
  bool extended = false;         ///< 29-bit identifier
  bool remote = false;           ///< classic remote transmission request: carries a size, no data
  bool fd = false;               ///< CAN FD format: up to 64 bytes
  bool bit_rate_switch = false;  ///< FD data phase at the fast bit rate
  bool perishable = false;       ///< worthless after its tick: may be dropped then. Not sent, not compared
  std::uint8_t size = 0;         ///< bytes used in `data`: 0..8, or 0..64 with `fd`
  alignas(4) std::array<std::uint8_t, can_fd_size_max> data{};

  /// The used bytes of data. `size` is not checked.
  [[nodiscard]] constexpr std::span<const std::uint8_t> payload() const { return {data.data(), size}; }
  friend constexpr bool operator==(const CanFrame& a, const CanFrame& b) {
    if (a.id != b.id || a.extended != b.extended || a.remote != b.remote || a.fd != b.fd ||
        a.bit_rate_switch != b.bit_rate_switch || a.size != b.size) {
      return false;
    }
    for (std::uint8_t i = 0; i < a.size && i < can_fd_size_max; ++i) {
      if (a.data[i] != b.data[i]) return false;
    }
    return true;
  }
};

/// Bytes of a CAN FD frame by its data length code; a classic frame has 8 at most.
inline constexpr std::array<std::uint8_t, 16> can_fd_sizes{0, 1,  2,  3,  4,  5,  6,  7,
                                                           8, 12, 16, 20, 24, 32, 48, 64};
/// The smallest code whose frame holds `bytes`, at most 64.
[[nodiscard]] constexpr std::uint32_t can_fd_code(std::uint8_t bytes) {
  std::uint32_t code = 0;
  while (code < 15 && can_fd_sizes[code] < bytes) ++code;
  return code;
}
/// The smallest size of a CAN FD frame that holds `bytes`, at most 64.
[[nodiscard]] constexpr std::uint8_t can_fd_size(std::uint8_t bytes) {
  return can_fd_sizes[can_fd_code(bytes)];
}

/// Copies a frame: all fields, of data at least the used bytes, and always 8, which costs no loop.
inline void copy_used(const CanFrame& from, CanFrame& to) {
  if (from.size > can_classic_size_max) {
    to = from;
    return;
  }
  std::memcpy(static_cast<void*>(&to), &from, offsetof(CanFrame, data) + can_classic_size_max);
}

/// True for a frame that a controller may put on the wire: identifier in range, size allowed by its format.
[[nodiscard]] constexpr bool well_formed(const CanFrame& f) {
  const std::uint32_t id_max = f.extended ? 0x1FFF'FFFFU : 0x7FFU;
  const std::uint8_t size_max = f.fd ? can_fd_size_max : can_classic_size_max;
  return f.id <= id_max && f.size <= size_max && !(f.fd && f.remote);
}

/// The arbitration field of a well-formed frame as a number: the smallest wins the bus. Frames of two nodes
/// with the same number collide.
[[nodiscard]] constexpr std::uint32_t arbitration(const CanFrame& f) {
  const std::uint32_t remote = f.remote ? 1 : 0;
  if (!f.extended) return (f.id << 21U) | (remote << 20U);
  return ((f.id >> 18U) << 21U) | (3U << 19U) | ((f.id & 0x3'FFFFU) << 1U) | remote;
}

/// Classic data frame with an 11-bit identifier and `size` bytes 0; neither is checked.
[[nodiscard]] constexpr CanFrame data_frame(std::uint32_t id, std::uint8_t size) {
  CanFrame f;
  f.id = id;
  f.size = size;
  return f;
}
/// Writes the low `bytes` (1..4) of `value` into the data of a frame, little-endian, from byte `at` on. Not
/// checked: at + bytes <= 64. `size` stays.
constexpr void put_field(CanFrame& f, std::size_t at, std::uint32_t value, std::size_t bytes) {
  for (std::size_t i = 0; i < bytes; ++i) f.data[at + i] = static_cast<std::uint8_t>(value >> (8U * i));
}
/// The number in `bytes` (1..4) bytes of data from `at` on, little-endian. Not checked: at + bytes <= 64.
[[nodiscard]] constexpr std::uint32_t get_field(const CanFrame& f, std::size_t at, std::size_t bytes) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < bytes; ++i) value |= std::uint32_t{f.data[at + i]} << (8U * i);
  return value;
}

/// Result of sending a frame.
enum class [[nodiscard]] SendStatus : std::uint8_t{
    ok,
    bus_full,  ///< transient: not queued; the next tick sends a newer frame
    bus_off,   ///< persistent: the controller has left the bus; drives must be disarmed
    refused,   ///< not well formed: a bug in the caller
};

/// A CAN controller: try_send queues a frame, try_receive takes the oldest received. No call blocks.
template <class B>
concept CanBus = requires(B& bus, const CanFrame& out, CanFrame& in) {
  { bus.try_send(out) } -> std::same_as<SendStatus>;
  // false: no frame, `in` untouched; true: every field is set, of `data` the first `size` bytes
  { bus.try_receive(in) } -> std::same_as<bool>;
};

/// A CanBus that has the arrival times of frames: frame_age_us() of the last received, us; 0: not known.
template <class B>
concept TimesFrames = CanBus<B> && requires(const B& bus) {
  { bus.frame_age_us() } -> std::same_as<std::uint32_t>;  // of the frame received last; 0: not known
};

}  // namespace esmc::hal
