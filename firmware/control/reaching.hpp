#pragma once
/// Reaching laws: what replaces sgn s. Functions of one channel's sliding variable alone.

#include <cstdint>

#include "firmware/numeric/elementary.hpp"

namespace esmc {

enum class Reaching : std::uint8_t {
  sign,        ///< sgn s, sgn 0 = 0. Chatters by +-K h in a sampled loop.
  saturation,  ///< clamp(s / layer, -1, 1)
  tanh,        ///< tanh(s / layer)
  implicit,    ///< backward Euler [F39]: saturation whose layer (1 + d) h K follows from the sampling
};

/// The layer that makes `saturation` the implicit step [F39]: sample time h (s), torque known to act d ticks late.
template <class S>
[[nodiscard]] constexpr S implicit_layer(S gain, S sample_time, S delay_ticks) {
  return (S(1) + delay_ticks) * sample_time * gain;
}

/// In [-1, 1], odd. `layer` > 0 in the unit of s; ignored by `sign`. NaN stays NaN.
template <class S>
[[nodiscard]] S switching(Reaching law, S s, S layer) {
  if (law == Reaching::sign) return s > S(0) ? S(1) : (s < S(0) ? S(-1) : S(0) * s);  // 0 for 0, NaN for NaN
  if (law == Reaching::tanh) return hyperbolic_tangent(s / layer);
  if (s > layer) return S(1);
  if (s < -layer) return S(-1);
  return layer == S(0) ? S(0) * s : s / layer;  // an implicit channel without gain has no layer: nothing, not 0/0
}

}  // namespace esmc
