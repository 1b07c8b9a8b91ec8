#include "host_sim/plant/system.hpp"

#include <cmath>

#include "firmware/numeric/elementary.hpp"

namespace esmc::host {
namespace {

using Values = std::span<const double>;
using Torque = std::span<double>;

struct Maker {
  Loads& out;
  void operator()(const ViscousFriction& e) const {
    out.joint.emplace_back([d = e.coefficient](Values, Values rate, Torque torque) {
      for (std::size_t i = 0; i < rate.size(); ++i) torque[i] -= d[i] * rate[i];
    });
  }
  void operator()(const CoulombFriction& e) const {
    if (e.regularised > 0.0) {
      out.joint.emplace_back([e, per_rate = 1.0 / e.regularised](Values, Values rate, Torque torque) {
        for (std::size_t i = 0; i < rate.size(); ++i) {
          const double sign = hyperbolic_tangent(rate[i] * per_rate);
          torque[i] -= e.torque[i] * sign;
          torque[i] -= e.asymmetry[i] * sign * sign;  // as smooth as the sign
        }
      });
    } else if (e.asymmetry != PerJoint{}) {  // a constant torque beside what is set-valued, also at rest:
                                             // [-torque, torque] less it
      out.joint.emplace_back([more = e.asymmetry](Values, Values rate, Torque torque) {
        for (std::size_t i = 0; i < rate.size(); ++i) torque[i] -= more[i];
      });
    }
  }
  /// Unloading along restitution^2 of the stiffness (Walton and Braun 1986): the rebound speed is restitution
  /// times the impact speed for every mass.
  void operator()(const EndStops& e) const {
    if (!e.stiffness) return;
    out.joint.emplace_back([e](Values angle, Values rate, Torque torque) {
      const double stiff = *e.stiffness, back = e.restitution * e.restitution;
      const std::size_t stride =
          angle.size() / 2;  // base joints: 0 and 2 of the five-bar, 0 and 1 of the arm
      for (std::size_t i = 0; i < 2; ++i) {
        const std::size_t joint = i * stride;
        const double above = angle[joint] - e.upper[i], below = e.lower[i] - angle[joint];
        if (above > 0.0) torque[joint] -= stiff * above * (rate[joint] > 0.0 ? 1.0 : back);
        if (below > 0.0) torque[joint] += stiff * below * (rate[joint] < 0.0 ? 1.0 : back);
      }
    });
  }
  void operator()(const ExternalForce& e) const {
    const auto force = [e](V2 p, V2 v) -> V2 {
      if (!e.human) return {e.force[0], e.force[1]};
      return e.stiffness * (V2{e.anchor[0], e.anchor[1]} - p) - e.damping * v;
    };
    out.effector.push_back({force, e.from, e.to});
    out.breaks.insert(out.breaks.end(), {e.from, e.to});
  }
  template <class Other>
  void operator()(const Other&) const {}
};

}  // namespace

Loads make_loads(const std::vector<Effect>& effects) {
  Loads out;
  for (const Effect& e : effects) std::visit(Maker{out}, e);
  return out;
}

bool set_valued(const std::vector<Effect>& effects) {
  const auto friction = find_effect<CoulombFriction>(effects);
  const auto stops = find_effect<EndStops>(effects);
  return (friction && !(friction->regularised > 0.0)) || (stops && !stops->stiffness);
}

bool may_have_events(const std::vector<Effect>& effects) {
  return set_valued(effects) || find_effect<EndStops>(effects) || find_effect<Backlash>(effects) ||
         find_effect<TorqueSaturation>(effects);
}

}  // namespace esmc::host
