#pragma once
/// Enums of scenes, with the names that scene files give them.

#include "firmware/drive/mit.hpp"
#include "firmware/link/codec.hpp"
#include "host_sim/names.hpp"

namespace esmc::host {

enum class MechanismType { five_bar, rr };
template <>
inline constexpr auto names_of<MechanismType> = std::array{"five_bar", "rr"};

enum class LawChoice { esmc, esmc_projected, smc, ctc, pd, open_loop, none };
template <>
inline constexpr auto names_of<LawChoice> =
    std::array{"esmc", "esmc_projected", "smc", "ctc", "pd", "open_loop", "none"};

enum class ReachingChoice { sign, saturation, tanh, implicit, super_twisting, implicit_coupled };
template <>
inline constexpr auto names_of<ReachingChoice> =
    std::array{"sign", "saturation", "tanh", "implicit", "super_twisting", "implicit_coupled"};

/// `none`: the scene has no [reference].
enum class ReferenceType { circle, line, polyline, joint_sine, hold, file, none };
template <>
inline constexpr auto names_of<ReferenceType> =
    std::array{"circle", "line", "polyline", "joint_sine", "hold", "file"};

enum class Protocol { odrive, odrive_0_5, cia402, mit };
template <>
inline constexpr auto names_of<Protocol> = std::array{"odrive", "odrive_0.5", "cia402", "mit"};
template <>
inline constexpr auto names_of<drive::mit::Dialect> = std::array{"mini_cheetah", "cubemars", "damiao"};

enum class Zero { absolute, pose, end_stop };
template <>
inline constexpr auto names_of<Zero> = std::array{"absolute", "pose", "end_stop"};

template <>
inline constexpr auto names_of<esmc::AfterHalt> = std::array{"release", "hold", "lower"};

template <>
inline constexpr auto names_of<link::Source> = std::array{"hold", "reference", "stream"};

// Scenes of `esmc spatial`.
enum class SpatialLawName { esmc, esmc_projected, smc_euler, none };
template <>
inline constexpr auto names_of<SpatialLawName> = std::array{"esmc", "esmc_projected", "smc_euler", "none"};

enum class SpatialReferenceName { hold, turn, spin, tumble, sway };
template <>
inline constexpr auto names_of<SpatialReferenceName> = std::array{"hold", "turn", "spin", "tumble", "sway"};

}  // namespace esmc::host
