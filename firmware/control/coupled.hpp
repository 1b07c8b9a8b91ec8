#pragma once
/// The implicit step of all channels together: the s+ that the mechanism can reach. docs/reaching.md.

#include <limits>

#include "firmware/control/reduced.hpp"
#include "firmware/numeric/elementary.hpp"

namespace esmc {

/// Backward Euler of C^T M (s' + K sgn s) = 0 [F31] over T seconds. s moves with the two degrees of freedom
/// alone, s+ = s + C q, and C^T M (s+ - s + T K sw) = 0 with sw_i in Sgn s_i+ are the conditions of
///
///   q = argmin f,  f(q) = 1/2 q^T H q + sum_i w_i |s_i + c_i q|,   w_i = T M_i K_i, c_i rows of C_a:
///
/// f is strictly convex, so the solution is unique for every K >= 0. The search starts where the clamp of
/// [F39] leads and takes steps of steepest descent in the metric of H, each to the best point of its sector
/// or to a lower kink before that: every step ends on a kink or in the minimum of one of finitely many smooth
/// pieces. After two kinks in a row their crossing is tried, because the way between two kinks can be
/// endless.
template <class M>
class CoupledStep {
 public:
  using S = typename M::Scalar;
  using Channels = typename M::Channels;
  static constexpr int most_steps = 24;

  /// s: unit of the channel / s; weight: w_i >= 0. Keeps references: all three must outlive this object.
  CoupledStep(const Reduced<M>& reduced, const Channels& s, const Channels& weight)
      : reduced_(reduced), s_(s), weight_(weight) {}
  /// Sets q, the change of the base joint rates, rad/s. False, q undefined: not within `most_steps`, or NaN.
  [[nodiscard]] bool solve(Vec2<S>& q) {
    q = Vec2<S>::Zero();
    if (clamped(q)) return true;
    int last = -1;
    for (steps_ = 1; steps_ <= most_steps; ++steps_) {
      linearise(q);
      if (kinks_ > 0) {
        if (last >= 0 && last != at_[0]) try_crossing(last, at_[0], q);
        last = at_[0];
      }
      Vec2<S> p;
      if (!descent(p)) return within(q);
      const S share = along(p);
      q += p * share;
      if (share == S(1) && dot(p, reduced_.times(p)) <= square(S(8) * epsilon) * dot(q, reduced_.times(q)))
        return within(q);
    }
    return false;
  }
  /// Number of steps of the last solution; 0: the clamp solved it.
  [[nodiscard]] int steps() const { return steps_; }

 private:
  static constexpr S epsilon = std::numeric_limits<S>::epsilon();
  static S square(S v) { return v * v; }
  static bool within(const Vec2<S>& q) {
    constexpr S most = std::numeric_limits<S>::max();
    return magnitude(q[0]) <= most && magnitude(q[1]) <= most;
  }
  [[nodiscard]] Vec2<S> row(int i) const { return {reduced_.column(0)[i], reduced_.column(1)[i]}; }
  [[nodiscard]] bool counts(int i) const { return weight_[i] > S(0); }
  /// Whether s_i + moved is zero within the rounding of its terms or of T K_i.
  [[nodiscard]] bool vanishes(int i, S moved) const {
    const S size = magnitude(s_[i]) + magnitude(moved) + weight_[i] / reduced_.mass()[i];
    return magnitude(s_[i] + moved) <= S(32) * epsilon * size;
  }

  /// Sets q to where the clamp leads; true: that is the solution.
  bool clamped(Vec2<S>& q) const {
    Channels sw;
    Vec2<S> sum = Vec2<S>::Zero();
    for (int i = 0; i < M::channels; ++i) {
      const S share = counts(i) ? s_[i] * reduced_.mass()[i] / weight_[i] : S(0);
      sw[i] = share > S(1) ? S(1) : (share < S(-1) ? S(-1) : share);
      sum += row(i) * (weight_[i] * sw[i]);
    }
    q = -reduced_.solve(sum);
    for (int i = 0; i < M::channels; ++i) {
      if (!counts(i)) continue;
      const S moved = dot(row(i), q);
      if (!(vanishes(i, moved) || sw[i] * (s_[i] + moved) == magnitude(s_[i] + moved))) return false;
    }
    return true;
  }

  /// f around q: slope_ of its smooth terms; at_: rows with a kink at q.
  void linearise(const Vec2<S>& q) {
    slope_ = reduced_.times(q);
    kinks_ = 0;
    for (int i = 0; i < M::channels; ++i) {
      value_[i] = s_[i] + dot(row(i), q);
      if (!counts(i)) continue;
      if (vanishes(i, value_[i] - s_[i])) {
        value_[i] = S(0);
        at_[kinks_++] = i;
      } else {
        slope_ += row(i) * (value_[i] > S(0) ? weight_[i] : -weight_[i]);
      }
    }
  }
  S objective(const Vec2<S>& q) const {
    S sum = S(0.5) * dot(q, reduced_.times(q));
    for (int i = 0; i < M::channels; ++i) sum += weight_[i] * magnitude(s_[i] + dot(row(i), q));
    return sum;
  }
  void try_crossing(int i, int j, Vec2<S>& q) {
    const Vec2<S> a = row(i), b = row(j);
    const Vec2<S> at =
        Vec2<S>(s_[j] * a.y() - s_[i] * b.y(), s_[i] * b.x() - s_[j] * a.x()) * (S(1) / cross(a, b));
    if (!(objective(at) < objective(q))) return;  // also where they are parallel
    q = at;
    linearise(q);
  }
  /// Bound of f(q + p) - f(q), exact up to the next kink; `size`: sum of the magnitudes of its terms.
  S change(const Vec2<S>& p, S& size) const {
    S rough = dot(slope_, p);
    size = magnitude(rough);
    for (int k = 0; k < kinks_; ++k) {
      const S part = weight_[at_[k]] * magnitude(dot(row(at_[k]), p));
      rough += part;
      size += part;
    }
    return rough + S(0.5) * dot(p, reduced_.times(p));
  }
  /// The step p of least change; false: q is the solution. All kink lines at q pass through q, so p is the
  /// minimum of a sector between them or along one of them.
  bool descent(Vec2<S>& p) const {
    S least(0);
    const auto take = [&](const Vec2<S>& candidate) {
      S size;
      const S gained = change(candidate, size);
      if (gained < least && -gained > S(16) * epsilon * size) {
        least = gained;
        p = candidate;
      }
    };
    if (kinks_ == 0) take(-reduced_.solve(slope_));
    for (int k = 0; k < kinks_; ++k) {
      const Vec2<S> c = row(at_[k]), line = perp(c);
      S held(0);
      Vec2<S> others = Vec2<S>::Zero();  // slope of the other lines on the side of `line`
      S parallel = weight_[at_[k]];      // weight of the lines parallel to this one
      for (int j = 0; j < kinks_; ++j) {
        if (j == k) continue;
        const Vec2<S> cj = row(at_[j]);
        const S across = dot(cj, line), aligned = dot(cj, c);
        const S w = weight_[at_[j]];
        if (magnitude(across) <= S(16) * epsilon * magnitude(aligned)) {
          parallel += w * magnitude(aligned) / dot(c, c);
        } else {
          held += w * magnitude(across);
          others += cj * (across > S(0) ? w : -w);
        }
      }
      const S pull = dot(slope_, line), stiff = dot(line, reduced_.times(line));
      if (magnitude(pull) > held) take(line * ((pull > S(0) ? held - pull : -held - pull) / stiff));
      for (const S side : {S(1), S(-1)}) {
        for (const S tilt : {S(1), S(-1)})
          take(-reduced_.solve(slope_ + others * side + c * (parallel * tilt)));
      }
    }
    return least < S(0);
  }
  /// Best share of p: 1, or less where kinks on the way make f rise.
  S along(const Vec2<S>& p) const {
    const S stiff = dot(p, reduced_.times(p));
    S passed(0), from(0);
    for (int n = 0; n < M::channels; ++n) {
      S next(1), step(0);
      for (int i = 0; i < M::channels; ++i) {
        const S moved = dot(row(i), p);
        if (!counts(i) || value_[i] == S(0) || moved == S(0)) continue;
        const S at = -value_[i] / moved;
        if (at > from && at < next) {
          next = at;
          step = S(2) * weight_[i] * magnitude(moved);
        }
      }
      const S rest = S(1) - passed / stiff;  // where the slope is zero without that kink
      if (next >= rest) return rest;
      if (next >= rest - step / stiff) return next;
      passed += step;
      from = next;
    }
    return from;
  }

  const Reduced<M>& reduced_;
  const Channels& s_;
  const Channels& weight_;
  Channels value_;
  Vec2<S> slope_;
  List<int, M::channels> at_;
  int kinks_ = 0, steps_ = 0;
};

}  // namespace esmc
