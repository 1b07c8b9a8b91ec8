#pragma once
/// Serial chains of firmware/mechanism coupled at points, in redundant coordinates with closure multipliers:
///   M a + A^T lambda = Q,   A a = gamma                                             [F11] with C = 1
/// M, Q and the rows of A and gamma are passes along the chains (`rates`, `bias`, `joint_torques`, `tip_*` of
/// Serial).
///
/// Where closure is regular, lambda comes from A M^-1 A^T. That squares the condition number, so next to a
/// loss of rank the rows of A are made orthonormal in the metric of M^-1 instead. At the loss itself A leaves
/// a direction undetermined: the acceleration is interpolated from instants before and after.

#include <array>
#include <cmath>
#include <limits>
#include <tuple>

#include "firmware/mechanism/serial.hpp"

namespace esmc::host {

/// L D L^T of a small symmetric positive definite matrix, of which the lower triangle is read; unrolled. Not
/// Eigen's LLT: with two solutions each, 2 x 2 takes that 15 ns and this 4 ns, 4 x 4 258 and 46, 6 x 6 464
/// and 179.
template <int N>
class Ldlt {
 public:
  using Matrix = Mat<double, N, N>;
  using Vector = Vec<double, N>;

  Ldlt() = default;
  explicit Ldlt(const Matrix& s) {
    unroll<N>([&](auto j) {
      double pivot = s.coeff(j, j);
      Vector scaled;  // row j of L times D
      unroll<j>([&](auto k) {
        scaled[k] = l_[j][k] * d_[k];
        pivot -= scaled[k] * l_[j][k];
      });
      d_[j] = pivot;
      inverse_[j] = 1.0 / pivot;
      unroll<N - 1 - j>([&](auto below) {
        constexpr int i = j + 1 + below;
        double v = s.coeff(i, j);
        unroll<j>([&](auto k) { v -= l_[i][k] * scaled[k]; });
        l_[i][j] = v * inverse_[j];
      });
    });
  }

  /// Entry i of D: the diagonal entry less its share in the rows before. Not positive or NaN: singular.
  [[nodiscard]] double pivot(int i) const { return d_[i]; }

  /// x of S x = b; not finite where a pivot is 0.
  [[nodiscard]] Vector solve(Vector b) const {
    unroll<N>([&](auto i) { unroll<i>([&](auto k) { b[i] -= l_[i][k] * b[k]; }); });
    unroll<N>([&](auto i) { b[i] *= inverse_[i]; });
    unroll<N>([&](auto up) {
      constexpr int i = N - 1 - up;
      unroll<up>([&](auto k) { b[i] -= l_[i + 1 + k][i] * b[i + 1 + k]; });
    });
    return b;
  }

 private:
  List<List<double, N>, N> l_{};  // below the diagonal
  Vector d_, inverse_;
};

/// The tip of one chain on the tip of another. The closure is tip(First) - tip(Second) = 0 in N.
template <int First, int Second>
struct TipOnTip {
  static constexpr int sign(int chain) { return chain == First ? 1 : chain == Second ? -1 : 0; }
};
template <class... Points>
struct Closures {};

template <class ClosureList, class... Chains>
class ClosedChains;

template <class... Points, class... Chains>
class ClosedChains<Closures<Points...>, Chains...> {
 public:
  static constexpr int chains = sizeof...(Chains);
  static constexpr int points = sizeof...(Points);
  static constexpr int coordinates = (Chains::joints + ... + 0);
  static constexpr int rows = 2 * points;
  using Coordinates = Vec<double, coordinates>;  ///< all joints, chain after chain: rad or m
  using Rows = Vec<double, rows>;
  using Poses = std::tuple<typename Chains::Pose...>;

  /// How the chains stand in N.
  struct Mounting {
    List<Vec2<double>, chains> base{};       ///< origin of each chain, m
    Coordinates zero = Coordinates::Zero();  ///< joint coordinate of the chain less the one of this class
  };

  /// Copies the chains; nothing is checked.
  ClosedChains(const Chains&... chain, const Mounting& mounting) : chain_(chain...), mounting_(mounting) {
    each([&](auto c) {
      double length = 0.0;
      for (int i = 0; i < size(c); ++i) length += std::abs(this->chain<c>().body(i).length);
      reach_ = std::fmax(reach_, length);
    });
  }

  template <int C>
  [[nodiscard]] const auto& chain() const {
    return std::get<C>(chain_);
  }
  /// Index of the first joint of a chain among all.
  static constexpr int first(int chain) {
    int sum = 0;
    for (int c = 0; c < chain; ++c) sum += size(c);
    return sum;
  }

  /// Accelerations of all joints, rad/s2 or m/s2. `load(poses, force)`, poses(c) being the pose of chain c,
  /// adds generalised forces on the joints, N m or N, to those of gravity and friction. Next to a loss of
  /// rank the state must be closed; at rest there, the acceleration minimises Gauss's constraint.
  template <class Load>
  [[nodiscard]] Coordinates acceleration(const Coordinates& q, const Coordinates& v, const Load& load) const {
    bool full = true;
    const bool moving = v.cwiseAbs().maxCoeff() > 0.0;
    const Coordinates a = accelerate(q, v, load, moving ? kCloseShare : kNoShare, full);
    return full || !moving ? a : interpolated(q, v, load);
  }

  /// Moves q and v onto the closure by the least change in the metric of M: at most four Newton steps for q,
  /// one for v. Directions in which the closure has lost rank stay. Judge the result by gap().
  void project(Coordinates& q, Coordinates& v) const {
    const double nothing = 4.0 * std::numeric_limits<double>::epsilon() * reach_;
    for (int round = 0;; ++round) {
      const Frame f = frame(q);
      const Rows open = gap(f);
      bool full = true;
      if (round == 4 || !(open.cwiseAbs().maxCoeff() > nothing)) {
        v -= shortest(f, closure_rates(f, v), kCloseShare, full);
        return;
      }
      q -= shortest(f, open, kCloseShare, full);
    }
  }

  /// Number of closure equations (two per point) that are independent of the others; `rows` where closure is
  /// regular.
  [[nodiscard]] int rank(const Coordinates& q) const { return Basis(frame(q), kNoShare).rank; }

  /// Closures in position, m: zero when the chains are closed.
  [[nodiscard]] Rows gap(const Coordinates& q) const { return gap(frame(q)); }

 private:
  static constexpr List<int, chains> sizes_{{Chains::joints...}};
  static constexpr int size(int chain) { return sizes_[chain]; }
  /// Closure is close to losing rank where the other rows of A span all but this share of a row, in the mass
  /// metric. With share s rounding eps is s^-1 eps in positions, s^-2 eps in rates, s^-3 eps in
  /// accelerations.
  static constexpr double kCloseShare = 1e-2;
  /// Less than this is rounding.
  static constexpr double kNoShare = 1e-8;
  /// From this square of a share on the squared condition number does no harm.
  static constexpr double kRegularShare = 1e-2;

  template <class Chain>
  struct Part {
    typename Chain::Pose pose{};
    Ldlt<Chain::joints> mass;
    Mat<double, 2, Chain::joints> J;  // tip velocity per joint rate
    Mat<double, Chain::joints, 2> Z;  // M^-1 J^T
  };
  struct Frame {
    std::tuple<Part<Chains>...> parts;
    Ldlt<rows> schur;  // of A M^-1 A^T
    bool regular = true;
  };

  template <class F>
  static constexpr void each(F&& f) {
    unroll<chains>(f);
  }
  /// f(k, c, sign) for every chain c that point k holds.
  template <class F>
  static constexpr void each_end(F&& f) {
    unroll<points>([&](auto k) {
      unroll<chains>([&](auto c) {
        constexpr int s = std::tuple_element_t<k, std::tuple<Points...>>::sign(c);
        if constexpr (s != 0) f(k, c, std::integral_constant<int, s>{});
      });
    });
  }
  template <class V, int C>
  static auto part(const Eigen::MatrixBase<V>& v, std::integral_constant<int, C>) {
    return v.template segment<size(C)>(first(C)).eval();
  }

  [[nodiscard]] Frame frame(const Coordinates& q) const {
    Frame f;
    List<Mat<double, 2, 2>, chains> G;  // what a force at the tip does to the tip
    each([&](auto c) {
      const auto& m = chain<c>();
      auto& p = std::get<c>(f.parts);
      constexpr int n = size(c);
      using Joints = Vec<double, n>;
      p.pose = m.pose(part(q + mounting_.zero, c));
      const auto weight = m.mass();
      Mat<double, n, n> M;
      unroll<n>([&](auto i) {
        const Joints unit = Joints::Unit(i);
        M.col(i) = m.joint_torques(p.pose, m.rates(p.pose, unit).cwiseProduct(weight));
        p.J.col(i) = m.tip_rate(p.pose, unit);
      });
      p.mass = Ldlt<n>(M);
      unroll<2>([&](auto i) { p.Z.col(i) = p.mass.solve(p.J.row(i).transpose()); });
      G[c] = p.J.lazyProduct(p.Z);
    });
    Mat<double, rows, rows> S = Mat<double, rows, rows>::Zero();
    each_end([&](auto k, auto c, auto sign) {
      unroll<k + 1>([&](auto l) {
        constexpr int s = sign * std::tuple_element_t<l, std::tuple<Points...>>::sign(c);
        if constexpr (s > 0) S.template block<2, 2>(2 * k, 2 * l) += G[c];
        if constexpr (s < 0) S.template block<2, 2>(2 * k, 2 * l) -= G[c];
      });
    });
    f.schur = Ldlt<rows>(S);
    unroll<points>([&](auto k) {
      // Against both rows of the point: one alone may be small as a whole.
      const double least = kRegularShare * (S.coeff(2 * k, 2 * k) + S.coeff(2 * k + 1, 2 * k + 1));
      f.regular = f.regular && f.schur.pivot(2 * k) >= least && f.schur.pivot(2 * k + 1) >= least;
    });
    return f;
  }

  [[nodiscard]] Rows gap(const Frame& f) const {
    Rows out = Rows::Zero();
    each_end([&](auto k, auto c, auto sign) {
      out.template segment<2>(2 * k) +=
          double(sign) * (mounting_.base[c] + chain<c>().tip(std::get<c>(f.parts).pose));
    });
    return out;
  }
  /// A v.
  [[nodiscard]] static Rows closure_rates(const Frame& f, const Coordinates& v) {
    Rows out = Rows::Zero();
    List<Vec2<double>, chains> tip;
    each([&](auto c) { tip[c] = std::get<c>(f.parts).J.lazyProduct(part(v, c)); });
    each_end([&](auto k, auto c, auto sign) { out.template segment<2>(2 * k) += double(sign) * tip[c]; });
    return out;
  }

  /// The x of A x = r that is shortest in the metric of M. `full` is cleared where closure has lost rank.
  [[nodiscard]] Coordinates shortest(const Frame& f, const Rows& r, double least_share, bool& full) const {
    if (f.regular) {
      const Rows lambda = f.schur.solve(r);
      List<Vec2<double>, chains> force;
      each([&](auto c) { force[c].setZero(); });
      each_end(
          [&](auto k, auto c, auto sign) { force[c] += double(sign) * lambda.template segment<2>(2 * k); });
      Coordinates x;
      each([&](auto c) {
        x.template segment<size(c)>(first(c)) = std::get<c>(f.parts).Z.lazyProduct(force[c]);
      });
      return x;
    }
    const Basis b(f, least_share);
    full = b.rank == rows;
    return b.shortest(r);
  }

  /// Rows of A made orthonormal in the metric of M^-1, the row with the largest rest first: A = L N. Each row
  /// is orthogonalised twice, so that N is orthonormal to rounding.
  struct Basis {
    List<Coordinates, rows> row{}, weighted{};  // of N, and M^-1 times it
    Mat<double, rows, rows> L = Mat<double, rows, rows>::Zero();
    List<int, rows> order{};
    int rank = 0;

    Basis(const Frame& f, double least_share) {
      List<double, rows> size{};
      for (int i = 0; i < rows; ++i) order[i] = i;
      unroll<points>([&](auto k) {
        unroll<2>([&](auto xy) {
          Coordinates a = Coordinates::Zero();
          each([&](auto c) {
            constexpr int s = std::tuple_element_t<k, std::tuple<Points...>>::sign(c);
            a.template segment<ClosedChains::size(c)>(first(c)) =
                s * std::get<c>(f.parts).J.row(xy).transpose();
          });
          row[2 * k + xy] = a;
          size[2 * k + xy] = a.dot(solve(f, a));
        });
        size[2 * k] = size[2 * k + 1] = std::sqrt(size[2 * k] + size[2 * k + 1]);
      });
      for (int step = 0; step < rows; ++step) {
        int best = step;
        double most = -1.0;
        for (int i = step; i < rows; ++i) {
          auto& a = row[order[i]];
          Coordinates z = solve(f, a);
          for (int again = 0; again < 2; ++again) {
            for (int k = 0; k < step; ++k) {
              const double along = z.dot(row[order[k]]);
              L(order[i], k) += along;
              a -= along * row[order[k]];
              z = solve(f, a);
            }
          }
          const double left = std::sqrt(a.dot(z)) / size[order[i]];
          if (left > most) {
            most = left;
            best = i;
          }
        }
        if (!(most > least_share)) return;
        std::swap(order[step], order[best]);
        auto& a = row[order[step]];
        const double length = std::sqrt(a.dot(solve(f, a)));
        a *= 1.0 / length;
        weighted[order[step]] = solve(f, a);
        L(order[step], step) = length;
        rank = step + 1;
      }
    }
    [[nodiscard]] Coordinates shortest(const Rows& r) const {
      Coordinates x = Coordinates::Zero();
      Rows y;
      for (int i = 0; i < rank; ++i) {
        double v = r[order[i]];
        for (int k = 0; k < i; ++k) v -= L(order[i], k) * y[k];
        y[i] = v / L(order[i], i);
        x += y[i] * weighted[order[i]];
      }
      return x;
    }
    static Coordinates solve(const Frame& f, const Coordinates& a) {
      Coordinates z;
      each([&](auto c) {
        z.template segment<ClosedChains::size(c)>(first(c)) = std::get<c>(f.parts).mass.solve(part(a, c));
      });
      return z;
    }
  };

  template <class Load>
  [[nodiscard]] Coordinates accelerate(const Coordinates& q, const Coordinates& v, const Load& load,
                                       double least_share, bool& full) const {
    const Frame f = frame(q);
    Coordinates force = Coordinates::Zero();
    load(
        [&](auto c) -> const auto& { return std::get<c>(f.parts).pose; }, force);
    List<Vec2<double>, chains> drift;  // tip acceleration at constant rates
    Coordinates a;
    each([&](auto c) {
      const auto& m = chain<c>();
      const auto& p = std::get<c>(f.parts);
      const auto rate = part(v, c);
      const auto resisting = m.joint_torques(p.pose, m.force(m.bias(p.pose, rate, rate), rate));
      a.template segment<size(c)>(first(c)) = p.mass.solve(part(force, c) - resisting);
      drift[c] = m.tip_bias(p.pose, rate, rate);
    });
    Rows missing = -closure_rates(f, a);
    each_end(
        [&](auto k, auto c, auto sign) { missing.template segment<2>(2 * k) -= double(sign) * drift[c]; });
    return a + shortest(f, missing, least_share, full);
  }

  /// The acceleration next to a loss of rank. It is smooth along any smooth curve of states through this one,
  /// so its values on both sides give it to the eighth order; the curve is q + t v, closed by `project`.
  template <class Load>
  [[nodiscard]] Coordinates interpolated(const Coordinates& q, const Coordinates& v, const Load& load) const {
    constexpr double distance =
        0.05;  // rad or m: rounding falls with its third power, the error grows with its eighth
    constexpr std::array<double, 4> weight{56.0 / 70.0, -28.0 / 70.0, 8.0 / 70.0, -1.0 / 70.0};
    const double step = distance / v.cwiseAbs().maxCoeff();
    Coordinates a = Coordinates::Zero();
    for (int i = 0; i < 4; ++i) {
      for (const int side : {-1, 1}) {
        Coordinates there = q + (side * (i + 1) * step) * v, rate = v;
        project(there, rate);
        bool full = true;
        a += weight[static_cast<unsigned>(i)] * accelerate(there, rate, load, kNoShare, full);
      }
    }
    return a;
  }

  std::tuple<Chains...> chain_;
  Mounting mounting_;
  double reach_ = 0.0;
};

}  // namespace esmc::host
