#include "host_sim/design/result.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <limits>
#include <numbers>

#include "host_sim/design/efforts.hpp"
#include "host_sim/design/linear_zone.hpp"
#include "host_sim/design/search.hpp"

namespace esmc::host::design {
namespace {

constexpr double enough = 1.0 - 1e-9;  ///< share of a force that counts as all of it

/// One design in one tube: the search over states, gains, bands, torque.
/// Problem, size of the tube, points of a first look; run() once.
template <class M>
class Designer : private Search<M> {
 public:
  using Search<M>::Search;
  using Search<M>::left;

  Design<M> run() {
    if (!look() || !payable()) return d_;
    for (int i = 0; i < (smc_ ? 1 : M::channels); ++i) refine(i);
    inertia();
    if (!rates_of_reaching()) return d_;
    linear_zone();
    choose();
    bands();
    sampled_layer();
    torque();
    return d_;
  }
  /// Size of tube that holds the band of the layer; 0: no band.
  [[nodiscard]] double asked_tube() const { return asked_tube_; }
  /// Whether another law, layer or rate may not be refused.
  [[nodiscard]] bool curable() const { return curable_; }

 private:
  using Channels = typename M::Channels;
  using Base = Search<M>;
  using Base::p_, Base::u_, Base::d_, Base::lambda_, Base::tube_, Base::swing_, Base::smc_, Base::looks_,
      Base::force_, Base::span_, Base::mismatch_at_, Base::everywhere, Base::unit, Base::where, Base::look,
      Base::refine, Base::note, Base::worst;
  using typename Base::Found;
  using typename Base::Worsts;

  /// A row without believed mass has no switching term; those of joints have neither gain nor condition.
  bool payable() {
    for (int i = 0; i < M::channels; ++i) {
      if (M::has_mass(i) || u_.mass()[i] == 0.0) continue;
      d_.refused = "the rotor of an elbow (mechanism.rotor_inertia) is no part of the conditions of a design";
      return false;
    }
    if (smc_) {
      if (d_.mismatch < 1.0) return true;
      d_.refused = fmt::format(
          "smc: ||H^-1 H_believed - 1|| reaches {:.3g} {}, and its gain condition [F37] needs less than 1: "
          "no gain works; narrower masses",
          d_.mismatch, where(mismatch_at_));
      curable_ = true;
      return false;
    }
    for (int i = 0; i < M::channels; ++i) {
      const auto k = static_cast<std::size_t>(i);
      if (force_[k] == 0.0 || u_.mass()[i] > 0.0) continue;
      d_.refused = fmt::format(
          "row {} of the condition has to stand {:.3g} {}, and the controller believes no {} there to switch "
          "with: give control.model or [mechanism] one",
          i, force_[k], M::is_angle(i) ? "N m" : "N", M::is_angle(i) ? "inertia" : "mass");
      return false;
    }
    return true;
  }

  /// Bounds of true inertia over poses and plants.
  void inertia() {
    heavy_ = 0.0;
    light_ = std::numeric_limits<double>::infinity();
    (void)everywhere(true, [&](const Place&, const State<M>& s) {
      const Worst<M> w(u_, s, swing_);
      for (int k = 0; k < 12; ++k) {
        const double a = std::numbers::pi * k / 12.0;
        const Span e = w.energy(Vec2<double>(std::cos(a), std::sin(a)));
        heavy_ = std::max(heavy_, e.high);
        light_ = std::min(light_, e.low);
      }
    });
    heavy_ *= margin;  // between the directions
    light_ /= margin;
    d_.inside = smc_ ? std::numbers::sqrt2 / 2.0 : std::sqrt(light_ / heavy_);
  }

  /// eta of every row so that the surface is reached in time: eta_i = (largest |s_i|) / tau.
  bool rates_of_reaching() {
    const double edge = lambda_ * tube_;
    if (smc_) {
      d_.eta_independent = edge / p_.uncertainty.reaching_time;
      d_.reaching_time = p_.uncertainty.reaching_time;
      return true;
    }
    double least = std::numeric_limits<double>::infinity();  // of sum M (largest |s_i|) |c_i v| / sqrt(v H v)
    (void)everywhere(true, [&](const Place&, const State<M>& s) {
      const Worst<M> w(u_, s, swing_);
      for (int kink = 0; kink < M::channels; ++kink) {  // the least lies where a term vanishes
        if (u_.mass()[kink] == 0.0) continue;
        const Vec2<double> v(-s.column[1][kink], s.column[0][kink]);
        if (dot(v, v) == 0.0) continue;
        double sum = 0.0;
        for (int i = 0; i < M::channels; ++i)
          sum += u_.mass()[i] * span_[i] * edge * std::abs(s.column[0][i] * v[0] + s.column[1][i] * v[1]);
        least = std::min(least, sum / std::sqrt(w.energy(v).high));
      }
    });
    if (!(least > 0.0) || !std::isfinite(least)) {
      d_.refused = "the believed masses leave a direction in which no switching term acts";
      return false;
    }
    const double tau = p_.uncertainty.reaching_time * least / (std::sqrt(heavy_) * edge);
    for (int i = 0; i < M::channels; ++i) {
      if (u_.mass()[i] > 0.0) d_.row[static_cast<std::size_t>(i)].eta = span_[i] * edge / tau;
    }
    d_.reach_margin = least / tau / margin;
    d_.reaching_time = p_.uncertainty.reaching_time;
    return true;
  }

  /// The linear zone of the implicit step, and the gains that it needs.
  void linear_zone() {
    const LinearZone<M> z = linear_zone_of(p_, u_, swing_, looks_);
    d_.disturbance = z.disturbance;
    if (!smc_) d_.mismatch = z.mismatch;
    if (p_.controller.reaching != Reaching::implicit) return;
    if (!z.holds) {
      d_.warnings.push_back(
          fmt::format("sampled, nothing is promised: a mass matrix wrong by {:.0f} % meets a loop that "
                      "answers an acceleration {:.2f}-fold: their product must stay below 0.95; smaller "
                      "lambda, shorter tick, less delay, or narrower masses",
                      100.0 * z.mismatch, z.peak.command));
      return;
    }
    for (int i = 0; i < M::channels; ++i) {
      if (u_.mass()[i] > 0.0) d_.row[static_cast<std::size_t>(i)].linear = z.gain[i];
    }
    linear_independent_ = z.gain_independent;
    // The delayed measurement follows the motion; the mechanism is ahead by the motion during the delay.
    d_.ahead = p_.lag * z.speed;
    d_.sampled = Band{margin * (z.band.error + d_.ahead),
                      margin * (z.band.sliding + p_.lag * (z.acceleration + lambda_ * z.speed))};
  }

  void choose() {
    if (smc_) {
      d_.k_independent = margin * std::max(force_[0], linear_independent_);
      return;
    }
    for (int i = 0; i < M::channels; ++i) {
      Row<M>& r = d_.row[static_cast<std::size_t>(i)];
      if (!(u_.mass()[i] > 0.0)) continue;
      r.need = force_[static_cast<std::size_t>(i)] / u_.mass()[i];
      r.k = margin * std::max(r.need + r.eta, r.linear);
    }
  }

  /// The band of a layer [F38], and whether the tube holds it.
  void bands() {
    const auto& c = p_.controller;
    if (c.reaching == Reaching::sign) return;
    Gains<M> g = c.gains;
    apply(p_, d_, g);
    double sigma = 0.0, level = 0.0;  // level: of |sigma| in a tube that holds it
    if (smc_) {  // the larger of |s_1|, |s_2| falls while k (1 - ||E||) times what the layer lets through is
                 // more than d
      // [F37] says k (1 - ||E||) >= d + eta: all is let through at the edge of a saturation, of a tanh the
      // share d / (k (1 - ||E||)) <= 1 - eta / k must be.
      const double widths =
          c.reaching == Reaching::tanh ? std::atanh(1.0 - d_.eta_independent / g.independent.k) : 1.0;
      sigma = g.independent.layer * widths * std::numbers::sqrt2;
      level = sigma;
    } else {
      const double lost = c.reaching == Reaching::tanh ? 0.2785 : 0.25;
      double sum = 0.0;
      for (int i = 0; i < M::channels; ++i) sum += u_.mass()[i] * g.k[i] * g.layer[i];
      sigma = lost * sum / d_.reach_margin / std::sqrt(light_);
      level = sigma;
    }
    d_.layer = Band{sigma / lambda_, sigma};
    asked_tube_ = level / lambda_;
    if (level <= lambda_ * tube_) return;
    d_.refused = fmt::format(
        "the layer of the reaching law leaves a band of {:.3g} {} [F38], and the tube is {:.3g} {}: what "
        "holds in the tube says nothing of the band; a larger uncertainty.tube, a smaller layer or delay, "
        "narrower intervals",
        asked_tube_, unit(), tube_, unit());
    curable_ = true;
  }

  /// Decay rate of s within the layers: an eigenvalue of (C^T M C)^-1 C^T M diag(K / layer) C.
  [[nodiscard]] double rate_in_layer(const State<M>& s, const Gains<M>& g) const {
    Mat<double, 2, 2> H = Mat<double, 2, 2>::Zero(), steep = H;
    for (int i = 0; i < M::channels; ++i) {
      const Vec2<double> c(s.column[0][i], s.column[1][i]);
      const Mat<double, 2, 2> share = c * c.transpose() * u_.mass()[i];
      H += share;
      steep += share * (g.k[i] / g.layer[i]);
    }
    const Mat<double, 2, 2> A = inverse(H) * steep;
    const double half = 0.5 * (A(0, 0) + A(1, 1)),
                 rest = half * half - (A(0, 0) * A(1, 1) - A(0, 1) * A(1, 0));
    return half + std::sqrt(std::max(0.0, rest));
  }
  /// A layer that holds in continuous time may oscillate in the sampled and delayed loop.
  void sampled_layer() {
    const auto& c = p_.controller;
    if (c.reaching != Reaching::saturation && c.reaching != Reaching::tanh) return;
    Gains<M> g = c.gains;
    apply(p_, d_, g);
    double steep = smc_ ? g.independent.k / g.independent.layer : 0.0;
    State<M> s;
    for (const Place& at : looks_) {
      if (smc_ || !state_at(p_, at, 0.0, s)) continue;
      const double rate = rate_in_layer(s, g);
      if (!(rate <= steep))
        steep = std::isnan(rate) ? std::numeric_limits<double>::infinity()
                                 : rate;  // a layer that is next to nothing
    }
    d_.stiffness = steep + lambda_;
    const double loop = d_.stiffness * c.sample_time, most = steepest(p_.told_ticks);
    if (loop <= most || !d_.refused.empty()) return;
    d_.refused = fmt::format(
        "within its layer the loop is too stiff for its tick: (gain / layer + lambda) * tick = {:.3g}, at "
        "most {:.2g}, half of what makes it ring by itself with a delay of {:g} ticks: a larger "
        "control.layer",
        loop, most, p_.told_ticks);
    curable_ = true;
  }

  using Joints = Vec<double, M::joints>;

  [[nodiscard]] bool four() const { return p_.controller.allocate != nullptr; }

  /// The worst places for each motor and, of four, for all together.
  struct Efforts {
    std::array<Worsts, M::joints> torque{};
    Worsts force{}, preload{};
  };
  void note_effort(Efforts& to, const Place& at, const Effort<M>& e) {
    for (int j = 0; j < M::joints; ++j) note(to.torque[static_cast<std::size_t>(j)], at, e.torque[j]);
    note(to.force, at, 1.0 - e.force);
    note(to.preload, at, 1.0 - e.preload);
  }
  template <class F>
  void keep_shares(Shares& to, Place& place, const Efforts& of, const F& need) {
    if (!four()) return;
    const Found force = worst(of.force, [&](const State<M>& t) { return 1.0 - need(t).force; });
    const Found preload = worst(of.preload, [&](const State<M>& t) { return 1.0 - need(t).preload; });
    to = {1.0 - force.need, 1.0 - preload.need};
    if (to.force < enough) place = force.place;
  }

  void torque() {
    const auto& c = p_.controller;
    State<M> s;
    const auto n = c.motor_count();
    Efforts hold, peak;
    for (const Place& at : looks_) {
      if (state_at(p_, at, 0.0, s)) note_effort(hold, at, holding(p_, u_, swing_, s));
    }
    Gains<M> g = c.gains;
    apply(p_, d_, g);
    (void)everywhere(false,
                     [&](const Place& at, const State<M>& t) { note_effort(peak, at, asking(p_, g, t)); });
    for (int i = 0; i < n; ++i) {
      const int joint = ControllerConfig<M>::joint_of(i, n);
      const auto k = static_cast<std::size_t>(joint);
      keep(d_.hold, d_.hold_place, joint, worst(hold.torque[k], [&](const State<M>& t) {
             return holding(p_, u_, swing_, t).torque[joint];
           }));
      keep(d_.peak, d_.peak_place, joint,
           worst(peak.torque[k], [&](const State<M>& t) { return asking(p_, g, t).torque[joint]; }));
    }
    keep_shares(d_.hold_shares, d_.hold_place, hold,
                [&](const State<M>& t) { return holding(p_, u_, swing_, t); });
    keep_shares(d_.peak_shares, d_.peak_place, peak, [&](const State<M>& t) { return asking(p_, g, t); });
    if (four()) {
      judge_four();
    } else {
      judge_two(n);
    }
  }
  void judge_two(int n) {
    const auto& c = p_.controller;
    for (int i = 0; i < n; ++i) {
      const int joint = ControllerConfig<M>::joint_of(i, n);
      const auto k = static_cast<std::size_t>(joint);
      const double limit = c.torque_limit[joint];
      if (d_.hold[k] > limit && d_.refused.empty()) {
        d_.refused = fmt::format(
            "motor {}: the worst plant takes {:.3g} N m on the motion itself ({}), torque_limit gives {:.3g} "
            "N "
            "m: no gain works",
            i + 1, d_.hold[k], where(d_.hold_place), limit);
      } else if (d_.peak[k] > limit) {
        d_.warnings.push_back(
            fmt::format("motor {}: at the edge of the tube the law asks for up to {:.3g} N m ({}), "
                        "torque_limit gives {:.3g} N m: while it is clamped nothing is promised",
                        i + 1, d_.peak[k], where(d_.peak_place), limit));
      }
    }
  }
  /// Four motors share the load: only their sum counts.
  void judge_four() {
    const auto& c = p_.controller;
    if (d_.hold_shares.force < enough && d_.refused.empty()) {
      d_.refused = fmt::format(
          "within torque_limit the four motors give {:.3g} % of what the worst plant takes on the motion "
          "itself ({}): no gain works",
          100.0 * d_.hold_shares.force, where(d_.hold_place));
    } else if (d_.peak_shares.force < enough) {
      d_.warnings.push_back(
          fmt::format("at the edge of the tube the four motors give {:.3g} % of what the law asks for ({}): "
                      "while it is cut short nothing is promised",
                      100.0 * d_.peak_shares.force, where(d_.peak_place)));
    }
    if (!(d_.hold_shares.preload < enough)) return;
    for (int i = 0; i < M::joints; ++i) {  // bounds yield towards the limit on the other side
      const double given = std::abs(c.preload[i]),
                   rest = given - (1.0 - d_.hold_shares.preload) * (given + c.torque_limit[i]);
      if (!(given > 0.0)) continue;
      d_.warnings.push_back(fmt::format(
          "motor {}: of its preload of {:.3g} N m the worst plant leaves {:.3g} N m on the motion itself{}",
          i + 1, given, rest, rest > 0.0 ? "" : ": its gear changes sides"));
    }
  }
  /// Keeps the place of the joint nearest to its limit.
  void keep(std::array<double, M::joints>& most, Place& place, int joint, const Found& f) const {
    most[static_cast<std::size_t>(joint)] = f.need;
    for (int j = 0; j < joint; ++j) {
      const double limit = p_.controller.torque_limit[j];
      if (limit > 0.0 &&
          most[static_cast<std::size_t>(j)] / limit > f.need / p_.controller.torque_limit[joint])
        return;
    }
    place = f.place;
  }

  double linear_independent_ = 0.0;
  double heavy_ = 0.0, light_ = 0.0;  ///< bounds of the true inertia
  double asked_tube_ = 0.0;
  bool curable_ = false;
};

constexpr double room = 1.2;            ///< tube over the band that it must hold, where the tube is computed
constexpr std::size_t looks_max = 256;  ///< points of a first look
constexpr std::size_t looks_few = looks_max / 8;  ///< where many designs are tried

/// Size of the tube that would hold the start.
template <class M>
double start_size(const Problem<M>& p) {
  Tracking<M> t;
  if (p.points.empty() || !desired(p, p.points.front().now, t)) return 0.0;
  const auto& c = p.controller;
  Tracking<M> at = t;
  if (!desired(p, p.start, at)) return 0.0;
  const Vec2<double> e = M::independent_error(t.desired_pose, at.desired_pose);
  const Vec2<double> sigma =
      M::independent(t.desired_rates) - M::independent(at.desired_rates) + e * c.gains.independent.lambda;
  return std::max(std::sqrt(dot(e, e)), std::sqrt(dot(sigma, sigma)) / c.gains.independent.lambda);
}

/// A tube that holds its own band with some room, found by steps between it and what the band asks for. 0:
/// there is none of a size that means anything.
template <class M>
double computed_tube(const Problem<M>& p) {
  const auto& leg = p.believed.legs[0];
  const double size = Uncertain<M>::first > 0 ? leg.l1 + leg.l2 : 1.0;
  double tube = 0.02 * size;
  const double most = 0.2 * size;
  if (p.controller.reaching == Reaching::sign) return tube;
  for (int pass = 0; pass < 12; ++pass) {
    Designer<M> d(p, tube, looks_few);
    (void)d.run();
    if (d.left()) {
      tube *= 0.5;
      continue;
    }
    const double asked = room * d.asked_tube();
    if (!(asked > 0.0)) return tube;  // refused for another reason, which is then told
    if (asked <= tube && tube <= 1.3 * asked) return tube;
    tube = std::clamp(std::sqrt(tube * asked) * (asked > tube ? 1.05 : 1.0), 0.2 * tube,
                      std::min(5.0 * tube, most));
  }
  return 0.0;
}

template <class M>
struct Answer {
  Design<M> design;
  bool curable = false;  ///< what_helps may know more
};
/// In the tube that is given, or one that is computed.
template <class M>
Answer<M> answer(const Problem<M>& p) {
  double tube = p.uncertainty.tube ? *p.uncertainty.tube : computed_tube(p);
  Answer<M> out;
  if (!(tube > 0.0)) {
    out.design.refused =
        "no tube around the motion holds the band that the layer of the reaching law leaves in it [F38]: "
        "less delay, a smaller layer or narrower intervals are needed";
    out.curable = true;
    return out;
  }
  for (int pass = 0; pass < 6; ++pass) {  // a tube from few looks may be too small for what more looks find
    Designer<M> full(p, tube, looks_max);
    out = {full.run(), full.curable()};
    if (p.uncertainty.tube || out.design.refused.empty() || !(full.asked_tube() > tube)) break;
    tube = room * full.asked_tube();
  }
  out.design.tube_given = p.uncertainty.tube.has_value();
  return out;
}
/// What else was tried, one by one, and which of it gives a design.
template <class M>
std::string what_helps(const Problem<M>& p) {
  std::vector<std::string> helps, fails;
  const auto attempt = [&](const std::string& what, const auto& change) {
    Problem<M> q = p;
    change(q.controller);
    (answer(q).design.refused.empty() ? helps : fails).push_back(what);
  };
  const auto& now = p.controller;
  const LawKind other = now.law == LawKind::smc ? LawKind::esmc_projected : LawKind::smc;
  const std::string law = other == LawKind::smc ? "law smc" : "law esmc_projected";
  const auto others = [&](LawKind kind, const std::string& first) {
    if (now.reaching != Reaching::sign) {
      attempt(first + "reaching sign (it chatters)", [&](auto& c) {
        c.law = kind;
        c.reaching = Reaching::sign;
      });
    }
    attempt(fmt::format("{}lambda {:.3g}", first, 0.5 * now.gains.independent.lambda), [&](auto& c) {
      c.law = kind;
      c.gains.lambda *= 0.5;
      c.gains.independent.lambda *= 0.5;
    });
    attempt(fmt::format("{}rate_hz {:.5g}", first, 2.0 / now.sample_time), [&](auto& c) {
      c.law = kind;
      c.sample_time *= 0.5;
    });
  };
  attempt(law, [&](auto& c) { c.law = other; });
  others(now.law, "");
  if (helps.empty()) others(other, law + " with ");
  std::string out;
  if (!helps.empty()) out += fmt::format("; tried and helps: {}", fmt::join(helps, ", "));
  if (!fails.empty()) out += fmt::format("; tried in vain: {}", fmt::join(fails, ", "));
  return out;
}

}  // namespace

template <class M>
Design<M> design(const Problem<M>& p) {
  if (p.points.empty()) {
    Design<M> none;
    none.refused = "there is no motion to design for: no place of the workspace is within reach and limits";
    return none;
  }
  auto [d, curable] = answer(p);
  if (curable) d.refused += what_helps(p);
  if (!p.along_time) return d;
  d.start = start_size(p);
  if (d.refused.empty() && d.start > d.tube * d.inside) {
    d.warnings.push_back(
        fmt::format("the start is {:.3g} times as far from the motion as the promise reaches: it holds from "
                    "the instant at which the error has come within; reference.join begins within",
                    d.start / (d.tube * d.inside)));
  }
  return d;
}

template Design<FiveBar<double>> design(const Problem<FiveBar<double>>&);
template Design<Rr<double>> design(const Problem<Rr<double>>&);

}  // namespace esmc::host::design
