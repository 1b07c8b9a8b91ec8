#pragma once
/// Everything that decides a run, as read from a scene file. Plain values.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "firmware/mechanism/params.hpp"
#include "host_sim/effects/effects.hpp"
#include "host_sim/plant/motion.hpp"
#include "host_sim/scene/drive_defects.hpp"
#include "host_sim/scene/friction.hpp"
#include "host_sim/scene/names.hpp"
#include "host_sim/scene/odrive_endpoints.hpp"
#include "host_sim/scene/program.hpp"
#include "host_sim/scene/uncertainty.hpp"

namespace esmc::host {

/// A gain per kind of channel.
struct PerKind {
  double position = 0.0;
  double angle = 0.0;
};

/// The controller's model as factors on the true mechanism.
struct ModelFactors {
  double half_base = 1, effector_mass = 1, gravity = 1;
  double l1 = 1, l2 = 1, lg1 = 1, lg2 = 1, m1 = 1, m2 = 1, J1 = 1, J2 = 1;
  bool exact_friction = false;
  JointFriction friction;                                          ///< unused with exact_friction
  PerJoint torque_factor{1, 1, 1, 1};                              ///< given over commanded torque of motor i
  PerJoint ripple_amplitude{}, ripple_per_turn{}, ripple_phase{};  ///< of motor i, N m, -, rad
  /// True if the model assumes ideal motors.
  [[nodiscard]] bool plain_motors() const {
    return torque_factor == PerJoint{1, 1, 1, 1} && ripple_amplitude == PerJoint{};
  }
};

/// Keys of a leg, their values, and their factors in [control.model].
struct LegKey {
  const char* name;
  double LegParams<double>::*value;
  double ModelFactors::*factor;
};
inline constexpr LegKey leg_keys[] = {{"l1", &LegParams<double>::l1, &ModelFactors::l1},
                                      {"l2", &LegParams<double>::l2, &ModelFactors::l2},
                                      {"lg1", &LegParams<double>::lg1, &ModelFactors::lg1},
                                      {"lg2", &LegParams<double>::lg2, &ModelFactors::lg2},
                                      {"m1", &LegParams<double>::m1, &ModelFactors::m1},
                                      {"m2", &LegParams<double>::m2, &ModelFactors::m2},
                                      {"J1", &LegParams<double>::J1, &ModelFactors::J1},
                                      {"J2", &LegParams<double>::J2, &ModelFactors::J2}};

/// A point of a reference file: time, s, and effector position, m.
struct PathPoint {
  double t, x, y;
};

/// [reference].
struct ReferenceScene {
  ReferenceType type = ReferenceType::none;
  std::array<double, 2> center{};                 // circle, m
  double radius = 0.0, speed = 0.0, phase = 0.0;  // circle: m, rad/s, rad; polyline: speed in m/s
  std::vector<std::array<double, 2>> points;      // line (two), polyline
  double duration = 0.0;                          // line: one way, s
  bool repeat = false;                            // line, polyline, program: back and forth, round and round
  std::array<double, 2> offset{}, amplitude{}, omega{}, phases{};  // joint_sine
  std::optional<std::array<double, 2>> position;                   // hold
  std::vector<PathPoint> table;                                    // file
  ProgramScene program;
  bool unattended = false;       // it may run without a console
  std::optional<double> join;    // s; unset: 0 in sim and lockstep, 1 on hardware
  std::uint32_t first_tick = 0;  // of it at t = 0: `esmc check` looks at parts of a scene
};

inline constexpr const char* reference_copy = "scene_reference.csv";   ///< reference.path
inline constexpr const char* model_copy = "scene_model.toml";          ///< control.model.mechanism
inline constexpr const char* endpoints_copy = "scene_endpoints.json";  ///< drives.endpoints
/// A file that a scene names, as read. A run leaves it beside the scene under one of these names.
struct Companion {
  std::string name, text;
  std::string source;  ///< path that it was read from

  /// The scene key that names this file.
  [[nodiscard]] std::string key() const {
    return name == reference_copy ? "reference.path"
                                  : (name == model_copy ? "control.model.mechanism" : "drives.endpoints");
  }
};
inline constexpr std::array companion_names{endpoints_copy, model_copy,
                                            reference_copy};  ///< as the digest has them

/// [initial]: start at the reference, at an effector position (m, m/s), or at joints (rad, rad/s).
struct InitialScene {
  bool at_reference = true;
  std::optional<std::array<double, 2>> position;
  std::array<double, 2> velocity{};
  std::vector<double> joints, joint_rates;  // two base joints or all four; RR: two
};

/// [drives] and [sensors]; lists have one entry per drive, motors first, unless stated.
struct DriveScene {
  Protocol protocol = Protocol::odrive;
  std::vector<int> nodes;
  std::vector<double> direction, gear_ratio, offset;
  Zero zero = Zero::absolute;
  std::vector<double> zero_pose;  // rad, per sensed joint in the order of the joints; empty: the start
  std::vector<double> homing_speed, homing_torque;  // of the base joints, rad/s and N m; empty: no homing
  double speed_step = 0.0;                          // rad/s at a joint, in which drives tell it; 0: floats
  double homing_back_off = 0.05;                    // rad, off each stop
  std::optional<bool> sign_test;                    // unset: only where the bus can carry real drives
  std::optional<bool> watchdog_test;                // likewise
  double sign_test_move = 0.0;                      // rad
  double torque_mismatch = 0.0, torque_time = 0.0;  // N m at the joint, s
  double torque_lead = 0.0;                         // s
  double heartbeat_timeout = 0.0;                   // s
  double watchdog_timeout = 0.0;                    // s
  double boot_time = 0.75;                          // s
  std::vector<double> rated_torque;                 // cia402, per motor: N m at the shaft
  double rated_torque_unit = 0.0;                   // cia402: N m per LSB of object 6076
  double velocity_unit = 0.0;                       // cia402: rad/s per LSB of object 606C
  int counts_per_turn = 0;                          // cia402: of object 6064
  int controller_node = 0;                          // cia402: whose heartbeat the drives watch
  std::optional<OdriveEndpoints> endpoints;         // odrive
  std::vector<double> torque_constant;              // odrive, per motor: N m/A; empty: not given
  std::optional<bool> confirmed;                    // unset: unless the bus can carry real drives
  std::string where;                                // FILE:LINE
  Defects defects{};                                // of the emulated drives
  drive::mit::Dialect dialect = drive::mit::Dialect::mini_cheetah;
  std::vector<int> master_id;                                        // mit, per motor
  std::vector<double> position_range, velocity_range, torque_range;  // mit, per motor: rad, rad/s, N m
  std::string missing;  ///< message: what a loop on a bus still needs; empty: nothing
};

/// The interface to a supervisor computer.
struct CommandScene {
  int base_id = 0;
  link::Source source = link::Source::reference;
  bool arm_by_link = false;
  double speed = 0.0, acceleration = 0.0;  // m/s or rad/s, of each coordinate
  int stream_age_ticks = 0, counter_jump = 0, status_ticks = 0, telemetry_ticks = 0;
  static constexpr int jerk_ticks_max = 64;
  double jerk_time = 0.0;                  // s: of the moving average
  double timeout = 0.0;                    // s; 0: not watched
  double order_age = 0.0;                  // s
  std::array<double, 2> lambda{}, gain{};  // lower, upper; equal: cannot be written
};

/// [limits].
struct LimitsScene {
  double min_abs_sin_type1 = 0, min_abs_sin_type2 = 0, joint_speed = 0, closure = 0;  // 1, 1, rad/s, m
  std::optional<std::array<std::array<double, 2>, 2>> workspace;                      // x, y: lower, upper
  std::optional<std::array<std::array<double, 2>, 2>> joint_angle;                    // per base joint
  int max_age_ticks = 0;
  double feedback_jump = 0;              // rad per tick; 0: not checked
  double join_acceleration = 0;          // rad/s2, base joints; 0: not checked
  double halt_time = 0, lower_time = 0;  // s
  AfterHalt after_halt = AfterHalt::release;
};

/// Whether a mechanism has a rotor behind the gear of an elbow.
[[nodiscard]] inline bool has_elbow_rotors(const FiveBarParams<double>& p) {
  return p.legs[0].rotor2 > 0.0 || p.legs[1].rotor2 > 0.0;
}

/// A scene as read, with every default; SI units.
struct Scene {
  std::string file;
  std::string name;
  std::string toml;  ///< as run: the file with every --set merged in; files that it names are its companions
  std::vector<Companion> companions;  ///< in the order of companion_names
  std::uint32_t identity = 0;         ///< CRC-32 of what a controller is made of; 0: not computed
  std::string control_where, reference_where, simulation_where, bus_effects_where,
      uncertainty_where;  ///< FILE:LINE, for errors found later

  MechanismType type = MechanismType::five_bar;
  FiveBarParams<double> mechanism;        ///< RR uses legs[0] and g only
  std::array<double, 2> rotor_inertia{};  ///< of the base motors, at the joint, kg m2; part of J1 above
  std::optional<FiveBarParams<double>>
      believed;  ///< parameters that control.model multiplies, where not `mechanism`
  std::array<int, 2> working_mode{};
  int assembly_mode = 0;  ///< 0 in the file: taken from the initial pose

  LawChoice law = LawChoice::esmc;
  ReachingChoice reaching = ReachingChoice::implicit;
  PerKind lambda, gain, layer;  ///< 1/s; m/s2, rad/s2 (super_twisting: per s more); m/s, rad/s
  bool robust_gain = false;     ///< one gain per channel, designed for `uncertainty`; `gain` is then 0
  std::optional<UncertaintyScene> uncertainty;
  std::shared_ptr<const Scene> whole;  ///< gains are designed for it; null: for this scene, no part of one
  std::optional<double> kp, kd;
  std::optional<double> torque_ramp;  ///< s; unset: 0 in sim and lockstep, 0.2 in real time
  std::optional<double> delay_ticks;  ///< unset: 0 in sim and lockstep, 2 in real time
  double sensor_lag_ticks = 0.0;
  double disturbance_observer = 0.0;  ///< bandwidth, 1/s; 0: none
  bool predictor = false;
  double rate_hz = 1000.0;
  bool all_motors = false, all_sensors = false;
  std::vector<double> encoder_sigma;  ///< rad, per joint; empty: the four encoders are not fused
  std::vector<double> torque_limit;   ///< per motor, N m at the joint
  std::vector<double> torque_weight;  ///< per motor, W of [F26]
  std::vector<double> preload;        ///< per motor, N m, signed; empty: none
  ModelFactors model;
  std::vector<Waveform> torque;  ///< open_loop, per motor

  ReferenceScene reference;
  InitialScene initial;
  LimitsScene limits;
  DriveScene drives;  ///< motors first, then the passive encoders of [sensors]
  std::optional<CommandScene> command;
  int bitrate = 0;       ///< bit/s
  int data_bitrate = 0;  ///< bit/s of the data of CAN FD frames; 0: the bus is classic
  /// Duration of a bit of CAN FD data in nominal bit times; 1 without FD.
  [[nodiscard]] double fast_bit() const {
    return data_bitrate > 0 ? static_cast<double>(bitrate) / data_bitrate : 1.0;
  }

  double duration = 0.0;  ///< s
  double step = 0.0;      ///< s; with accuracy: a tick
  std::optional<double> accuracy;
  AccuracyOf accuracy_of = AccuracyOf::end;
  Method method = Method::rk4;
  Resolution resolution;  ///< of event_driven; not of the file: the search for an accuracy sets it
  std::vector<Effect> effects;
  std::uint64_t seed = 1;  ///< of everything random; from --seed
  bool hardware = false;   ///< the bus of this run may carry real drives

  /// True state at t = 0: joint angles and rates (four for the five-bar, two for RR).
  std::vector<double> start_angle, start_rate;

  [[nodiscard]] int joints() const { return type == MechanismType::five_bar ? 4 : 2; }  ///< their number
  [[nodiscard]] int motors() const { return all_motors ? joints() : 2; }                ///< number of motors
  /// Whether a controller computes the torques: the law is neither open_loop nor none.
  [[nodiscard]] bool closed_loop() const { return law != LawChoice::open_loop && law != LawChoice::none; }
  /// Whether the law has a sliding surface and a switching gain: esmc, esmc_projected, smc.
  [[nodiscard]] bool sliding() const { return law <= LawChoice::smc; }
  /// True if a console homes before it arms: emulated encoders then begin without their zero as well.
  [[nodiscard]] bool homes() const { return !drives.homing_speed.empty() && command && command->arm_by_link; }
  /// True if the drives are ODrives, of either firmware.
  [[nodiscard]] bool odrive() const {
    return drives.protocol == Protocol::odrive || drives.protocol == Protocol::odrive_0_5;
  }
  [[nodiscard]] double tick() const { return 1.0 / rate_hz; }  ///< control period, s
  /// Index of the joint of each motor, in the order of [drives]; five-bar with two motors: 0 and 2.
  [[nodiscard]] std::vector<std::size_t> motor_joints() const {
    const auto n = static_cast<std::size_t>(motors()), all = static_cast<std::size_t>(joints());
    std::vector<std::size_t> out;
    for (std::size_t m = 0; m < n; ++m) out.push_back(m * all / n);
    return out;
  }
  [[nodiscard]] RrParams<double> arm() const { return {mechanism.legs[0], mechanism.g}; }  ///< if type is rr
};

/// Ticks between the controller's heartbeats (CANopen): a third of the drives' time-out, so that one may be
/// lost. At most 20: a drive must receive one within the 60 ticks from its watchdog's set-up to its torque.
[[nodiscard]] inline std::uint32_t heartbeat_ticks(const Scene& scene) {
  return static_cast<std::uint32_t>(
      std::clamp(std::floor(scene.drives.watchdog_timeout * scene.rate_hz / 3.0), 1.0, 20.0));
}

/// Returns CAN identifiers that the drives of a scene send or receive: for ODrives the first of each node's
/// block of 32, else all of them.
std::vector<std::uint32_t> drive_identifiers(const Scene& scene);
/// Throws InputError where a scene has effects that need a bus; `why`: "esmc sim has no bus".
void refuse_bus_effects(const Scene& scene, const std::string& why);

/// Fills start_angle, start_rate and a missing assembly_mode. Throws InputError at `initial` or `reference`
/// (places in the scene file) when the start is out of reach, contradicts a mode or does not close.
void set_start(Scene& scene, const std::string& initial, const std::string& reference);
/// The commented scene that `esmc init` prints: for "rr" the RR arm, for any other `kind` the five-bar.
std::string_view starting_scene(const std::string& kind);

/// Reads a scene; `sets` are "section.key=value" overrides. The scene is possible and its start reachable:
/// else throws InputError with file, line, key and the allowed values.
Scene read_scene(const std::string& file, const std::vector<std::string>& sets);
/// Reads a scene from TOML text, otherwise like read_scene; `name` stands for the file in errors.
Scene read_scene_text(const std::string& text, const std::string& name, const std::vector<std::string>& sets);

}  // namespace esmc::host
