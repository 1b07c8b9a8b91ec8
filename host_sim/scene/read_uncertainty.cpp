#include "host_sim/scene/reader.hpp"

#include "host_sim/scene/scene.hpp"

namespace esmc::host {
namespace {

Interval ordered(const Section& s, const char* key, const std::array<double, 2>& r) {
  if (!(r[0] <= r[1]))
    s.fail(key, "must be [lower, upper] with lower <= upper, not [{:g}, {:g}]", r[0], r[1]);
  return {r[0], r[1]};
}

/// Truth over belief, where `about` is 1, or less belief, where it is 0: a number h stands for about -+ h.
Interval around(Section& s, const char* key, double about) {
  const auto r = s.number_or_pair(key);
  if (!r) return {about, about};
  if (r->size() == 2) return ordered(s, key, {(*r)[0], (*r)[1]});
  const double h = r->front();
  if (about == 1.0 && !(h < 1.0))
    s.fail(key, "is a share: a half width below 1 (0.1 is 10 %), or [lower, upper] as factors; not {:g}", h);
  if (about == 0.0 && !(h >= 0.0)) s.fail(key, "must be a half width >= 0, or [lower, upper]; not {:g}", h);
  return {about == 0.0 ? -h : about - h, about + h};
}

std::optional<std::array<Interval, 4>> per_joint(Section& s, const char* key, bool five_bar) {
  if (!s.has(key)) return std::nullopt;
  const auto given = s.pairs(key);
  if (given.size() != 2 && !(five_bar && given.size() == 4)) {
    s.fail(key, "must have [lower, upper] for each of the two joints{}",
           five_bar ? " of a leg, or for all four" : "");
  }
  std::array<Interval, 4> out;
  for (std::size_t i = 0; i < 4; ++i) out[i] = ordered(s, key, given[given.size() == 4 ? i : i % 2]);
  return out;
}

}  // namespace

void read_uncertainty(Section s, Scene& scene) {
  const bool five_bar = scene.type == MechanismType::five_bar;
  UncertaintyScene& u = scene.uncertainty.emplace();
  s.read_fields(scene);
  u.m1 = around(s, "m1", 1.0);
  u.m2 = around(s, "m2", 1.0);
  u.J1 = around(s, "J1", 1.0);
  u.J2 = around(s, "J2", 1.0);
  u.lg1 = around(s, "lg1", 0.0);
  u.lg2 = around(s, "lg2", 0.0);
  u.gravity = around(s, "gravity", 1.0);
  if (const auto r = s.optional_numbers("payload", {2}))
    u.payload = ordered(s, "payload", {(*r)[0], (*r)[1]});
  const double carried =
      five_bar ? scene.believed.value_or(scene.mechanism).m0 * scene.model.effector_mass : 0.0;
  if (!(carried + u.payload.lower >= 0.0)) {
    s.fail("payload", "takes away more than the {:g} kg that the controller believes at the effector",
           carried);
  }
  u.viscous = per_joint(s, "viscous", five_bar);
  u.coulomb = per_joint(s, "coulomb", five_bar);
  if (five_bar) u.half_base = s.number("half_base");
  u.workspace = s.text("over") == "workspace";
  s.finish();
}

}  // namespace esmc::host
