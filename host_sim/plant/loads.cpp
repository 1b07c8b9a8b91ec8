#include "host_sim/plant/loads.hpp"

#include "firmware/numeric/elementary.hpp"

namespace esmc::host {
namespace {

class Viscous final : public JointLoad {
 public:
  explicit Viscous(const ViscousFriction& e) : d_(e.coefficient) {}
  void add(std::span<const double>, std::span<const double> rate, std::span<double> torque) const override {
    for (std::size_t i = 0; i < rate.size(); ++i) torque[i] -= d_[i] * rate[i];
  }

 private:
  PerJoint d_;
};

class SmoothedCoulomb final : public JointLoad {
 public:
  explicit SmoothedCoulomb(const CoulombFriction& e) : torque_(e.torque), per_rate_(1.0 / e.regularised) {}
  void add(std::span<const double>, std::span<const double> rate, std::span<double> torque) const override {
    for (std::size_t i = 0; i < rate.size(); ++i)
      torque[i] -= torque_[i] * hyperbolic_tangent(rate[i] * per_rate_);
  }

 private:
  PerJoint torque_;
  double per_rate_;
};

/// Unloading along restitution^2 of the stiffness (Walton and Braun 1986): the rebound speed is restitution
/// times the impact speed for every mass.
class SoftStops final : public JointLoad {
 public:
  explicit SoftStops(const EndStops& e) : stops_(e) {}
  void add(std::span<const double> angle, std::span<const double> rate,
           std::span<double> torque) const override {
    const double stiff = *stops_.stiffness, back = stops_.restitution * stops_.restitution;
    const std::size_t stride = angle.size() / 2;  // base joints: 0 and 2 of the five-bar, 0 and 1 of the arm
    for (std::size_t i = 0; i < 2; ++i) {
      const std::size_t joint = i * stride;
      const double above = angle[joint] - stops_.upper[i], below = stops_.lower[i] - angle[joint];
      if (above > 0.0) torque[joint] -= stiff * above * (rate[joint] > 0.0 ? 1.0 : back);
      if (below > 0.0) torque[joint] += stiff * below * (rate[joint] < 0.0 ? 1.0 : back);
    }
  }

 private:
  EndStops stops_;
};

class Force final : public EffectorLoad {
 public:
  explicit Force(const ExternalForce& e) : e_(e) {}
  void begin(double middle) override { acting_ = middle > e_.from && middle < e_.to; }
  [[nodiscard]] V2 force(V2 p, V2 v) const override {
    if (!acting_) return {};
    if (!e_.human) return {e_.force[0], e_.force[1]};
    return e_.stiffness * (V2{e_.anchor[0], e_.anchor[1]} - p) - e_.damping * v;
  }

 private:
  ExternalForce e_;
  bool acting_ = false;
};

struct Maker {
  Loads& out;
  void operator()(const ViscousFriction& e) const { out.joint.push_back(std::make_unique<Viscous>(e)); }
  void operator()(const CoulombFriction& e) const {
    if (e.regularised > 0.0) out.joint.push_back(std::make_unique<SmoothedCoulomb>(e));
  }
  void operator()(const EndStops& e) const {
    if (e.stiffness) out.joint.push_back(std::make_unique<SoftStops>(e));
  }
  void operator()(const ExternalForce& e) const {
    out.effector.push_back(std::make_unique<Force>(e));
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

}  // namespace esmc::host
