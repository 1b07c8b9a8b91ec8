#include "host_sim/plan/timing.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace esmc::host::plan {
namespace {

/// low <= u - slope x <= high.
struct Bound {
  double slope = 0.0, low = -unlimited, high = unlimited, weight = 0.0;  // weight: |a| of its row
};

/// The u that a point and the next one allow, for every x of the point.
class Step {
 public:
  /// Bounds are written from `first`, which has room for all of them.
  void clear(Bound* first, double high) {
    first_ = end_ = first;
    low_ = 0.0;
    high_ = high;
    least_ = -unlimited;
    most_ = unlimited;
    next_ = {};
  }
  /// low <= a u + b x <= high.
  void add(double a, double b, double low, double high) {
    if (a > 0.0 || a < 0.0) {
      const double r = 1.0 / a, one = low * r, other = high * r;
      *end_ = {-b * r, std::min(one, other), std::max(one, other), std::abs(a)};
      most_ = std::min(most_, end_->high);
      least_ = std::max(least_, end_->low);
      ++end_;
    } else if (b > 0.0 || b < 0.0) {
      high_ = std::min(high_, std::max(low / b, high / b));
      low_ = std::max(low_, std::min(low / b, high / b));
    } else if (!(low <= 0.0 && high >= 0.0)) {
      high_ = -1.0;
    }
  }
  /// low <= x + w u <= high, in the place of the last of its kind.
  void set_next(double w, double low, double high) { next_ = {-1.0 / w, low / w, high / w, w}; }
  [[nodiscard]] double high() const { return high_; }  ///< of x, without regard to u
  /// Whether at x = 0 some u is left.
  [[nodiscard]] bool from_rest() const {
    return low_ == 0.0 && high_ >= 0.0 && std::max(least_, next_.low) <= std::min(most_, next_.high);
  }
  /// The largest u at x. Where rounding leaves none, that which exceeds the rows on both sides alike.
  [[nodiscard]] double most(double x) const {
    double low = next_.low + next_.slope * x, high = next_.high + next_.slope * x;
    for (const Bound* b = first_; b != end_; ++b) {
      low = std::max(low, b->low + b->slope * x);
      high = std::min(high, b->high + b->slope * x);
    }
    if (low <= high) return high;
    const Ends e = ends(x);
    return (e.most->weight * e.high + e.least->weight * e.low) / (e.most->weight + e.least->weight);
  }
  /// The largest (or smallest) x for which some u is left; negative: none. `guess`: of the largest, or 0.
  [[nodiscard]] double end(bool largest, double guess = 0.0) const {
    double x = largest ? high_ : low_;
    bool guessed = guess > low_ && guess < high_;
    if (guessed) x = guess;
    for (int pass = 0; pass < 100 && x >= low_ && x <= high_; ++pass) {
      const Ends e = ends(x);
      const double gap = e.low - e.high, slope = e.least->slope - e.most->slope,
                   size = std::abs(e.least->low) + std::abs(e.most->high) +
                          (std::abs(e.least->slope) + std::abs(e.most->slope)) * x;
      if (gap <= 1e-13 * size) {
        if (!guessed) return x;
        // The gap is convex in x: from a guess within, the zero of the tangent is not before the end.
        x = slope > 0.0 ? std::min(high_, x - gap / slope) : high_;
      } else if (largest ? slope > 0.0 : slope < 0.0) {
        x -= gap / slope;  // from beyond, the zero of the tangent is not beyond the true one
      } else {
        if (!guessed) return -1.0;
        x = high_;
      }
      guessed = false;
    }
    return -1.0;
  }

 private:
  /// The range of u at x, and what bounds it.
  struct Ends {
    const Bound *least, *most;
    double low, high;
  };
  [[nodiscard]] Ends ends(double x) const {
    Ends out{&next_, &next_, next_.low + next_.slope * x, next_.high + next_.slope * x};
    for (const Bound* b = first_; b != end_; ++b) {
      const double bend = b->slope * x, low = b->low + bend, high = b->high + bend;
      if (high < out.high) {
        out.high = high;
        out.most = b;
      }
      if (low > out.low) {
        out.low = low;
        out.least = b;
      }
    }
    return out;
  }
  Bound *first_ = nullptr, *end_ = nullptr;
  Bound next_;
  double low_ = 0.0, high_ = 0.0, least_ = 0.0, most_ = 0.0;  // of x; of u at x = 0
};

constexpr double near_limit = 0.15;  ///< share of the range of u within which its limit rules
constexpr double any_square = 1e8;   ///< where no row bounds x; more loses digits of the others

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
        r.low -= r.d * root / 2.0;
        r.high -= r.d * root / 2.0;
      }
      r.d = 0.0;
    }
  }
  return out;
}

/// Motion through an interval, from v0 to v1 in dt: the acceleration begins with a and changes by j per s.
struct Run {
  double dt, a, j;
  Run(double width, double v0, double v1, double slope) {
    const double mean = 0.5 * (v0 + v1), most = mean * mean / width;
    // Acceleration falls from u + half to u - half: mean dt + half dt^2 / 6 = width.
    const double half = std::clamp(-0.5 * slope * width, -most, most);
    dt = 2.0 * width / (mean + std::sqrt(mean * mean + 2.0 / 3.0 * half * width));
    a = (v1 - v0) / dt + half;
    j = -2.0 * half / dt;
  }
};

/// What a run has beyond the constant u of its interval: of u at its begin, its middle and its end, and of x
/// in the middle.
struct Beyond {
  double begin = 0.0, middle = 0.0, end = 0.0, square = 0.0;
};
std::vector<Beyond> beyond(const std::vector<double>& s, const Squares& of) {
  std::vector<Beyond> out(s.size() - 1);
  for (std::size_t i = 0; i + 1 < s.size(); ++i) {
    const double width = s[i + 1] - s[i], v0 = std::sqrt(of.x[i]), v1 = std::sqrt(of.x[i + 1]),
                 u = 0.5 * (of.x[i + 1] - of.x[i]) / width, square = 0.5 * (of.x[i] + of.x[i + 1]);
    const Run run(width, v0, v1, of.slope[i]);
    const double t = width / (v0 + std::sqrt(square)), v = v0 + t * (run.a + 0.5 * t * run.j);
    out[i] = {run.a - u, run.a + run.j * t - u, run.a + run.j * run.dt - u, v * v - square};
  }
  return out;
}

/// The least and the largest u that the rows of a place allow at x.
std::array<double, 2> range_at(const Grid& grid, std::size_t place, double x) {
  std::array<double, 2> out{-unlimited, unlimited};
  const double root = std::sqrt(x);
  for (std::size_t k = grid.first[place]; k < grid.first[place + 1]; ++k) {
    const Row& r = grid.rows[k];
    if (r.a == 0.0) continue;
    const double inverse = 1.0 / r.a, rest = r.b * x + r.d * root, low = (r.low - rest) * inverse,
                 high = (r.high - rest) * inverse;
    out[0] = std::max(out[0], r.a > 0.0 ? low : high);
    out[1] = std::min(out[1], r.a > 0.0 ? high : low);
  }
  return out;
}

/// Slope of u by s in every interval: where a limit of u rules, that of the limit. Elsewhere, of the slopes
/// to both neighbours, the smaller one, 0 where they differ in sign: where u jumps, the smooth side counts.
std::vector<double> slopes(const Grid& grid, const std::vector<double>& x) {
  const std::vector<double>& s = grid.s;
  const std::size_t cells = s.size() - 1;
  const auto mean = [&](std::size_t i) { return (x[i + 1] - x[i]) / (2.0 * (s[i + 1] - s[i])); };
  std::vector<double> out(cells, 0.0);
  std::array<double, 2> here = range_at(grid, 0, x[0]);
  double u = mean(0), after = 0.0;
  for (std::size_t i = 0; cells > 1 && i < cells; ++i) {
    const double before = after, now = u;
    if (i + 1 < cells) {
      u = mean(i + 1);
      after = (u - now) / (0.5 * (s[i + 2] - s[i]));
    }
    if (i == 0 || before * after > 0.0) out[i] = i > 0 && std::abs(before) < std::abs(after) ? before : after;
    const std::array<double, 2> next = range_at(grid, 2 * i + 2, x[i + 1]);
    for (std::size_t k = 0; k < 2; ++k) {
      const double off = std::abs(now - 0.5 * (here[k] + next[k])),
                   width = std::min(here[1] - here[0], next[1] - next[0]);
      if (off < near_limit * width) out[i] = (next[k] - here[k]) / (s[i + 1] - s[i]);
    }
    here = next;
  }
  return out;
}

/// One solution. `beyond`: of every interval, from the solution before; it makes the constant u of an
/// interval the mean of one that changes, so that the error of the grid is of second order.
class Pass {
 public:
  explicit Pass(const Grid& grid)
      : grid_(grid), step_(grid.s.size() - 1), low_(grid.s.size(), 0.0), high_(low_) {
    std::size_t rows = 0;
    for (std::size_t i = 0; i < step_.size(); ++i) rows += rows_of(i);
    bounds_.resize(rows);
  }

  std::optional<std::vector<double>> run(const std::vector<Row>& rows, const std::vector<Beyond>& beyond,
                                         std::size_t& blocked) {
    const std::size_t n = grid_.s.size() - 1;
    Bound* room = bounds_.data();
    for (std::size_t i = n; i-- > 0;) {
      step_[i].clear(std::exchange(room, room + rows_of(i)), any_square);
      set(i, rows, beyond.empty() ? Beyond{} : beyond[i]);
      const double guess =
          high_[i] > 0.0 ? high_[i] : high_[i + 1];  // of the run before, or of the neighbour
      // From the fastest speed of all the next one may have to be 0: a little less leaves a way to go on.
      for (const double keep : {i + 1 < n && i > 0 ? 0.05 : 0.0, 0.0}) {
        step_[i].set_next(2.0 * width(i), std::max(low_[i + 1], keep * high_[i + 1]), high_[i + 1]);
        high_[i] = step_[i].end(true, guess);
        low_[i] = !(high_[i] >= 0.0) ? -1.0 : step_[i].from_rest() ? 0.0 : step_[i].end(false);
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
      step_[i].set_next(2.0 * width(i), low_[i + 1], high_[i + 1]);
      const double u = step_[i].most(x[i]);
      x[i + 1] = std::clamp(x[i] + 2.0 * width(i) * u, low_[i + 1], std::max(low_[i + 1], high_[i + 1]));
      blocked = i + 1;
      if (i + 1 < n && !(x[i + 1] > 0.0) && !(x[i] > 0.0)) return std::nullopt;
    }
    return x;
  }

 private:
  [[nodiscard]] double width(std::size_t i) const { return grid_.s[i + 1] - grid_.s[i]; }
  /// Of an interval: those of its ends and its middle.
  [[nodiscard]] std::size_t rows_of(std::size_t i) const {
    return grid_.first[2 * i + 3] - grid_.first[2 * i];
  }
  /// The rows between points i and i + 1.
  void set(std::size_t i, const std::vector<Row>& rows, const Beyond& more) {
    const double w = 2.0 * width(i);
    Step& step = step_[i];
    const auto add = [&](std::size_t place, double ahead, double u, double x) {
      for (std::size_t k = grid_.first[place]; k < grid_.first[place + 1]; ++k) {
        const Row& r = rows[k];
        // Of speeds alone: the next point has met those of its own, which mostly leave less than the middle.
        if (r.kind == LimitKind::speed &&
            (place == 2 * i + 2 ||
             (place == 2 * i + 1 && r.b * (0.5 * (step.high() + high_[i + 1]) + x) <= r.high)))
          continue;
        const double off = r.a * u + r.b * x;
        step.add(r.a + ahead * r.b, r.b, r.low - off, r.high - off);
      }
    };
    add(2 * i, 0.0, more.begin, 0.0);
    add(2 * i + 1, 0.5 * w, more.middle, more.square);
    add(2 * i + 2, w, more.end, 0.0);
  }

  const Grid& grid_;
  std::vector<Step> step_;
  std::vector<Bound> bounds_;
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
    std::vector<Bound> bounds(grid.first[i + 1] - grid.first[i]);
    double x = 0.0;
    for (int pass = 0; pass < 4; ++pass) {  // the tangent of sqrt(x) at the limit before
      step.clear(bounds.data(), any_square);
      const double root = std::sqrt(std::max(x, 0.0));
      for (std::size_t k = grid.first[i]; k < grid.first[i + 1]; ++k) {
        const Row& r = grid.rows[k];
        const double off = 0.5 * r.d * root;
        step.add(r.a, root > 0.0 ? r.b + r.d / (2.0 * root) : r.b, r.low - off, r.high - off);
      }
      x = step.end(true);
    }
    out.push_back(x);
  }
  return out;
}

std::optional<Squares> fastest(const Grid& grid, const Squares& start, std::size_t& blocked, bool rough) {
  const bool viscous = std::ranges::any_of(grid.rows, [](const Row& r) { return r.d != 0.0; });
  Squares out = start, best;
  double least = std::numeric_limits<double>::infinity();
  Pass pass(grid);
  double before = start.empty() ? -1.0 : time_along(grid.s, start.x);
  const int passes = rough ? (start.empty() ? 2 : 1) : viscous ? 12 : 5;
  for (int k = 0; k < passes; ++k) {
    std::vector<Beyond> more;
    if (!out.empty()) {
      out.slope = slopes(grid, out.x);
      more = beyond(grid.s, out);
    }
    std::size_t at = 0;
    auto better = viscous ? pass.run(straightened(grid, out.x), more, at) : pass.run(grid.rows, more, at);
    if (!better && k == 0) blocked = at;
    if (!better && k == 0) return start.empty() ? std::nullopt : fastest(grid, {}, blocked, rough);
    if (!better) {  // too much friction at that speed for its tangent: from a slower motion
      for (double& square : out.x) square *= 0.5;
      continue;
    }
    out.x = std::move(*better);
    out.slope.resize(grid.s.size() - 1, 0.0);
    const double now = time_along(grid.s, out.x);
    // What a tangent of the friction allows, the friction does; without one it was not looked at.
    if ((k > 0 || !viscous || !start.empty()) && now < least) {
      least = now;
      best = out;
    }
    if (std::abs(now - before) <= grid.enough * now) break;
    before = now;
  }
  return best.empty() ? out : best;
}

Timing::Timing(const std::vector<double>& s, const Squares& of) : s_(s) {
  t_.assign(s.size(), 0.0);
  sum_ = t_;
  for (const double square : of.x) v_.push_back(std::sqrt(square));
  for (std::size_t i = 0; i + 1 < s.size(); ++i) {
    const Run run(s[i + 1] - s[i], v_[i], v_[i + 1], of.slope[i]);
    const double dt = run.dt;
    a_.push_back(run.a);
    j_.push_back(run.j);
    t_[i + 1] = t_[i] + dt;
    sum_[i + 1] = sum_[i] + dt * (s[i] + dt * (0.5 * v_[i] + dt * (run.a / 6.0 + dt * run.j / 24.0)));
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
  const auto ahead = [&](std::size_t i) { return before ? t_[i] < time : t_[i] <= time; };
  if (last_ + 1 < a_.size() && ahead(last_ + 1)) ++last_;  // mostly it is asked for times in order
  if (!ahead(last_) || ahead(last_ + 1)) {
    const auto at =
        before ? std::lower_bound(t_.begin(), t_.end(), time) : std::upper_bound(t_.begin(), t_.end(), time);
    last_ =
        std::min(static_cast<std::size_t>(std::max<std::ptrdiff_t>(1, at - t_.begin())) - 1, a_.size() - 1);
  }
  return last_;
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
  double low = 0.0, high = duration(), t = high;
  for (int k = 0; k < 60 && high - low > 1e-12 * duration(); ++k) {
    const State now = at(t);
    (now.s >= s ? high : low) = t;
    const double next = t - (now.s - s) / now.rate;  // Newton's step, where it stays within
    if (now.rate > 0.0 && std::abs(next - t) < 1e-12 * duration()) break;
    t = now.rate > 0.0 && next > low && next < high ? next : 0.5 * (low + high);
  }
  return t;
}

}  // namespace esmc::host::plan
