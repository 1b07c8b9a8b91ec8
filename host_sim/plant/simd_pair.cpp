#include "host_sim/plant/simd_pair.hpp"

namespace esmc {
namespace {

constexpr host::Double2 broadcast(double v) { return host::Double2{v, v}; }
template <std::size_t N>
constexpr std::array<host::Double2, N> broadcast(const std::array<double, N>& c) {
  std::array<host::Double2, N> out{};
  for (std::size_t i = 0; i < N; ++i) out[i] = broadcast(c[i]);
  return out;
}
using One = ieee::Constants<double>;

}  // namespace

namespace ieee {
constinit const host::Double2 Constants<host::Double2>::kToInteger = broadcast(One::kToInteger);
constinit const host::Double2 Constants<host::Double2>::kQuadrantsPerRadian =
    broadcast(One::kQuadrantsPerRadian);
constinit const std::array<host::Double2, 3> Constants<host::Double2>::kHalfPi = broadcast(One::kHalfPi);
constinit const std::array<host::Double2, 6> Constants<host::Double2>::kSine = broadcast(One::kSine);
constinit const std::array<host::Double2, 6> Constants<host::Double2>::kCosine = broadcast(One::kCosine);
}  // namespace ieee

namespace host {

SinCos<double> sin_cos_any_range(double angle) { return {std::sin(angle), std::cos(angle)}; }

SinCos<Double2> sin_cos_any_range(Double2 angle) {
  const SinCos<double> a = direction(angle[0]), b = direction(angle[1]);
  return {Double2{a.sin, b.sin}, Double2{a.cos, b.cos}};
}

}  // namespace host
}  // namespace esmc
