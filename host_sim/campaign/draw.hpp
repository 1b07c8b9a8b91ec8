#pragma once
/// Random numbers of an episode: a function of its seed, the same on every machine.

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace esmc::host {

/// SplitMix64: neighbouring seeds give unrelated streams.
class Draw {
 public:
  explicit Draw(std::uint64_t seed) : state_(seed) {}

  std::uint64_t bits() {
    state_ += 0x9E37'79B9'7F4A'7C15ULL;
    std::uint64_t z = state_;
    z = (z ^ (z >> 30U)) * 0xBF58'476D'1CE4'E5B9ULL;
    z = (z ^ (z >> 27U)) * 0x94D0'49BB'1331'11EBULL;
    return z ^ (z >> 31U);
  }
  /// Draws an integer in 0 .. n - 1; n > 0. The bias is below n / 2^64.
  std::uint64_t below(std::uint64_t n) { return bits() % n; }
  /// Draws an integer in lowest .. highest, both included; lowest <= highest.
  int between(int lowest, int highest) {
    return lowest + static_cast<int>(below(static_cast<std::uint64_t>(highest - lowest) + 1));
  }
  bool one_in(std::uint64_t n) { return below(n) == 0; }  ///< true with probability 1 / n; n > 0
  /// Draws a number in [0, 1), or in [lowest, highest).
  double uniform() { return static_cast<double>(bits() >> 11U) * 0x1p-53; }
  double uniform(double lowest, double highest) { return lowest + (highest - lowest) * uniform(); }
  /// Draws a number of a magnitude in lowest .. highest, both > 0, of either sign and each power of two
  /// equally often; without library functions whose last bit may differ.
  double signed_magnitude(double lowest, double highest) {
    const double size = std::ldexp(1.0 + uniform(), between(std::ilogb(lowest), std::ilogb(highest)));
    return (one_in(2) ? 1.0 : -1.0) * std::clamp(size, lowest, highest);
  }

 private:
  std::uint64_t state_;
};

}  // namespace esmc::host
