#pragma once
/// Enums of scenes, with the names that scene files give them.

#include "firmware/drive/mit.hpp"
#include "firmware/link/codec.hpp"
#include "host_sim/names.hpp"

namespace esmc::host {

/// Types of mechanism.
enum class MechanismType { five_bar, rr };
template <>
inline constexpr auto names_of<MechanismType> = std::array{"five_bar", "rr"};

/// control.law: the laws of LawKind; open_loop: given torques; none: no torque.
enum class LawChoice { esmc, esmc_projected, smc, ctc, pd, open_loop, none };
template <>
inline constexpr auto names_of<LawChoice> =
    std::array{"esmc", "esmc_projected", "smc", "ctc", "pd", "open_loop", "none"};

/// control.reaching: the laws of Reaching, then the optional parts of the firmware.
enum class ReachingChoice { sign, saturation, tanh, implicit, super_twisting, implicit_coupled };
template <>
inline constexpr auto names_of<ReachingChoice> =
    std::array{"sign", "saturation", "tanh", "implicit", "super_twisting", "implicit_coupled"};

/// reference.type; `none`: the scene has no [reference].
enum class ReferenceType { circle, line, polyline, joint_sine, hold, file, program, none };
template <>
inline constexpr auto names_of<ReferenceType> =
    std::array{"circle", "line", "polyline", "joint_sine", "hold", "file", "program"};

/// The error that simulation.accuracy bounds: of final_state.q, or of q in every row of the log.
enum class AccuracyOf { end, trajectory };
template <>
inline constexpr auto names_of<AccuracyOf> = std::array{"end", "trajectory"};

/// Protocols of drives.
enum class Protocol { odrive, odrive_0_5, cia402, mit, moteus };
template <>
inline constexpr auto names_of<Protocol> = std::array{"odrive", "odrive_0.5", "cia402", "mit", "moteus"};
template <>
inline constexpr auto names_of<drive::mit::Dialect> =
    std::array{"mini_cheetah", "cubemars", "damiao", "cubemars_v3"};

/// drives.zero: encoders keep their zero; it is confirmed in a pose, or found at end stops.
enum class Zero { absolute, pose, end_stop };
template <>
inline constexpr auto names_of<Zero> = std::array{"absolute", "pose", "end_stop"};

template <>
inline constexpr auto names_of<esmc::AfterHalt> = std::array{"release", "hold", "lower"};

template <>
inline constexpr auto names_of<link::Source> = std::array{"hold", "reference", "stream"};

/// Laws of the scenes of `esmc spatial`.
enum class SpatialLaw {
  esmc,            ///< [F29]: an error, a surface and a switching term in every channel
  esmc_projected,  ///< [F33]: one surface in the six independent velocities, switching in every channel
  smc_euler,       ///< [F27] in minimal coordinates: position, yaw, pitch, roll. Ends at pitch = +-90 degrees
  none,            ///< no force
};
template <>
inline constexpr auto names_of<SpatialLaw> = std::array{"esmc", "esmc_projected", "smc_euler", "none"};

/// Shapes of the reference of a spatial scene.
enum class SpatialReferenceKind {
  hold,    ///< stay at the start
  turn,    ///< once, rest to rest by a quintic: `angle` about `axis` along the great circle, `shift` along a
           ///< line
  spin,    ///< `rate` about `axis`, for ever
  tumble,  ///< that, and `second_rate` about `second_axis`, which the first turns
  sway,    ///< there and back: (1 - cos)/2 of the phase times `angle` about `axis` and `shift`
};
template <>
inline constexpr auto names_of<SpatialReferenceKind> = std::array{"hold", "turn", "spin", "tumble", "sway"};

}  // namespace esmc::host
