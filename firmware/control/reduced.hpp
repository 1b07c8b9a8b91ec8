#pragma once
/// The mass matrix of the two degrees of freedom at one pose, in the base-joint form (regular at type 1).
/// Only optional parts of the control tick use it.

#include "firmware/types.hpp"

namespace esmc {

/// C_a, M and H_a = C_a^T M C_a of [F25]. M: Rr or FiveBar.
template <class M>
class Reduced {
 public:
  using S = typename M::Scalar;
  using Channels = typename M::Channels;

  /// Computes C_a and H_a at a pose, which must be closed; not finite at type 2.
  Reduced(const M& m, const typename M::Pose& pose) : mass_(m.mass()) {
    for (int k = 0; k < 2; ++k) column_[k] = m.channel_rates(pose, m.base_rates(pose, Vec2<S>::Unit(k)));
    h00_ = weighed(column_[0], column_[0]);
    h01_ = weighed(column_[0], column_[1]);
    h11_ = weighed(column_[1], column_[1]);
    inverse_ = S(1) / (h00_ * h11_ - h01_ * h01_);
  }

  /// Column k of C_a: rates of the channels while base joint k (0 or 1) turns at 1 rad/s, the other at 0.
  [[nodiscard]] const Channels& column(int k) const { return column_[k]; }
  [[nodiscard]] const Channels& mass() const { return mass_; }  ///< diagonal of M, kg m2 and kg
  /// H_a v: torques (N m) of accelerations of the base joints (rad/s2).
  [[nodiscard]] Vec2<S> times(const Vec2<S>& v) const {
    return {h00_ * v[0] + h01_ * v[1], h01_ * v[0] + h11_ * v[1]};
  }
  /// H_a^-1 F: accelerations (rad/s2) of the base joints by torques on them (N m). Not finite at type 2.
  [[nodiscard]] Vec2<S> solve(const Vec2<S>& F) const {
    return {(h11_ * F[0] - h01_ * F[1]) * inverse_, (h00_ * F[1] - h01_ * F[0]) * inverse_};
  }
  /// sigma (rad/s) of s = C_a sigma + r with C_a^T M r = 0 [F32]: H_a^-1 C_a^T M s. Not finite at type 2.
  [[nodiscard]] Vec2<S> nearest(const Channels& s) const {
    return solve({weighed(column_[0], s), weighed(column_[1], s)});
  }
  /// C_a v: rates of the channels of rates v of the base joints (rad/s).
  [[nodiscard]] Channels channels(const Vec2<S>& v) const {
    Channels out;
    for (int i = 0; i < M::channels; ++i) out[i] = column_[0][i] * v[0] + column_[1][i] * v[1];
    return out;
  }

 private:
  [[nodiscard]] S weighed(const Channels& a, const Channels& b) const {
    S sum(0);
    for (int i = 0; i < M::channels; ++i) sum += a[i] * mass_[i] * b[i];
    return sum;
  }

  Channels mass_;
  List<Channels, 2> column_;
  S h00_, h01_, h11_, inverse_;
};

}  // namespace esmc
