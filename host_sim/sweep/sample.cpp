#include "host_sim/sweep/sample.hpp"

#include <bit>
#include <cmath>
#include <utility>

namespace esmc::host {
namespace {

constexpr std::uint64_t golden = 0x9E3779B97F4A7C15ULL;

/// The output function of SplitMix64 (Steele, Lea, Flood 2014).
std::uint64_t mix(std::uint64_t z) {
  z = (z ^ (z >> 30U)) * 0xBF58476D1CE4E5B9ULL;
  z = (z ^ (z >> 27U)) * 0x94D049BB133111EBULL;
  return z ^ (z >> 31U);
}

/// In [0, 1), in steps of 2^-53.
double unit(std::uint64_t bits) { return static_cast<double>(bits >> 11U) * 0x1p-53; }

constexpr std::uint64_t permutations = 0x8000'0000'0000'0000ULL;  // streams apart from those of values

}  // namespace

double Axis::at(double u) const {
  if (u <= 0.0) return from;
  if (u >= 1.0) return to;
  return logarithmic ? from * std::pow(to / from, u) : from + (to - from) * u;
}

std::uint64_t random_bits(std::uint64_t seed, std::uint64_t stream, std::uint64_t index) {
  return mix(mix(mix(seed + golden) + stream * golden) + (index + 1) * golden);
}

std::uint64_t permuted(std::uint64_t seed, std::uint64_t stream, std::uint64_t index, std::uint64_t size) {
  if (size < 2) return 0;
  const unsigned half = (static_cast<unsigned>(std::bit_width(size - 1)) + 1U) / 2U;
  const std::uint64_t low = (std::uint64_t{1} << half) - 1U;
  constexpr std::uint64_t rounds = 6;
  do {  // at most four halves fit one size, so a few walks do
    std::uint64_t left = index >> half, right = index & low;
    for (std::uint64_t r = 0; r < rounds; ++r) {
      left ^= random_bits(seed, permutations + stream * rounds + r, right) & low;
      std::swap(left, right);
    }
    index = left << half | right;
  } while (index >= size);
  return index;
}

Design::Design(Sampling method, std::uint64_t samples, std::uint64_t seed, std::vector<Axis> axes)
    : method_(method), samples_(samples), seed_(seed), axes_(std::move(axes)), stride_(axes_.size(), 0) {
  std::uint64_t grid = 1;
  for (std::size_t a = axes_.size(); a-- > 0;) {
    if (!axes_[a].crossed) continue;
    stride_[a] = grid;
    if (axes_[a].points() == 0 || grid > most_cases / axes_[a].points()) return;
    grid *= axes_[a].points();
  }
  if (samples_ == 0 || grid > most_cases / samples_) return;
  cases_ = grid * samples_;
}

std::uint64_t Design::crossed_point(std::uint64_t index, std::size_t axis) const {
  return index / samples_ / stride_[axis] % axes_[axis].points();
}

double Design::sampled(std::uint64_t index, std::size_t axis) const {
  const std::uint64_t sample = index % samples_;
  const double u = unit(random_bits(seed_, axis, sample));
  if (method_ != Sampling::latin_hypercube) return u;
  const double v =
      (static_cast<double>(permuted(seed_, axis, sample, samples_)) + u) / static_cast<double>(samples_);
  return v < 1.0 ? v : std::nextafter(1.0, 0.0);
}

std::uint64_t Design::chosen(std::uint64_t index, std::size_t axis) const {
  if (axes_[axis].crossed) return crossed_point(index, axis);
  if (axes_[axis].in_order) return index % axes_[axis].listed;
  return static_cast<std::uint64_t>(sampled(index, axis) * static_cast<double>(axes_[axis].listed));
}

double Design::value(std::uint64_t index, std::size_t axis) const {
  const Axis& a = axes_[axis];
  if (!a.crossed) return a.at(sampled(index, axis));
  return a.steps < 2
             ? a.from
             : a.at(static_cast<double>(crossed_point(index, axis)) / static_cast<double>(a.steps - 1));
}

}  // namespace esmc::host
