#include "host_sim/design/design.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "host_sim/design/designer.hpp"

namespace esmc::host::design {
namespace {

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
