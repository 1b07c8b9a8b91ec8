// What random scenes do in a plant that is not ours, under the firmware's controller: the judge of `esmc
// check`. usage: verdict_judge SCENE; prints one JSON object. The bodies are those of accuracy_judge.hpp;
// drives, sensors and delays are written here from docs/effects.md.

#include <cstdio>
#include <deque>
#include <nlohmann/json.hpp>
#include <numbers>

#include "firmware/cycle/instances.hpp"
#include "firmware/safety/faults.hpp"
#include "host_sim/controller/controller_config.hpp"
#include "host_sim/controller/robust.hpp"
#include "host_sim/error.hpp"
#include "host_sim/names.hpp"
#include "tests/studies/accuracy_judge.hpp"

namespace {

using namespace esmc;
using host::Scene;

/// The effects of a scene, those that may be named once.
struct Named {
  judge::Case plant;
  double saturation = 0, continuous = 0, heating = 0;  ///< N m, N m, s; 0: not named
  double counts = 0, bandwidth = 0;                    ///< per turn; rad/s, 0: no observer
  int sensor_delay = 0;                                ///< ticks
  double torque_delay = 0;                             ///< s
  double force_from = 0, force_to = 0;

  void operator()(const host::ViscousFriction& e) { plant.viscous = e.coefficient; }
  void operator()(const host::CoulombFriction& e) {
    plant.rubs = true;
    plant.friction = e.torque;
  }
  void operator()(const host::JointFlexibility& e) {
    plant.gear = true;
    plant.gear_stiffness = e.stiffness[0];
    plant.gear_damping = e.damping[0];
    plant.rotor = e.rotor_inertia[0];
  }
  void operator()(const host::Backlash& e) {
    plant.play = true;
    plant.gap = e.gap;
  }
  void operator()(const host::Payload& e) {
    plant.load_mass = e.mass;
    plant.load_from = e.from;
    plant.load_to = e.to;
  }
  void operator()(const host::ExternalForce& e) {
    plant.force = e.human ? std::array{0.0, 0.0} : e.force;
    plant.anchor = e.anchor;
    plant.hand_stiffness = e.human ? e.stiffness : 0.0;
    plant.hand_damping = e.human ? e.damping : 0.0;
    force_from = e.from;
    force_to = e.to;
  }
  void operator()(const host::TorqueLag& e) { plant.lag = e.time_constant; }
  void operator()(const host::TorqueSaturation& e) { saturation = e.limit; }
  void operator()(const host::ThermalLimit& e) {
    continuous = e.continuous;
    heating = e.time_constant;
  }
  void operator()(const host::Encoder& e) {
    counts = std::pow(2.0, e.bits);
    bandwidth = e.bandwidth;
  }
  void operator()(const host::SensorDelay& e) { sensor_delay = e.ticks; }
  void operator()(const host::ComputeDelay& e) { torque_delay = e.time; }
  template <class Other>
  void operator()(const Other&) {
    throw host::InputError("", std::string("no judge of ") + Other::type);
  }
};

Named named(const Scene& s) {
  Named n;
  judge::Case& c = n.plant;
  c.five_bar = s.type == host::MechanismType::five_bar;
  c.closed = true;
  c.motors = static_cast<std::size_t>(s.motors());
  for (std::size_t j = 0; j < 2; ++j) {
    const auto& l = s.mechanism.legs[j];
    c.leg[j] = {l.l1, l.l2, l.lg1, l.lg2, l.m1, l.m2, l.J1, l.J2};
  }
  c.base = s.mechanism.l0;
  c.effector_mass = c.five_bar ? s.mechanism.m0 : 0.0;
  c.gravity = s.mechanism.g;
  c.start = {s.start_angle[0], s.start_angle[c.five_bar ? 2 : 1]};
  c.rough = true;
  for (const host::Effect& e : s.effects) std::visit(n, e);
  return n;
}

/// A drive: what it delivers of a torque, and how warm it is.
class Motor {
 public:
  double operator()(const Named& n, double torque, double tick) {
    double out = torque;
    if (n.saturation > 0) out = std::min(std::max(out, -n.saturation), n.saturation);
    if (n.continuous > 0) {
      if (hot_) out = std::min(std::max(out, -n.continuous), n.continuous);
      for (int i = 0; i < 100; ++i)
        heat_ += tick / 100 / n.heating * (out * out / (n.continuous * n.continuous) - heat_);
      if (heat_ > 1.0) hot_ = true;
      if (heat_ < 0.9) hot_ = false;
    }
    return out;
  }

 private:
  double heat_ = 0;
  bool hot_ = false;
};

/// Encoder with the drive's observer: two equal real poles, sampled eight times per tick.
class Eye {
 public:
  Eye(const Named& n, double gear, double angle, double period)
      : gear_(gear), counts_(n.counts), old_(static_cast<std::size_t>(n.sensor_delay)) {
    if (n.bandwidth > 0) pole_ = std::exp(-n.bandwidth * period);
    period_ = period;
    angle_ = counted(angle);
    for (auto& o : old_) o = {n.bandwidth > 0 ? angle_ : angle, 0.0};
  }
  /// One of the samples of a tick.
  void look(double angle) {
    if (pole_ == 0) return;
    // x' = x + T v + a m, v' = v + b m, m = y - x - T v: (z - p)^2 asks a = 1 - p^2, b T = (1 - p)^2.
    const double guess = angle_ + period_ * rate_, miss = counted(angle) - guess;
    rate_ += (1 - pole_) * (1 - pole_) / period_ * miss;
    angle_ = guess + (1 - pole_ * pole_) * miss;
  }
  /// At a tick: what the drive says.
  std::array<double, 2> say(const std::array<double, 2>& truth) {
    old_.push_back(pole_ == 0 ? truth : std::array{angle_, rate_});
    const auto out = old_.front();
    old_.pop_front();
    return out;
  }

 private:
  [[nodiscard]] double counted(double angle) const {
    if (counts_ == 0) return angle;
    const double step = 2 * std::numbers::pi / (counts_ * gear_);
    return step * std::nearbyint(angle / step);
  }
  double gear_, counts_, pole_ = 0, period_ = 0, angle_ = 0, rate_ = 0;
  std::deque<std::array<double, 2>> old_;
};

struct Result {
  double change = 0, saturated = 0;
  std::uint32_t ticks = 0;
  Fault fault = Fault::none;
  bool diverged = false;
};

template <class M>
class Loop {
 public:
  explicit Loop(const Scene& s)
      : s_(s),
        n_(named(s)),
        plant_(n_.plant),
        bundle_(host::make_reference(s, host::Pacing::lockstep)),
        controller_(host::make_controller<M>(s, host::Pacing::lockstep, bundle_)),
        joint_(s.motor_joints()),
        motor_(joint_.size()) {
    for (std::size_t j = 0; j < static_cast<std::size_t>(s.joints()); ++j)
      eye_.emplace_back(n_, 1.0, plant_.seen_joint(j)[0], s.tick() / looks);
  }

  Result run() {
    Result out;
    Supervisor supervisor(controller_.supervision());
    supervisor.begin_tick(Command::enable, {});
    TickResult<M> r;
    const std::uint32_t ticks = host::tick_count(s_), join = bundle_.join_ticks;
    std::vector<double> before, share(joint_.size());
    std::uint32_t counted = 0;
    for (std::uint32_t n = 0; n < ticks; ++n) {
      Sample<M> sample;
      for (std::size_t j = 0; j < eye_.size(); ++j) {
        const auto seen = eye_[j].say(plant_.seen_joint(j));
        sample.angle[static_cast<int>(j)] = seen[0];
        sample.rate[static_cast<int>(j)] = seen[1];
      }
      supervisor.begin_tick(Command::none, {true, false}, r.stage_done);
      r = controller_.tick(sample, supervisor);
      out.fault = r.fault;
      if (r.fault != Fault::none) break;
      bool cut = r.saturated;
      std::array<double, 4> torque{};
      double moved = 0;
      for (std::size_t m = 0; m < joint_.size(); ++m) {
        const double asked = r.torque[static_cast<int>(joint_[m])];
        torque[m] = motor_[m](n_, asked, s_.tick());
        cut = cut || torque[m] != asked;
        if (!before.empty()) moved += std::abs(torque[m] - before[m]) / s_.torque_limit[m];
      }
      before.assign(torque.begin(), torque.begin() + static_cast<long>(joint_.size()));
      out.saturated += cut ? 1 : 0;
      ++out.ticks;
      if (n == join)
        out.change = counted = 0;  // a run that does not live to see its end is judged by the join
      out.change += moved / static_cast<double>(joint_.size());
      ++counted;
      if (!move(n * s_.tick(), torque)) {
        out.diverged = true;
        break;
      }
    }
    out.change /= std::max(1U, counted);
    out.saturated /= std::max(1U, out.ticks);
    return out;
  }

 private:
  static constexpr int looks = 8;

  /// Over a tick from t, in steps of an eighth or less, so that every change of torque falls on one.
  bool move(double t, const std::array<double, 4>& torque) {
    waiting_.push_back({t + n_.torque_delay, torque});
    const double h = s_.tick() / looks;
    for (int i = 0; i < looks; ++i) {
      double at = t + i * h;
      const double end = t + (i + 1) * h;
      while (end - at > 1e-12) {
        while (!waiting_.empty() && waiting_.front().first <= at + 1e-12) {
          acting_ = waiting_.front().second;
          waiting_.pop_front();
        }
        double to = waiting_.empty() ? end : std::min(end, waiting_.front().first);
        if (n_.plant.gear) to = std::min(to, at + h / 2);
        const judge::Case& c = n_.plant;
        const double middle = 0.5 * (at + to);
        if (!plant_.move(
                at, to - at, acting_,
                middle > c.load_from && middle<c.load_to, middle> n_.force_from && middle < n_.force_to))
          return false;
        at = to;
      }
      for (std::size_t j = 0; j < eye_.size(); ++j) eye_[j].look(plant_.seen_joint(j)[0]);
    }
    return true;
  }

  const Scene& s_;
  Named n_;
  judge::Plant plant_;
  host::ReferenceBundle<double> bundle_;
  Controller<M> controller_;
  std::vector<std::size_t> joint_;
  std::vector<Motor> motor_;
  std::vector<Eye> eye_;
  std::deque<std::pair<double, std::array<double, 4>>> waiting_;
  std::array<double, 4> acting_{};
};

}  // namespace

int main(int argc, char** argv) try {
  if (argc != 2) return 2;
  const Scene s = host::read_scene(argv[1], {});
  const Result r = host::with_mechanism<double>(s, [&]<class M>(const M*) { return Loop<M>(s).run(); });
  const nlohmann::json j = {{"change", r.change},
                            {"saturated", r.saturated},
                            {"ticks", r.ticks},
                            {"fault", r.fault == Fault::none ? "" : name(r.fault)},
                            {"diverged", r.diverged}};
  std::puts(j.dump().c_str());
  return 0;
} catch (const std::exception& e) {
  std::fprintf(stderr, "verdict_judge: %s\n", e.what());
  return 2;
}
