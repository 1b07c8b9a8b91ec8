/// The table of keys of the scenes of `esmc spatial`; docs/spatial.md prints it.

#include <array>

#include "host_sim/scene/keys.hpp"

namespace esmc::host {
namespace {

constexpr double inf = std::numeric_limits<double>::infinity();
constexpr double big = 1e6;  // magnitudes beyond this are a slip of units

// clang-format off
constexpr std::array keys{
    Key{"name", "string", "\"scene\"", "", -inf, inf, false, "", "shown in summaries"},

    Key{"body", "table", "-", "", -inf, inf, false, "", "a free rigid body; or [platform]"},
    Key{"body.mass", "number", "", "kg", 0, big, true, "", ""},
    Key{"body.inertia", "numbers", "", "kg m2", 0, big, true, "", "principal, about the mass centre; the frame of the body lies along its principal axes"},
    Key{"body.gravity", "number", "0.0", "m/s2", 0, 1e3, false, "", "along -z"},

    Key{"platform", "table", "-", "", -inf, inf, false, "", "a Gough-Stewart platform: six legs, each universal joint, slide, spherical joint"},
    Key{"platform.mass", "number", "", "kg", 0, big, true, "", ""},
    Key{"platform.inertia", "numbers", "", "kg m2", 0, big, true, "", "principal, about the mass centre"},
    Key{"platform.gravity", "number", "9.8", "m/s2", 0, 1e3, false, "", "along -z"},
    Key{"platform.base_radius", "number", "", "m", 0, 1e3, true, "", "of the circle of the universal joints, at z = 0"},
    Key{"platform.base_spread", "number", "", "rad", 0, 1.0471975511965976, false, "", "the joints of pair k stand at 120 k degrees less and plus this"},
    Key{"platform.radius", "number", "", "m", 0, 1e3, true, "", "of the circle of the spherical joints"},
    Key{"platform.spread", "number", "", "rad", 0, 1.0471975511965976, false, "", "likewise"},
    Key{"platform.joint_height", "number", "0.0", "m", -1e3, 1e3, false, "", "of the spherical joints above the mass centre of the platform, along its z"},
    Key{"platform.home", "number", "", "m", 0, 1e3, true, "", "height of the mass centre about which it works; positions count from there"},
    Key{"platform.cylinder", "table", "", "", -inf, inf, false, "", "lower body of every leg"},
    Key{"platform.cylinder.mass", "number", "", "kg", 0, big, true, "", ""},
    Key{"platform.cylinder.centre", "number", "", "m", 0, 1e3, false, "", "mass centre, from the base joint up the leg"},
    Key{"platform.cylinder.transverse", "number", "", "kg m2", 0, big, true, "", "inertia across the leg, about the mass centre"},
    Key{"platform.cylinder.axial", "number", "", "kg m2", 0, big, true, "", "inertia about the axis of the leg"},
    Key{"platform.rod", "table", "", "", -inf, inf, false, "", "upper body of every leg"},
    Key{"platform.rod.mass", "number", "", "kg", 0, big, true, "", ""},
    Key{"platform.rod.centre", "number", "", "m", 0, 1e3, false, "", "mass centre, from the platform's joint down the leg"},
    Key{"platform.rod.transverse", "number", "", "kg m2", 0, big, true, "", "inertia across the leg, about the mass centre"},
    Key{"platform.rod.axial", "number", "", "kg m2", 0, big, true, "", "inertia about the axis of the leg"},
    Key{"platform.rod.viscous", "number", "0.0", "N s/m", 0, big, false, "", "friction of the slide"},

    Key{"control.law", "string", "", "", -inf, inf, false, "esmc | esmc_projected | smc_euler | none", "smc_euler: minimal coordinates, for comparison; none: no force"},
    Key{"control.reaching", "string", "\"implicit\"", "", -inf, inf, false, "sign | saturation | tanh | implicit", "what replaces sgn s"},
    Key{"control.lambda", "number or {position, angle}", "", "1/s", 0, 1e5, true, "", "slope of the surface"},
    Key{"control.gain", "number or {position, angle}", "", "m/s2, rad/s2", 0, 1e9, false, "", "switching gain k"},
    Key{"control.layer", "number or {position, angle}", "0.05", "m/s, rad/s", 0, 1e6, true, "", "boundary layer of saturation and tanh"},
    Key{"control.rate_hz", "number", "1000.0", "Hz", 10, 100000, false, "", "control ticks per second"},
    Key{"control.hysteresis", "number", "0.1", "", 0, 0.9, false, "", "cos of half the turn beyond which the other way round is taken; 0: at 180 degrees, 0.1: at 191.5"},
    Key{"control.force_limit", "number", "", "N", 0, big, true, "", "hard clamp of each motor; of a free body, of each entry of the force"},
    Key{"control.moment_limit", "number", "-", "N m", 0, big, true, "", "free body: of each entry of the moment; required"},
    Key{"control.model", "table", "-", "", -inf, inf, false, "", "what the controller believes, as factors on the true values"},
    Key{"control.model.mass", "number", "1.0", "", 0, 100, true, "", "of the body or the platform"},
    Key{"control.model.inertia", "number", "1.0", "", 0, 100, true, "", "likewise"},
    Key{"control.model.legs", "number", "1.0", "", 0, 100, false, "", "platform: masses and inertias of the legs; 0: legs without mass"},

    Key{"reference.type", "string", "", "", -inf, inf, false, "hold | turn | spin | tumble | sway", "kind of reference"},
    Key{"reference.position", "numbers", "[0, 0, 0]", "m", -1e3, 1e3, false, "", "where it starts; of a platform from home"},
    Key{"reference.rotation", "numbers", "[0, 0, 0]", "rad", -7, 7, false, "", "how it starts, as rotation vector: axis times angle"},
    Key{"reference[turn].axis", "numbers", "", "", -1e3, 1e3, false, "", "in the frame of the body, any length but 0"},
    Key{"reference[turn].angle", "number", "", "rad", -100, 100, false, "", "of the whole turn, rest to rest by a quintic, along the great circle of the quaternions (slerp)"},
    Key{"reference[turn].shift", "numbers", "[0, 0, 0]", "m", -1e3, 1e3, false, "", "by which the position moves meanwhile"},
    Key{"reference[turn].duration", "number", "", "s", 0, 3600, true, "", ""},
    Key{"reference[spin].axis", "numbers", "", "", -1e3, 1e3, false, "", "in the frame of the body, any length but 0"},
    Key{"reference[spin].rate", "number", "", "rad/s", -1e3, 1e3, false, "", "for ever"},
    Key{"reference[tumble].axis", "numbers", "", "", -1e3, 1e3, false, "", "in the frame of the body at the start, any length but 0"},
    Key{"reference[tumble].rate", "number", "", "rad/s", -1e3, 1e3, false, "", "for ever"},
    Key{"reference[tumble].second_axis", "numbers", "", "", -1e3, 1e3, false, "", "which the first turns, any length but 0"},
    Key{"reference[tumble].second_rate", "number", "", "rad/s", -1e3, 1e3, false, "", "for ever"},
    Key{"reference[sway].axis", "numbers", "", "", -1e3, 1e3, false, "", "in the frame of the body, any length but 0"},
    Key{"reference[sway].angle", "number", "", "rad", -100, 100, false, "", "there and back, (1 - cos)/2 of the phase"},
    Key{"reference[sway].shift", "numbers", "[0, 0, 0]", "m", -1e3, 1e3, false, "", "likewise"},
    Key{"reference[sway].frequency", "number", "", "Hz", 0, 1e3, true, "", "periods per second"},

    Key{"initial.position", "numbers", "[0, 0, 0]", "m", -1e3, 1e3, false, "", "off the start of the reference"},
    Key{"initial.rotation", "numbers", "[0, 0, 0]", "rad", -7, 7, false, "", "off the start of the reference, rotation vector in the frame of the body"},
    Key{"initial.velocity", "numbers", "[0, 0, 0]", "m/s", -1e3, 1e3, false, "", ""},
    Key{"initial.turning", "numbers", "[0, 0, 0]", "rad/s", -1e3, 1e3, false, "", "angular velocity in the frame of the body"},

    Key{"measurement.position_noise", "number", "0.0", "m", 0, 1, false, "", "standard deviation, each entry"},
    Key{"measurement.attitude_noise", "number", "0.0", "rad", 0, 1, false, "", "of a rotation vector, each entry"},
    Key{"measurement.rate_noise", "number", "0.0", "m/s, rad/s", 0, 1e3, false, "", "of both velocities, each entry"},
    Key{"measurement.alternate_sign", "boolean", "false", "", -inf, inf, false, "", "the quaternion comes as q and -q in turns: must change nothing"},

    Key{"simulation.duration", "number", "", "s", 0, 1e6, true, "", ""},
    Key{"simulation.step", "number", "1e-3", "s", 0, 1, true, "", "largest step of the plant (RK4); a tick is divided into equal ones"},
};
// clang-format on

}  // namespace

std::span<const Key> spatial_keys() { return keys; }

}  // namespace esmc::host
