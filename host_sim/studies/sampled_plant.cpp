#include "host_sim/studies/studies.hpp"

#include <fmt/format.h>

#include "host_sim/controller/controller_config.hpp"
#include "host_sim/scene/scene.hpp"
#include "host_sim/sweep/sample.hpp"

namespace esmc::host {
namespace {

/// Draws one number after another from intervals.
class Draw {
 public:
  Draw(std::uint64_t seed, std::uint64_t index) : seed_(seed), index_(index), corner_(index % 2 == 0) {}
  double in(const Interval& i) {
    const std::uint64_t bits = random_bits(seed_, 0x2000'0000'0000'0000ULL + next_++, index_);
    const double u = corner_ ? static_cast<double>(bits >> 63U) : static_cast<double>(bits >> 11U) * 0x1p-53;
    return i.lower + u * (i.upper - i.lower);
  }

 private:
  std::uint64_t seed_, index_, next_ = 0;
  bool corner_;
};

bool within(double v, const Interval& i) {
  const double slack = 1e-9 * std::max(std::abs(i.lower), std::abs(i.upper));
  return v >= i.lower - slack && v <= i.upper + slack;
}

/// Delays that the controller assumes, s and ticks.
double known_torque_delay(const Scene& s) { return delay_ticks(s, Pacing::lockstep) * s.tick(); }
int known_sensor_delay(const Scene& s) { return static_cast<int>(std::floor(s.sensor_lag_ticks)); }

/// Makes an effect of the scene at least so large; `size` is its only parameter.
template <class E, class T>
void enlarge(std::vector<Effect>& effects, T E::*size, T least) {
  const auto own = find_effect<E>(effects);
  if (!(least > (own ? (*own).*size : T(0)))) return;
  std::erase_if(effects, [](const Effect& e) { return std::holds_alternative<E>(e); });
  effects.emplace_back(E{least});
}

/// Gives the plant the delays that the controller assumes.
void delay(Scene& s) {
  enlarge(s.effects, &ComputeDelay::time, known_torque_delay(s));
  if (!find_effect<Encoder>(s.effects) && !find_effect<SensorNoise>(s.effects))
    enlarge(s.effects, &SensorDelay::ticks, known_sensor_delay(s));
}

}  // namespace

Scene sampled_plant(const Scene& scene, std::uint64_t seed, std::uint64_t index, bool lengths) {
  const UncertaintyScene& u = *scene.uncertainty;
  const FiveBarParams<double> belief = believed_mechanism(scene);
  Draw draw(seed, index);
  Scene out = scene;
  out.model = {};  // `believed` includes the factors
  out.believed = belief;
  out.model.friction = friction_of(belief);
  FiveBarParams<double>& truth = out.mechanism;
  truth = belief;
  const auto about = [](double half) { return Interval{1.0 - half, 1.0 + half}; };
  const bool rr = scene.type == MechanismType::rr;
  for (auto& leg : truth.legs) {
    leg.m1 *= draw.in(u.m1);
    leg.m2 *= draw.in(u.m2);
    leg.J1 *= draw.in(u.J1);
    leg.J2 *= draw.in(u.J2);
    leg.lg1 += draw.in(u.lg1);
    leg.lg2 += draw.in(u.lg2);
    const double l1 = draw.in(about(u.l1)), l2 = draw.in(about(u.l2));
    if (lengths) {
      leg.l1 *= l1;
      leg.l2 *= l2;
    }
  }
  set_friction(truth, {});  // the plant's are effects
  const double base = draw.in(about(u.half_base));
  if (lengths && !rr) truth.l0 *= base;
  truth.g *= draw.in(u.gravity);
  const double load = draw.in(u.payload);
  std::erase_if(out.effects, [](const Effect& e) {
    return std::holds_alternative<ViscousFriction>(e) || std::holds_alternative<CoulombFriction>(e) ||
           std::holds_alternative<Payload>(e);
  });
  if (rr) {
    if (load > 0.0) out.effects.emplace_back(Payload{load, 0.0, 1e6});
  } else {
    truth.m0 += load;
  }
  const auto friction = [&](const auto& given, const PerJoint& believed) {
    PerJoint v{};
    for (std::size_t j = 0; j < 4; ++j) v[j] = draw.in(interval_of(given, believed, j));
    return v;
  };
  const PerJoint viscous = friction(u.viscous, out.model.friction.viscous),
                 dry = friction(u.coulomb, out.model.friction.dry);
  const auto any = [](const PerJoint& v) { return std::ranges::any_of(v, [](double x) { return x > 0.0; }); };
  if (any(viscous)) out.effects.emplace_back(ViscousFriction{viscous});
  if (any(dry)) out.effects.emplace_back(CoulombFriction{dry, 0.0, out.model.friction.asymmetry});
  delay(out);
  set_start(out, scene.control_where, scene.reference_where);
  return out;
}

std::vector<std::string> outside(const Scene& scene) {
  const UncertaintyScene& u = *scene.uncertainty;
  const FiveBarParams<double> belief = believed_mechanism(scene);
  const FiveBarParams<double>& truth = scene.mechanism;
  std::vector<std::string> out;
  const auto judge = [&](const std::string& what, double is, const Interval& allowed) {
    if (!within(is, allowed))
      out.push_back(fmt::format("{} = {:.4g}, [uncertainty] has [{:.4g}, {:.4g}]", what, is, allowed.lower,
                                allowed.upper));
  };
  const auto share = [&](const std::string& what, double is, double believed, const Interval& allowed) {
    if (believed == 0.0 && is == 0.0) return;
    judge("true / believed " + what, is / believed, allowed);
  };
  const bool rr = scene.type == MechanismType::rr;
  const JointFriction is = friction_of(scene.effects).value_or(JointFriction{}), known = friction_of(belief);
  const auto load = find_effect<Payload>(scene.effects);
  for (std::size_t j = 0; j < (rr ? 1U : 2U); ++j) {
    const auto &t = truth.legs[j], &b = belief.legs[j];
    const std::string of = rr ? "" : fmt::format(" of leg {}", j + 1);
    share("m1" + of, t.m1, b.m1, u.m1);
    share("m2" + of, t.m2, b.m2, u.m2);
    share("J1" + of, t.J1, b.J1, u.J1);
    share("J2" + of, t.J2, b.J2, u.J2);
    judge("true - believed lg1" + of, t.lg1 - b.lg1, u.lg1);
    judge("true - believed lg2" + of, t.lg2 - b.lg2, u.lg2);
    share("l1" + of, t.l1, b.l1, {1, 1});
    share("l2" + of, t.l2, b.l2, {1, 1});
  }
  if (!rr) share("half_base", truth.l0, belief.l0, {1, 1});
  share("gravity", truth.g, belief.g, u.gravity);
  const double added = (load ? load->mass : 0.0) + (rr ? 0.0 : truth.m0 - belief.m0);
  judge("mass at the effector beyond the believed one", added, u.payload);
  for (std::size_t j = 0; j < (rr ? 2U : 4U); ++j) {
    judge(fmt::format("viscous friction of joint {}", j + 1), is.viscous[j],
          interval_of(u.viscous, known.viscous, j));
    judge(fmt::format("dry friction of joint {}", j + 1), is.dry[j], interval_of(u.coulomb, known.dry, j));
  }
  return out;
}

std::vector<std::string> not_covered(const Scene& scene) {
  std::vector<std::string> out;
  const bool implicit = scene.reaching == ReachingChoice::implicit;  // only this one has a sampled guarantee
  for (const Effect& e : scene.effects) {
    const std::string type = type_name(e);
    const auto* torque = std::get_if<ComputeDelay>(&e);
    const auto* sensor = std::get_if<SensorDelay>(&e);
    if (implicit && torque != nullptr && torque->time <= known_torque_delay(scene) * (1.0 + 1e-9)) continue;
    if (implicit && sensor != nullptr && sensor->ticks <= known_sensor_delay(scene)) continue;
    if (type != ViscousFriction::type && type != CoulombFriction::type && type != Payload::type)
      out.push_back(type);
  }
  return out;
}

}  // namespace esmc::host
