#pragma once
/// The table of parameters: readable by the supervisor computer, gains writable.

#include <array>
#include <bit>
#include <cstdint>

#include "firmware/link/codec.hpp"

namespace esmc::link {

/// Index in the table, as sent: append only. Gains apply to every channel of their kind.
enum class Index : std::uint8_t {
  lambda_position = 0,  ///< 1/s
  lambda_angle = 1,     ///< 1/s
  gain_position = 2,    ///< m/s2
  gain_angle = 3,       ///< rad/s2
  sample_time = 4,      ///< s
  torque_limit_1 = 5,   ///< N m, first base joint
  torque_limit_2 = 6,   ///< N m, second base joint
  joint_speed = 7,      ///< rad/s, limit of the base joints
  speed = 8,            ///< m/s or rad/s, of set points
  acceleration = 9,     ///< m/s2 or rad/s2
  stream_age = 10,      ///< ticks without a sample after which a stream is lost
  silence = 11,  ///< ticks without a sign of life after which the supervisor computer is lost; 0: never
};
inline constexpr std::uint8_t parameter_count = static_cast<std::uint8_t>(Index::silence) + 1;
inline constexpr std::uint8_t gain_count = 4;  ///< the first ones; only these can be written

/// Closed interval of a writable gain.
struct Bounds {
  float lower = 0, upper = 0;
};
using Gains = std::array<float, gain_count>;  ///< in the order and units of Index

/// Values of the table, bounds of the gains, and the checksum of the values.
class Parameters {
 public:
  using Values = std::array<float, parameter_count>;

  /// All values 0, no gain writable.
  Parameters() { sum(); }
  /// A gain whose upper bound is not above its lower one cannot be written.
  Parameters(const Values& values, const std::array<Bounds, gain_count>& bounds)
      : values_(values), bounds_(bounds) {
    sum();
  }

  [[nodiscard]] float operator[](Index i) const { return values_[static_cast<unsigned>(i)]; }
  [[nodiscard]] float at(std::uint8_t i) const {
    return values_[i];
  }                                                               ///< value i < parameter_count, not checked
  [[nodiscard]] const Values& values() const { return values_; }  ///< in the order of Index
  [[nodiscard]] const std::array<Bounds, gain_count>& bounds() const { return bounds_; }  ///< of each gain
  /// True for a gain whose upper bound is above its lower one; false for any other index.
  [[nodiscard]] bool writable(std::uint8_t i) const {
    return i < gain_count && bounds_[i].upper > bounds_[i].lower;
  }

  /// Sets parameter i. The first of unknown_index, read_only, not_now (not `disabled`), out_of_bounds (a NaN
  /// too) that applies is returned, without effect; else ok.
  Answer write(std::uint8_t i, float value, bool disabled) {
    if (i >= parameter_count) return Answer::unknown_index;
    if (!writable(i)) return Answer::read_only;
    if (!disabled) return Answer::not_now;
    if (!(value >= bounds_[i].lower && value <= bounds_[i].upper)) return Answer::out_of_bounds;
    values_[i] = value;
    sum();
    return Answer::ok;
  }

  [[nodiscard]] Gains gains() const { return {values_[0], values_[1], values_[2], values_[3]}; }
  /// True if the writable gains are within their bounds and the others equal the present ones, bit by bit.
  [[nodiscard]] bool acceptable(const Gains& g) const {
    bool good = true;
    for (std::uint8_t i = 0; i < gain_count; ++i) {
      good = good &&
             (writable(i) ? g[i] >= bounds_[i].lower && g[i] <= bounds_[i].upper
                          : std::bit_cast<std::uint32_t>(g[i]) == std::bit_cast<std::uint32_t>(values_[i]));
    }
    return good;
  }
  /// Takes all gains and returns true if they are acceptable(); else false, and nothing changes.
  bool restore(const Gains& g) {
    if (!acceptable(g)) return false;
    for (unsigned i = 0; i < gain_count; ++i) values_[i] = g[i];
    sum();
    return true;
  }

  /// CRC-32/ISO-HDLC over the present values (binary32, little endian) in the order of their indices.
  [[nodiscard]] std::uint32_t crc() const { return crc_; }

 private:
  void sum() {
    std::uint32_t c = crc32_start;
    for (const float v : values_) {
      const auto word = std::bit_cast<std::uint32_t>(v);
      for (unsigned i = 0; i < 4; ++i) c = crc32_add(c, static_cast<std::uint8_t>(word >> (8U * i)));
    }
    crc_ = ~c;
  }

  Values values_{};
  std::array<Bounds, gain_count> bounds_{};
  std::uint32_t crc_ = 0;
};

}  // namespace esmc::link
