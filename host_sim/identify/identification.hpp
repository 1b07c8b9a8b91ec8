#pragma once
/// Inertia, friction and torque delay of a mechanism, from the angles that its base encoders have said and
/// the torques that its controller has asked for. The equations are linear in the parameters and are taken in
/// momentum form, under smooth windows: no acceleration appears. Equations of its own: nothing of the
/// controller's model is used.

#include <array>
#include <cstddef>
#include <string>
#include <vector>

#include "host_sim/least_squares.hpp"

namespace esmc::host {

/// Lengths are known: calibrate them first. Angles and torques in the order of the model.
struct IdentifyProblem {
  bool five_bar = true;
  double l0 = 0.0;                   ///< m
  std::array<double, 2> l1{}, l2{};  ///< m, per leg
  int assembly = -1;                 ///< sign of D2
  double gravity = 0.0;              ///< m/s2
  double tick = 1e-3;                ///< s
  double window = 0.1;               ///< s, of one equation
  /// rad/s: the angles may be late as after an observer of that bandwidth, or not; 0: are not
  double observer_bandwidth = 1000.0;
  std::array<std::vector<double>, 2> angle;  ///< rad, of the base joints (RR: both), per tick
  std::vector<int> motors;                   ///< joints that have one
  /// Of each joint, as believed, and not part of what is found: N m, half of what friction is larger one way;
  /// kg m2, of a rotor behind its gear.
  std::array<double, 4> asymmetry{}, rotor{};
  /// Cogging of the motor of a joint, as believed: N m, periods per turn, rad.
  std::array<double, 4> ripple_amplitude{}, ripple_per_turn{}, ripple_phase{};
  std::vector<std::array<double, 4>> torque;  ///< N m that the motor of a joint gives, as believed, for what
                                              ///< it was asked at that tick; 0 without a motor
  Vector
      nominal;  ///< of the standard parameters, see standard_parameters(); frictions 0 where nothing is known
};

/// Parameters in which the equations are linear: per leg a = J1 + m1 lg1^2 + m2 l1^2, c = J2 + m2 lg2^2, h =
/// m2 lg2, s = m1 lg1 + m2 l1; the mass at the effector; then viscous and Coulomb friction of each joint.
struct StandardParameter {
  std::string name, unit;
  bool inertial = true;
};

/// A combination of standard parameters that the motion of this mechanism depends on: `of` + sum of `share` *
/// others.
struct BaseParameter {
  StandardParameter of;  ///< that it is named after
  int column = 0;        ///< index of that one
  Vector share;          ///< of every standard parameter: 1 for `of`, 0 for those that stand alone
  std::string text;      ///< "a1 + 0.0144 m0"
  double nominal = 0.0, value = 0.0, sigma = 0.0;
};

enum class DefectKind { direction, rotor, torque_constant, cogging, eccentric, spring };
inline constexpr std::array defect_codes{"direction_dependent_friction",
                                         "rotor_inertia",
                                         "torque_constant",
                                         "cogging",
                                         "eccentric_encoder",
                                         "gear_spring"};
/// Something that moves the mechanism and is no parameter: found, and taken into account as more unknowns.
struct Defect {
  DefectKind kind{};
  int joint = 0;
  double periods = 1.0;  ///< cogging: per turn of the joint
  double phase = 0.0;    ///< cogging: amount * sin(periods * angle + phase), rad
  double amount = 0.0,
         sigma = 0.0;  ///< N m (direction: half of the difference), kg m2, 1, N m, rad, rad/(N m)
  double statistic = 0.0,
         shift = 0.0;  ///< over what is needed; standard uncertainties of a parameter, without it
};

struct Identification {
  std::vector<BaseParameter> parameters;
  Matrix covariance;  ///< of parameters, then the delay
  double delay_ticks = 0.0, delay_sigma = 0.0;
  std::array<double, 2> residual{};  ///< N m rms, of the window means, per equation (base joint)
  std::array<double, 2> effort{};    ///< N m rms of the torque itself, likewise
  int windows = 0;
  std::vector<Defect> defects;
  /// Combinations of parameters that the motion does not determine; then nothing else counts.
  std::vector<std::string> weak;
};

/// All standard parameters in their order, leg by leg and joint by joint. RR: those of one leg, without m0.
[[nodiscard]] std::vector<StandardParameter> standard_parameters(bool five_bar);

/// Least number of ticks that a log must have for the windows of p.
[[nodiscard]] std::size_t ticks_needed(const IdentifyProblem& p);

/// Least squares with the delay as one more unknown. The covariance is that of the estimator for residuals
/// that are correlated in time. p.angle and p.torque have the same length, ticks_needed(p) at least (not
/// checked). Throws InputError where base angles fit no closed mechanism.
[[nodiscard]] Identification identify(const IdentifyProblem& p);

}  // namespace esmc::host
