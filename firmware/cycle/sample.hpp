#pragma once
/// Measurements of a tick.

#include <array>
#include <cstdint>

#include "firmware/types.hpp"

namespace esmc {

/// Measured angles and rates, model convention, one entry per joint; joints without a sensor are not used.
template <class M>
struct Sample {
  using S = typename M::Scalar;
  Vec<S, M::joints> angle = Vec<S, M::joints>::Zero();  ///< rad
  Vec<S, M::joints> rate = Vec<S, M::joints>::Zero();   ///< rad/s
  /// 0: of this tick; otherwise the number of missed samples.
  std::array<std::uint32_t, static_cast<unsigned>(M::joints)> age_ticks{};
  /// s, >= 0, from the arrival of the sample to the instant of its tick.
  std::array<S, static_cast<unsigned>(M::joints)> phase{};
};

}  // namespace esmc
