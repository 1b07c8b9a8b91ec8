#include "host_sim/plan/piece.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "host_sim/plan/spline.hpp"

namespace esmc::host::plan {
namespace {

/// Distance of a point from the line from a to b.
double distance(const Vec2<double>& p, const Vec2<double>& a, const Vec2<double>& b) {
  const Vec2<double> along = b - a;
  const double square = along.squaredNorm();
  const double share = square > 0.0 ? std::clamp((p - a).dot(along) / square, 0.0, 1.0) : 0.0;
  return (p - a - share * along).norm();
}

}  // namespace

CurvePoint Piece::point(double t, bool third) const {
  CurvePoint out;
  switch (kind) {
    case Kind::polynomial: {
      const double u = t / scale;
      for (std::size_t k = terms; k-- > 0;) {  // Horner's rule, with three derivatives
        if (third) out.d3 = out.d3 * u + 3.0 * out.d2;
        out.d2 = out.d2 * u + 2.0 * out.d1;
        out.d1 = out.d1 * u + out.p;
        out.p = out.p * u + c[k];
      }
      out.d1 /= scale;
      out.d2 /= scale * scale;
      out.d3 /= scale * scale * scale;
      break;
    }
    case Kind::arc: {
      const double phi = angle + turn * t;
      const Vec2<double> r(radius * std::cos(phi), radius * std::sin(phi));
      out.p = c[0] + r;
      out.d1 = perp(r) * turn;
      out.d2 = -r * (turn * turn);
      out.d3 = -perp(r) * (turn * turn * turn);
      break;
    }
    case Kind::joint:
      out.p = c[0] + c[1] * t;
      out.d1 = c[1];
      break;
  }
  return out;
}

Vec2<double> Piece::position(double t) const {
  if (kind != Kind::polynomial) return point(t).p;
  Vec2<double> p = Vec2<double>::Zero();
  for (std::size_t k = terms; k-- > 0;) p = p * (t / scale) + c[k];
  return p;
}

Piece line(const Vec2<double>& from, const Vec2<double>& to, Piece::Kind kind) {
  Piece out;
  out.kind = kind;
  out.terms = 2;
  out.end = (to - from).norm();
  out.c[0] = from;
  out.c[1] = (to - from) / out.end;
  return out;
}

bool arc(const Vec2<double>& from, const Vec2<double>& via, const Vec2<double>& to, Piece& out) {
  const Vec2<double> a = via - from, b = to - from;
  const double area = cross(a, b), size = a.norm() * b.norm() * (to - via).norm();
  if (!(std::abs(area) > 1e-9 * a.norm() * b.norm()) || !(size > 0.0)) return false;
  out.kind = Piece::Kind::arc;
  out.c[0] = from + perp(Vec2<double>(a * b.squaredNorm() - b * a.squaredNorm())) * (0.5 / area);
  out.radius = 0.5 * size / std::abs(area);
  const auto angle_of = [&](const Vec2<double>& p) {
    const Vec2<double> r = p - out.c[0];
    return std::atan2(r.y(), r.x());
  };
  out.angle = angle_of(from);
  const double sense = area > 0.0 ? 1.0 : -1.0;
  double swept = sense * (angle_of(to) - out.angle);
  if (swept <= 0.0) swept += 2.0 * std::numbers::pi;
  out.turn = sense / out.radius;
  out.end = swept * out.radius;
  return true;
}

std::vector<Piece> spline(const std::vector<Vec2<double>>& points) {
  if (points.size() == 2) return {line(points[0], points[1])};
  std::vector<double> span;
  for (std::size_t i = 0; i + 1 < points.size(); ++i) span.push_back((points[i + 1] - points[i]).norm());
  const std::vector<Vec2<double>> m = second_derivatives(points, span);
  std::vector<Piece> out;
  for (std::size_t i = 0; i + 1 < points.size(); ++i) {
    Piece p;
    p.terms = 4;
    const double h = p.end = span[i];
    p.c[0] = points[i];
    p.c[1] = (points[i + 1] - points[i]) / h - h / 6.0 * (2.0 * m[i] + m[i + 1]);
    p.c[2] = 0.5 * m[i];
    p.c[3] = (m[i + 1] - m[i]) / (6.0 * h);
    out.push_back(p);
  }
  return out;
}

Piece blend_between(const CurvePoint& a, const CurvePoint& b) {
  Piece out;
  const double pace = 0.5 * (a.d1.norm() + b.d1.norm());
  double length = (b.p - a.p).norm() / pace;
  for (int pass = 0; pass < 3; ++pass) {  // its parameter runs as fast as that of its neighbours
    const double L = length, L2 = L * L, L3 = L2 * L;
    auto& c = out.c;
    c[0] = a.p;
    c[1] = a.d1 * L;
    c[2] = a.d2 * (0.5 * L2);
    c[3] = a.d3 * (L3 / 6.0);
    const Vec2<double> r0 = b.p - c[0] - c[1] - c[2] - c[3], r1 = b.d1 * L - c[1] - 2.0 * c[2] - 3.0 * c[3],
                       r2 = b.d2 * L2 - 2.0 * c[2] - 6.0 * c[3], r3 = b.d3 * L3 - 6.0 * c[3];
    c[4] = 35.0 * r0 - 15.0 * r1 + 2.5 * r2 - r3 / 6.0;
    c[5] = -84.0 * r0 + 39.0 * r1 - 7.0 * r2 + 0.5 * r3;
    c[6] = 70.0 * r0 - 34.0 * r1 + 6.5 * r2 - 0.5 * r3;
    c[7] = -20.0 * r0 + 10.0 * r1 - 2.0 * r2 + r3 / 6.0;
    out.scale = out.end = L;
    double sum = 0.0;
    Vec2<double> last = a.p;
    constexpr int parts = 16;
    for (int i = 1; i <= parts; ++i) {
      const Vec2<double> now = out.position(L * i / parts);
      sum += (now - last).norm();
      last = now;
    }
    length = sum / pace;
  }
  return out;
}

double deviation(const Piece& blend, const Vec2<double>& corner, const std::vector<Vec2<double>>& stubs) {
  constexpr int parts = 64;
  double to_corner = 1e300, from_stubs = 0.0;
  for (int i = 0; i <= parts; ++i) {
    const Vec2<double> p = blend.position(blend.end * i / parts);
    to_corner = std::min(to_corner, (p - corner).norm());
    double nearest = 1e300;
    for (std::size_t k = 0; k + 1 < stubs.size(); ++k)
      nearest = std::min(nearest, distance(p, stubs[k], stubs[k + 1]));
    from_stubs = std::max(from_stubs, nearest);
  }
  return std::max(to_corner, from_stubs);
}

}  // namespace esmc::host::plan
