#include "host_sim/plan/timing.hpp"

#include <algorithm>
#include <cmath>

namespace esmc::host::plan {
namespace {

/// u <= offset + slope x, or u >= it.
struct Bound {
  double offset = 0.0, slope = 0.0, weight = 0.0;  // weight: |a| of its row
  [[nodiscard]] double at(double x) const { return offset + slope * x; }
  [[nodiscard]] double size(double x) const { return std::abs(offset) + std::abs(slope) * x; }
};

/// The u that a point and the next one allow, for every x of the point.
class Step {
 public:
  void clear(double low, double high) {
    constexpr std::size_t usual = 16;
    upper_.clear();
    lower_.clear();
    upper_.reserve(usual);
    lower_.reserve(usual);
    low_ = low;
    high_ = high;
    next_ = none(-1.0);
  }
  /// a u + b x <= c.
  void add(double a, double b, double c) {
    if (a > 0.0) {
      upper_.push_back({c / a, -b / a, a});
    } else if (a < 0.0) {
      lower_.push_back({c / a, -b / a, -a});
    } else if (b > 0.0) {
      high_ = std::min(high_, c / b);
    } else if (b < 0.0) {
      low_ = std::max(low_, c / b);
    } else if (!(c >= 0.0)) {
      high_ = -1.0;
    }
  }
  /// x + w u >= next, in the place of the last of its kind.
  void set_next(double w, double next) { next_ = {next / w, -1.0 / w, w}; }
  /// The largest u at x. Where rounding leaves none, that which exceeds the rows on both sides alike.
  [[nodiscard]] double most(double x) const {
    const Bound high = upper(x), low = lower(x);
    if (low.at(x) <= high.at(x)) return high.at(x);
    return (high.weight * high.at(x) + low.weight * low.at(x)) / (high.weight + low.weight);
  }
  /// The largest (or smallest) x for which some u is left; negative: none.
  [[nodiscard]] double end(bool largest) const {
    double x = largest ? high_ : low_;
    for (int pass = 0; pass < 100 && x >= low_ && x <= high_; ++pass) {
      const Bound most = upper(x), least = lower(x);
      const double gap = least.at(x) - most.at(x);
      if (gap <= 1e-13 * (least.size(x) + most.size(x))) return x;
      // The gap is convex in x, so that the zero of its tangent is not beyond the true one.
      const double slope = least.slope - most.slope;
      if (largest ? !(slope > 0.0) : !(slope < 0.0)) return -1.0;
      x = (most.offset - least.offset) / slope;
    }
    return -1.0;
  }

 private:
  static Bound none(double sign) { return {sign * 1e300, 0.0, 0.0}; }
  [[nodiscard]] Bound upper(double x) const { return tightest(upper_, none(1.0), x, 1.0); }
  [[nodiscard]] Bound lower(double x) const { return tightest(lower_, next_, x, -1.0); }
  static Bound tightest(const std::vector<Bound>& of, const Bound& other, double x, double sign) {
    const Bound* best = &other;
    double least = sign * other.at(x);
    for (const Bound& b : of) {
      const double now = sign * b.at(x);
      if (now < least) {
        least = now;
        best = &b;
      }
    }
    return *best;
  }
  std::vector<Bound> upper_, lower_;
  Bound next_;
  double low_ = 0.0, high_ = 0.0;
};

constexpr double any_square = 1e12;  ///< where no row bounds x

/// Rows with d folded into b and c: the tangent of sqrt(x) at `about`, which for d > 0 errs on the safe side.
std::vector<Row> straightened(const Grid& grid, const std::vector<double>& about) {
  std::vector<Row> out = grid.rows;
  const double floor = about.empty() ? 1.0 : 1e-6 * *std::max_element(about.begin(), about.end());
  for (std::size_t i = 0; i + 1 < grid.first.size(); ++i) {  // of a middle: the mean of its ends
    const double square = about.empty() ? 0.0 : 0.5 * (about[i / 2] + about[(i + 1) / 2]),
                 root = about.empty() ? 0.0 : std::sqrt(std::max(square, floor));
    for (std::size_t k = grid.first[i]; k < grid.first[i + 1]; ++k) {
      Row& r = out[k];
      if (r.d != 0.0 && root > 0.0) {
        r.b += r.d / (2.0 * root);
        r.c -= r.d * root / 2.0;
      }
      r.d = 0.0;
    }
  }
  return out;
}

/// Slope of u by s in every interval: of those to both neighbours the smaller one, 0 where they differ in
/// sign. Where u jumps, the smooth side counts.
std::vector<double> slopes(const std::vector<double>& s, const std::vector<double>& x) {
  const std::size_t cells = s.size() - 1;
  const auto u = [&](std::size_t i) { return (x[i + 1] - x[i]) / (2.0 * (s[i + 1] - s[i])); };
  const auto right = [&](std::size_t i) { return (u(i + 1) - u(i)) / (0.5 * (s[i + 2] - s[i])); };
  std::vector<double> out(cells, 0.0);
  for (std::size_t i = 0; cells > 1 && i < cells; ++i) {
    const double before = right(i > 0 ? i - 1 : 0), after = right(i + 1 < cells ? i : cells - 2);
    if (before * after > 0.0) out[i] = std::abs(before) < std::abs(after) ? before : after;
  }
  return out;
}

/// One solution. `slope`: of u in every interval, from the solution before; it makes the constant u of an
/// interval the mean of one that changes, so that the error of the grid is of second order.
class Pass {
 public:
  explicit Pass(const Grid& grid) : grid_(grid), step_(grid.s.size() - 1) {}

  std::optional<std::vector<double>> run(const std::vector<Row>& rows, const std::vector<double>& slope,
                                         std::size_t& blocked) {
    const std::size_t n = grid_.s.size() - 1;
    low_.assign(n + 1, 0.0);
    high_.assign(n + 1, 0.0);
    for (std::size_t i = n; i-- > 0;) {
      set(i, rows, slope.empty() ? 0.0 : 0.5 * slope[i] * width(i));
      // From the fastest speed of all the next one may have to be 0: a little less leaves a way to go on.
      for (const double keep : {i + 1 < n && i > 0 ? 0.05 : 0.0, 0.0}) {
        step_[i].set_next(2.0 * width(i), std::max(low_[i + 1], keep * high_[i + 1]));
        high_[i] = step_[i].end(true);
        low_[i] = high_[i] >= 0.0 ? step_[i].end(false) : -1.0;
        if (low_[i] == 0.0) break;
      }
      if (!(high_[i] >= 0.0) || !(low_[i] >= 0.0)) {
        blocked = i;
        return std::nullopt;
      }
    }
    std::vector<double> x(n + 1, 0.0);
    blocked = 0;
    if (low_[0] > 0.0) return std::nullopt;
    for (std::size_t i = 0; i < n; ++i) {
      step_[i].set_next(2.0 * width(i), low_[i + 1]);
      const double u = step_[i].most(x[i]);
      x[i + 1] = std::clamp(x[i] + 2.0 * width(i) * u, low_[i + 1], std::max(low_[i + 1], high_[i + 1]));
      blocked = i + 1;
      if (i + 1 < n && !(x[i + 1] > 0.0) && !(x[i] > 0.0)) return std::nullopt;
    }
    return x;
  }

 private:
  [[nodiscard]] double width(std::size_t i) const { return grid_.s[i + 1] - grid_.s[i]; }
  /// The rows between points i and i + 1; half: change of u from the middle to an end.
  void set(std::size_t i, const std::vector<Row>& rows, double half) {
    const double w = 2.0 * width(i);
    Step& step = step_[i];
    step.clear(0.0, any_square);
    for (std::size_t k = grid_.first[2 * i]; k < grid_.first[2 * i + 1]; ++k)
      step.add(rows[k].a, rows[k].b, rows[k].c + rows[k].a * half);
    for (std::size_t k = grid_.first[2 * i + 1]; k < grid_.first[2 * i + 2]; ++k)
      step.add(rows[k].a + 0.5 * w * rows[k].b, rows[k].b, rows[k].c);
    for (std::size_t k = grid_.first[2 * i + 2]; k < grid_.first[2 * i + 3]; ++k)
      step.add(rows[k].a + w * rows[k].b, rows[k].b, rows[k].c - rows[k].a * half);
    step.add(w, 1.0, high_[i + 1]);
  }

  const Grid& grid_;
  std::vector<Step> step_;
  std::vector<double> low_, high_;
};

double time_along(const std::vector<double>& s, const std::vector<double>& x) {
  double t = 0.0;
  for (std::size_t i = 0; i + 1 < s.size(); ++i)
    t += 2.0 * (s[i + 1] - s[i]) / (std::sqrt(x[i]) + std::sqrt(x[i + 1]));
  return t;
}

}  // namespace

std::vector<double> speed_limits(const Grid& grid) {
  std::vector<double> out;
  Step step;
  for (std::size_t i = 0; i + 1 < grid.first.size(); ++i) {
    double x = 0.0;
    for (int pass = 0; pass < 4; ++pass) {  // the tangent of sqrt(x) at the limit before
      step.clear(0.0, any_square);
      const double root = std::sqrt(std::max(x, 0.0));
      for (std::size_t k = grid.first[i]; k < grid.first[i + 1]; ++k) {
        const Row& r = grid.rows[k];
        step.add(r.a, root > 0.0 ? r.b + r.d / (2.0 * root) : r.b, r.c - 0.5 * r.d * root);
      }
      x = step.end(true);
    }
    out.push_back(x);
  }
  return out;
}

std::optional<Squares> fastest(const Grid& grid, const Squares& start, std::size_t& blocked) {
  const bool viscous = std::ranges::any_of(grid.rows, [](const Row& r) { return r.d != 0.0; });
  Squares out = start;
  Pass pass(grid);
  double before = -1.0;
  const int passes = viscous ? 12 : 5;
  const double points = static_cast<double>(grid.s.size()), enough = std::max(1e-9, 0.3 / (points * points));
  for (int k = 0; k < passes; ++k) {
    const std::vector<double> slope = out.empty() ? out.x : slopes(grid.s, out.x);
    std::size_t at = 0;
    auto better = viscous ? pass.run(straightened(grid, out.x), slope, at) : pass.run(grid.rows, slope, at);
    if (!better && k == 0) blocked = at;
    if (!better && k == 0) return start.empty() ? std::nullopt : fastest(grid, {}, blocked);
    if (!better) break;
    out = {std::move(*better), slope};
    const double now = time_along(grid.s, out.x);
    if (std::abs(now - before) <= enough * now) break;
    before = now;
  }
  if (out.slope.empty()) out.slope.assign(grid.s.size() - 1, 0.0);
  return out;
}

Timing::Timing(const std::vector<double>& s, const Squares& of) : s_(s) {
  t_.assign(s.size(), 0.0);
  sum_ = t_;
  for (const double square : of.x) v_.push_back(std::sqrt(square));
  for (std::size_t i = 0; i + 1 < s.size(); ++i) {
    const double width = s[i + 1] - s[i], mean = 0.5 * (v_[i] + v_[i + 1]), most = mean * mean / width;
    // Acceleration falls from u + half to u - half: mean dt + half dt^2 / 6 = width.
    const double half = std::clamp(-0.5 * of.slope[i] * width, -most, most);
    const double dt = 2.0 * width / (mean + std::sqrt(mean * mean + 2.0 / 3.0 * half * width));
    a_.push_back((v_[i + 1] - v_[i]) / dt + half);
    j_.push_back(-2.0 * half / dt);
    t_[i + 1] = t_[i] + dt;
    sum_[i + 1] = sum_[i] + dt * (s[i] + dt * (0.5 * v_[i] + dt * (a_[i] / 6.0 + dt * j_[i] / 24.0)));
  }
}

Timing Timing::quintic(double length, double duration) {
  Timing out;
  out.quintic_ = true;
  constexpr int parts = 64;
  for (int i = 0; i <= parts; ++i) out.t_.push_back(duration * i / parts);
  out.s_ = {0.0, length};
  return out;
}

std::size_t Timing::cell(double time, bool before) const {
  const auto at =
      before ? std::lower_bound(t_.begin(), t_.end(), time) : std::upper_bound(t_.begin(), t_.end(), time);
  const auto i = static_cast<std::size_t>(std::max<std::ptrdiff_t>(1, at - t_.begin())) - 1;
  return std::min(i, a_.size() - 1);
}

Timing::State Timing::raw(double time, bool before) const {
  if (quintic_) {
    const double T = t_.back(), L = s_.back(), u = std::clamp(time / T, 0.0, 1.0);
    return {L * u * u * u * (10.0 + u * (6.0 * u - 15.0)), L / T * 30.0 * u * u * (1.0 + u * (u - 2.0)),
            L / (T * T) * 60.0 * u * (1.0 + u * (2.0 * u - 3.0))};
  }
  if (time < 0.0 || (time == 0.0 && before)) return {0.0, 0.0, 0.0};
  if (time > t_.back() || (time == t_.back() && !before)) return {s_.back(), 0.0, 0.0};
  const std::size_t i = cell(time, before);
  const double dt = time - t_[i];
  if (dt == 0.0) return {s_[i], v_[i], a_[i]};
  const double end = a_[i] + j_[i] * dt;
  if (time == t_[i + 1]) return {s_[i + 1], v_[i + 1], end};
  return {std::min(s_.back(), s_[i] + dt * (v_[i] + dt * (0.5 * a_[i] + dt * j_[i] / 6.0))),
          std::max(0.0, v_[i] + 0.5 * dt * (a_[i] + end)), end};
}

double Timing::integral(double time) const {
  if (time <= 0.0) return 0.0;
  if (time >= t_.back()) return sum_.back() + s_.back() * (time - t_.back());
  const std::size_t i = cell(time, false);
  const double dt = time - t_[i];
  return sum_[i] + dt * (s_[i] + dt * (0.5 * v_[i] + dt * (a_[i] / 6.0 + dt * j_[i] / 24.0)));
}

Timing::State Timing::at(double time, bool before) const {
  const double t = std::clamp(time / stretch_, 0.0, raw_duration() + window_);
  State out;
  if (window_ > 0.0) {
    const State now = raw(t, before), then = raw(t - window_, before);
    out = {std::clamp((integral(t) - integral(t - window_)) / window_, 0.0, s_.back()),
           (now.s - then.s) / window_, (now.rate - then.rate) / window_};
  } else {
    out = raw(t, before || t >= t_.back());
    if (t <= 0.0 && !quintic_ && before) out = raw(0.0, false);
  }
  out.rate /= stretch_;
  out.acceleration /= stretch_ * stretch_;
  return out;
}

std::pair<double, double> Timing::span(double time) const {
  const double t = time / stretch_;
  return {raw(std::max(0.0, t - window_), false).s, raw(std::min(t, raw_duration()), true).s};
}

std::vector<double> Timing::breaks() const {
  std::vector<double> out;
  for (const double t : t_) out.push_back(stretch_ * t);
  if (window_ > 0.0) {
    for (const double t : t_) out.push_back(stretch_ * (t + window_));
    std::ranges::sort(out);
    const double least = 1e-9 * out.back();
    const auto close = [&](double a, double b) { return b - a < least; };
    out.erase(std::unique(out.begin(), out.end(), close), out.end());
    out.back() = duration();
  }
  return out;
}

double Timing::time_of(double s) const {
  double low = 0.0, high = duration();
  for (int k = 0; k < 40; ++k) {
    const double middle = 0.5 * (low + high);
    (at(middle).s >= s ? high : low) = middle;
  }
  return high;
}

}  // namespace esmc::host::plan
