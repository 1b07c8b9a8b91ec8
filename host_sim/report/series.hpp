#pragma once
/// Data of a report besides the rows of the log: distributions of durations, and a load over time.

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace esmc::host {

/// Durations counted in eighths of octaves, from 2^-30 s (1 ns) to 2^10 s; fixed size. A bin is the exponent
/// and the first three bits of the mantissa: counting is to cost a loop next to nothing.
class Histogram {
 public:
  static constexpr std::size_t octaves = 40, per_octave = 8, bins = octaves * per_octave;

  /// Negative values and NaN are left out; durations outside the bins count in the outermost.
  void add(double seconds) {
    if (!(seconds >= 0.0)) return;
    const std::uint64_t at = std::bit_cast<std::uint64_t>(seconds) >> shift;
    ++counts_[std::min<std::uint64_t>(bins - 1, std::max(at, offset) - offset)];
    largest_ = std::max(largest_, seconds);
    sum_ += seconds;
    ++total_;
  }
  [[nodiscard]] std::uint64_t total() const { return total_; }  ///< durations counted
  [[nodiscard]] double largest() const { return largest_; }     ///< s, like the mean; 0: none
  [[nodiscard]] double mean() const { return total_ > 0 ? sum_ / static_cast<double>(total_) : 0.0; }
  [[nodiscard]] const std::array<std::uint64_t, bins>& counts() const { return counts_; }  ///< per bin
  /// Lower edge of a bin, s; edge(bins) is the upper edge of the last.
  [[nodiscard]] static double edge(std::size_t bin) { return std::bit_cast<double>((offset + bin) << shift); }
  /// A duration, s, that the share `q` (0..1) of all does not exceed: upper edge of its bin, or largest().
  [[nodiscard]] double quantile(double q) const {
    std::uint64_t seen = 0;
    for (std::size_t i = 0; i < bins; ++i) {
      seen += counts_[i];
      if (static_cast<double>(seen) >= q * static_cast<double>(total_))
        return std::min(edge(i + 1), largest_);
    }
    return largest_;
  }

 private:
  static constexpr unsigned shift = 49;
  static constexpr std::uint64_t offset = std::bit_cast<std::uint64_t>(0x1p-30) >> shift;

  std::array<std::uint64_t, bins> counts_{};
  std::uint64_t total_ = 0;
  double largest_ = 0.0, sum_ = 0.0;
};

struct NamedHistogram {
  std::string title, note;  ///< what was measured, from where to where
  Histogram histogram;
};

/// A sum per tick, kept in at most 512 bins of equally many ticks each: when they are full, two become one.
class Binned {
 public:
  static constexpr std::size_t most = 512;

  /// Adds one more tick, with its amount.
  void add(double amount) {
    if (ticks_ == most * stride_) {
      for (std::size_t i = 0; i < most / 2; ++i) bins_[i] = bins_[2 * i] + bins_[2 * i + 1];
      bins_.resize(most / 2);
      stride_ *= 2;
    }
    if (ticks_++ % stride_ == 0) bins_.push_back(0.0);
    bins_.back() += amount;
  }
  [[nodiscard]] std::uint64_t ticks() const { return ticks_; }
  [[nodiscard]] std::uint64_t stride() const { return stride_; }  ///< ticks per bin
  [[nodiscard]] const std::vector<double>& bins() const { return bins_; }
  /// Ticks in the last bin, which may not be full.
  [[nodiscard]] std::uint64_t last_ticks() const { return ticks_ == 0 ? 0 : (ticks_ - 1) % stride_ + 1; }

 private:
  std::vector<double> bins_;
  std::uint64_t ticks_ = 0, stride_ = 1;
};

/// A row of log.csv, as plots show it.
struct SeriesRow {
  std::vector<double> values;
  std::string state;     ///< empty: the log has no such column
  double chatter = 0.0;  ///< N m: change of torque per tick, mean over motors and ticks since the last row
};

}  // namespace esmc::host
