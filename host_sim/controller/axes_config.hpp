#pragma once
/// From a scene to the drives' axes and the cycle around them.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <variant>

#include "firmware/cycle/instances.hpp"
#include "host_sim/controller/controller_config.hpp"

namespace esmc::host {

/// In the scene motors come first; in the cycle axes stand in the order of their joints: place of the scene's
/// drive i.
std::size_t axis_of(const Scene& scene, std::size_t i);

/// Settings of the axis of drive i, in the order of the scene: motors first, then passive encoders.
drive::AxisConfig mount(const Scene& scene, std::size_t i);
struct OdriveSettings {
  drive::odrive::Version version{};
  std::uint32_t retry_ticks = 1;
  drive::OdriveTable table{};
  std::uint32_t silence_ticks = 1;  ///< longer without a heartbeat it may have restarted
  std::uint32_t proof_ticks = 0;    ///< in which a starved watchdog must have tripped; 0: it is not starved
};
OdriveSettings odrive_settings(const Scene& scene, Pacing pacing, std::size_t i);
drive::Cia402Settings cia402_settings(const Scene& scene, std::size_t i);
drive::MitAxis::Settings mit_settings(const Scene& scene, std::size_t i);

/// Ticks in which an ODrive's starved watchdog has to have tripped, and to have been heard of.
[[nodiscard]] inline std::uint32_t watchdog_proof_ticks(const DriveScene& d, double rate_hz) {
  return static_cast<std::uint32_t>(std::ceil((1.01 * d.watchdog_timeout + d.heartbeat_timeout) * rate_hz) +
                                    2.0);
}

/// Who arms, and resets: this program, which gives up when it cannot, or a supervisor computer.
[[nodiscard]] inline bool armed_by_link(const Scene& s) { return s.command && s.command->arm_by_link; }

/// s that the drives have, from the order to arm, to confirm torque control, watchdogs proven and objects set
/// up. A controller that ticks slowly asks for the hundred answers or so of a set-up slowly.
[[nodiscard]] double enabling_time_max(const Scene& s);
/// s of them without a word from a drive, or, once all have been heard, in which no drive is being set up.
[[nodiscard]] double waiting_time_max(const Scene& s);

/// The cycle as a board has it, for whichever protocol the scene names.
template <class M>
using AnyCycle = std::variant<OdriveCycle<M>, Cia402Cycle<M>, MitCycle<M>>;
/// What one is made from: the Config of one of them.
template <class M>
using AnyCycleConfig = std::variant<typename OdriveCycle<M>::Config, typename Cia402Cycle<M>::Config,
                                    typename MitCycle<M>::Config>;

/// With one axis per motor and passive encoder. `reference` must outlive the cycle.
template <class M>
AnyCycleConfig<M> make_cycle_config(const Scene& scene, Pacing pacing,
                                    const ReferenceBundle<typename M::Scalar>& reference);
template <class M>
AnyCycle<M> make_cycle(const Scene& scene, Pacing pacing,
                       const ReferenceBundle<typename M::Scalar>& reference);

}  // namespace esmc::host
