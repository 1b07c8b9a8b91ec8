// The map of a report against derivations of its own: elbows as intersections of circles, joint angles by
// differences, torques by solving for them.

#include "host_sim/report/workspace.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "host_sim/report/series.hpp"

namespace esmc::host {
namespace {

double cross(V2 a, V2 b) { return a.x * b.y - a.y * b.x; }

/// Elbow of a leg with its base at (x, 0), of the two the one whose outer bar turns left (+1) or right (-1)
/// of the inner one, seen from the front.
V2 elbow(const LegParams<double>& leg, double x, V2 tip, int left) {
  const V2 to = tip - V2{x, 0.0};
  const double d2 = dot(to, to), a = (d2 + leg.l1 * leg.l1 - leg.l2 * leg.l2) / (2.0 * d2);
  const double h = std::sqrt(std::max(0.0, leg.l1 * leg.l1 / d2 - a * a));
  // The outer bar turns left where the elbow lies to the right of the line from base to tip.
  return V2{x, 0.0} + a * to + (-left * h) * V2{-to.y, to.x};
}

struct Case {
  FiveBarParams<double> m;
  std::array<int, 2> bend;

  [[nodiscard]] std::array<V2, 2> elbows(V2 tip) const {
    return {elbow(m.legs[0], m.l0, tip, bend[0]), elbow(m.legs[1], -m.l0, tip, -bend[1])};
  }
  /// Sine of the angle between the outer bars; 0 at type 2.
  [[nodiscard]] double between(V2 tip) const {
    const auto e = elbows(tip);
    return cross(tip - e[0], tip - e[1]) / (m.legs[0].l2 * m.legs[1].l2);
  }
  [[nodiscard]] double rim(std::size_t leg, V2 tip) const {  // distance from the nearer circle of type 1
    const LegParams<double>& p = m.legs[leg];
    const double r = std::hypot(tip.x - (leg == 0 ? m.l0 : -m.l0), tip.y);
    return std::min(std::abs(r - p.l1 - p.l2), std::abs(r - std::abs(p.l1 - p.l2)));
  }
  [[nodiscard]] bool reaches(V2 tip, double slack) const {
    for (std::size_t j = 0; j < 2; ++j) {
      const double r = std::hypot(tip.x - (j == 0 ? m.l0 : -m.l0), tip.y);
      if (!(r <= m.legs[j].l1 + m.legs[j].l2 + slack && r >= std::abs(m.legs[j].l1 - m.legs[j].l2) - slack))
        return false;
    }
    return true;
  }
  /// Joint angles as the model counts them: leg 2 in its mirrored frame.
  [[nodiscard]] std::array<double, 4> angles(V2 tip) const {
    const auto e = elbows(tip);
    const V2 a = e[0] - V2{m.l0, 0}, b = tip - e[0], c = e[1] + V2{m.l0, 0}, d = tip - e[1];
    return {std::atan2(a.y, a.x), std::atan2(b.y, b.x) - std::atan2(a.y, a.x), std::atan2(c.y, -c.x),
            std::atan2(d.y, -d.x) - std::atan2(c.y, -c.x)};
  }
  [[nodiscard]] double potential(V2 tip) const {
    const auto e = elbows(tip);
    double v = m.m0 * tip.y;
    for (std::size_t j = 0; j < 2; ++j) {
      const LegParams<double>& p = m.legs[j];
      v += p.m1 * p.lg1 / p.l1 * e[j].y + p.m2 * (e[j].y + p.lg2 / p.l2 * (tip.y - e[j].y));
    }
    return m.g * v;
  }
};

std::vector<Case> cases() {
  std::mt19937_64 random(7);
  const auto between = [&](double lo, double hi) {
    return lo + (hi - lo) * static_cast<double>(random() >> 11U) * 0x1p-53;
  };
  std::vector<Case> out;
  for (int n = 0; n < 12; ++n) {
    FiveBarParams<double> m;
    m.l0 = between(0.03, 0.15);
    m.m0 = between(0.0, 0.3);
    m.g = n % 3 == 0 ? 0.0 : 9.8;
    for (LegParams<double>& p : m.legs)
      p = {.l1 = between(0.1, 0.2),
           .l2 = between(0.1, 0.2),
           .lg1 = between(0.02, 0.1),
           .lg2 = between(0.02, 0.1),
           .m1 = between(0.05, 0.3),
           .m2 = between(0.05, 0.3),
           .J1 = 2e-4,
           .J2 = 7e-4};
    if (n % 4 == 1) m.legs[1] = m.legs[0];               // outer bars that can lie on each other
    if (n % 4 == 2) m.legs[1].l2 = m.legs[0].l2 + 1e-7;  // nearly
    for (const int a : {-1, 1})
      for (const int b : {-1, 1}) out.push_back({m, {a, b}});
  }
  return out;
}

const std::vector<MotorLimit> base_motors{{0, 2.0}, {2, 1.5}};

TEST(Workspace, LociAreSingular) {
  for (const Case& c : cases()) {
    const WorkspaceMap map = workspace_map(c.m, c.bend, {}, 3);
    ASSERT_FALSE(map.type1.empty());
    for (const auto& path : map.type1) {
      for (const V2 p : path) {
        EXPECT_LT(std::min(c.rim(0, p), c.rim(1, p)), 1e-9);
        EXPECT_TRUE(c.reaches(p, 1e-9));
      }
    }
    std::size_t points = 0;
    for (const auto& path : map.type2) {
      ASSERT_GT(path.size(), 1U);
      for (std::size_t k = 1; k < path.size(); ++k) {  // drawn as straight pieces
        EXPECT_LT(std::hypot(path[k].x - path[k - 1].x, path[k].y - path[k - 1].y), 0.02 * (map.y1 - map.y0));
      }
      for (const V2 p : path) {
        ++points;
        EXPECT_TRUE(c.reaches(p, 1e-9));
        // On the rim the elbow is known to the root of the rounding only.
        if (std::min(c.rim(0, p), c.rim(1, p)) > 1e-6) {
          EXPECT_NEAR(c.between(p), 0.0, 1e-8);
        }
      }
    }
    EXPECT_GT(points, 0U);
  }
}

/// Nothing is left out: where the sign of a field changes between neighbours, a locus passes. The rim is
/// always traced.
TEST(Workspace, LociAreWhole) {
  int crossings = 0, rims = 0;
  for (const Case& c : cases()) {
    const WorkspaceMap map = workspace_map(c.m, c.bend, {}, 61);
    const double dx = (map.x1 - map.x0) / (map.columns - 1), dy = (map.y1 - map.y0) / (map.rows - 1);
    const auto near = [&](const std::vector<WorkspaceMap::Path>& paths, V2 p, double distance) {
      for (const auto& path : paths) {
        for (std::size_t k = 1; k < path.size(); ++k) {
          const V2 along = path[k] - path[k - 1], to = p - path[k - 1];
          const double t = std::clamp(dot(to, along) / std::max(dot(along, along), 1e-30), 0.0, 1.0);
          const V2 off = to - t * along;
          if (std::hypot(off.x, off.y) < distance) return true;
        }
      }
      return false;
    };
    const auto at = [&](int i, int j) { return V2{map.x0 + dx * i, map.y0 + dy * j}; };
    for (int j = 0; j < map.rows; ++j) {
      for (int i = 0; i + 1 < map.columns; ++i) {
        const V2 p = at(i, j), q = at(i + 1, j);
        const bool in_p = c.reaches(p, 0.0), in_q = c.reaches(q, 0.0);
        if (in_p != in_q) {
          ++rims;
          EXPECT_TRUE(near(map.type1, 0.5 * (p + q), dx));
        }
        if (!in_p || !in_q || std::min({c.rim(0, p), c.rim(1, p), c.rim(0, q), c.rim(1, q)}) < 0.1 * dx)
          continue;
        if ((c.between(p) > 0) == (c.between(q) > 0)) continue;
        ++crossings;
        EXPECT_TRUE(near(map.type2, 0.5 * (p + q), dx)) << p.x << " " << p.y;
      }
    }
  }
  EXPECT_GT(crossings, 1000);
  EXPECT_GT(rims, 1000);
}

TEST(Workspace, FieldsAreThoseOfTheMechanism) {
  constexpr double h = 1e-6;
  int seen = 0, weak = 0;
  for (const Case& c : cases()) {
    const WorkspaceMap map = workspace_map(c.m, c.bend, base_motors, 24);
    ASSERT_EQ(map.force.size(), static_cast<std::size_t>(map.columns * map.rows));
    for (int j = 0; j < map.rows; ++j) {
      for (int i = 0; i < map.columns; ++i) {
        const auto k = static_cast<std::size_t>(j * map.columns + i);
        const V2 p{map.x0 + (map.x1 - map.x0) * i / (map.columns - 1),
                   map.y0 + (map.y1 - map.y0) * j / (map.rows - 1)};
        if (std::min(c.rim(0, p), c.rim(1, p)) < 1e-3) continue;
        if (!c.reaches(p, 0.0)) {
          EXPECT_TRUE(std::isnan(map.force[k]) && std::isnan(map.type2_sine[k]));
          continue;
        }
        ++seen;
        const auto theta = c.angles(p);
        EXPECT_NEAR(map.type2_sine[k], std::sin(theta[0] + theta[1] + theta[2] + theta[3]), 1e-9);
        EXPECT_NEAR(std::abs(map.type2_sine[k]), std::abs(c.between(p)), 1e-9);
        // Torques that a force takes: tau = J^T (F + weight), J the velocity of the effector by the base
        // joints.
        const auto by = [&](auto f) {
          return V2{(f(p + V2{h, 0}) - f(p - V2{h, 0})) / (2 * h),
                    (f(p + V2{0, h}) - f(p - V2{0, h})) / (2 * h)};
        };
        const auto angle = [&](std::size_t joint) {
          return by([&](V2 q) {
            return std::remainder(c.angles(q)[joint] - theta[joint], 2.0 * std::numbers::pi);
          });
        };
        const V2 r1 = angle(0), r2 = angle(2), weight = by([&](V2 q) { return c.potential(q); });
        const double det = cross(r1, r2);
        if (std::abs(map.type2_sine[k]) < 0.05) continue;
        const auto holds = [&](double radius, double direction) {
          const V2 f = weight + radius * V2{std::cos(direction), std::sin(direction)};
          return std::abs(cross(f, r2) / det) <= 2.0 && std::abs(cross(r1, f) / det) <= 1.5;
        };
        const double force = map.force[k];
        if (force < 0) {
          ++weak;
          EXPECT_FALSE(holds(0.0, 0.0));
          continue;
        }
        bool all = true, more = true;
        for (int n = 0; n < 720; ++n) {
          all = all && holds(force * 0.998, n * std::numbers::pi / 360);
          more = more && holds(force * 1.002 + 1e-3, n * std::numbers::pi / 360);
        }
        EXPECT_TRUE(all) << force;
        EXPECT_FALSE(more) << force;
      }
    }
  }
  EXPECT_GT(seen, 3000);
  EXPECT_GT(weak, 0);
}

TEST(Workspace, MoreMotorsAreNotWeaker) {
  const std::vector<MotorLimit> all{{0, 2.0}, {1, 0.5}, {2, 1.5}, {3, 0.5}};
  for (const Case& c : cases()) {
    const WorkspaceMap two = workspace_map(c.m, c.bend, base_motors, 15),
                       four = workspace_map(c.m, c.bend, all, 15);
    for (std::size_t k = 0; k < two.force.size(); ++k) {
      if (!std::isnan(two.force[k])) {
        EXPECT_GE(four.force[k], two.force[k] - 1e-9);
      }
    }
  }
}

/// Closed form: stretched sideways by a right angle without gravity, each motor pulls across the other bar.
TEST(Workspace, Arm) {
  const RrParams<double> arm{
      {.l1 = 0.3, .l2 = 0.4, .lg1 = 0.15, .lg2 = 0.2, .m1 = 1, .m2 = 1, .J1 = 0.01, .J2 = 0.01}, 0.0};
  const WorkspaceMap map = workspace_map(arm, 1, {{0, 7.0}, {1, 3.0}}, 71);
  EXPECT_TRUE(map.type2.empty());
  EXPECT_TRUE(map.type2_sine.empty());
  ASSERT_EQ(map.type1.size(), 2U);
  for (const V2 p : map.type1[0]) EXPECT_NEAR(std::hypot(p.x, p.y), 0.7, 1e-12);
  for (const V2 p : map.type1[1]) EXPECT_NEAR(std::hypot(p.x, p.y), 0.1, 1e-12);
  // At (0.3, 0.4): theta1 = 0, theta2 = pi/2. Virtual work: F = tau1 r1 + tau2 r2 with r1 = (0, 1/0.3), r2 =
  // (-1/0.4, -1/0.3). Across r1 only motor 2 counts: 3 * 2.5 = 7.5 N; across r2 only motor 1: 7 |r1 x r2| /
  // |r2| = 14 N.
  const auto column =
      static_cast<std::size_t>(std::lround((0.3 - map.x0) / (map.x1 - map.x0) * (map.columns - 1)));
  const auto row = static_cast<std::size_t>(std::lround((0.4 - map.y0) / (map.y1 - map.y0) * (map.rows - 1)));
  EXPECT_NEAR(map.force[row * static_cast<std::size_t>(map.columns) + column], 7.5, 1e-9);
}

TEST(Workspace, BasesTooFarApart) {
  FiveBarParams<double> m;
  m.l0 = 1.0;
  for (LegParams<double>& p : m.legs)
    p = {.l1 = 0.1, .l2 = 0.1, .lg1 = 0, .lg2 = 0, .m1 = 1, .m2 = 1, .J1 = 1, .J2 = 1};
  const WorkspaceMap map = workspace_map(m, {1, 1}, base_motors, 11);
  EXPECT_EQ(map.columns * map.rows, 0);
  EXPECT_TRUE(map.type1.empty() && map.type2.empty());
}

TEST(Histogram, CountsAndQuantiles) {
  Histogram h;
  for (int i = 1; i <= 1000; ++i) h.add(i * 1e-6);
  h.add(std::nan(""));
  h.add(-1.0);
  EXPECT_EQ(h.total(), 1000U);
  EXPECT_NEAR(h.mean(), 500.5e-6, 1e-12);
  EXPECT_EQ(h.largest(), 1e-3);
  EXPECT_GE(h.quantile(0.5), 500e-6);
  EXPECT_LE(h.quantile(0.5), 500e-6 * (1.0 + 1.0 / Histogram::per_octave));
  EXPECT_EQ(h.quantile(1.0), 1e-3);
  for (std::size_t i = 0; i < Histogram::bins; ++i) {  // an edge belongs to the bin that it begins
    Histogram one;
    one.add(Histogram::edge(i));
    EXPECT_EQ(one.counts()[i], 1U);
  }
  EXPECT_EQ(Histogram::edge(0), 0x1p-30);
  EXPECT_EQ(Histogram::edge(Histogram::bins), 0x1p10);
  std::uint64_t sum = 0;
  for (const std::uint64_t n : h.counts()) sum += n;
  EXPECT_EQ(sum, 1000U);
  h.add(0.0);
  h.add(1e9);  // outside: the outermost bins
  EXPECT_EQ(h.counts().front(), 1U);
  EXPECT_EQ(h.counts().back(), 1U);
}

TEST(Binned, KeepsItsSum) {
  for (const std::uint64_t ticks : {1U, 511U, 512U, 513U, 1025U, 5000U}) {
    Binned b;
    for (std::uint64_t i = 0; i < ticks; ++i) b.add(1.0);
    EXPECT_LE(b.bins().size(), Binned::most);
    double sum = 0.0;
    for (std::size_t i = 0; i < b.bins().size(); ++i) {
      sum += b.bins()[i];
      EXPECT_EQ(b.bins()[i], static_cast<double>(i + 1 < b.bins().size() ? b.stride() : b.last_ticks()));
    }
    EXPECT_EQ(sum, static_cast<double>(ticks));
  }
}

}  // namespace
}  // namespace esmc::host
