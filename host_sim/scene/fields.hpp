#pragma once
/// How the key table names the field of a Scene that a key fills: into<&LimitsScene::closure>.

#include <cmath>
#include <tuple>

#include "host_sim/scene/reader.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

/// The part of a scene that has the type Part; an effect's type: the last effect, which must be of it (else
/// std::bad_variant_access). A scene without [command] or [uncertainty] has no such part: it is not checked.
template <class Part>
Part& part_of(Scene& s) {
  if constexpr (std::is_constructible_v<Effect, Part>) {
    return std::get<Part>(s.effects.back());
  } else if constexpr (std::is_same_v<Part, CommandScene>) {
    return *s.command;
  } else if constexpr (std::is_same_v<Part, UncertaintyScene>) {
    return *s.uncertainty;
  } else {
    return std::get<Part&>(
        std::tie(s, s.mechanism, s.model, s.model.friction, s.reference, s.initial, s.limits, s.drives));
  }
}
/// The field of the part_of() a scene that has it.
template <class Part, class T>
T& field_of(Scene& s, T Part::*field) {
  return part_of<Part>(s).*field;
}

/// Reads a key as a T, in the form that T has in TOML; errors and defaults are those of Section.
template <class T>
T value_of(Section& s, const std::string& key) {
  using Pair = std::array<double, 2>;
  if constexpr (std::is_same_v<T, double>) return s.number(key);
  if constexpr (std::is_same_v<T, bool>) return s.boolean(key);
  if constexpr (std::is_integral_v<T> && !std::is_same_v<T, bool>) return static_cast<T>(s.integer(key));
  if constexpr (std::is_same_v<T, Pair>) return s.pair(key);
  if constexpr (std::is_same_v<T, std::vector<Pair>>) return s.pairs(key);
  if constexpr (Named<T>) return s.choice<T>(key);
}
template <>
inline PerKind value_of<PerKind>(Section& s, const std::string& key) {
  const auto [position, angle] = s.per_kind(key);
  return {position, angle};
}
/// Sets `to` to the key's value or default.
template <class T>
void take(Section& s, const std::string& key, T& to) {
  to = value_of<T>(s, key);
}
/// Sets `to` to the value of the key; it stays as it is where the key is absent.
template <class T>
void take(Section& s, const std::string& key, std::optional<T>& to) {
  if (s.given(key)) to = value_of<T>(s, key);
}

/// Throws InputError where dry friction would push in one direction: |asymmetry| above `torque`, the value of
/// `key`.
inline void require_friction(const Section& s, const PerJoint& torque, const PerJoint& asymmetry,
                             const char* key) {
  for (std::size_t i = 0; i < torque.size(); ++i)
    if (std::abs(asymmetry[i]) > torque[i]) s.fail("asymmetry", "must be at most {}, joint by joint", key);
}

// ---- readers for the key table ----

/// Reads the key into `field`.
template <auto field>
void into(Section& s, const std::string& key, Scene& scene) {
  take(s, key, field_of(scene, field));
}
/// Reads numbers per joint into `field`; of a five-bar, two hold for both legs, and one for all joints.
template <auto field>
void per_joint(Section& s, const std::string& key, Scene& scene) {
  const std::vector<std::size_t> sizes =
      scene.joints() == 4 ? std::vector<std::size_t>{2, 4} : std::vector<std::size_t>{2};
  const auto v = s.numbers(key, sizes);
  auto& to = field_of(scene, field);
  for (std::size_t i = 0; i < to.size(); ++i) to[i] = v[i % v.size()];
}
/// Reads one number for all motors, or one each, into `field`.
template <auto field>
void per_motor(Section& s, const std::string& key, Scene& scene) {
  const auto v = s.each(key, static_cast<std::size_t>(scene.motors()));
  auto& to = field_of(scene, field);
  if constexpr (requires { to = v; }) {
    to = v;
  } else {
    for (std::size_t i = 0; i < to.size(); ++i) to[i] = v[i % v.size()];
  }
}

}  // namespace esmc::host
