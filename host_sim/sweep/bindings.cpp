/// Numbers of a Scene that a sweep sets without reading the scene again. The reader checks their range and
/// what CaseScenes::bind checks again: legs that can move, and the start.

#include <string>
#include <string_view>

#include "host_sim/scene/key.hpp"
#include "host_sim/sweep/cases.hpp"

namespace esmc::host {
namespace {

struct Row {
  std::string_view key;   ///< as in a specification
  std::string_view path;  ///< in the table of keys
  Binding::Set set;
};

template <double LegParams<double>::*member>
void both(Scene& s, double v) {
  for (LegParams<double>& leg : s.mechanism.legs) leg.*member = v;
}
template <std::size_t leg, double LegParams<double>::*member>
void one(Scene& s, double v) {
  s.mechanism.legs[leg].*member = v;
}
template <double ModelFactors::*member>
void factor(Scene& s, double v) {
  s.model.*member = v;
}
template <PerKind Scene::*member>
void per_kind(Scene& s, double v) {
  s.*member = {v, v};
}

#define ESMC_LEG(x)                                                                   \
  {"mechanism.leg." #x, "mechanism.leg." #x, both<&LegParams<double>::x>},            \
      {"mechanism.legs.1." #x, "mechanism.leg." #x, one<0, &LegParams<double>::x>},   \
      {"mechanism.legs.2." #x, "mechanism.leg." #x, one<1, &LegParams<double>::x>}, { \
    "control.model." #x, "control.model." #x, factor<&ModelFactors::x>                \
  }

constexpr Row rows[] = {
    ESMC_LEG(l1),
    ESMC_LEG(l2),
    ESMC_LEG(lg1),
    ESMC_LEG(lg2),
    ESMC_LEG(m1),
    ESMC_LEG(m2),
    ESMC_LEG(J1),
    ESMC_LEG(J2),
    {"mechanism.half_base", "mechanism.half_base", [](Scene& s, double v) { s.mechanism.l0 = v; }},
    {"mechanism.effector_mass", "mechanism.effector_mass", [](Scene& s, double v) { s.mechanism.m0 = v; }},
    {"control.model.half_base", "control.model.half_base", factor<&ModelFactors::half_base>},
    {"control.model.effector_mass", "control.model.effector_mass", factor<&ModelFactors::effector_mass>},
    {"control.model.gravity", "control.model.gravity", factor<&ModelFactors::gravity>},
    {"control.lambda", "control.lambda", per_kind<&Scene::lambda>},
    {"control.gain", "control.gain",
     [](Scene& s, double v) {
       s.gain = {v, v};
       s.robust_gain = false;
     }},
    {"control.layer", "control.layer", per_kind<&Scene::layer>},
    {"control.kp", "control.kp", [](Scene& s, double v) { s.kp = v; }},
    {"control.kd", "control.kd", [](Scene& s, double v) { s.kd = v; }},
    {"control.delay_ticks", "control.delay_ticks", [](Scene& s, double v) { s.delay_ticks = v; }},
    {"reference.radius", "reference[circle].radius", [](Scene& s, double v) { s.reference.radius = v; }},
    {"reference.speed", "reference[circle].speed", [](Scene& s, double v) { s.reference.speed = v; }},
    {"reference.phase", "reference[circle].phase", [](Scene& s, double v) { s.reference.phase = v; }},
};
#undef ESMC_LEG

}  // namespace

Binding find_binding(const std::string& key, const Scene& nominal) {
  const std::string name = key.starts_with("plant.") ? "mechanism." + key.substr(6) : key;
  const bool five_bar = nominal.type == MechanismType::five_bar;
  for (const Row& r : rows) {
    if (r.key != name) continue;
    const bool circle = nominal.reference.type == ReferenceType::circle;
    if (name.starts_with("reference.") && !circle) return {};
    if (!five_bar && (name.starts_with("mechanism.legs") || name == "mechanism.half_base" ||
                      name == "mechanism.effector_mass"))
      return {};
    const Key& k = find_key(r.path);
    return {r.set, k.low, k.high, k.low_open};
  }
  return {};
}

}  // namespace esmc::host
