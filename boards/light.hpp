#pragma once
/// The light of a board, whose blinking shows the state of the controller.

#include <cstdint>

#include "firmware/safety/supervisor.hpp"

namespace esmc {

/// Whether the light is on, `now_ms` after any instant. A dark or a steady light for two seconds is a
/// program that does not run, or a supply that is missing, unless it is steady in `running`.
///
///   disabled                    one flash of 0.1 s every 2 s
///   enabling, testing           ten flashes a second
///   running                     on, with a gap of 0.1 s every 2 s
///   halting, lowering, stopping one flash of 0.5 s a second
///   holding                     on, with two gaps of 0.1 s every 2 s
///   fault                       three flashes every 2 s; after a crash (`crashed`) six
[[nodiscard]] constexpr bool light_on(State state, bool crashed, std::uint32_t now_ms) {
  const std::uint32_t phase = now_ms % 2000U, slot = phase / 100U;  // slots of 0.1 s
  if (crashed) return slot < 12U && slot % 2U == 0;
  switch (state) {
    case State::disabled:
      return slot == 0;
    case State::enabling:
    case State::testing:
      return phase % 100U < 50U;
    case State::running:
      return slot != 0;
    case State::holding:
      return slot != 0 && slot != 2;
    case State::halting:
    case State::lowering:
    case State::stopping:
      return phase % 1000U < 500U;
    case State::fault:
      return slot < 10U && slot % 4U < 2U;
  }
  return false;
}

}  // namespace esmc
