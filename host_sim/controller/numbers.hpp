#pragma once
/// Everything that a result depends on as one list of numbers: equal lists, equal results.

#include <Eigen/Core>
#include <type_traits>
#include <vector>

#include "firmware/mechanism/params.hpp"
#include "host_sim/scene/uncertainty.hpp"

namespace esmc::host {

/// Adds a value's numbers to the list; overloads for each type follow.
inline void append(std::vector<double>& to, double v) { to.push_back(v); }
template <class E>
requires std::is_enum_v<E>
void append(std::vector<double>& to, E v) { to.push_back(static_cast<double>(v)); }
template <class Vector>
void append(std::vector<double>& to, const Eigen::MatrixBase<Vector>& v) {
  for (int i = 0; i < v.size(); ++i) to.push_back(v[i]);
}
inline void append(std::vector<double>& to, const Interval& i) { to.insert(to.end(), {i.lower, i.upper}); }
inline void append(std::vector<double>& to, const LegParams<double>& leg) {
  const auto& [l1, l2, lg1, lg2, m1, m2, J1, J2, d1, d2, g1, g2, a1, a2, rotor] = leg;
  to.insert(to.end(), {l1, l2, lg1, lg2, m1, m2, J1, J2, d1, d2, g1, g2, a1, a2, rotor});
}
/// Adds the numbers of every value.
template <class... T>
void put(std::vector<double>& to, const T&... value) {
  (append(to, value), ...);
}

}  // namespace esmc::host
