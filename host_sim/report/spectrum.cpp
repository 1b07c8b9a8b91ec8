#include "host_sim/report/spectrum.hpp"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

namespace esmc::host {
namespace {

using Complex = std::complex<double>;

/// Discrete Fourier transform of n values, n a power of two, `stride` apart (Cooley and Tukey).
std::vector<Complex> transform(const double* x, std::size_t n, std::size_t stride) {
  if (n == 1) return {*x};
  const auto even = transform(x, n / 2, 2 * stride), odd = transform(x + stride, n / 2, 2 * stride);
  std::vector<Complex> out(n);
  for (std::size_t k = 0; k < n / 2; ++k) {
    const Complex turned =
        odd[k] * std::polar(1.0, -2.0 * std::numbers::pi * static_cast<double>(k) / static_cast<double>(n));
    out[k] = even[k] + turned;
    out[k + n / 2] = even[k] - turned;
  }
  return out;
}

}  // namespace

void Spectrum::take(std::size_t n) {
  double mean = 0.0, weights = 0.0;
  for (std::size_t i = 0; i < n; ++i) mean += values_[i] / static_cast<double>(n);
  std::array<double, segment> windowed{};
  for (std::size_t i = 0; i < n; ++i) {
    const double w = 0.5 - 0.5 * std::cos(2.0 * std::numbers::pi * (static_cast<double>(i) + 0.5) /
                                          static_cast<double>(n));
    windowed[i] = w * (values_[i] - mean);
    weights += w;
  }
  const auto lines = transform(windowed.data(), segment, 1);
  for (std::size_t k = 0; k < power_.size(); ++k) power_[k] += std::norm(2.0 / weights * lines[k]);
  ++segments_;
}

void Spectrum::add(double value) {
  values_[filled_++] = value;
  if (filled_ < segment) return;
  take(segment);
  std::copy_n(values_.begin() + segment / 2, segment / 2, values_.begin());
  filled_ = segment / 2;
}

std::vector<double> Spectrum::amplitudes() const {
  Spectrum whole = *this;
  if (segments_ == 0 && filled_ > 0) whole.take(filled_);
  std::vector<double> out;
  for (const double p : whole.power_)
    out.push_back(std::sqrt(p / static_cast<double>(std::max<std::uint64_t>(1, whole.segments_))));
  return out;
}

}  // namespace esmc::host
