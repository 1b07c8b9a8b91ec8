#pragma once
/// A scene as constants of a board's image: numbers and plain structures as C++ initialisers, exact to the
/// last bit. Structured bindings take aggregates apart, so that one with a new member that is missing here
/// does not compile.

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <concepts>
#include <cstdint>
#include <string>
#include <type_traits>

#include "host_sim/controller/axes_config.hpp"
#include "host_sim/controller/controller_config.hpp"
#include "host_sim/error.hpp"

namespace esmc::host::bake {

/// The C++ initialiser of a value, here of a number; throws InputError unless it is finite. Overloads follow.
template <std::floating_point T>
std::string initialiser(T v) {
  constexpr bool single = std::is_same_v<T, float>;
  if (!std::isfinite(v))
    throw InputError(
        "",
        "a number of this scene, or the quotient of two, is beyond what the scalar type of the image holds");
  return fmt::format("{:a}{}", v, single ? "F" : "");
}
inline std::string initialiser(bool v) { return v ? "true" : "false"; }
template <std::integral T>
std::string initialiser(T v) {
  if constexpr (std::is_signed_v<T>) return fmt::format("{}", static_cast<long long>(v));
  return fmt::format("{}U{}", static_cast<unsigned long long>(v), sizeof(T) > 4 ? "LL" : "");
}
/// Initialiser of an enumerator: the image's Enum, which converts to the enumeration of the field.
template <class T>
requires std::is_enum_v<T> std::string initialiser(T v) {
  return fmt::format("Enum{{{}}}", static_cast<int>(v));
}
template <class S, int N>
std::string initialiser(const Eigen::Matrix<S, N, 1>& v) {
  std::string out = "column(";
  for (int i = 0; i < N; ++i) out += (i > 0 ? ", " : "") + initialiser(v[i]);
  return out + ")";
}

template <class T, class... Of>
inline constexpr bool one_of = (std::is_same_v<T, Of> || ...);
/// Number of members of an aggregate that is written as a list of them; 0: of another form.
template <class T>
inline constexpr int members = 0;
template <class T>
requires one_of<T, link::Bounds, PhaseClock>
inline constexpr int members<T> = 2;
template <class T>
requires one_of<T, drive::AxisConfig, drive::OdriveCheck, drive::OdriveTable, drive::MoteusAxis::Settings>
inline constexpr int members<T> = 4;
template <>
inline constexpr int members<drive::Cia402Settings> = 14;
template <class S, int Joints>
inline constexpr int members<MotorMap<S, Joints>> = 4;
template <class S>
inline constexpr int members<Range<S>> = 2;
template <class S>
inline constexpr int members<RrParams<S>> = 2;
template <class S>
inline constexpr int members<FiveBarParams<S>> = 4;
template <class S>
inline constexpr int members<Limits<S>> = 11;
template <class S>
inline constexpr int members<LegParams<S>> = 15;

// Declared before they are needed: arrays of aggregates, aggregates of aggregates.
template <class T>
requires(members<T> > 0) std::string initialiser(const T& v);
inline std::string initialiser(const link::Parameters&);
template <class S>
std::string initialiser(const PathSegment<S>&);

template <class T, std::size_t N>
std::string initialiser(const std::array<T, N>& v) {
  std::string out = "{{";
  for (std::size_t i = 0; i < N; ++i) out += (i > 0 ? ", " : "") + initialiser(v[i]);
  return out + "}}";
}
template <class T, int N>
std::string initialiser(const List<T, N>& v) {
  return "{" + initialiser(v.items) + "}";
}
/// An expression of C++ in place of a value.
struct Code {
  std::string expression;
};
inline std::string initialiser(const Code& v) { return v.expression; }
/// The initialisers of all members, separated by ", "; braces(): in braces.
template <class... T>
std::string list(const T&... member) {
  std::string out;
  ((out += (out.empty() ? "" : ", ") + initialiser(member)), ...);
  return out;
}
template <class... T>
std::string braces(const T&... member) {
  return "{" + list(member...) + "}";
}

template <class T>
requires(members<T> > 0) std::string initialiser(const T& v) {
  if constexpr (members<T> == 2) {
    const auto& [a, b] = v;
    return braces(a, b);
  } else if constexpr (members<T> == 4) {
    const auto& [a, b, c, d] = v;
    return braces(a, b, c, d);
  } else if constexpr (members<T> == 11) {
    const auto& [a, b, c, d, e, f, g, h, i, j, k] = v;
    return braces(a, b, c, d, e, f, g, h, i, j, k);
  } else if constexpr (members<T> == 15) {
    const auto& [a, b, c, d, e, f, g, h, i, j, k, l, m, n, o] = v;
    return braces(a, b, c, d, e, f, g, h, i, j, k, l, m, n, o);
  } else {
    const auto& [a, b, c, d, e, f, g, h, i, j, k, l, m, n] = v;
    return braces(a, b, c, d, e, f, g, h, i, j, k, l, m, n);
  }
}
inline std::string initialiser(const link::Parameters& v) {
  return "link::Parameters(" + initialiser(v.values()) + ", " + initialiser(v.bounds()) + ")";
}
inline std::string initialiser(const link::LinkConfig& v) {
  const auto& [base_id, session, jump, age, status, telemetry, table, period, source, space, position, scene,
               parameters, has_path, unattended] = v;
  (void)session;  // drawn by the image
  return braces(base_id, std::uint8_t{1}, jump, age, status, telemetry, table, period, source, space,
                position, scene, parameters, has_path, unattended);
}
inline std::string initialiser(const drive::MitAxis::Settings& v) {
  const auto& [ranges, dialect, master, retry, unit] = v;
  const auto& [position, velocity, torque] = ranges;
  return braces(Code{braces(position, velocity, torque)}, dialect, master, retry, unit);
}
template <class S>
std::string initialiser(const PathSegment<S>& v) {
  const auto& [start_tick, offset, curve] = v;
  const auto& [duration, c] = curve;
  return braces(start_tick, offset, Code{braces(duration, c)});
}
/// Initialiser of a reference; its path is the variable `path` of the image.
template <class S>
std::string initialiser(const Reference<S>& v) {
  const auto& [kind, space, centre, amplitude, speed, phase, path, repeat] = v;
  return braces(kind, space, centre, amplitude, speed, phase, Code{"path"}, repeat);
}
template <class M>
std::string initialiser(const Gains<M>& v) {
  const auto& [lambda, k, layer, own] = v;
  const auto& [own_lambda, own_k, own_layer, kp, kd] = own;
  return braces(lambda, k, layer, Code{braces(own_lambda, own_k, own_layer, kp, kd)});
}
template <class S>
std::string initialiser(const HomingConfig<S>& v) {
  const auto& [speed, torque, damping, travel, back_off, share] = v;
  return braces(speed, torque, damping, travel, back_off, share);
}
template <class Mode>
std::string mode_text(const Mode& v) {
  if constexpr (requires { v.assembly; })
    return braces(v.working, v.assembly);
  else
    return braces(v.working);
}

/// C++ text of the address of the first part that applies; "nullptr": none does.
inline std::string part_text(std::initializer_list<std::pair<bool, const char*>> parts) {
  for (const auto& [applies, name] : parts) {
    if (applies) return fmt::format("&part::{}<Mechanism>", name);
  }
  return "nullptr";
}

/// Initialiser of the configuration, for the C++ of an image; its mechanism is the image's `believed`.
template <class M>
std::string initialiser(const ControllerConfig<M>& v) {
  const auto& [m, mode, law, reaching, gains, reference, limits, torque_limit, torque_weight, sample_time,
               torque_lead, join, ramp, sign_test, halt, lower, after_halt, enabling, stopping,
               setpoint_speed, setpoint_acceleration, setpoint_jerk, motors, sensors, preload, allocate,
               variance, fuse, delay, lag, bandwidth, reach, behind, observer, predict, motor_map, correct] =
      v;
  const auto reaching_part = [](ReachingPart<M> p) {
    return Code{part_text({{p == &part::super_twisting<M>, "super_twisting"},
                           {p == &part::implicit_coupled<M>, "implicit_coupled"},
                           {p == &part::elbow_rotors<M>, "elbow_rotors"}})};
  };
  std::string lines;
  const auto add = [&](const auto&... member) {
    ((lines += "          " + initialiser(member) + ",\n"), ...);
  };
  add(Code{"Mechanism(believed)"}, Code{mode_text(mode)}, law, reaching, gains, reference, limits,
      torque_limit, torque_weight, sample_time, torque_lead, join, ramp, sign_test, halt, lower, after_halt,
      enabling, stopping, setpoint_speed, setpoint_acceleration, setpoint_jerk, motors, sensors, preload,
      Code{part_text({{allocate != nullptr, "four_motors"}})}, variance,
      Code{part_text({{fuse != nullptr, "closure_projection"}})}, delay, lag, bandwidth, reaching_part(reach),
      reaching_part(behind), Code{part_text({{observer != nullptr, "momentum_observer"}})},
      Code{part_text({{predict != nullptr, "predictor"}})}, motor_map,
      Code{part_text({{correct != nullptr, "motor_map"}})});
  return "{\n" + lines + "      }";
}

/// Initialisers of the members of a cycle's configuration; `line`: text for its member line. The axes are
/// left empty, because calls make them, and the session is 1, because the image draws it.
template <class Config>
std::string cycle_text(const Config& v, const std::string& line) {
  const auto& [controller, axes, its_line, count, heartbeat, waiting, confirmed, absolute, zero, mismatch,
               torque_time, timed, link, delay, homing] = v;
  return "      " + initialiser(controller) + ",\n      {},\n      " + line + ",\n      " +
         list(count, heartbeat, waiting, confirmed, absolute, zero, mismatch, torque_time, timed) +
         ",\n      " + initialiser(link) + ",\n      " + initialiser(delay) +
         (homing.travel > 0 ? ",\n      " + initialiser(homing) : "");
}

}  // namespace esmc::host::bake

namespace esmc::host {

/// CRC-32 of all values of an image in double precision: equal for scenes with the same controller. A
/// controller with a command interface sends it. Throws InputError where robust gains are refused.
std::uint32_t identity_of(Scene scene, Pacing pacing);

/// The C++ header of an image. Throws InputError where the reference has more pieces than a board holds, a
/// number is beyond its scalar type or robust gains are refused.
std::string baked_header(const Scene& scene, Pacing pacing, bool single_precision);

}  // namespace esmc::host
