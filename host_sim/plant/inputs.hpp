#pragma once
/// What moves a plant beside its effects: torques of the motors, a hand; and the method that integrates it.

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "host_sim/names.hpp"
#include "host_sim/plant/plant.hpp"

namespace esmc::host {

/// A hand at the effector, moved while the simulation runs.
struct Hand {
  bool holding = false;                   ///< spring and damper towards `anchor`
  V2 anchor{};                            ///< m
  double stiffness = 0.0, damping = 0.0;  ///< N/m, N s/m, >= 0
  V2 push{};                              ///< N, besides
  double most = 0.0;                      ///< N, > 0: no hand pulls harder

  /// Force, N, on an effector at p, m, moving with v, m/s: push and pull, their sum cut to `most`.
  [[nodiscard]] V2 force(V2 p, V2 v) const {
    V2 f = push;
    if (holding) f = f + stiffness * (anchor - p) - damping * v;
    const double size = std::sqrt(dot(f, f));
    return size > most ? (most / size) * f : f;
  }
};

/// `moreau_jean` or `event_driven` is what set-valued effects need; a scene with such effects gets the former
/// where it does not name the latter.
enum class Method { semi_implicit_euler, rk4, dopri5, dopri8, radau5, moreau_jean, event_driven };
template <>
inline constexpr auto names_of<Method> =
    std::array{"semi_implicit_euler", "rk4", "dopri5", "dopri8", "radau5", "moreau_jean", "event_driven"};

/// How `event_driven` integrates between two events, by order. Euler: of a motion without any; else midpoint.
enum class Between { semi_implicit_euler, midpoint, heun3, rk4, dopri5, dopri8, radau5 };
template <>
inline constexpr auto names_of<Between> =
    std::array{"semi_implicit_euler", "midpoint", "heun3", "rk4", "dopri5", "dopri8", "radau5"};
struct Resolution {
  Between between = Between::rk4;
  double tolerance = 0.0;     ///< of a step of dopri5, dopri8 and radau5, rad; 0: fixed steps
  double rebound_min = 1e-9;  ///< rad: a lower bounce off a rigid stop is the last one
  int ticks = 1;              ///< per fixed step, in an open loop of which nothing is recorded
  bool operator==(const Resolution&) const = default;
};

/// Events located by `event_driven`.
struct Events {
  long stick = 0, slip = 0, impact = 0, contact = 0;
  long accumulated = 0;  ///< impacts that ended a sequence of ever smaller bounces
  long crowded = 0;      ///< stretches with too many events to locate, stepped by moreau_jean
  [[nodiscard]] long total() const { return stick + slip + impact + contact + crowded; }
};

/// What an engine of `event_driven` has done since the start.
struct Effort {
  long evaluations = 0;  ///< of right-hand sides
  long steps = 0;
  Events events;
  bool smooth = true;  ///< there is nothing that could have an event
};

/// tau(t) = offset + sum amp sin(omega t + phase), N m.
struct Waveform {
  struct Term {
    double amp, omega, phase;
  };
  double offset = 0.0;
  std::vector<Term> terms;

  /// Torque, N m, at time t, s.
  [[nodiscard]] double at(double t) const {
    double v = offset;
    for (const Term& term : terms) v += term.amp * std::sin(term.omega * t + term.phase);
    return v;
  }
};

/// Waveforms per motor, placed on joints and limited by what the drives deliver.
struct OpenLoop {
  std::vector<Waveform> wave;
  std::vector<std::size_t> joint;                          ///< of each waveform, model order
  double limit = std::numeric_limits<double>::infinity();  ///< N m, either way

  /// Torques per joint, N m, at time t, s; 0 at joints without a motor.
  template <class Joints>
  [[nodiscard]] Joints at(double t) const {
    Joints out{};
    for (std::size_t i = 0; i < wave.size(); ++i) out[joint[i]] = std::clamp(wave[i].at(t), -limit, limit);
    return out;
  }
};

/// Torques of the motors over a stretch of time: constant, or an open-loop scene's waveforms.
template <class Joints>
struct MotorTorques {
  Joints held{};                   ///< N m per joint, model convention
  const OpenLoop* open = nullptr;  ///< instead of held; must outlive this

  [[nodiscard]] Joints at(double t) const { return open == nullptr ? held : open->at<Joints>(t); }
};

}  // namespace esmc::host
