#pragma once
/// Worst cases of inertia H = C^T M C and force C^T delta together, over the corners of all uncertain
/// parameters: a search from corner to corner, from several starts. Each parameter belongs to one part (a
/// bar, the payload, a joint's friction), and the shares of the parts in H and in the force add up.

#include "host_sim/design/extremes.hpp"

namespace esmc::host::design {

/// Eigenvalues, ascending, of the symmetric part of a 2 x 2 matrix.
[[nodiscard]] inline Vec2<double> eigenvalues(const Mat<double, 2, 2>& m) {
  const double mean = 0.5 * (m(0, 0) + m(1, 1)), half = 0.5 * (m(0, 0) - m(1, 1)),
               off = 0.5 * (m(0, 1) + m(1, 0));
  const double r = std::hypot(half, off);
  return {mean - r, mean + r};
}
/// Inverse of a 2 x 2 matrix; not finite where it is singular.
[[nodiscard]] inline Mat<double, 2, 2> inverse(const Mat<double, 2, 2>& m) {
  Mat<double, 2, 2> out;
  out << m(1, 1), -m(0, 1), -m(1, 0), m(0, 0);
  return out / (m(0, 0) * m(1, 1) - m(0, 1) * m(1, 0));
}
/// Upper triangular R with R^T R = m > 0: |R v| is the length of v in the metric m.
[[nodiscard]] inline Mat<double, 2, 2> root(const Mat<double, 2, 2>& m) {
  Mat<double, 2, 2> r = Mat<double, 2, 2>::Zero();
  r(0, 0) = std::sqrt(m(0, 0));
  r(0, 1) = m(0, 1) / r(0, 0);
  r(1, 1) = std::sqrt(std::max(0.0, m(1, 1) - r(0, 1) * r(0, 1)));
  return r;
}

/// Share of a part in inertia and force.
struct Share {
  Mat<double, 2, 2> H;
  Vec2<double> F;
};

template <class M>
class Worst {
 public:
  static constexpr int parts_max = 2 * M::joints + 1, corners_max = 8;

  /// The corners in state s; `swing`: see Uncertain::friction(). Keeps no reference.
  Worst(const Uncertain<M>& u, const State<M>& s, double swing) : believed_(Mat<double, 2, 2>::Zero()) {
    const Mat<double, 2, 2> tip = u.tip_columns(s);
    believed_ += tip.transpose() * tip * u.own_tip();
    for (int b = 0; b < M::joints; ++b)
      believed_ += Uncertain<M>::inertia(Uncertain<M>::bar(s, b), u.box(b).believed);
    const Interval g = u.gravity();
    for (const double now : {g.lower, g.upper}) {
      fill(u, s, swing, now, tip);
      ++gravities_;
      if (g.lower == g.upper) break;
    }
  }

  [[nodiscard]] const Mat<double, 2, 2>& believed() const { return believed_; }  ///< H as believed

  /// Largest f(H, F) that the search finds at corners.
  template <class F>
  [[nodiscard]] double largest(const F& f) const {
    double best = -1e300;
    for (int g = 0; g < gravities_; ++g) {
      for (int start = 0; start < 6; ++start) best = std::max(best, climb(g, start, f));
    }
    return best;
  }

  /// Smallest and largest v . (C^T delta) over all corners, exactly.
  [[nodiscard]] Span along(const Vec2<double>& v) const {
    Span out = nothing;
    for (int g = 0; g < gravities_; ++g) {
      Span sum;
      for (int k = 0; k < parts_; ++k) {
        Span part = nothing;
        for (int c = 0; c < count_[k]; ++c) part.hold(dot(v, share(g, k, c).F));
        sum.add(part.low, part.high);
      }
      out.low = std::min(out.low, sum.low);
      out.high = std::max(out.high, sum.high);
    }
    return out;
  }
  /// Calls f(C^T delta), believed less true, N or N m, for each gravity and eight directions: at the corner
  /// that pushes most along it. Not all corners.
  template <class F>
  void each_push(const F& f) const {
    for (int g = 0; g < gravities_; ++g) {
      for (int d = 0; d < 8; ++d) {
        const double angle = 0.7853981633974483 * d;
        const Vec2<double> v(std::cos(angle), std::sin(angle));
        Vec2<double> sum = Vec2<double>::Zero();
        for (int k = 0; k < parts_; ++k) sum += share(g, k, pushing(g, k, v, 0)).F;
        f(sum);
      }
    }
  }
  /// Smallest and largest v . H v over all corners.
  [[nodiscard]] Span energy(const Vec2<double>& v) const {
    Span sum;
    for (int k = 0; k < parts_; ++k) {
      Span part = nothing;
      for (int c = 0; c < count_[k]; ++c) part.hold(v.dot(share(0, k, c).H * v));
      sum.add(part.low, part.high);
    }
    return sum;
  }

 private:
  [[nodiscard]] const Share& share(int g, int part, int corner) const { return shares_[g][part][corner]; }

  void fill(const Uncertain<M>& u, const State<M>& s, double swing, double g, const Mat<double, 2, 2>& tip) {
    parts_ = 0;
    for (int b = 0; b < M::joints; ++b) {
      const Bar bar = Uncertain<M>::bar(s, b);
      const Box& box = u.box(b);
      int n = 0;
      for (const double m : ends(box.m)) {
        for (const double J : ends(box.J)) {
          for (const double o : ends(box.offset)) {
            const Corner c{m, J, o};
            const Wrench w = u.lack(bar, box, c, g);
            put(n++, {Uncertain<M>::inertia(bar, c), bar.A.transpose() * w.force + bar.turn * w.moment});
          }
        }
      }
      close(n);
    }
    int n = 0;
    for (const double load : ends(u.payload()))
      put(n++, {tip.transpose() * tip * (u.own_tip() + load), tip.transpose() * u.tip_lack(s, load, g)});
    close(n);
    for (int j = 0; j < M::joints; ++j) {
      const Span f = u.friction(s, j, swing);
      const int row = Uncertain<M>::first + 8 * (j / 2) + j % 2;
      const Vec2<double> turn(s.column[0][row], s.column[1][row]);
      n = 0;
      for (const double v : ends({f.low, f.high})) put(n++, {Mat<double, 2, 2>::Zero(), turn * v});
      close(n);
    }
  }
  struct Ends {
    double v[2];
    int n;
    [[nodiscard]] const double* begin() const { return v; }
    [[nodiscard]] const double* end() const { return v + n; }
  };
  static Ends ends(const Interval& i) { return {{i.lower, i.upper}, i.lower == i.upper ? 1 : 2}; }
  void put(int corner, const Share& s) { shares_[gravities_][parts_][corner] = s; }
  void close(int n) { count_[parts_++] = n; }

  /// The corner of a part that pushes most along v: `at` where none pushes more.
  [[nodiscard]] int pushing(int g, int part, const Vec2<double>& v, int at) const {
    for (int c = 0; c < count_[part]; ++c) {
      if (dot(v, share(g, part, c).F) > dot(v, share(g, part, at).F)) at = c;
    }
    return at;
  }
  /// Start 0..3: every part at the corner that pushes most along a direction; 4, 5: first and last corners.
  template <class F>
  [[nodiscard]] double climb(int g, int start, const F& f) const {
    List<int, parts_max> at{};
    Share sum{Mat<double, 2, 2>::Zero(), Vec2<double>::Zero()};
    const double angle = 0.7853981633974483 * start;
    const Vec2<double> v(std::cos(angle), std::sin(angle));
    for (int k = 0; k < parts_; ++k) {
      at[k] = start == 4 ? 0 : (start == 5 ? count_[k] - 1 : pushing(g, k, v, count_[k] - 1));
      sum.H += share(g, k, at[k]).H;
      sum.F += share(g, k, at[k]).F;
    }
    double best = f(sum.H, sum.F);
    for (bool better = true; better;) {
      better = false;
      for (int k = 0; k < parts_; ++k) {
        for (int c = 0; c < count_[k]; ++c) {
          if (c == at[k]) continue;
          const Share tried{sum.H - share(g, k, at[k]).H + share(g, k, c).H,
                            sum.F - share(g, k, at[k]).F + share(g, k, c).F};
          const double value = f(tried.H, tried.F);
          if (!(value > best + 1e-12 * std::abs(best))) continue;
          best = value;
          sum = tried;
          at[k] = c;
          better = true;
        }
      }
    }
    return best;
  }

  Mat<double, 2, 2> believed_;
  int parts_ = 0, gravities_ = 0;
  List<int, parts_max> count_{};
  List<List<List<Share, corners_max>, parts_max>, 2> shares_;
};

}  // namespace esmc::host::design
