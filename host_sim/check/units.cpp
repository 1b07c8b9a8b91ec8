#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "host_sim/check/check.hpp"

namespace esmc::host {
namespace {

constexpr double longest = 5.0;  ///< m: bars of planar mechanisms are shorter

/// Beyond a turn, and as round as degrees are.
bool like_degrees(double v) {
  return std::abs(v) > 2.0 * std::numbers::pi && std::abs(v) <= 720.0 && std::fmod(v, 5.0) == 0.0;
}

void judge_legs(const Scene& s, Findings& f) {
  const std::size_t legs = s.type == MechanismType::five_bar ? 2 : 1;
  for (std::size_t j = 0; j < legs; ++j) {
    const LegParams<double>& leg = s.mechanism.legs[j];
    const auto hint = [&](const char* key, const std::string& text) {
      f.hint(Code::units_suspicious, std::string("mechanism.leg.") + key, "leg {}: {} {}", j + 1, key, text);
    };
    for (const auto& [key, length] : {std::pair{"l1", leg.l1}, std::pair{"l2", leg.l2}})
      if (length > longest) hint(key, fmt::format("= {:g} m: millimetres?", length));
    if (std::abs(leg.lg1) > leg.l1)
      hint("lg1", fmt::format("= {:g} m: the mass centre is outside its bar of {:g} m", leg.lg1, leg.l1));
    if (std::abs(leg.lg2) > leg.l2)
      hint("lg2", fmt::format("= {:g} m: the mass centre is outside its bar of {:g} m", leg.lg2, leg.l2));
    for (const auto& [key, inertia, mass, length] :
         {std::tuple{"J1", leg.J1, leg.m1, leg.l1}, std::tuple{"J2", leg.J2, leg.m2, leg.l2}}) {
      if (mass > 0.0 && inertia > mass * length * length)
        hint(key, fmt::format("= {:g} kg m2 is more than the whole mass at the end of the bar has", inertia));
    }
  }
  if (s.type == MechanismType::five_bar && s.mechanism.l0 > longest)
    f.hint(Code::units_suspicious, "mechanism.half_base", "half_base = {:g} m: millimetres?", s.mechanism.l0);
}

}  // namespace

void judge_units(const Scene& s, Findings& f) {
  judge_legs(s, f);
  const auto degrees = [&](const char* key, const auto& values) {
    for (const double v : values) {
      if (!like_degrees(v)) continue;
      f.hint(Code::units_suspicious, key,
             "{} = {:g} rad is more than a turn: degrees? {:g} degrees are {:.4g} rad", key, v, v,
             v * std::numbers::pi / 180.0);
      return;
    }
  };
  const ReferenceScene& r = s.reference;
  degrees("reference.phase", std::array{r.phase});
  degrees("reference.phases", r.phases);
  if (r.type == ReferenceType::joint_sine) {
    degrees("reference.offset", r.offset);
    degrees("reference.amplitude", r.amplitude);
  }
  degrees("initial.joints", s.initial.joints);
  degrees("drives.offset", s.drives.offset);
  if (s.limits.joint_angle) {
    for (const auto& range : *s.limits.joint_angle) degrees("limits.joint_angle", range);
  }
  if (s.closed_loop() && !s.accuracy && s.step > 1.5 * s.tick()) {
    f.hint(Code::units_suspicious, "simulation.step",
           "simulation.step = {:g} s is longer than a tick of {:g} s, with which every step ends: {:g} s is "
           "used",
           s.step, s.tick(), s.tick());
  }
}

}  // namespace esmc::host
