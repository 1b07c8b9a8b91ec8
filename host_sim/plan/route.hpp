#pragma once
/// The geometric path of a program: stretches of pieces, each from rest to rest.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "host_sim/plan/piece.hpp"
#include "host_sim/plan/problem.hpp"
#include "host_sim/turns.hpp"

namespace esmc::host::plan {

/// A point of the path with its derivatives by the parameter: all joints, effector, base joints.
template <class M>
struct Place {
  Desired<M> at;   ///< rates and acceleration: first and second derivatives
  CurvePoint tip;  ///< effector, m; d3 is not set
  Vec2<double> base1, base2;
};

/// A way from rest to rest.
struct Stretch {
  std::vector<Piece> pieces;
  double length = 0.0;              ///< of the parameter
  std::size_t first = 0, last = 0;  ///< moves
  std::optional<double> time;       ///< s, of all moves together; unset: optimal
  double rest = 0.0;                ///< s, of dwells before it
};

inline Vec2<double> tip_acceleration(const FiveBar<double>&, const Desired<FiveBar<double>>& d) {
  return d.acceleration.platform;
}
inline Vec2<double> tip_acceleration(const Rr<double>& m, const Desired<Rr<double>>& d) {
  return m.arm().tip_bias(d.pose.arm, d.rates, d.rates) + m.tip_rate(d.pose, d.acceleration);
}

template <class M>
class Route {
 public:
  explicit Route(const Problem<M>& p) : p_(p), tip_(p.start), base_(p.start_base) {
    start();
    for (std::size_t i = 0; i < p.moves.size(); ++i) {
      mark();
      if (p.moves[i].kind == MoveKind::dwell) {
        rest_ += *p.moves[i].time;
      } else {
        add(i);
      }
    }
    mark();
    if (p.repeat && (tip_ - p.start).norm() > 1e-6) {
      throw Refused(p.moves.size() - 1, "to",
                    "ends at ({:.6g}, {:.6g}), and repeat = true begins again at ({:.6g}, {:.6g})", tip_.x(),
                    tip_.y(), p.start.x(), p.start.y());
    }
    for (Stretch& s : stretches_) {
      for (Piece& piece : s.pieces) {
        piece.at = s.length;
        s.length += piece.length();
      }
    }
  }

  [[nodiscard]] const std::vector<Stretch>& stretches() const { return stretches_; }
  [[nodiscard]] double last_rest() const { return rest_; }       ///< s, after the last stretch
  [[nodiscard]] double deviation() const { return deviation_; }  ///< m, of all blends

  /// Where each move begins, and the last one ends: effector, m, and base joints, rad, not wrapped.
  [[nodiscard]] const std::vector<Vec2<double>>& from() const { return from_; }
  [[nodiscard]] const std::vector<Vec2<double>>& from_base() const { return from_base_; }

  /// Sets the place at parameter t of a piece; false: there is no such pose.
  [[gnu::noinline, gnu::flatten]] bool place(const Piece& piece, double t, Place<M>& out) const {
    const auto& c = p_.controller;
    const CurvePoint at = piece.point(t, false);
    Desired<M>& d = out.at;
    const bool joint = piece.kind == Piece::Kind::joint;
    if (!(joint ? desired_at_base(c.mechanism, c.mode, at.p, at.d1, at.d2, d.pose, d.rates, d.acceleration)
                : desired_at_effector(c.mechanism, c.mode, at.p, at.d1, at.d2, d.pose, d.rates,
                                      d.acceleration)))
      return false;
    out.tip = at;
    if (joint)
      out.tip = {
          d.pose.effector, c.mechanism.tip_rate(d.pose, d.rates), tip_acceleration(c.mechanism, d), {}};
    out.base1 = M::base(d.rates);
    out.base2 = M::base(d.acceleration);
    return true;
  }
  [[nodiscard]] std::optional<Place<M>> place(const Piece& piece, double t) const {
    Place<M> out;
    return place(piece, t, out) ? std::optional(out) : std::nullopt;
  }
  /// The place at parameter s of a stretch.
  [[nodiscard]] std::optional<Place<M>> place(const Stretch& stretch, double s) const {
    const Piece& piece = piece_at(stretch, s);
    return place(piece, piece.begin + std::clamp(s - piece.at, 0.0, piece.length()));
  }
  /// The effector at parameter s of a stretch on which there is a pose everywhere; d3 is not set.
  [[nodiscard]] CurvePoint tip(const Stretch& stretch, double s) const {
    const Piece& piece = piece_at(stretch, s);
    const double t = piece.begin + std::clamp(s - piece.at, 0.0, piece.length());
    return piece.kind == Piece::Kind::joint ? place(piece, t)->tip : piece.point(t, false);
  }
  [[nodiscard]] static const Piece& piece_at(const Stretch& stretch, double s) {
    const auto next = std::upper_bound(stretch.pieces.begin() + 1, stretch.pieces.end(), s,
                                       [](double v, const Piece& piece) { return v < piece.at; });
    return *(next - 1);
  }

 private:
  static std::string text(const Vec2<double>& p) { return fmt::format("({:.6g}, {:.6g})", p.x(), p.y()); }

  void mark() {
    from_.push_back(tip_);
    from_base_.push_back(base_);
  }
  void start() {
    const auto& c = p_.controller;
    const auto d = desired_at_effector(c.mechanism, c.mode, tip_, Vec2<double>(0, 0), Vec2<double>(0, 0));
    if (!d) throw Refused(0, "", "begins at {}, which is out of reach", text(tip_));
    unwrap(M::base_angles(d->pose));
  }
  /// The turn of each base angle that is nearest to where the base joints are.
  void unwrap(const Vec2<double>& wrapped) {
    for (int i = 0; i < 2; ++i) base_[i] = nearest_turn(wrapped[i], base_[i]);
  }

  void add(std::size_t i) {
    const MoveScene& m = p_.moves[i];
    std::vector<Piece> pieces = pieces_of(i);
    for (Piece& piece : pieces) piece.move = piece.next = i;
    const std::string key = m.kind == MoveKind::spline && pieces.size() > 1 ? "through" : "to";
    for (const Piece& piece : pieces) follow(piece, key);
    const bool blended = i > 0 && p_.moves[i - 1].blend > 0.0;
    if (!blended) stretches_.push_back({{}, 0.0, i, i, std::nullopt, std::exchange(rest_, 0.0)});
    Stretch& s = stretches_.back();
    s.last = i;
    if (m.time) s.time = s.time.value_or(0.0) + *m.time;
    if (blended) round_corner(s.pieces, pieces);
    s.pieces.insert(s.pieces.end(), pieces.begin(), pieces.end());
  }

  std::vector<Piece> pieces_of(std::size_t i) const {
    const MoveScene& m = p_.moves[i];
    const auto vec = [](const std::array<double, 2>& a) { return Vec2<double>(a[0], a[1]); };
    const Vec2<double> to = vec(m.to), from = m.kind == MoveKind::joint ? base_ : tip_;
    constexpr double least = 1e-9;  // m or rad
    if (!((to - from).norm() > least)) {
      throw Refused(i, "to", "{} is where the move begins{}", text(to),
                    m.kind == MoveKind::arc ? ": a full circle takes two arcs" : "");
    }
    if (m.kind == MoveKind::joint) return {line(from, to, Piece::Kind::joint)};
    if (m.kind == MoveKind::arc) {
      Piece out;
      if (!arc(from, vec(m.via), to, out))
        throw Refused(i, "via", "{} lies on the line from {} to {}: no circle", text(vec(m.via)), text(from),
                      text(to));
      return {out};
    }
    std::vector<Vec2<double>> points{from};
    for (const auto& through : m.through) {
      if (!((vec(through) - points.back()).norm() > least))
        throw Refused(i, "through", "has {} twice in a row", text(vec(through)));
      points.push_back(vec(through));
    }
    if (!((to - points.back()).norm() > least))
      throw Refused(i, "to", "{} is the last point of through", text(to));
    points.push_back(to);
    return spline(points);
  }

  /// Refuses the way from t, where there is a pose, to `end`, where there is none, by the place between.
  [[noreturn]] void refuse_end(const Piece& piece, double t, double end, const std::string& key) const {
    for (int pass = 0; pass < 20; ++pass) {
      const double middle = 0.5 * (t + end);
      (place(piece, middle) ? t : end) = middle;
    }
    const std::string at = text(piece.point(end).p);
    throw Refused(piece.move, key, "{}",
                  piece.kind == Piece::Kind::joint
                      ? fmt::format("the legs cannot be closed on the way, at base joints {} rad", at)
                      : fmt::format("out of reach on the way, at {} m", at));
  }
  /// The pose at a point of a curve, or at base angles.
  [[nodiscard]] std::optional<typename M::Pose> pose_at(bool joint, const Vec2<double>& p) const {
    const auto& c = p_.controller;
    if (!joint) return c.mechanism.inverse(p, c.mode);
    const auto e = estimate_from_base(c.mechanism, c.mode, p, Vec2<double>(0, 0));
    return e ? std::optional(e->pose) : std::nullopt;
  }
  /// Moves the present position to the end of a piece.
  void follow(const Piece& piece, const std::string& key) {
    const bool joint = piece.kind == Piece::Kind::joint;
    const int parts = piece.straight() ? 16 : 32;
    double last = piece.begin;
    for (int k = 0; k <= parts; ++k) {
      const double t = piece.begin + piece.length() * k / parts;
      const Vec2<double> p = piece.position(t);
      const auto pose = pose_at(joint, p);
      if (!pose) refuse_end(piece, last, t, key);
      last = t;
      if (joint) {
        base_ = p;
      } else {
        unwrap(M::base_angles(*pose));
      }
      tip_ = joint ? pose->effector : p;
    }
  }

  /// The effector's curve at t; its third derivative from the second where it has no closed form.
  [[nodiscard]] CurvePoint curve(const Piece& piece, double t) const {
    if (piece.kind != Piece::Kind::joint) return piece.point(t);
    auto at = place(piece, t);
    if (!at) throw Refused(piece.move, "blend", "begins where the mechanism has no pose");
    const double step = 1e-4;  // rad
    const auto after = place(piece, t + step), before = place(piece, t - step);
    if (after && before) at->tip.d3 = (after->tip.d2 - before->tip.d2) / (2.0 * step);
    return at->tip;
  }

  /// Points of a piece from t to `end`, ends included.
  void add_points(const Piece& piece, double t, double end, std::vector<Vec2<double>>& out) const {
    const int parts = piece.straight() ? 1 : 16;
    for (int k = 0; k <= parts; ++k)
      out.push_back(piece.kind == Piece::Kind::joint ? curve(piece, t + (end - t) * k / parts).p
                                                     : piece.position(t + (end - t) * k / parts));
  }

  /// Puts a blend between the last piece of `before` and the first of `after`, as long as its deviation
  /// allows.
  void round_corner(std::vector<Piece>& before, std::vector<Piece>& after) {
    Piece &a = before.back(), &b = after.front();
    const double allowed = p_.moves[a.move].blend;
    const CurvePoint in = curve(a, a.end), out = curve(b, b.begin);
    const double fast_in = in.d1.norm(), fast_out = out.d1.norm();
    if (!(in.d1.dot(out.d1) > -0.95 * fast_in * fast_out))
      throw Refused(a.move, "blend", "cannot round the corner at {}: the next move turns back", text(in.p));
    const bool both = after.size() == 1 && p_.moves[b.move].blend > 0.0;
    const double most = std::min(0.98 * a.length() * fast_in, (both ? 0.5 : 0.98) * b.length() * fast_out);
    Piece best;
    double best_deviation = 0.0, best_cut = 0.0, low = 0.0, high = most, cut = most;
    for (int pass = 0; pass < 32 && best_deviation < 0.98 * allowed; ++pass) {
      const double ta = a.end - cut / fast_in, tb = b.begin + cut / fast_out;
      const Piece tried = blend_between(curve(a, ta), curve(b, tb));
      std::vector<Vec2<double>> stubs;
      add_points(a, ta, a.end, stubs);
      add_points(b, b.begin, tb, stubs);
      const double off = plan::deviation(tried, in.p, stubs);
      if (off <= allowed) {
        best = tried;
        best_deviation = off;
        best_cut = low = cut;
        if (cut == most) break;
      } else {
        high = cut;
      }
      cut *= 0.999 * allowed / off;  // between two lines in proportion to it
      if (!(cut > low && cut < high)) cut = 0.5 * (low + high);
    }
    if (!(best_cut > 0.0))
      throw Refused(a.move, "blend", "of {:g} m is too small to round the corner", allowed);
    deviation_ = std::max(deviation_, best_deviation);
    best.move = a.move;
    best.next = b.move;
    a.end -= best_cut / fast_in;
    b.begin += best_cut / fast_out;
    before.push_back(best);
  }

  const Problem<M>& p_;
  std::vector<Stretch> stretches_;
  Vec2<double> tip_, base_;  // present position
  std::vector<Vec2<double>> from_, from_base_;
  double rest_ = 0.0, deviation_ = 0.0;
};

}  // namespace esmc::host::plan
