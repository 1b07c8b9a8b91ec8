#pragma once
/// Pieces of a geometric path. A piece is a curve in the plane, or straight in the base joints; its parameter
/// is its length in m, or in rad, but for splines and blends, whose parameter is near it.

#include <array>
#include <cstddef>
#include <vector>

#include "firmware/types.hpp"

namespace esmc::host::plan {

/// A point of a curve and its derivatives by the parameter.
struct CurvePoint {
  Vec2<double> p = Vec2<double>::Zero(), d1 = Vec2<double>::Zero(), d2 = Vec2<double>::Zero(),
               d3 = Vec2<double>::Zero();
};

struct Piece {
  enum class Kind { polynomial, arc, joint } kind = Kind::polynomial;
  /// polynomial: powers of t / scale, m. arc: c[0] the centre, m. joint: c[0] start, rad, c[1] direction.
  std::array<Vec2<double>, 8> c = zeros();
  std::size_t terms = 8;  ///< of c that are not zero
  double scale = 1.0;
  double radius = 0.0, angle = 0.0, turn = 0.0;  ///< arc: m, rad at t = 0, rad per m
  double begin = 0.0, end = 0.0;                 ///< part of the curve that is in the path
  double at = 0.0;                               ///< parameter of the path at `begin`
  std::size_t move = 0, next = 0;                ///< indices of moves; they differ for a blend

  [[nodiscard]] static std::array<Vec2<double>, 8> zeros() {  // Eigen leaves values as they were
    std::array<Vec2<double>, 8> out;
    out.fill(Vec2<double>::Zero());
    return out;
  }
  [[nodiscard]] bool straight() const { return kind == Kind::polynomial && terms == 2; }
  [[nodiscard]] bool blend() const { return move != next; }
  [[nodiscard]] double length() const { return end - begin; }
  /// Point of a curve in the plane; of a joint piece base angles, rad. `third`: d3 as well.
  [[nodiscard]] CurvePoint point(double t, bool third = true) const;
  [[nodiscard]] Vec2<double> position(double t) const;  ///< the same without its derivatives
};

/// Straight in the plane, or with Kind::joint in the base joints, rad. The ends must differ.
[[nodiscard]] Piece line(const Vec2<double>& from, const Vec2<double>& to,
                         Piece::Kind kind = Piece::Kind::polynomial);
/// Circle through three points; false: they are on a line.
[[nodiscard]] bool arc(const Vec2<double>& from, const Vec2<double>& via, const Vec2<double>& to, Piece& out);
/// Natural cubic spline through two points or more, no two neighbours equal.
[[nodiscard]] std::vector<Piece> spline(const std::vector<Vec2<double>>& points);
/// Polynomial of degree 7 from a to b with their first three derivatives: neither speed nor acceleration nor
/// jerk jumps where it meets its neighbours.
[[nodiscard]] Piece blend_between(const CurvePoint& a, const CurvePoint& b);

/// Largest distance between a blend and the corner it replaces, both ways; `stubs`: points of both sides that
/// it leaves out, in order.
[[nodiscard]] double deviation(const Piece& blend, const Vec2<double>& corner,
                               const std::vector<Vec2<double>>& stubs);

}  // namespace esmc::host::plan
