#include "host_sim/report/workspace.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>
#include <utility>

#include "host_sim/plant/kinematics.hpp"

namespace esmc::host {
namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();
constexpr double turn = 2.0 * std::numbers::pi;

double cross(V2 a, V2 b) { return a.x * b.y - a.y * b.x; }
double length(V2 a) { return std::hypot(a.x, a.y); }
V2 along(double angle) { return {std::cos(angle), std::sin(angle)}; }

/// A leg where it stands: base at (x, 0), side -1 for a mirrored one.
struct Leg {
  LegParams<double> p;
  double x, side;
  int bend;

  [[nodiscard]] V2 local(V2 point) const { return {side * (point.x - x), point.y}; }
  /// The annulus of its tip; `slack`: m, for what is computed to lie on the rim.
  [[nodiscard]] bool reaches(V2 point, double slack) const {
    const double r = length(local(point));
    return r <= p.l1 + p.l2 + slack && r >= std::abs(p.l1 - p.l2) - slack;
  }
};

struct Mechanism {
  std::vector<Leg> legs;
  double gravity = 0.0, effector_mass = 0.0;
};

/// Between two points of a path that are further apart than `widest`: more of it.
template <class Point>
void refine(const Point& point, double u0, double u1, V2 to, double widest, WorkspaceMap::Path& path,
            int depth = 6) {
  const double mid = 0.5 * (u0 + u1);
  std::optional<V2> p;
  if (depth > 0 && length(to - path.back()) > widest) p = point(mid);
  if (p) {
    refine(point, u0, mid, *p, widest, path, depth - 1);
    refine(point, mid, u1, to, widest, path, depth - 1);
  } else {
    path.push_back(to);
  }
}

/// The path point(u) over a turn of u, in pieces where there is none; their ends are found by halving.
template <class Point>
void trace(const Point& point, double widest, std::vector<WorkspaceMap::Path>& out) {
  constexpr int steps = 360, halvings = 40;
  struct End {
    double u;
    V2 p;
  };
  const auto end = [&](double in, double beyond) {
    End last{in, *point(in)};
    for (int i = 0; i < halvings; ++i) {
      const double mid = 0.5 * (last.u + beyond);
      const std::optional<V2> p = point(mid);
      if (p) {
        last = {mid, *p};
      } else {
        beyond = mid;
      }
    }
    return last;
  };
  WorkspaceMap::Path path;
  std::optional<V2> before;
  double reached = 0.0;
  for (int k = 0; k <= steps; ++k) {
    const double u = turn * k / steps, former = turn * (k - 1) / steps;
    const std::optional<V2> p = point(u);
    if (p && path.empty()) {
      const End first = k > 0 ? end(u, former) : End{u, *p};
      path.push_back(first.p);
      reached = first.u;
    }
    if (p) {
      refine(point, reached, u, *p, widest, path);
      reached = u;
    } else if (before) {
      const End last = end(former, u);
      refine(point, reached, last.u, last.p, widest, path);
    }
    if (!p || k == steps) {
      WorkspaceMap::Path done = std::exchange(path, {});
      if (done.size() > 1) out.push_back(std::move(done));
    }
    before = p;
  }
}

/// A leg is stretched or folded where its tip is on the rim of its annulus. Only what the other leg reaches
/// exists.
void trace_type1(const Mechanism& m, double widest, std::vector<WorkspaceMap::Path>& out) {
  for (const Leg& leg : m.legs) {
    for (const double radius : {leg.p.l1 + leg.p.l2, std::abs(leg.p.l1 - leg.p.l2)}) {
      const double slack = 1e-12 * radius;
      if (!(radius > 1e-9 * leg.p.l1)) continue;
      const auto rim = [&](double u) -> std::optional<V2> {
        const V2 p = V2{leg.x, 0.0} + radius * along(u);
        if (!std::ranges::all_of(m.legs, [&](const Leg& l) { return l.reaches(p, slack); })) return {};
        return p;
      };
      trace(rim, widest, out);
    }
  }
}

/// Both outer bars on one line, whose direction is u: the second elbow is `span` further along it than the
/// first, which so lies on a circle about the first base and on one about the second base less the span.
/// Regular also where the elbows coincide (span = 0, equal outer bars).
void trace_type2(const Leg& a, const Leg& b, double widest, std::vector<WorkspaceMap::Path>& out) {
  const auto bends_rightly = [](const Leg& leg, V2 elbow, V2 tip) {
    const V2 e = leg.local(elbow);
    return cross(e, leg.local(tip) - e) * leg.bend > 0.0;
  };
  for (const double span : {a.p.l2 + b.p.l2, a.p.l2 - b.p.l2}) {
    for (const int branch : {-1, 1}) {
      const auto locus = [&](double u) -> std::optional<V2> {
        const V2 line = along(u), base{a.x, 0.0}, to = V2{b.x, 0.0} - span * line - base;
        const double d = length(to), middle = (d * d + a.p.l1 * a.p.l1 - b.p.l1 * b.p.l1) / (2.0 * d);
        const double height2 = a.p.l1 * a.p.l1 - middle * middle;
        if (!(height2 >= 0.0)) return {};
        const V2 unit = (1.0 / d) * to, normal{-unit.y, unit.x};
        const V2 elbow = base + middle * unit + (branch * std::sqrt(height2)) * normal;
        const V2 tip = elbow + a.p.l2 * line;
        if (!bends_rightly(a, elbow, tip) || !bends_rightly(b, elbow + span * line, tip)) return {};
        return tip;
      };
      trace(locus, widest, out);
    }
  }
}

/// One node: how the joints move with the effector, and what the motors make of it.
struct Node {
  double force = nan, type2 = nan;
};

Node node(const Mechanism& m, V2 point, const std::vector<MotorLimit>& motors) {
  std::array<V2, 4> gradient{};  // of each joint angle, by the effector: rad/m
  V2 weight{0.0, m.gravity * m.effector_mass};
  double phi = 0.0;
  for (std::size_t j = 0; j < m.legs.size(); ++j) {
    const Leg& leg = m.legs[j];
    const auto theta = reach(leg.p, leg.local(point), leg.bend);
    if (!theta) return {};
    const double outer = (*theta)[0] + (*theta)[1];
    phi += outer;
    const auto by_x = joint_rates(leg.p, *theta, {leg.side, 0.0}),
               by_y = joint_rates(leg.p, *theta, {0.0, 1.0});
    const V2 r1{by_x[0], by_y[0]}, r2{by_x[1], by_y[1]};
    gradient[2 * j] = r1;
    gradient[2 * j + 1] = r2;
    weight = weight +
             (m.gravity * (leg.p.m1 * leg.p.lg1 + leg.p.m2 * leg.p.l1) * std::cos((*theta)[0])) * r1 +
             (m.gravity * leg.p.m2 * leg.p.lg2 * std::cos(outer)) * (r1 + r2);
  }
  Node out;
  if (m.legs.size() == 2) out.type2 = std::sin(phi);
  // Forces of the motors fill a zonotope; the edges of its rim are parallel to the gradients. Its distance
  // from the weight is least across one of them.
  for (const MotorLimit& edge : motors) {
    const V2 g = gradient[edge.joint];
    const V2 normal = (1.0 / length(g)) * V2{-g.y, g.x};
    double support = -std::abs(dot(weight, normal));
    for (const MotorLimit& motor : motors)
      support += motor.torque * std::abs(dot(gradient[motor.joint], normal));
    if (!(support >= out.force)) out.force = support;
  }
  return out;
}

WorkspaceMap map_of(const Mechanism& m, const std::vector<MotorLimit>& motors, int nodes) {
  WorkspaceMap out;
  out.x0 = out.y0 = -std::numeric_limits<double>::infinity();
  out.x1 = out.y1 = -out.x0;
  for (const Leg& leg : m.legs) {
    const double r = leg.p.l1 + leg.p.l2;
    out.x0 = std::max(out.x0, leg.x - r);
    out.x1 = std::min(out.x1, leg.x + r);
    out.y0 = std::max(out.y0, -r);
    out.y1 = std::min(out.y1, r);
  }
  if (!(out.x1 > out.x0)) return out;  // bases too far apart
  const double width = out.x1 - out.x0, height = out.y1 - out.y0,
               cell = std::max(width, height) / (nodes - 1);
  out.columns = std::max(2, static_cast<int>(std::ceil(width / cell - 1e-9)) + 1);
  out.rows = std::max(2, static_cast<int>(std::ceil(height / cell - 1e-9)) + 1);
  for (int row = 0; row < out.rows; ++row) {
    for (int column = 0; column < out.columns; ++column) {
      const Node n = node(
          m, {out.x0 + width * column / (out.columns - 1), out.y0 + height * row / (out.rows - 1)}, motors);
      if (!motors.empty()) out.force.push_back(n.force);
      if (m.legs.size() == 2) out.type2_sine.push_back(n.type2);
    }
  }
  const double widest = 0.01 * std::max(width, height);
  trace_type1(m, widest, out.type1);
  if (m.legs.size() == 2) trace_type2(m.legs[0], m.legs[1], widest, out.type2);
  return out;
}

}  // namespace

WorkspaceMap workspace_map(const FiveBarParams<double>& m, const std::array<int, 2>& bend,
                           const std::vector<MotorLimit>& motors, int nodes) {
  return map_of({{{m.legs[0], m.l0, 1.0, bend[0]}, {m.legs[1], -m.l0, -1.0, bend[1]}}, m.g, m.m0}, motors,
                nodes);
}

WorkspaceMap workspace_map(const RrParams<double>& m, int bend, const std::vector<MotorLimit>& motors,
                           int nodes) {
  return map_of({{{m.arm, 0.0, 1.0, bend}}, m.g, 0.0}, motors, nodes);
}

nlohmann::ordered_json mechanism_json(const FiveBarParams<double>& m, bool five_bar) {
  auto legs = nlohmann::ordered_json::array();
  for (std::size_t j = 0; j < (five_bar ? 2U : 1U); ++j)
    legs.push_back({{"l1", m.legs[j].l1}, {"l2", m.legs[j].l2}});
  return {{"type", five_bar ? "five_bar" : "rr"},
          {"half_base", five_bar ? nlohmann::ordered_json(m.l0) : nlohmann::ordered_json(nullptr)},
          {"legs", std::move(legs)}};
}

}  // namespace esmc::host
