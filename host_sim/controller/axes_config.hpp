#pragma once
/// From a scene to the drives' axes and the cycle around them.

#include <cmath>
#include <cstdint>
#include <variant>

#include "firmware/cycle/instances.hpp"
#include "host_sim/controller/controller_config.hpp"

namespace esmc::host {

/// Index of the scene's drive i (motors first) among the axes of the cycle, which are in the order of joints.
std::size_t axis_of(const Scene& scene, std::size_t i);

/// Node, direction, gear ratio and offset (rad) of drive i in the scene: motors first, then passive encoders.
/// i < number of drives, not checked.
drive::AxisConfig mount(const Scene& scene, std::size_t i);
/// Arguments of drive::OdriveAxis and its setters.
struct OdriveSettings {
  drive::odrive::Version version{};
  std::uint32_t retry_ticks = 1;    ///< as for drive::OdriveAxis
  drive::OdriveTable table{};       ///< configuration to be read back
  std::uint32_t silence_ticks = 1;  ///< after longer without a heartbeat the drive may have restarted
  std::uint32_t proof_ticks = 0;    ///< within which the watchdog must trip in its test; 0: no test
};
/// Controller's settings for drive i of a scene, which must have the protocol of the name (not checked).
OdriveSettings odrive_settings(const Scene& scene, Pacing pacing, std::size_t i);
drive::Cia402Settings cia402_settings(const Scene& scene, std::size_t i);  ///< of drive i, protocol cia402
drive::MitAxis::Settings mit_settings(const Scene& scene, std::size_t i);  ///< of drive i, protocol mit
drive::MoteusAxis::Settings moteus_settings(const Scene& scene, std::size_t i);  ///< of drive i, moteus

/// Ticks within which an ODrive's watchdog must trip in its test and its heartbeat must report that.
[[nodiscard]] inline std::uint32_t watchdog_proof_ticks(const DriveScene& d, double rate_hz) {
  return static_cast<std::uint32_t>(std::ceil((1.01 * d.watchdog_timeout + d.heartbeat_timeout) * rate_hz) +
                                    2.0);
}

/// Whether a supervisor computer arms and resets, instead of this program.
[[nodiscard]] inline bool armed_by_link(const Scene& s) { return s.command && s.command->arm_by_link; }

/// Time, s, from the order to arm until every drive must confirm torque control. A set-up takes about a
/// hundred answers, at most one per tick.
[[nodiscard]] double enabling_time_max(const Scene& s);
/// Time, s, for which enabling may make no progress before the fault enabling_timeout: some drive has sent no
/// frame yet, or all have and no motor is being set up.
[[nodiscard]] double waiting_time_max(const Scene& s);

/// Load of one base joint in homing.
struct HomingLoad {
  double inertia;  ///< kg m2
  double weight;   ///< N m at most, of that inertia
  double hold;     ///< N m at most, to hold all that the joint may have to carry
};
/// Bandwidth of the speed controller of homing, 1/s: below that of drives and delay.
double homing_bandwidth(const Scene& scene);
/// The load that homing moves with base joint i, by the controller's model.
HomingLoad homing_load(const Scene& scene, std::size_t i);

/// The cycle of firmware for any protocol of a scene; AnyCycleConfig: its configuration.
template <class M>
using AnyCycle = std::variant<OdriveCycle<M>, Cia402Cycle<M>, MitCycle<M>, MoteusCycle<M>>;
template <class M>
using AnyCycleConfig = std::variant<typename OdriveCycle<M>::Config, typename Cia402Cycle<M>::Config,
                                    typename MitCycle<M>::Config, typename MoteusCycle<M>::Config>;

/// Configuration of the cycle of a scene, with one axis per motor and passive encoder. `reference` must
/// outlive the configuration and the cycle. Throws InputError like make_controller(). In real time each call
/// draws another session.
template <class M>
AnyCycleConfig<M> make_cycle_config(const Scene& scene, Pacing pacing,
                                    const ReferenceBundle<typename M::Scalar>& reference);
/// The cycle with make_cycle_config().
template <class M>
AnyCycle<M> make_cycle(const Scene& scene, Pacing pacing,
                       const ReferenceBundle<typename M::Scalar>& reference);

}  // namespace esmc::host
