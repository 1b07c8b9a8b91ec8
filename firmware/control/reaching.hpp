#pragma once
/// Reaching laws: what replaces sgn s. Functions of one channel's sliding variable alone.

#include <cstdint>

#include "firmware/numeric/elementary.hpp"
#include "firmware/types.hpp"

namespace esmc {

/// What stands in place of sgn s.
enum class Reaching : std::uint8_t {
  sign,        ///< sgn s, sgn 0 = 0. Chatters by +-K h in a sampled loop.
  saturation,  ///< clamp(s / layer, -1, 1)
  tanh,        ///< tanh(s / layer)
  implicit,    ///< backward Euler [F39]: saturation whose layer (1 + d) h K follows from the sampling
};

/// Those of the shape of `saturation`.
[[nodiscard]] constexpr bool clamps(Reaching law) {
  return law == Reaching::saturation || law == Reaching::implicit;
}

/// The layer that makes `saturation` the implicit step [F39]: sample time h (s), torque known to act d ticks
/// late. Where the gain is 0, or so small that its layer would be, it is the layer of gain 1: any positive
/// one does there.
template <class S>
[[nodiscard]] constexpr S implicit_layer(S gain, S sample_time, S delay_ticks) {
  const S of_unit = (S(1) + delay_ticks) * sample_time, layer = of_unit * gain;
  return layer > S(0) ? layer : of_unit;
}

/// In [-1, 1], odd, NaN for NaN; `saturated` with layer > 0.
template <class S>
[[nodiscard]] constexpr S sign_of(S s) {
  return s > S(0) ? S(1) : (s < S(0) ? S(-1) : s);
}
template <class S>
[[nodiscard, gnu::always_inline]] constexpr S saturated(S s, S layer) {
  if (s > layer) return S(1);
  if (s < -layer) return S(-1);
  return s / layer;
}

/// In [-1, 1], odd. `layer` > 0 in the unit of s; ignored by `sign`. NaN stays NaN.
template <class S>
[[nodiscard]] S switching(Reaching law, S s, S layer) {
  if (clamps(law)) return saturated(s, layer);
  return law == Reaching::sign ? sign_of(s) : hyperbolic_tangent(s / layer);
}

/// to += k switching(s), channel by channel.
template <class S, int N>
void add_switching(Reaching law, const Vec<S, N>& s, const Vec<S, N>& k, const Vec<S, N>& layer,
                   Vec<S, N>& to) {
  switch (law) {  // once, not in every channel
    case Reaching::sign:
      for (int i = 0; i < N; ++i) to[i] += k[i] * sign_of(s[i]);
      return;
    case Reaching::tanh:
      for (int i = 0; i < N; ++i) to[i] += k[i] * hyperbolic_tangent(s[i] / layer[i]);
      return;
    case Reaching::saturation:
    case Reaching::implicit:
      break;
  }
  for (int i = 0; i < N; ++i) to[i] += k[i] * saturated(s[i], layer[i]);
}

}  // namespace esmc
