#pragma once
/// The grid of a stretch: few points at first, more where the solution asks for them.

#include <cmath>
#include <numbers>

#include "host_sim/plan/guard.hpp"

namespace esmc::host::plan {

// First intervals of every piece, and more of them by its length, as a share of Problem::grid; of a stretch;
// and how often they are cut, in 2, 4 or 8, where their error exceeds a share that falls with the square of
// Problem::grid.
constexpr std::size_t least_cells = 2;
constexpr double first_share = 0.15, least_intervals = 12.0, speed_error = 60.0, time_error = 3.0,
                 quarter = 4.0;
constexpr int refinements = 2;

/// A point of the grid, or the middle between two. Without a place its rows come from its neighbours.
struct Spot {
  double s;
  const Piece* piece;
  std::size_t place = none;       // its index, if it has one
  std::size_t row = 0, rows = 0;  // the first of all limits, and their number
  static constexpr auto none = static_cast<std::size_t>(-1);
};

template <class M>
class Spots {
 public:
  Spots(const Problem<M>& p, const Route<M>& route, const MotorLimits<M>& motors)
      : p_(p), route_(route), motors_(motors) {}

  void begin(const Stretch& stretch) {
    stretch_ = &stretch;
    limits_moves_ = false;
    for (std::size_t i = stretch.first; i <= stretch.last; ++i)
      limits_moves_ = limits_moves_ || p_.moves[i].speed || p_.moves[i].acceleration;
    set(p_.uncertain ? 3.0 : first_share);  // the worst plant is not known between
  }
  /// Points of the stretch: dense at rest, where time passes slowly along the path. `share`: of
  /// Problem::grid.
  void set(double share = first_share) {
    const auto& pieces = stretch_->pieces;
    spot_.clear();
    place_.clear();
    rows_.clear();
    for (std::size_t k = 0; k < pieces.size(); ++k) {
      const Piece& piece = pieces[k];
      const std::size_t n = least_cells + static_cast<std::size_t>(share * static_cast<double>(p_.grid) *
                                                                   piece.length() / stretch_->length);
      const bool begins = k == 0, ends = k + 1 == pieces.size();
      for (std::size_t i = 0; i < n + (ends ? 1 : 0); ++i) {
        const double x = static_cast<double>(i) / static_cast<double>(n);
        double y = x;
        if (begins && ends) {
          y = x - 0.9 * std::sin(2.0 * std::numbers::pi * x) / (2.0 * std::numbers::pi);
        } else if (begins) {
          y = x * (0.1 + 0.9 * x);
        } else if (ends) {
          y = 1.0 - (1.0 - x) * (0.1 + 0.9 * (1.0 - x));
        }
        const double at = piece.at + y * piece.length();
        if (!spot_.empty()) spot_.push_back(spot(0.5 * (spot_.back().s + at), p_.uncertain.has_value()));
        spot_.push_back(spot(at, true));
      }
    }
    take_points();
  }
  /// Cuts the intervals whose time may be wrong. x: of these points, then of the new ones. False: there is
  /// none.
  bool refine(Squares& x) {
    const std::size_t cells = grid_.s.size() - 1;
    const std::vector<double> wrong = errors(x);
    Squares finer;
    std::vector<Spot> spots;
    spots.reserve(2 * spot_.size());
    const bool placed = p_.uncertain.has_value();
    for (std::size_t i = 0; i < cells; ++i) {
      const double worst = wrong[i], begin = grid_.s[i], width = grid_.s[i + 1] - begin;
      const int parts = worst <= 1.0 ? 1 : worst <= quarter ? 2 : worst <= quarter * quarter ? 4 : 8;
      spots.push_back(spot_[2 * i]);
      for (int k = 1; k <= 2 * parts; ++k) {
        if (k % 2 == 1) {
          finer.x.push_back(x.x[i] + (x.x[i + 1] - x.x[i]) * (k - 1) / (2 * parts));
          finer.slope.push_back(x.slope[i]);
        }
        if (k == parts) {
          spots.push_back(spot_[2 * i + 1]);
          if (k % 2 == 0 && spots.back().place == Spot::none) spots.back().rows = 0;
          if (k % 2 == 0) place(spots.back());
        } else if (k < 2 * parts) {
          spots.push_back(spot(begin + width * k / (2 * parts), placed || k % 2 == 0));
        }
      }
    }
    finer.x.push_back(x.x[cells]);
    spots.push_back(spot_.back());
    const bool more = spots.size() > spot_.size();
    spot_ = std::move(spots);
    x = std::move(finer);
    take_points();
    return more;
  }
  /// Rows of all spots; `motors_only`: of the motors without reserve.
  void set_rows(bool motors_only = false) {
    grid_.rows.clear();
    grid_.first.clear();
    for (std::size_t i = 0; i < spot_.size(); i += 2) add_rows(i, motors_only);
    for (std::size_t i = 1; i < spot_.size(); i += 2) {
      if (spot_[i].rows == 0 && !between(i)) add_rows(i, motors_only);
    }
    for (const Spot& spot : spot_) {
      grid_.first.push_back(grid_.rows.size());
      const Row* row = &rows_[spot.row];
      grid_.rows.insert(grid_.rows.end(), row, row + spot.rows);
    }
    grid_.first.push_back(grid_.rows.size());
  }
  void forget_rows() {
    for (Spot& spot : spot_) spot.rows = 0;
    rows_.clear();
  }
  /// What the worst plant takes beyond the believed one, of a spot. forget_rows() then makes it count.
  void set_reserve(std::size_t i, const Reserve& less) { less_[i] = less; }

  [[nodiscard]] Grid& grid() { return grid_; }
  [[nodiscard]] std::size_t size() const { return spot_.size(); }
  [[nodiscard]] const Spot& operator[](std::size_t i) const { return spot_[i]; }
  [[nodiscard]] const Place<M>* at(std::size_t i) const {
    return spot_[i].place == Spot::none ? nullptr : &place_[spot_[i].place];
  }

 private:
  /// A spot with its place, or without: it is then known only from its neighbours.
  Spot spot(double s, bool placed) {
    Spot out{s, &Route<M>::piece_at(*stretch_, s)};
    if (placed) place(out);
    return out;
  }
  void place(Spot& spot) {
    if (spot.place != Spot::none) return;
    spot.place = place_.size();
    const double t = spot.piece->begin + std::clamp(spot.s - spot.piece->at, 0.0, spot.piece->length());
    if (!route_.place(*spot.piece, t, place_.emplace_back()))
      throw Refused(spot.piece->move, "to", "leads out of reach at {}", place_text(spot.piece->position(t)));
  }
  void take_points() {
    grid_.s.clear();
    grid_.enough = std::max(1e-9, 4.0 / static_cast<double>(p_.grid * p_.grid));
    for (std::size_t i = 0; i < spot_.size(); i += 2) grid_.s.push_back(spot_[i].s);
    less_.assign(p_.uncertain ? spot_.size() : 0, Reserve{});
  }
  /// Of every interval, how many times as wrong as is allowed its time may be.
  [[nodiscard]] std::vector<double> errors(const Squares& x) const {
    const std::size_t cells = grid_.s.size() - 1;
    const double n = static_cast<double>(p_.grid);
    std::vector<double> width(cells), u(cells), out(cells);
    double time = 0.0;
    for (std::size_t i = 0; i < cells; ++i) {
      width[i] = grid_.s[i + 1] - grid_.s[i];
      u[i] = (x.x[i + 1] - x.x[i]) / (2.0 * width[i]);
      time += 2.0 * width[i] / (std::sqrt(x.x[i]) + std::sqrt(x.x[i + 1]));
    }
    // Between interval i - 1 and i: what u jumps by beyond its slopes, and what these change by.
    const auto jump = [&](std::size_t i) {
      const bool outer = i == 0 || i == cells;
      return outer ? 0.0 : u[i] - u[i - 1] - 0.5 * (x.slope[i] * width[i] + x.slope[i - 1] * width[i - 1]);
    };
    const auto bend = [&](std::size_t i) {
      return i == 0 || i == cells ? 0.0 : std::abs(x.slope[i] - x.slope[i - 1]);
    };
    for (std::size_t i = 0; i < cells; ++i) {
      const double w = width[i], square = 0.5 * (x.x[i] + x.x[i + 1]), pace = std::sqrt(square);
      // A jump down, to slowing down, costs time in its interval; others cost speed from there on.
      const double down = std::max(-jump(i), -jump(i + 1)),
                   up = std::max({jump(i), jump(i + 1), 0.125 * w * std::max(bend(i), bend(i + 1))});
      out[i] = std::max({n * n * up * w / (2.0 * square * speed_error),
                         n * n * down * w * w / (8.0 * square * pace * time * time_error),
                         least_intervals * w / (pace * time)});
    }
    return out;
  }
  void add_rows(std::size_t i, bool motors_only) {
    Spot& spot = spot_[i];
    if (spot.rows > 0) return;
    place(spot);
    spot.row = rows_.size();
    const Place<M>& at = place_[spot.place];
    motors_.add_rows(at, motors_only || less_.empty() ? Reserve{} : less_[i], rows_);
    if (!motors_only) add_motion_rows(p_, *spot.piece, at, rows_);
    spot.rows = rows_.size() - spot.row;
  }
  /// Sets the rows of a middle to the cubic through those of four points of its piece; false: it has not
  /// four.
  bool between(std::size_t i) {
    Spot& spot = spot_[i];
    if (spot.place != Spot::none) return false;
    const Piece* piece = spot.piece;
    const auto within = [&](std::size_t first) {  // where two pieces meet, what both have in common is smooth
      if (first + 6 >= spot_.size() || spot_[first].piece != piece || spot_[first + 4].piece != piece)
        return false;
      return spot_[first + 6].piece == piece || !limits_moves_;
    };
    std::size_t first = i >= 3 ? i - 3 : i - 1;
    if (!within(first)) first = i - 1;
    if (!within(first)) first = i >= 5 ? i - 5 : i - 1;
    if (!within(first)) return false;
    std::array<double, 4> weight{};
    for (std::size_t k = 0; k < 4; ++k) {
      weight[k] = 1.0;
      for (std::size_t j = 0; j < 4; ++j) {
        if (j == k) continue;
        const double s = spot_[first + 2 * j].s;
        weight[k] *= (spot.s - s) / (spot_[first + 2 * k].s - s);
      }
    }
    spot.row = rows_.size();
    spot.rows = spot_[first].rows;
    rows_.resize(spot.row + spot.rows);
    for (std::size_t r = 0; r < spot.rows; ++r) {
      Row& out = rows_[spot.row + r];
      out = {0.0, 0.0, 0.0, 0.0, 0.0, rows_[spot_[first].row + r].kind};
      for (std::size_t k = 0; k < 4; ++k) {
        const Row& row = rows_[spot_[first + 2 * k].row + r];
        for (double Row::*of : {&Row::a, &Row::b, &Row::d, &Row::low, &Row::high})
          out.*of += weight[k] * row.*of;
      }
    }
    return true;
  }

  const Problem<M>& p_;
  const Route<M>& route_;
  const MotorLimits<M>& motors_;
  const Stretch* stretch_ = nullptr;
  bool limits_moves_ = false;  // a move of the stretch limits speed or acceleration
  Grid grid_;
  std::vector<Spot> spot_;
  std::vector<Place<M>> place_;
  std::vector<Row> rows_;
  std::vector<Reserve> less_;  // of each spot
};

}  // namespace esmc::host::plan
