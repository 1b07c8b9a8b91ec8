#pragma once
/// The equations of FiveBarPlantOf, for the files that instantiate it: one mechanism (five_bar_plant.cpp) or
/// several side by side (sweep/lanes). Only `project` branches on numbers; it does so by `choose` and `none`.

#include <cmath>
#include <cstddef>

#include "host_sim/plant/plant.hpp"

namespace esmc::host {

// Of one number; a type of several numbers has its own.
[[nodiscard]] constexpr double choose(bool condition, double yes, double no) { return condition ? yes : no; }
[[nodiscard]] inline double magnitude(double v) { return std::abs(v); }
[[nodiscard]] constexpr bool none(bool condition) { return !condition; }

namespace five_bar {

/// Solves M x = r. Where closure has lost its rank, M is singular and x not finite.
template <class S>
Planar<S> solve(const typename LegDynamics<S>::Symmetric& m, Planar<S> r) {
  const S inverse = 1.0 / (m.xx * m.yy - m.xy * m.xy);
  return {(m.yy * r.x - m.xy * r.y) * inverse, (m.xx * r.y - m.xy * r.x) * inverse};
}

// Both legs as one: bar k of leg 1 and of leg 2.
template <class Both, class S>
typename LegDynamics<Both>::Pair bars(const std::array<S, 4>& a) {
  return {Both{a[0], a[2]}, Both{a[1], a[3]}};
}
template <class S, class Pair>
std::array<S, 4> angles(const Pair& b) {
  return {b.first[0], b.second[0], b.first[1], b.second[1]};
}
/// apart: leg 1 minus leg 2; together: their sum; first: leg 1 alone.
template <class S, class Both>
Planar<S> apart(const Planar<Both>& v) {
  return {v.x[0] - v.x[1], v.y[0] - v.y[1]};
}
template <class S, class Both>
Planar<S> together(const Planar<Both>& v) {
  return {v.x[0] + v.x[1], v.y[0] + v.y[1]};
}
template <class S, class Both>
Planar<S> first(const Planar<Both>& v) {
  return {v.x[0], v.y[0]};
}
template <class S, class Both>
S total(const Both& v) {
  return v[0] + v[1];
}
template <class S, class Condition>
std::array<S, 4> choose_all(const Condition& c, const std::array<S, 4>& yes, const std::array<S, 4>& no) {
  return {choose(c, yes[0], no[0]), choose(c, yes[1], no[1]), choose(c, yes[2], no[2]),
          choose(c, yes[3], no[3])};
}

}  // namespace five_bar

template <class Both, class S>
typename LegDynamics<Both>::Pose FiveBarPlantOf<Both, S>::pose(const Angles& angle) const {
  const typename Legs::Pair b = five_bar::bars<Both>(angle);
  return legs_.pose(direction(b.first), direction(b.second));
}

template <class Both, class S>
typename LegDynamics<Both>::Pair FiveBarPlantOf<Both, S>::closing(const typename Legs::Pose& p,
                                                                  Planar<S> gap) const {
  const auto m = legs_.tip_mobility(p);
  const Planar<S> f =
      five_bar::solve<S>({five_bar::total<S>(m.xx), five_bar::total<S>(m.xy), five_bar::total<S>(m.yy)}, gap);
  const typename Legs::Pair b = Legs::solve(p, legs_.tip_force(p, {Both{f.x, f.x}, Both{f.y, f.y}}));
  const Both sign{1.0, -1.0};
  return {sign * b.first, sign * b.second};
}

template <class Both, class S>
typename FiveBarPlantOf<Both, S>::Angles FiveBarPlantOf<Both, S>::acceleration(const Angles& angle,
                                                                               const Angles& rate,
                                                                               const Joints& torque) const {
  const typename Legs::Pose p = pose(angle);
  const typename Legs::Pair w = five_bar::bars<Both>(rate), t = five_bar::bars<Both>(torque);
  const typename Legs::Pair a = Legs::solve(p, legs_.force(p, w.first, w.second, t.first, t.second));
  // How far the tips would part, and the force between them that keeps them together.
  return five_bar::angles<S>(
      a - closing(p, five_bar::apart<S>(legs_.tip_rate(p, a) + legs_.tip_bias(p, w.first, w.second))));
}

template <class Both, class S>
typename FiveBarPlantOf<Both, S>::Angles FiveBarPlantOf<Both, S>::response(const Angles& angle,
                                                                           const Joints& torque) const {
  const typename Legs::Pose p = pose(angle);
  const typename Legs::Pair t = five_bar::bars<Both>(torque);
  const typename Legs::Pair a = Legs::solve(p, legs_.on_bars(t.first, t.second));
  return five_bar::angles<S>(a - closing(p, five_bar::apart<S>(legs_.tip_rate(p, a))));
}

template <class Both, class S>
void FiveBarPlantOf<Both, S>::project(Angles& angle, Angles& rate) const {
  // A Newton step turns a gap of the integrator's local error e into e^2; repeated until that is rounding.
  constexpr double nothing = 4e-17, little = 1e-9;
  auto going = S(0.0) <= S(0.0);
  for (int round = 0; round < 4; ++round) {
    const typename Legs::Pose p = pose(angle);
    const typename Legs::Pair w = five_bar::bars<Both>(rate);
    rate = five_bar::choose_all(
        going, five_bar::angles<S>(w - closing(p, five_bar::apart<S>(legs_.tip_rate(p, w)))), rate);
    const Planar<S> gap = five_bar::apart<S>(legs_.tip(p.e1, p.e2));
    const S size = magnitude(gap.x) + magnitude(gap.y);
    going = going && !(size <= S(nothing));
    if (none(going)) return;
    angle = five_bar::choose_all(going, five_bar::angles<S>(five_bar::bars<Both>(angle) - closing(p, gap)),
                                 angle);
    going = going && !(size < S(little));
    if (none(going)) return;
  }
}

template <class Both, class S>
EffectorPointOf<S> FiveBarPlantOf<Both, S>::effector_point(const Angles& angle, const Angles& rate) const {
  const typename Legs::Pose p = pose(angle);
  const auto torque = legs_.torque_per_force(p);
  return {five_bar::first<S>(legs_.tip(p.e1, p.e2)),
          five_bar::first<S>(legs_.tip_rate(p, five_bar::bars<Both>(rate))),
          {five_bar::first<S>(torque[0]), five_bar::first<S>(torque[1])}};
}

template <class Both, class S>
typename FiveBarPlantOf<Both, S>::Output FiveBarPlantOf<Both, S>::output(const State& s) const {
  const typename Legs::Pose p = pose(s.angle);
  const Planar<Both> tip = legs_.tip(p.e1, p.e2);
  const Planar<S> gap = five_bar::apart<S>(tip), x = 0.5 * five_bar::together<S>(tip),
                  v = 0.5 * five_bar::together<S>(legs_.tip_rate(p, five_bar::bars<Both>(s.rate)));
  const Joints theta = joint_angles(s.angle), w = joint_rates(s.rate);
  return {{x.x, x.y, theta[0], theta[1], theta[2], theta[3]},
          {v.x, v.y, w[0], w[1], w[2], w[3]},
          x,
          v,
          square_root(dot(gap, gap))};
}

template <class Both, class S>
S FiveBarPlantOf<Both, S>::kinetic_energy(const State& s) const {
  const typename Legs::Pose p = pose(s.angle);
  const typename Legs::Pair w = five_bar::bars<Both>(s.rate);
  return five_bar::total<S>(legs_.kinetic(p.e1, p.e2, w.first, w.second));
}

template <class Both, class S>
S FiveBarPlantOf<Both, S>::potential_energy(const State& s) const {
  const typename Legs::Pose p = pose(s.angle);
  return five_bar::total<S>(legs_.potential(p.e1, p.e2));
}

}  // namespace esmc::host
