#pragma once
/// Random numbers that are the same everywhere for one seed.

#include <cmath>
#include <cstdint>
#include <random>

namespace esmc::host {

/// Numbers of independent streams of one seed. Streams of Normal: the joint for sensors, 1000 for actuators.
enum class Stream : std::uint64_t { bus_loss = 2000, bus_duplication, bus_corruption, babbling_node };

/// Draws uniform numbers in [0, 1), in steps of 2^-53.
class Uniform {
 public:
  Uniform(std::uint64_t seed, Stream stream)
      : bits_(seed * 0x9E3779B97F4A7C15ULL + static_cast<std::uint64_t>(stream)) {}
  [[nodiscard]] double operator()() { return static_cast<double>(bits_() >> 11U) * 0x1p-53; }  ///< draws
  /// Draws a uniform integer in 0 .. n - 1; n = 0 gives 0.
  [[nodiscard]] std::uint32_t below(std::uint32_t n) { return static_cast<std::uint32_t>((*this)() * n); }

 private:
  std::mt19937_64 bits_;
};

/// Draws numbers of N(0, 1) by Box and Muller: the standard does not fix the bits of its normal distribution.
class Normal {
 public:
  /// `stream`: number of the stream; streams of one seed are independent.
  Normal(std::uint64_t seed, std::uint64_t stream) : bits_(seed * 0x9E3779B97F4A7C15ULL + stream) {}

  [[nodiscard]] double operator()() {
    if (spare_) {
      spare_ = false;
      return kept_;
    }
    const double u = (static_cast<double>(bits_() >> 11U) + 0.5) * 0x1p-53,
                 v = static_cast<double>(bits_() >> 11U) * 0x1p-53;
    const double r = std::sqrt(-2.0 * std::log(u)), a = 6.283185307179586 * v;
    kept_ = r * std::sin(a);
    spare_ = true;
    return r * std::cos(a);
  }

 private:
  std::mt19937_64 bits_;
  double kept_ = 0.0;
  bool spare_ = false;
};

}  // namespace esmc::host
