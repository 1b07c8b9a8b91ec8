// Passage of type 2 with two motors and all encoders: how many plants with masses and inertias within 5 % get
// through, at which speed. The way goes straight down or up through the pose with the distal bars in line;
// its acceleration there is that at which the motors need not push across the bars (consistent), or a quintic
// that does not care (plain). The guard of D2 is open only while the plan is near that pose. usage:
// type2_passage PLANTS [PICTURE.svg]; prints rows of docs/redundant-actuation.md

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <vector>

#include "firmware/control/reference.hpp"
#include "host_sim/report/study_page.hpp"
#include "tests/support/program_problem.hpp"
#include "tests/support/sampled_loop.hpp"

namespace esmc::test {
namespace {

using M = FiveBar<double>;
using host::FiveBarPlant;

constexpr double tick = 1e-3, torque_limit = 1.5, guard = 0.05,
                 open_below = 0.1;                                          // s, N m, |D2|, planned |D2|
constexpr double upper_y = 0.11, lower_y = 0.005, goal = 1e-3, wait = 0.3;  // m, m, m, s
const M::Mode mode{{{1, 1}}, -1};

/// y of the effector at which the distal bars are in line, m.
double singular_y(const FiveBarParams<double>& p) {
  const double across = p.legs[0].l2 - p.l0;
  return std::sqrt(p.legs[0].l1 * p.legs[0].l1 - across * across);
}

/// Vertical acceleration at which the motors need no force across the distal bars, m/s2; speed: upwards, m/s.
double consistent_acceleration(const M& m, double y, double speed) {
  const auto across = [&](double a) {
    auto d = *desired_at_effector(m, mode, Vec2<double>(0, y), Vec2<double>(0, speed), Vec2<double>(0, a));
    const auto w = m.force(m.channel_accelerations(d.pose, d.rates, d.acceleration), M::Rates::Zero());
    d.pose.sin_type2 = 1.0;  // the torque is a / D2 + b: its a
    const double one = m.base_torque(d.pose, w)[0];
    d.pose.sin_type2 = 2.0;
    return 2.0 * (one - m.base_torque(d.pose, w)[0]);
  };
  const double at_rest = across(0.0);
  return at_rest / (at_rest - across(1.0));
}

/// Through y at `speed` (upwards, m/s), from rest to rest.
class Way {
 public:
  Way(double y, double speed, double acceleration)
      : start_(speed > 0.0 ? lower_y : upper_y), end_(speed > 0.0 ? upper_y : lower_y) {
    const Motion2<double> begin{{0, start_}, {0, 0}, {0, 0}}, end{{0, end_}, {0, 0}, {0, 0}},
        middle{{0, y}, {0, speed}, {0, acceleration}};
    // With an acceleration at the end a long quintic would swing far beyond its ends.
    const auto time = [&](double d) {
      const double usual = 2.0 * std::abs(d / speed);
      return acceleration == 0.0 ? usual : std::min(usual, 2.0 * std::sqrt(std::abs(d / acceleration)));
    };
    first_ = Quintic<double>::between(begin, middle, time(y - start_));
    second_ = Quintic<double>::between(middle, end, time(end_ - y));
  }
  [[nodiscard]] double start() const { return start_; }  ///< m
  [[nodiscard]] double end() const { return end_; }
  [[nodiscard]] double duration() const { return first_.duration + second_.duration; }
  [[nodiscard]] Motion2<double> at(double t) const {
    return t < first_.duration ? first_.at(t) : second_.at(t - first_.duration);
  }

 private:
  double start_, end_;
  Quintic<double> first_, second_;
};

struct Result {
  bool through = false;
  double worst = 0.0;  // m, error on the way
  int saturated = 0;   // ticks
};

/// What the controller does while the plan is near type 2: its law as ever, or the torque of the reference
/// and springs and dampers in the base joints.
enum class Inside { law, reference };

class Loop {
 public:
  explicit Loop(const FiveBarParams<double>& believed) : model_(believed), gains_(usual_gains(tick)) {
    gains_.independent.kp = 3.0;
    gains_.independent.kd = 0.1;
  }
  [[nodiscard]] const M& model() const { return model_; }

  Result run(const FiveBarParams<double>& truth, const Way& way, Inside inside) const {
    const FiveBarPlant plant(truth);
    const auto q = host::reach(truth, {0.0, way.start()}, {1, 1});
    FiveBarPlant::State s = FiveBarPlant::from_joints(*q, {0.0, 0.0, 0.0, 0.0});
    Result out;
    const int ticks = static_cast<int>((way.duration() + wait) / tick);
    for (int n = 0; n < ticks; ++n) {
      const auto o = plant.output(s);
      const Tracking<M> t = track(model_, mode, o, way.at(n * tick));
      const bool open = std::abs(t.desired_pose.sin_type2) < open_below;
      const double side = t.desired_pose.sin_type2 < 0.0 ? -1.0 : 1.0;
      if (!(open || side * t.pose.sin_type2 >= guard)) return out;  // the guard: a fault
      const Vec2<double> error = t.desired_pose.effector - t.pose.effector;
      out.worst = std::max(out.worst, error.norm());
      Vec2<double> tau = torque(t, open && inside == Inside::reference);
      for (int i = 0; i < 2; ++i) {
        if (!std::isfinite(tau[i])) tau[i] = 0.0;
        out.saturated += std::abs(tau[i]) > torque_limit ? 1 : 0;
        tau[i] = std::clamp(tau[i], -torque_limit, torque_limit);
      }
      advance(plant, s, tau, tick);
    }
    const auto o = plant.output(s);
    out.through = std::hypot(o.q[0], o.q[1] - way.end()) < goal;
    return out;
  }

 private:
  Vec2<double> torque(const Tracking<M>& t, bool of_reference) const {
    if (!of_reference) {
      const auto asked = demand(LawKind::esmc, model_, gains_, Reaching::implicit, t).acceleration;
      return model_.base_torque(t.pose, model_.force(asked, t.rates));
    }
    const auto asked = model_.channel_accelerations(t.desired_pose, t.desired_rates, t.desired_acceleration);
    auto pose = t.desired_pose;  // beside the pose itself, where numerator and D2 are both 0
    const double near = 1e-3;
    if (std::abs(pose.sin_type2) < near) pose.sin_type2 = pose.sin_type2 < 0.0 ? -near : near;
    return model_.base_torque(pose, model_.force(asked, t.desired_rates)) + torque_pd(gains_, t);
  }
  M model_;
  Gains<M> gains_;
};

FiveBarParams<double> sample(Random& r, double spread) {
  FiveBarParams<double> p = five_bar_example();
  const auto vary = [&](double& v) { v *= 1.0 + r.in<double>(-spread, spread); };
  vary(p.m0);
  for (auto& leg : p.legs) {
    for (double LegParams<double>::*v :
         {&LegParams<double>::m1, &LegParams<double>::m2, &LegParams<double>::J1, &LegParams<double>::J2})
      vary(leg.*v);
  }
  return p;
}

int study(int plants, const char* picture) {
  const Loop loop(five_bar_example());
  const double y = singular_y(five_bar_example());
  struct Case {
    const char* name;
    bool up, consistent;
    Inside inside;
  };
  constexpr Case cases[] = {{"down, consistent, law", false, true, Inside::law},
                            {"down, consistent, reference", false, true, Inside::reference},
                            {"down, plain, law", false, false, Inside::law},
                            {"up, consistent, law", true, true, Inside::law},
                            {"up, consistent, reference", true, true, Inside::reference},
                            {"up, plain, law", true, false, Inside::law}};
  constexpr double speeds[] = {0.05, 0.1, 0.2, 0.3, 0.5, 1.0, 2.0};
  std::vector<host::Series> curves;
  fmt::print("| way, torque near type 2 |");
  for (const double speed : speeds) fmt::print(" {:g} m/s |", speed);
  fmt::print("\n|---|---|---|---|---|---|---|---|\n");
  int missed = 0;  // passages of the nominal plant that are sure to work
  for (const Case& c : cases) {
    curves.push_back({c.name, {}});
    fmt::print("| {} |", c.name);
    for (const double pace : speeds) {
      const double speed = c.up ? pace : -pace;
      const double a = consistent_acceleration(loop.model(), y, speed);
      const Way way(y, speed, c.consistent ? a : 0.0);
      Random r(2311);
      int through = 0, saturated = 0;
      std::vector<double> worst;
      for (int i = 0; i < plants; ++i) {
        const Result one = loop.run(sample(r, 0.05), way, c.inside);
        through += one.through ? 1 : 0;
        saturated += one.saturated;
        if (one.through) worst.push_back(one.worst);
      }
      std::ranges::sort(worst);
      const Result nominal = loop.run(five_bar_example(), way, c.inside);
      if (c.consistent && pace >= 0.5 && !nominal.through) ++missed;
      const double share = 100.0 * through / plants;
      curves.back().points.emplace_back(pace, share);
      fmt::print(" {:.3g} %, {}, {:.2g} |", share,
                 through > 0 ? fmt::format("{:.2g}", 1e3 * worst[worst.size() / 2]) : "-",
                 static_cast<double>(saturated) / plants);
      std::fflush(stdout);
    }
    fmt::print("\n");
  }
  if (picture != nullptr) {
    std::ofstream(picture) << host::standalone(
        host::chart_svg("Passage of type 2 with two motors", "speed there, m/s", "plants that get through, %",
                        curves, host::Scale::linear, host::Scale::linear));
  }
  return missed == 0 ? 0 : 1;
}

}  // namespace
}  // namespace esmc::test

int main(int argc, char** argv) {
  return esmc::test::study(argc > 1 ? std::atoi(argv[1]) : 20, argc > 2 ? argv[2] : nullptr);
}
