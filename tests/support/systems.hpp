#pragma once
/// Systems with known solutions, for the integrators. Entries beyond size() hold a mark that must not be
/// touched.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace esmc::test {

inline constexpr double pi = 3.14159265358979323846;
inline constexpr double mark = -123.456;

/// Free systems of n states, two more entries than they use.
template <std::size_t n, std::size_t m>
struct Free {
  static constexpr std::size_t capacity = n + 2;
  static constexpr std::size_t positions = m;
  using State = std::array<double, capacity>;
  static constexpr std::size_t size() { return n; }
  void project(State&) const {}
};

/// Two bodies: r'' = -r / |r|^3, from perihelion, semi-major axis 1.
struct Kepler : Free<4, 2> {
  double e = 0.5;
  [[nodiscard]] State start() const { return exact(0.0); }
  void slope(double, const State& y, State& dy) const {
    const double r = std::hypot(y[0], y[1]), w = 1.0 / (r * r * r);
    dy[0] = y[2];
    dy[1] = y[3];
    dy[2] = -w * y[0];
    dy[3] = -w * y[1];
  }
  /// By Kepler's equation E - e sin E = t.
  [[nodiscard]] State exact(double t) const {
    double E = t;
    for (int i = 0; i < 100; ++i) E -= (E - e * std::sin(E) - t) / (1.0 - e * std::cos(E));
    const double b = std::sqrt(1.0 - e * e), rate = 1.0 / (1.0 - e * std::cos(E));
    return {std::cos(E) - e, b * std::sin(E), -std::sin(E) * rate, b * std::cos(E) * rate, mark, mark};
  }
  [[nodiscard]] double error(double t, const State& y) const {
    const State x = exact(t);
    double worst = 0.0;
    for (std::size_t i = 0; i < size(); ++i) worst = std::max(worst, std::abs(y[i] - x[i]));
    return std::isnan(y[0]) ? y[0] : worst;
  }
};

/// theta'' = -sin theta.
struct Pendulum : Free<2, 1> {
  void slope(double, const State& y, State& dy) const {
    dy[0] = y[1];
    dy[1] = -std::sin(y[0]);
  }
  /// Time of a full swing from rest at `amplitude`: 2 pi / agm(1, cos(amplitude / 2)).
  static double period(double amplitude) {
    double a = 1.0, g = std::cos(0.5 * amplitude);
    for (int i = 0; i < 20; ++i) {
      const double mean = 0.5 * (a + g);
      g = std::sqrt(a * g);
      a = mean;
    }
    return 2.0 * pi / a;
  }
};

/// The pendulum in x, y with its rod as a constraint of index 1: |p| = 1, p . v = 0.
struct RodPendulum {
  static constexpr std::size_t capacity = 4;
  static constexpr std::size_t positions = 2;
  using State = std::array<double, capacity>;
  static constexpr std::size_t size() { return 4; }
  void slope(double, const State& y, State& dy) const {
    // Multiplier from p . a + v . v = 0 with a = (0, -1) - lambda p.
    const double lambda = (y[2] * y[2] + y[3] * y[3] - y[1]) / (y[0] * y[0] + y[1] * y[1]);
    dy = {y[2], y[3], -lambda * y[0], -1.0 - lambda * y[1]};
  }
  void project(State& y) const {
    const double r = std::sqrt(y[0] * y[0] + y[1] * y[1]);
    y[0] /= r;
    y[1] /= r;
    const double along = y[0] * y[2] + y[1] * y[3];
    y[2] -= along * y[0];
    y[3] -= along * y[1];
  }
  static double drift(const State& y) {
    return std::max(std::abs(y[0] * y[0] + y[1] * y[1] - 1.0), std::abs(y[0] * y[2] + y[1] * y[3]));
  }
};

/// y' = lambda (y - cos t) - sin t, y = cos t: Prothero and Robinson (1974).
struct ProtheroRobinson : Free<1, 0> {
  double lambda = -1e6;
  void slope(double t, const State& y, State& dy) const {
    dy[0] = lambda * (y[0] - std::cos(t)) - std::sin(t);
  }
};

/// y'' = ((1 - y^2) y' - y) / epsilon, HW (IV.1.5').
struct VanDerPol : Free<2, 1> {
  double epsilon = 1e-6;
  void slope(double, const State& y, State& dy) const {
    dy[0] = y[1];
    dy[1] = ((1.0 - y[0] * y[0]) * y[1] - y[0]) / epsilon;
  }
};

}  // namespace esmc::test
