#pragma once
/// The drives of a scene: joint, mount and settings of each.

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>
#include <vector>

#include "host_sim/drives/cia402_axis.hpp"
#include "host_sim/drives/mit_axis.hpp"
#include "host_sim/drives/moteus_axis.hpp"
#include "host_sim/drives/odrive_axis.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

struct PlacedAxis {
  AxisMount mount;
  int joint = 0;          ///< index into the joints of the plant
  bool motor = false;     ///< false: a passive encoder
  std::size_t entry = 0;  ///< in the lists of [drives]
};

/// Joint and mount of every drive of a scene, motors first, then passive encoders: the order of [drives].
/// Encoders that homing is for count from where they are switched on.
inline std::vector<PlacedAxis> placed_axes(const Scene& s) {
  std::vector<PlacedAxis> out;
  for (std::size_t i = 0; i < s.drives.nodes.size(); ++i) {
    const int motors = s.motors(), at = static_cast<int>(i);
    const bool motor = at < motors;
    const int joint = !motor ? 2 * (at - motors) + 1 : at * s.joints() / motors;
    const double begin = s.homes() ? s.start_angle[static_cast<std::size_t>(joint)] : 0.0;
    out.push_back(
        {{s.drives.nodes[i], s.drives.direction[i], s.drives.gear_ratio[i], s.drives.offset[i] + begin},
         joint,
         motor,
         i});
  }
  return out;
}

/// Settings of the emulated MIT drive of `motor`, from the scene.
inline MitAxis::Settings mit_settings(const Scene& s, std::size_t motor, bool lockstep) {
  const DriveScene& d = s.drives;
  MitAxis::Settings out;
  out.dialect = d.dialect;
  out.master_id = static_cast<std::uint16_t>(d.master_id[motor]);
  out.reply_size = out.dialect == drive::mit::Dialect::mini_cheetah ? 6 : 8;
  out.position_range = d.position_range[motor];
  out.velocity_range = d.velocity_range[motor];
  out.torque_range = d.torque_range[motor];
  out.velocity_unit = d.velocity_unit;
  out.period = s.tick();
  out.timeout_cycles = static_cast<int>(std::llround(d.watchdog_timeout / out.control_period));
  out.realtime = !lockstep;
  out.defects = d.defects;
  return out;
}

/// Speed, rev/s of the shaft, that an ODrive must allow for limits.joint_speed.
inline double odrive_vel_limit(const Scene& s, std::size_t motor) {
  return s.limits.joint_speed * s.drives.gear_ratio[motor] / (2.0 * std::numbers::pi);
}
/// Current, A, for the torque_limit of `motor`; torque_constant in N m/A, > 0.
inline double odrive_current(const Scene& s, std::size_t motor, double torque_constant) {
  return s.torque_limit[motor] / s.drives.gear_ratio[motor] / torque_constant;
}

/// Makes the drive as the real one is configured for a scene. `lockstep`: its ticks are the controller's.
inline std::unique_ptr<EmulatedAxis> make_axis(const Scene& s, const PlacedAxis& a, bool lockstep = true) {
  const SensorEffects sensor(s.effects);
  if (s.drives.protocol == Protocol::mit && a.motor) {
    return std::make_unique<MitAxis>(a.mount, mit_settings(s, a.entry, lockstep), sensor, a.joint, s.seed);
  }
  if (s.drives.protocol == Protocol::moteus && a.motor) {
    const double asked = s.torque_limit[a.entry] / s.drives.gear_ratio[a.entry];
    return std::make_unique<MoteusAxis>(a.mount,
                                        MoteusAxis::Settings{.period = s.tick(),
                                                             .torque_max = std::max(10.0, 1.01 * asked),
                                                             .realtime = !lockstep,
                                                             .defects = s.drives.defects},
                                        sensor, a.joint, s.seed);
  }
  if (s.drives.protocol == Protocol::cia402) {
    Cia402Axis::Settings settings;
    settings.defects = s.drives.defects;
    settings.lockstep = lockstep;
    settings.period = s.tick();
    if (a.motor) {
      settings.rated_torque = s.drives.rated_torque[a.entry];
      // A drive of this motor gives what the controller may ask for.
      const double asked = s.torque_limit[a.entry] / s.drives.gear_ratio[a.entry];
      settings.max_torque = std::max(settings.max_torque, 1.01 * asked / settings.rated_torque);
    }
    settings.rated_torque_unit = s.drives.rated_torque_unit;
    settings.counts_per_turn = s.drives.counts_per_turn;
    settings.velocity_unit = s.drives.velocity_unit;
    return std::make_unique<Cia402Axis>(a.mount, settings, sensor, a.joint, s.seed);
  }
  OdriveAxis::Settings settings;
  settings.version =
      s.drives.protocol == Protocol::odrive ? OdriveAxis::Version::v0_6 : OdriveAxis::Version::v0_5_6;
  settings.period = s.tick();
  settings.watchdog_timeout = s.drives.watchdog_timeout;
  if (a.motor) {  // as above: what the controller may ask for, it gives
    settings.torque_max =
        std::max(settings.torque_max, 1.01 * s.torque_limit[a.entry] / s.drives.gear_ratio[a.entry]);
  }
  settings.says_torque = s.drives.protocol == Protocol::odrive && a.motor && s.drives.torque_mismatch > 0.0;
  if (s.drives.endpoints) settings.endpoints = *s.drives.endpoints;
  settings.defects = s.drives.defects;
  if (const std::size_t other = a.entry ^ 1U; other < s.drives.nodes.size())  // two axes are a board
    settings.partner = s.drives.nodes[other];
  if (!s.drives.confirmed.value_or(true)) {  // as delivered
    settings.defects.watchdog_off = settings.defects.torque_mode_limit = true;
  } else if (a.motor) {
    if (!s.drives.torque_constant.empty()) settings.torque_constant = s.drives.torque_constant[a.entry];
    settings.vel_limit = odrive_vel_limit(s, a.entry);
    settings.current_limit = odrive_current(s, a.entry, settings.torque_constant);
  }
  return std::make_unique<OdriveAxis>(a.mount, settings, sensor, a.joint, s.seed);
}

}  // namespace esmc::host
