#pragma once
/// What the sensors say at a tick, and whether it fits what they said before.

#include <array>
#include <cstdint>

#include "firmware/types.hpp"

namespace esmc {

/// In the model's convention, one entry per joint; only the joints that have a
/// sensor are read.
template <class M>
struct Sample {
  using S = typename M::Scalar;
  Vec<S, M::joints> angle = Vec<S, M::joints>::Zero();  ///< rad
  Vec<S, M::joints> rate = Vec<S, M::joints>::Zero();   ///< rad/s
  std::array<std::uint32_t, static_cast<unsigned>(M::joints)> age_ticks{};     ///< 0: of this tick; missed samples otherwise
};

/// The samples of a tick against those before: an angle that moved, but not by its own rate, is a glitch, a slipped
/// coupling or another sensor's frame.
template <class M>
class Consistency {
 public:
  using S = typename M::Scalar;

  /// Whether a fresh sample of a joint is within `jump` rad per tick passed of where its rate takes it from the last
  /// one. Finite samples only. True before the first one, and with jump = 0.
  [[nodiscard]] bool plausible(int joint, const Sample<M>& now, S jump, S sample_time) const {
    const auto u = static_cast<unsigned>(joint);
    if (!(jump > S(0)) || !known_[u]) return true;
    const S ticks = S(since_[u] + 1);
    const S off = now.angle[joint] - last_[joint] - now.rate[joint] * (sample_time * ticks);
    return off <= jump * ticks && -off <= jump * ticks;
  }

  /// At the end of a tick.
  void keep(const Sample<M>& now) {
    for (int j = 0; j < M::joints; ++j) {
      const auto u = static_cast<unsigned>(j);
      if (now.age_ticks[u] == 0) {
        last_[j] = now.angle[j];
        known_[u] = true;
        since_[u] = 0;
      } else if (since_[u] < forgotten) {
        ++since_[u];
      } else {
        known_[u] = false;
      }
    }
  }

 private:
  static constexpr std::uint32_t forgotten = 1000;  ///< ticks: what was known before says nothing any more
  Vec<S, M::joints> last_ = Vec<S, M::joints>::Zero();
  std::array<std::uint32_t, static_cast<unsigned>(M::joints)> since_{};
  std::array<bool, static_cast<unsigned>(M::joints)> known_{};
};

}  // namespace esmc
