#pragma once
/// Everything that a result depends on as one list of numbers: equal lists, equal results.

#include <Eigen/Core>
#include <deque>
#include <mutex>
#include <type_traits>
#include <utility>
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
template <class T, std::size_t N>
void append(std::vector<double>& to, const std::array<T, N>& list) {
  for (const T& v : list) append(to, v);
}
template <class T>
void append(std::vector<double>& to, const std::optional<T>& v) {
  to.push_back(v ? 1.0 : 0.0);
  if (v) append(to, *v);
}
inline void append(std::vector<double>& to, const FiveBarParams<double>& p) {
  for (const double v : {p.l0, p.m0, p.g}) append(to, v);
  append(to, p.legs);
}
/// Without what makes gains of it: tube and reaching time.
inline void append(std::vector<double>& to, const UncertaintyScene& u) {
  for (const Interval& i : {u.m1, u.m2, u.J1, u.J2, u.lg1, u.lg2, u.gravity, u.payload}) append(to, i);
  append(to, u.viscous);
  append(to, u.coulomb);
}
/// Adds the numbers of every value.
template <class... T>
void put(std::vector<double>& to, const T&... value) {
  (append(to, value), ...);
}

/// The answers to the last lists of numbers that were asked for, by any thread.
template <class T>
class Known {
 public:
  /// The answer for `of`: make(), where it is not known.
  template <class F>
  T get(const std::vector<double>& of, const F& make) {
    {
      const std::lock_guard lock(mutex_);
      for (const auto& [numbers, answer] : known_) {
        if (numbers == of) return answer;
      }
    }
    const T made = make();
    const std::lock_guard lock(mutex_);
    known_.emplace_back(of, made);
    if (known_.size() > 32) known_.pop_front();
    return made;
  }

 private:
  std::mutex mutex_;
  std::deque<std::pair<std::vector<double>, T>> known_;
};

}  // namespace esmc::host
