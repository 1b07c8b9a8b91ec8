#pragma once
/// What the firmware's Controller needs to run several five-bars side by side: its checks with one truth per
/// lane, and a reference that is computed outside.

#include <Eigen/Core>
#include <cstdint>
#include <limits>

#include "firmware/cycle/controller.hpp"
#include "host_sim/sweep/lanes/lanes.hpp"

template <int N, class Tag>
struct Eigen::NumTraits<esmc::host::Lanes<N, Tag>> : Eigen::GenericNumTraits<double> {
  using Real = esmc::host::Lanes<N, Tag>;
  using NonInteger = Real;
  using Nested = Real;
  using Literal = Real;
};

/// isZero of the controller's preload, which no lane has.
template <int N, class Tag>
struct Eigen::internal::scalar_fuzzy_impl<esmc::host::Lanes<N, Tag>> {
  using L = esmc::host::Lanes<N, Tag>;
  template <class>  // NOLINTNEXTLINE(readability-identifier-naming): Eigen's name
  static bool isMuchSmallerThan(const L& x, const L& y, const L& precision) {
    return none(!(magnitude(x) <= magnitude(y) * precision));
  }
};

template <int N, class Tag>
struct std::numeric_limits<esmc::host::Lanes<N, Tag>> : std::numeric_limits<double> {};

namespace esmc::host {

/// Motion of the reference at consecutive ticks from `first` on, in the layout of fill_references.
struct LaneTrack {
  const double* values = nullptr;
  std::uint64_t first = 0;
  bool one_reference = true;
};

// ---- firmware/safety/guards.hpp, with a truth per lane ----

template <int N, class Tag>
[[nodiscard]] LaneMask<N, Tag> within(Lanes<N, Tag> v, Lanes<N, Tag> limit) {
  return magnitude(v) <= limit;
}
template <int N, class Tag>
[[nodiscard]] LaneMask<N, Tag> finite(Lanes<N, Tag> v) {
  return within(v, Lanes<N, Tag>(std::numeric_limits<double>::max()));
}
template <int N, class Tag>
struct LaneTorqueCheck {
  LaneMask<N, Tag> passed, limited;
  friend LaneMask<N, Tag> operator==(const LaneTorqueCheck& c, TorqueCheck asked) {
    if (asked == TorqueCheck::passed) return c.passed;
    return asked == TorqueCheck::limited ? c.limited : !(c.passed || c.limited);
  }
};
/// Clamps `torque` to +-limit. Where it is not finite, it counts as TorqueCheck::not_finite, its number means
/// nothing, and its lane is run again, alone.
template <int N, class Tag>
LaneTorqueCheck<N, Tag> limit_torque(Lanes<N, Tag>& torque, Lanes<N, Tag> limit) {
  using L = Lanes<N, Tag>;
  const LaneMask<N, Tag> usable = finite(torque) && limit >= L(0.0), inside = within(torque, limit);
  torque = choose(inside, torque, choose(torque < L(0.0), -limit, limit));
  return {usable && inside, usable && !inside};
}

}  // namespace esmc::host

namespace esmc {

/// The reference as a table that fill_references has computed. `track` must be set and have the tick.
template <int N, class Tag>
struct Reference<host::Lanes<N, Tag>> {
  using L = host::Lanes<N, Tag>;
  ReferenceKind kind = ReferenceKind::circle;
  ReferenceSpace space = ReferenceSpace::effector;
  Vec2<L> centre = Vec2<L>::Zero();
  const host::LaneTrack* track = nullptr;

  [[nodiscard]] ESMC_INLINE Motion2<L> from(std::uint64_t tick, L) const {
    const std::uint64_t row = 6 * (tick - track->first);
    const auto coordinate = [&](std::uint64_t i) {
      return track->one_reference ? L(track->values[row + i]) : L::load(track->values + (row + i) * L::size);
    };
    return {{coordinate(0), coordinate(1)}, {coordinate(2), coordinate(3)}, {coordinate(4), coordinate(5)}};
  }
};

/// Lanes follow their reference, never set points.
template <int N, class Tag>
class SetpointGenerator<host::Lanes<N, Tag>> {
 public:
  using L = host::Lanes<N, Tag>;
  SetpointGenerator() = default;
  SetpointGenerator(L, L, L, std::array<bool, 2>, std::uint32_t) {}
  [[nodiscard]] static constexpr bool active() { return false; }
  [[nodiscard]] static Motion2<L> at() { return {}; }
  static void start(const Vec2<L>&, const Vec2<L>&) {}
  static void advance() {}
};

/// Nor at another rate.
template <int N, class Tag>
class PathRate<host::Lanes<N, Tag>> {
 public:
  using L = host::Lanes<N, Tag>;
  PathRate() = default;
  PathRate(L, L) {}
  [[nodiscard]] static constexpr bool active() { return false; }
  [[nodiscard]] static L begin() { return L(1.0); }
  template <class Reference, class Feasible>
  static Motion2<L> step(const Reference&, std::uint64_t, std::uint32_t, const Feasible&) {
    return {};
  }
};

/// Lanes take no scene with a sign test.
template <int N, class Tag>
class SignTest<FiveBar<host::Lanes<N, Tag>>> {
 public:
  using M = FiveBar<host::Lanes<N, Tag>>;
  using Vector = Vec2<typename M::Scalar>;
  enum class Verdict : std::uint8_t { going_on, passed, failed };
  SignTest() = default;
  SignTest(typename M::Scalar, typename M::Scalar) {}
  static void reset() {}
  static Verdict step(const M&, const typename M::Pose&, const Vector&, const Vector&, const Vector&,
                      const Vector&) {
    return Verdict::failed;
  }
};

}  // namespace esmc
