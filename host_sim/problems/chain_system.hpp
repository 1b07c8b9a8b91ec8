#pragma once
/// Closed chains as a System.

#include "host_sim/integrate/system.hpp"
#include "host_sim/problems/closed_chains.hpp"

namespace esmc::host {

/// A System of closed chains; Derived adds mounting and loads.
template <class Derived, class Mechanism>
class ChainSystem {
 public:
  static constexpr std::size_t positions = Mechanism::coordinates;
  static constexpr std::size_t capacity = 2 * positions;
  using State = std::array<double, capacity>;
  using Coordinates = typename Mechanism::Coordinates;

  explicit ChainSystem(const Mechanism& m) : mechanism_(m) {}

  [[nodiscard]] static constexpr std::size_t size() { return capacity; }
  void slope(double, const State& y, State& dy) const {
    const Coordinates q = position(y), v = rate(y);
    put(v, mechanism_.acceleration(q, v, static_cast<const Derived&>(*this)), dy);
  }
  void project(State& y) const {
    Coordinates q = position(y), v = rate(y);
    mechanism_.project(q, v);
    put(q, v, y);
  }
  [[nodiscard]] const Mechanism& mechanism() const { return mechanism_; }

  static Coordinates position(const State& y) { return Eigen::Map<const Coordinates>(y.data()); }
  static Coordinates rate(const State& y) { return Eigen::Map<const Coordinates>(y.data() + positions); }
  static void put(const Coordinates& first, const Coordinates& second, State& y) {
    Eigen::Map<Coordinates>(y.data()) = first;
    Eigen::Map<Coordinates>(y.data() + positions) = second;
  }

 private:
  Mechanism mechanism_;
};

}  // namespace esmc::host
