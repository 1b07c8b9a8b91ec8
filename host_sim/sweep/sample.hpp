#pragma once
/// The cases of a sweep. Every number is a function of seed, axis and case alone, so that the result does not
/// depend on threads and processes.

#include <cstdint>
#include <vector>

#include "host_sim/names.hpp"

namespace esmc::host {

enum class Sampling { grid, random, latin_hypercube };
template <>
inline constexpr auto names_of<Sampling> = std::array{"grid", "random", "latin_hypercube"};

/// What one key of the scene goes through.
struct Axis {
  std::uint64_t listed = 0;  ///< number of listed values; 0: a range
  double from = 0.0, to = 0.0;
  bool logarithmic = false;
  std::uint64_t steps = 0;  ///< of a range that is crossed: points, both ends among them
  bool crossed = false;     ///< every value with every sample; the others are sampled
  bool in_order = false;    ///< case i takes listed value i

  [[nodiscard]] std::uint64_t points() const { return listed > 0 ? listed : steps; }  ///< if crossed
  /// Value of the range at u in [0, 1]; equal steps of u are equal steps or, if logarithmic, equal factors.
  [[nodiscard]] double at(double u) const;
};

/// 64 random bits, a function of its arguments (SplitMix64 at a random place of its sequence).
[[nodiscard]] std::uint64_t random_bits(std::uint64_t seed, std::uint64_t stream, std::uint64_t index);

inline constexpr std::uint64_t noise_stream = 0x4000'0000'0000'0000ULL;  ///< apart from those of axes

/// Element `index` of a random permutation of 0 .. size - 1: a Feistel network, repeated until in range.
[[nodiscard]] std::uint64_t permuted(std::uint64_t seed, std::uint64_t stream, std::uint64_t index,
                                     std::uint64_t size);

/// `samples` cases of the sampled axes at every point of the grid of crossed ones, the same samples at each;
/// the last crossed axis changes fastest.
class Design {
 public:
  static constexpr std::uint64_t most_cases = 10'000'000;

  Design() = default;
  /// `samples` >= 1; 1 for a grid.
  Design(Sampling method, std::uint64_t samples, std::uint64_t seed, std::vector<Axis> axes);

  /// Number of cases; 0 where it would exceed most_cases.
  [[nodiscard]] std::uint64_t cases() const { return cases_; }
  [[nodiscard]] std::uint64_t samples() const { return samples_; }  ///< per point of the grid
  [[nodiscard]] const std::vector<Axis>& axes() const { return axes_; }
  /// Place, 0 .. listed - 1, of the value of a listed axis in case `index`. Not checked: index < cases().
  [[nodiscard]] std::uint64_t chosen(std::uint64_t index, std::size_t axis) const;
  /// Value of a range axis in case `index`.
  [[nodiscard]] double value(std::uint64_t index, std::size_t axis) const;

 private:
  [[nodiscard]] std::uint64_t crossed_point(std::uint64_t index, std::size_t axis) const;
  /// Place of the sample of case `index` on a sampled axis, in [0, 1); the same at every point of the grid.
  [[nodiscard]] double sampled(std::uint64_t index, std::size_t axis) const;

  Sampling method_ = Sampling::grid;
  std::uint64_t samples_ = 1, seed_ = 1, cases_ = 0;
  std::vector<Axis> axes_;
  std::vector<std::uint64_t> stride_;  ///< of crossed axes, in points of the grid
};

}  // namespace esmc::host
