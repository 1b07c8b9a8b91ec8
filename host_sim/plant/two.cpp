#include "host_sim/plant/two.hpp"

namespace esmc {
namespace {

constexpr host::Two twice(double v) { return host::Two{v, v}; }
template <std::size_t N>
constexpr std::array<host::Two, N> twice(const std::array<double, N>& c) {
  std::array<host::Two, N> out{};
  for (std::size_t i = 0; i < N; ++i) out[i] = twice(c[i]);
  return out;
}
using One = ieee::Constants<double>;

}  // namespace

namespace ieee {
constinit const host::Two Constants<host::Two>::kToInteger = twice(One::kToInteger);
constinit const host::Two Constants<host::Two>::kQuadrantsPerRadian = twice(One::kQuadrantsPerRadian);
constinit const std::array<host::Two, 3> Constants<host::Two>::kHalfPi = twice(One::kHalfPi);
constinit const std::array<host::Two, 6> Constants<host::Two>::kSine = twice(One::kSine);
constinit const std::array<host::Two, 6> Constants<host::Two>::kCosine = twice(One::kCosine);
}  // namespace ieee

namespace host {

SinCos<double> far_direction(double angle) { return {std::sin(angle), std::cos(angle)}; }

SinCos<Two> far_direction(Two angle) {
  const SinCos<double> a = direction(angle[0]), b = direction(angle[1]);
  return {Two{a.sin, b.sin}, Two{a.cos, b.cos}};
}

}  // namespace host
}  // namespace esmc
