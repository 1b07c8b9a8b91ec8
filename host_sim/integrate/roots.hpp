#pragma once
/// One root in a bracket, by ITP: I. Oliveira, R. Takahashi, ACM TOMS 47 (2020) 5. Superlinear on smooth
/// functions, and never worse than one more evaluation than bisection.

#include <algorithm>
#include <cmath>

namespace esmc::host {

struct Bracket {
  double before, after;  ///< the function has its old sign at `before`, its new one (or 0) at `after`
};

/// f(a) and f(b) of opposite sign, f(b) possibly 0; a < b. Ends when the bracket is at most `width` > 0 wide
/// or has no double inside, after at most 128 evaluations. A NaN value of f counts as the old sign.
template <class F>
[[nodiscard]] Bracket bracket_root(const F& f, double a, double fa, double b, double fb, double width) {
  const double sign = fa < 0.0 ? 1.0 : -1.0;  // sign f rises
  double ya = sign * fa, yb = sign * fb;
  const double half_width = 0.5 * width, k1 = 0.2 / (b - a);
  int budget = static_cast<int>(std::clamp(std::ceil(std::log2((b - a) / width)), 0.0, 126.0)) + 1;
  for (; budget >= 0 && b - a > width; --budget) {
    const double middle = a + 0.5 * (b - a);
    if (!(middle > a && middle < b)) break;
    const double secant = (yb * a - ya * b) / (yb - ya);
    const double toward = middle >= secant ? 1.0 : -1.0;
    const double truncation = k1 * (b - a) * (b - a);
    const double truncated = truncation <= std::abs(middle - secant) ? secant + toward * truncation : middle;
    const double radius = std::max(0.0, half_width * std::ldexp(1.0, budget) - 0.5 * (b - a));
    double x = std::abs(truncated - middle) <= radius ? truncated : middle - toward * radius;
    if (!(x > a && x < b)) x = middle;
    const double y = sign * f(x);
    if (y >= 0.0) {
      b = x;
      yb = y;
    } else {
      a = x;
      ya = std::isnan(y) ? ya : y;
    }
  }
  return {a, b};
}

}  // namespace esmc::host
