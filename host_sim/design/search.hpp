#pragma once
/// The search for the worst places of the tube: a grid over motion and tube, then climbs from its worst
/// points. It finds a lower bound; `margin` covers the places between.

#include <fmt/format.h>

#include <array>
#include <numbers>
#include <string>
#include <utility>

#include "host_sim/design/result.hpp"
#include "host_sim/design/worst.hpp"

namespace esmc::host::design {

template <class M>
class Search {
 public:
  /// `p` must outlive this and have points. `tube`: m or rad. `looks`: about the number of points of the
  /// motion before the climbs.
  Search(const Problem<M>& p, double tube, std::size_t looks)
      : p_(p),
        u_(p),
        lambda_(p.controller.gains.independent.lambda),
        tube_(tube),
        swing_(2.0 * lambda_ * tube),
        smc_(p.controller.law == LawKind::smc) {
    d_.tube = tube;
    if (p.along_time) {  // the way onto the motion is short, and no less steep than the motion
      pick(0, p.joining, looks / 2);
      pick(p.joining, p.points.size(), std::max(looks, p.points.size() * looks / 2048));
      step_ = p.points.size() / 32;
    } else {
      star(looks / 4);
    }
  }
  /// Whether the tube left the reach or the controller's limits.
  [[nodiscard]] bool left() const { return left_; }

 protected:
  using Channels = typename M::Channels;
  static constexpr int directions = 6;
  /// Sections of a motion, each with its own worst place: two of the way onto it, four of the rest.
  static constexpr std::size_t parts_joining = 2, parts = 6;
  struct Found {
    double need = 0.0;
    Place place{};
  };

  void pick(std::size_t from, std::size_t to, std::size_t most) {
    if (from >= to) return;
    const std::size_t stride = (to - from + most - 1) / most;
    for (std::size_t n = from; n < to; n += stride) looks_.push_back({n});
  }
  /// Places of a workspace, with all directions of velocity and acceleration; and at rest (dry friction).
  void star(std::size_t most) {
    const std::size_t stride = std::max<std::size_t>(1, (p_.points.size() + most - 1) / most);
    for (std::size_t n = 0; n < p_.points.size(); n += stride) {
      for (int a = 0; a < directions; ++a) {
        for (int v = 0; v <= directions; ++v)
          looks_.push_back({n, 0, 0, 0, 0, turned(v), v < directions ? 1.0 : 0.0, turned(a)});
      }
    }
  }
  static double turned(int k) { return 2.0 * std::numbers::pi * k / directions; }

  /// Calls f(place, state) for the tube's centre and edge, point by point. False: an impossible place.
  template <class F>
  bool everywhere(bool poses_only, const F& f) {
    State<M> s;
    const Place* last = nullptr;
    bool room = true;
    for (const Place& look : looks_) {
      if (p_.between != nullptr) p_.between();
      const bool moved = last == nullptr || last->point != look.point;
      last = &look;
      if (poses_only && !moved) continue;
      const auto visit = [&](double angle_e, double share_e, double angle_s, double share_s) {
        const Place at = edge(look, angle_e, share_e, angle_s, share_s);
        ++d_.states;
        if (!state_at(p_, at, tube_, s)) {
          left_ = true;
          d_.refused = fmt::format(
              "a tube of {:.3g} {} around the motion leaves the reach of the mechanism, or passes "
              "limits.min_abs_sin_type1 or type2, {}",
              tube_, unit(), where(at));
          return false;
        }
        f(at, s);
        return true;
      };
      const auto possible = [&] {
        for (int a = 0; a < directions; ++a) {
          if (!state_at(p_, edge(look, turned(a), 1, 0, 0), tube_, s)) return false;
        }
        return true;
      };
      if (!p_.along_time && moved) room = possible();  // a place of the workspace has its tube around it
      if (!room) continue;
      bool within = visit(0, 0, 0, 0);
      for (int a = 0; a < directions && within; ++a) {
        within = visit(turned(a), 1, 0, 0);
        if (poses_only) continue;
        within = within && visit(0, 0, turned(a), 1);
        for (int b = 0; b < directions && within; ++b) within = visit(turned(a), 1, turned(b), 1);
      }
      if (!within) return false;
    }
    return true;
  }
  static Place edge(Place at, double angle_e, double share_e, double angle_s, double share_s) {
    at.angle_e = angle_e;
    at.share_e = share_e;
    at.angle_s = angle_s;
    at.share_s = share_s;
    return at;
  }
  [[nodiscard]] static const char* unit() { return Uncertain<M>::first > 0 ? "m" : "rad"; }
  [[nodiscard]] std::string where(const Place& at) const {
    const Point& n = p_.points[at.point];
    return p_.along_time ? fmt::format("at t = {:.3f} s", n.time)
                         : fmt::format("at ({:.3g}, {:.3g})", n.now.position.x(), n.now.position.y());
  }

  /// Needs of the rows (for smc: of the gain, in place of row 0), lengths of the rows of C.
  bool look() {
    return everywhere(false, [&](const Place& at, const State<M>& s) {
      for (int i = 0; i < M::channels; ++i)
        span_[i] = std::max(span_[i], std::hypot(s.column[0][i], s.column[1][i]));
      if (smc_) {
        const double wrong = smc_mismatch(Worst<M>(u_, s, swing_));
        if (wrong > d_.mismatch) {
          d_.mismatch = wrong;
          mismatch_at_ = at;
        }
        if (wrong < 1.0) note(0, at, smc_need(s));
      } else {
        if (p_.controller.law == LawKind::esmc && at.share_s > 0.0)
          d_.beyond_range = std::max(d_.beyond_range, beyond(s));
        const auto rows = u_.rows(s, swing_);
        for (int i = 0; i < M::channels; ++i) {
          const auto k = static_cast<std::size_t>(i);
          note(k, at, rows[k].size());
        }
      }
    });
  }

  /// Share of s outside the range of C, in the metric of the believed M.
  [[nodiscard]] double beyond(const State<M>& s) const {
    Mat<double, 2, 2> H;
    Vec2<double> f;
    const auto weigh = [&](const Channels& a, const Channels& b) {
      double sum = 0.0;
      for (int i = 0; i < M::channels; ++i) sum += u_.mass()[i] * a[i] * b[i];
      return sum;
    };
    for (int i = 0; i < 2; ++i) {
      f[i] = weigh(s.column[i], s.sliding);
      for (int j = 0; j < 2; ++j) H(i, j) = weigh(s.column[i], s.column[j]);
    }
    const Vec2<double> sigma = inverse(H) * f;
    const Channels r = s.sliding - s.column[0] * sigma[0] - s.column[1] * sigma[1];
    return std::sqrt(weigh(r, r) / weigh(s.sliding, s.sliding));
  }

  /// Keeps the worst place of each section of the motion, where a climb begins.
  using Worsts = std::array<Found, parts>;
  void note(std::size_t row, const Place& at, double need) {
    note(found_[row], at, need);
    force_[row] = std::max(force_[row], need);
  }
  void note(Worsts& of, const Place& at, double need) const {
    const std::size_t j = p_.joining, n = at.point,
                      part = n < j
                                 ? n * parts_joining / j
                                 : parts_joining + (n - j) * (parts - parts_joining) / (p_.points.size() - j);
    if (need > of[part].need) of[part] = {need, at};
  }
  /// The worst of them, after a climb from each.
  template <class F>
  Found worst(const Worsts& of, const F& need) {
    Found best;
    for (Found f : of) {
      if (!(f.need > 0.0)) continue;
      climb(f, need);
      if (f.need > best.need) best = f;
    }
    return best;
  }

  /// [F37]: the maximum norms of H^-1 H_believed - 1 and of H^-1 F.
  static std::pair<double, double> smc_norms(const Mat<double, 2, 2>& believed, const Mat<double, 2, 2>& H,
                                             const Vec2<double>& F) {
    const Mat<double, 2, 2> inv = inverse(H), E = inv * believed - Mat<double, 2, 2>::Identity();
    const Vec2<double> d = inv * F;
    return {std::max(std::abs(E(0, 0)) + std::abs(E(0, 1)), std::abs(E(1, 0)) + std::abs(E(1, 1))),
            std::max(std::abs(d[0]), std::abs(d[1]))};
  }
  [[nodiscard]] static double smc_mismatch(const Worst<M>& w) {
    return w.largest([&](const auto& H, const auto& F) { return smc_norms(w.believed(), H, F).first; });
  }
  [[nodiscard]] double smc_need(const State<M>& s) const {
    const Worst<M> w(u_, s, swing_);
    const double eta = lambda_ * tube_ / p_.uncertainty.reaching_time;
    return w.largest([&](const auto& H, const auto& F) {
      const auto [wrong, d] = smc_norms(w.believed(), H, F);
      return wrong < 1.0 ? (d + eta) / (1.0 - wrong) : 0.0;
    });
  }

  /// Climbs from the worst places of a row.
  void refine(int row) {
    const auto k = static_cast<std::size_t>(row);
    if (force_[k] <= 0.0) return;
    Row<M>& r = d_.row[k];
    const Found f = worst(
        found_[k], [&](const State<M>& s) { return smc_ ? smc_need(s) : u_.rows(s, swing_)[k].size(); });
    force_[k] = f.need;
    r.place = f.place;
    State<M> s;
    if (smc_ || !state_at(p_, r.place, tube_, s)) return;
    double share = -1.0;
    for (int c = 0; c < static_cast<int>(Cause::count); ++c) {
      const double own = u_.rows(s, swing_, static_cast<Cause>(c))[k].size();
      if (own > share) {
        share = own;
        r.cause = static_cast<Cause>(c);
      }
    }
  }
  /// Hill climbing by halving steps of angles, and of time or place.
  template <class F>
  void climb(Found& best, const F& need) {
    State<M> s;
    const auto attempt = [&](const Place& at) {
      ++d_.states;
      if (at.point >= p_.points.size() || !state_at(p_, at, tube_, s)) return false;
      const double now = need(s);
      if (!(now > best.need * (1.0 + 1e-9))) return false;
      best = {now, at};
      return true;
    };
    constexpr std::array angles{&Place::angle_e, &Place::angle_s, &Place::angle_v, &Place::angle_a};
    double turn = std::numbers::pi / directions;
    auto along = static_cast<std::ptrdiff_t>(step_);
    for (int halvings = 0; halvings < 8;) {
      bool better = false;
      for (std::size_t n = 0; !p_.along_time && halvings % 4 == 0 && n < p_.points.size(); ++n) {
        Place at = best.place;  // neighbours in a list of places need not be neighbours
        at.point = n;
        better = attempt(at) || better;
      }
      for (const int sign : {-1, 1}) {
        for (std::size_t i = 0; i < (p_.along_time ? 2U : angles.size()); ++i) {
          Place at = best.place;
          at.*angles[i] += sign * turn;
          better = attempt(at) || better;
        }
        if (along == 0) continue;
        Place at = best.place;
        at.point = static_cast<std::size_t>(static_cast<std::ptrdiff_t>(at.point) +
                                            sign * along);  // may wrap: then too large
        better = attempt(at) || better;
      }
      if (better) continue;
      ++halvings;
      turn *= 0.5;
      along /= 2;
    }
  }

  const Problem<M>& p_;
  Uncertain<M> u_;
  double lambda_, tube_, swing_;
  bool smc_;
  std::vector<Place> looks_;  ///< centres of the tube
  std::size_t step_ = 0;      ///< first step of a climb along time, in points
  Design<M> d_;
  std::array<Worsts, M::channels> found_{};
  std::array<double, M::channels> force_{};  ///< largest |delta|, N or N m; smc: the gain, first
  Channels span_ = Channels::Zero();         ///< largest |c_i|
  bool left_ = false;
  Place mismatch_at_{};
};

}  // namespace esmc::host::design
