#pragma once
/// Amplitudes of a signal over frequency, of any number of values, in fixed memory.

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace esmc::host {

/// Mean of the power of half overlapping segments, less their mean, under the window of Hann (P. D. Welch,
/// The use of fast Fourier transform for the estimation of power spectra, IEEE Transactions on Audio and
/// Electroacoustics 15, 1967). A run shorter than a segment is one segment, filled up with zeros.
class Spectrum {
 public:
  static constexpr std::size_t segment = 1024;  ///< values

  void add(double value);
  /// Line k, 0 <= k <= segment / 2, is at k / segment of the sample rate: the amplitude of a sine there, in
  /// the unit of the values. A value that is not finite makes all lines so.
  [[nodiscard]] std::vector<double> amplitudes() const;

 private:
  void take(std::size_t n);

  std::array<double, segment> values_{};
  std::array<double, segment / 2 + 1> power_{};
  std::size_t filled_ = 0;
  std::uint64_t segments_ = 0;
};

}  // namespace esmc::host
