#pragma once
/// Parameters of the planar mechanisms, SI units, and the check that they are physical. Shared with the
/// simulator, whose plant writes its own equations.

#include <array>
#include <cstdint>

namespace esmc {

/// One leg (or the RR arm): two bars in series. Symbols of model.md section 0.
template <class S>
struct LegParams {
  S l1{}, l2{};          ///< link lengths, m, > 0
  S lg1{}, lg2{};        ///< mass centre from the bar's own joint along the bar, m (may lie outside the bar)
  S m1{}, m2{};          ///< masses, kg, >= 0
  S J1{}, J2{};          ///< inertias about the mass centre, kg m2, >= 0
  S d1{}, d2{};          ///< viscous friction of the joints (relative rates), N m s/rad, >= 0
  S gamma1{}, gamma2{};  ///< Coulomb friction of the joints, N m, >= 0
  /// N m: gamma + asymmetry acts against positive rates, gamma - asymmetry against negative ones.
  S asymmetry1{}, asymmetry2{};
  S rotor2{};  ///< of the rotor behind the elbow's rigid gear, kg m2 on the joint's rate, >= 0
};

/// Parameters of the arm.
template <class S>
struct RrParams {
  LegParams<S> arm{};
  S g{};  ///< gravity along -y, m/s2, >= 0; 0 for a horizontal mechanism
};

/// Parameters of the five-bar.
template <class S>
struct FiveBarParams {
  S l0{};  ///< half the distance between the base joints, m, > 0: leg 1 at (+l0, 0), leg 2 at (-l0, 0)
  S m0{};  ///< point mass at the effector, kg, >= 0
  S g{};   ///< gravity along -y, m/s2, >= 0
  std::array<LegParams<S>, 2> legs{};  ///< leg 2 is described in its mirrored frame N2
};

/// Why parameters are refused. A NaN is refused everywhere, and so is a value above 1e30.
enum class [[nodiscard]] ParamError : std::uint8_t{
    none,
    link_length,  ///< l1, l2 or l0 is not > 0
    mass,         ///< a mass is not >= 0
    inertia,      ///< an inertia is not >= 0
    mass_centre,  ///< lg1 or lg2 is not a number
    friction,     ///< a friction coefficient is not >= 0, or an asymmetry above its Coulomb friction
    gravity,      ///< g is not >= 0
    rotor,        ///< beside a rotor at the elbow J1 and J2 must be > 0
    no_inertia,   ///< a bar has no inertia about its joint: accelerations are unbounded
};

namespace detail {
/// 0 <= v <= 1e30; above_zero: 0 < v <= 1e30. Both false for a NaN.
template <class S>
constexpr bool at_least_zero(S v) {
  return v >= S(0) && v <= S(1e30F);
}
template <class S>
constexpr bool above_zero(S v) {
  return v > S(0) && v <= S(1e30F);
}
}  // namespace detail

/// The first error in the parameters of a leg; none: physical.
template <class S>
constexpr ParamError check(const LegParams<S>& p) {
  using detail::above_zero;
  using detail::at_least_zero;
  if (!above_zero(p.l1) || !above_zero(p.l2)) return ParamError::link_length;
  if (!at_least_zero(p.m1) || !at_least_zero(p.m2)) return ParamError::mass;
  if (!at_least_zero(p.J1) || !at_least_zero(p.J2) || !at_least_zero(p.rotor2)) return ParamError::inertia;
  if (p.rotor2 > S(0) && !(above_zero(p.J1) && above_zero(p.J2))) return ParamError::rotor;
  if (!at_least_zero(p.lg1 * p.lg1) || !at_least_zero(p.lg2 * p.lg2)) return ParamError::mass_centre;
  if (!at_least_zero(p.d1) || !at_least_zero(p.d2)) return ParamError::friction;
  for (const S gamma :
       {p.gamma1 + p.asymmetry1, p.gamma1 - p.asymmetry1, p.gamma2 + p.asymmetry2, p.gamma2 - p.asymmetry2}) {
    if (!at_least_zero(gamma)) return ParamError::friction;
  }
  if (!above_zero(p.J2 + p.m2 * p.lg2 * p.lg2)) return ParamError::no_inertia;
  if (!above_zero(p.J1 + p.m1 * p.lg1 * p.lg1 + p.m2 * p.l1 * p.l1)) return ParamError::no_inertia;
  return ParamError::none;
}

/// The first error in the parameters of an arm; none: physical.
template <class S>
constexpr ParamError check(const RrParams<S>& p) {
  return detail::at_least_zero(p.g) ? check(p.arm) : ParamError::gravity;
}

/// The first error in the parameters of a 5R; none: physical. Whether its legs can meet is not checked.
template <class S>
constexpr ParamError check(const FiveBarParams<S>& p) {
  if (!detail::above_zero(p.l0)) return ParamError::link_length;
  if (!detail::at_least_zero(p.m0)) return ParamError::mass;
  if (!detail::at_least_zero(p.g)) return ParamError::gravity;
  const ParamError leg1 = check(p.legs[0]);
  return leg1 != ParamError::none ? leg1 : check(p.legs[1]);
}

}  // namespace esmc
