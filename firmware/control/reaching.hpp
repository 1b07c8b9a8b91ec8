#pragma once
/// Reaching laws: the function sw(s) that stands in place of sgn s, of one channel's sliding variable alone.

#include <cstdint>

#include "firmware/numeric/elementary.hpp"
#include "firmware/types.hpp"

namespace esmc {

/// Reaching laws; s and layer in the unit of the channel / s.
enum class Reaching : std::uint8_t {
  sign,        ///< sgn s, sgn 0 = 0. Chatters by +-K h in a sampled loop.
  saturation,  ///< clamp(s / layer, -1, 1)
  tanh,        ///< tanh(s / layer)
  implicit,    ///< backward Euler [F39]: saturation whose layer (1 + d) h K follows from the sampling
};

/// True if sw of this law is `saturated`: saturation and implicit.
[[nodiscard]] constexpr bool clamps(Reaching law) {
  return law == Reaching::saturation || law == Reaching::implicit;
}

/// The layer with which `saturation` is the implicit step [F39], in the unit of s: gain K >= 0, sample time
/// h > 0 (s), torque delay d >= 0 (ticks). Always > 0: where it would be 0 or underflow, that of gain 1.
template <class S>
[[nodiscard]] constexpr S implicit_layer(S gain, S sample_time, S delay_ticks) {
  const S of_unit = (S(1) + delay_ticks) * sample_time, layer = of_unit * gain;
  return layer > S(0) ? layer : of_unit;
}

/// sgn s; NaN for NaN.
template <class S>
[[nodiscard]] constexpr S sign_of(S s) {
  return s > S(0) ? S(1) : (s < S(0) ? S(-1) : s);
}
/// clamp(s / layer, -1, 1), layer > 0; NaN for NaN.
template <class S>
[[nodiscard, gnu::always_inline]] constexpr S saturated(S s, S layer) {
  if (s > layer) return S(1);
  if (s < -layer) return S(-1);
  return s / layer;
}

/// sw(s): in [-1, 1], odd, NaN for NaN. layer > 0, in the unit of s; `sign` ignores it.
template <class S>
[[nodiscard]] S switching(Reaching law, S s, S layer) {
  if (clamps(law)) return saturated(s, layer);
  return law == Reaching::sign ? sign_of(s) : hyperbolic_tangent(s / layer);
}
/// sw(s) of every channel, each with its own layer > 0, in the unit of its s; a NaN stays in its channel.
template <class S, int N>
[[nodiscard]] Vec<S, N> switching(Reaching law, const Vec<S, N>& s, const Vec<S, N>& layer) {
  Vec<S, N> out;
  for (int i = 0; i < N; ++i) out[i] = switching(law, S(s[i]), S(layer[i]));
  return out;
}

}  // namespace esmc
