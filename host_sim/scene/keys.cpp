#include "host_sim/scene/keys.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <stdexcept>

namespace esmc::host {
namespace {

constexpr double inf = std::numeric_limits<double>::infinity();
constexpr double big = 1e6;  // magnitudes beyond this are a slip of units

// clang-format off
constexpr std::array keys{
    Key{"name", "string", "\"scene\"", "", -inf, inf, false, "", "shown in reports"},

    Key{"mechanism.type", "string", "", "", -inf, inf, false, "five_bar | rr", "which mechanism"},
    Key{"mechanism.half_base", "number", "", "m", 0, 1e3, true, "", "five_bar: half the distance between the base joints"},
    Key{"mechanism.gravity", "number", "", "m/s2", 0, 1e3, false, "", "along -y; 0 for a horizontal mechanism"},
    Key{"mechanism.effector_mass", "number", "0.0", "kg", 0, big, false, "", "five_bar: point mass at the effector"},
    Key{"mechanism.leg", "table", "-", "", -inf, inf, false, "", "both legs (or the arm); or [[mechanism.legs]] twice"},
    Key{"mechanism.legs", "tables", "-", "", -inf, inf, false, "", "five_bar: the two legs, leg 1 (right) first"},
    Key{"mechanism.working_mode", "strings", "", "", -inf, inf, false, "+ | -", "array, one per leg (RR: one entry): sign of sin(theta_j2), in the leg's own frame"},
    Key{"mechanism.assembly_mode", "string", "-", "", -inf, inf, false, "+ | -", "five_bar: sign of sin(phi12 + phi22); else from the initial pose"},
    Key{"mechanism.leg.l1", "number", "", "m", 0, 1e3, true, "", "length of the proximal bar"},
    Key{"mechanism.leg.l2", "number", "", "m", 0, 1e3, true, "", "length of the distal bar"},
    Key{"mechanism.leg.lg1", "number", "", "m", -1e3, 1e3, false, "", "mass centre of the proximal bar, from its joint along the bar"},
    Key{"mechanism.leg.lg2", "number", "", "m", -1e3, 1e3, false, "", "mass centre of the distal bar, likewise"},
    Key{"mechanism.leg.m1", "number", "", "kg", 0, big, false, "", "mass of the proximal bar"},
    Key{"mechanism.leg.m2", "number", "", "kg", 0, big, false, "", "mass of the distal bar"},
    Key{"mechanism.leg.J1", "number", "", "kg m2", 0, big, false, "", "inertia of the proximal bar about its mass centre"},
    Key{"mechanism.leg.J2", "number", "", "kg m2", 0, big, false, "", "inertia of the distal bar about its mass centre"},

    Key{"control.law", "string", "", "", -inf, inf, false, "esmc | esmc_projected | smc | ctc | pd | open_loop | none", "control law"},
    Key{"control.reaching", "string", "\"implicit\"", "", -inf, inf, false, "sign | saturation | tanh | implicit | super_twisting | implicit_coupled", "what replaces sgn s"},
    Key{"control.lambda", "number or {position, angle}", "", "1/s", 0, 1e5, true, "", "esmc, esmc_projected, smc: slope of the surface; ctc: K_p = lambda^2, K_d = 2 lambda unless kp, kd are given"},
    Key{"control.gain", "number, {position, angle} or \"robust\"", "", "m/s2, rad/s2", 0, 1e9, false, "", "esmc, esmc_projected, smc: switching gain k; \"robust\": one per channel, from [uncertainty]; super_twisting: L in m/s3, rad/s3, how fast the disturbance may change"},
    Key{"control.layer", "number or {position, angle}", "0.05", "m/s, rad/s", 0, 1e6, true, "", "boundary layer of saturation and tanh"},
    Key{"control.kp", "number", "-", "1/s2 (ctc), N m/rad (pd)", 0, 1e9, false, "", "proportional gain; required for pd"},
    Key{"control.kd", "number", "-", "1/s (ctc), N m s/rad (pd)", 0, 1e9, false, "", "derivative gain; required for pd"},
    Key{"control.delay_ticks", "number", "-", "ticks", 0, 20, false, "", "known torque delay told to the implicit laws; default 0 in sim and lockstep, 2 in real time"},
    Key{"control.sensor_lag_ticks", "number", "0.0", "ticks", 0, 20, false, "", "known lag of what is measured, told to the implicit laws besides delay_ticks; a predictor does not bridge it"},
    Key{"control.disturbance_observer", "number", "0.0", "1/s", 0, 1e5, false, "", "bandwidth of the observer of unknown torques on the base joints, which are then compensated; 0: none. Laws with a model"},
    Key{"control.predictor", "boolean", "false", "", -inf, inf, false, "", "true: the law acts on the state predicted over delay_ticks (whole, 1 to 8), towards the reference of then. Laws with a model"},
    Key{"control.rate_hz", "number", "1000.0", "Hz", 10, 100000, false, "", "control ticks per second"},
    Key{"control.motors", "string", "\"base\"", "", -inf, inf, false, "base | all", "five_bar: two motors on the base, or four"},
    Key{"control.sensors", "string", "\"base\"", "", -inf, inf, false, "base | all", "five_bar: base encoders and closure, or all four joints"},
    Key{"control.encoder_sigma", "number or numbers", "-", "rad", 0, 1, true, "", "sensors = all: standard deviation of each joint's encoder, one for all or one each; with it the four are fused, weighted projection onto closed configurations"},
    Key{"control.torque_limit", "number or numbers", "", "N m", 0, big, true, "", "hard clamp at the controller, at the joint; one for all motors or one each"},
    Key{"control.torque_ramp", "number", "-", "s", 0, 60, false, "", "in which the torque rises from what carries the weight to what the law asks for; default 0 in sim and lockstep, 0.2 in real time"},
    Key{"control.torque_weight", "numbers", "-", "", 0, 1e12, true, "", "four motors: diagonal of W, minimised is tau^T W tau; default 1/torque_limit^2"},
    Key{"control.preload", "numbers", "-", "N m", -big, big, false, "", "four motors: each one's torque stays at this or above where it is > 0, at this or below where it is < 0, beyond the play of its gear; motors work against each other for it"},
    Key{"control.model", "table", "-", "", -inf, inf, false, "", "what the controller believes, as factors on [mechanism]"},
    Key{"control.torque", "tables", "-", "", -inf, inf, false, "", "open_loop: per motor { offset, terms = [{ amp, omega, phase }] }"},
    Key{"control.model.mechanism", "string", "-", "", -inf, inf, false, "", "scene file whose [mechanism] the controller believes in instead of this one's, relative to the scene file; the factors go onto that"},
    Key{"control.model.half_base", "number", "1.0", "", 0, 100, true, "", "factor"},
    Key{"control.model.effector_mass", "number", "1.0", "", 0, 100, false, "", "factor"},
    Key{"control.model.gravity", "number", "1.0", "", 0, 100, false, "", "factor"},
    Key{"control.model.l1", "number", "1.0", "", 0, 100, true, "", "factor"},
    Key{"control.model.l2", "number", "1.0", "", 0, 100, true, "", "factor"},
    Key{"control.model.lg1", "number", "1.0", "", -100, 100, false, "", "factor"},
    Key{"control.model.lg2", "number", "1.0", "", -100, 100, false, "", "factor"},
    Key{"control.model.m1", "number", "1.0", "", 0, 100, false, "", "factor"},
    Key{"control.model.m2", "number", "1.0", "", 0, 100, false, "", "factor"},
    Key{"control.model.J1", "number", "1.0", "", 0, 100, false, "", "factor"},
    Key{"control.model.J2", "number", "1.0", "", 0, 100, false, "", "factor"},
    Key{"control.model.friction", "string", "\"none\"", "", -inf, inf, false, "none | exact", "friction the controller compensates"},
    Key{"control.torque.offset", "number", "0.0", "N m", -big, big, false, "", "constant part"},
    Key{"control.torque.terms", "tables", "[]", "", -inf, inf, false, "", "sine terms"},
    Key{"control.torque.terms.amp", "number", "", "N m", -big, big, false, "", "amplitude"},
    Key{"control.torque.terms.omega", "number", "", "rad/s", -big, big, false, "", "angular frequency"},
    Key{"control.torque.terms.phase", "number", "0.0", "rad", -big, big, false, "", "phase"},

    Key{"uncertainty", "table", "-", "", -inf, inf, false, "", "where the truth lies around what the controller believes; `esmc design`, gain = \"robust\""},
    Key{"uncertainty.m1", "number or [lower, upper]", "-", "", 0, 100, false, "", "true over believed mass of the proximal bars: 0.1 is [0.9, 1.1]; default [1, 1]"},
    Key{"uncertainty.m2", "number or [lower, upper]", "-", "", 0, 100, false, "", "of the distal bars, likewise"},
    Key{"uncertainty.J1", "number or [lower, upper]", "-", "", 0, 100, false, "", "inertia of the proximal bars, likewise"},
    Key{"uncertainty.J2", "number or [lower, upper]", "-", "", 0, 100, false, "", "inertia of the distal bars, likewise"},
    Key{"uncertainty.lg1", "number or [lower, upper]", "-", "m", -1e3, 1e3, false, "", "true less believed place of the mass centre: 0.005 is [-0.005, 0.005]; default [0, 0]"},
    Key{"uncertainty.lg2", "number or [lower, upper]", "-", "m", -1e3, 1e3, false, "", "of the distal bars, likewise"},
    Key{"uncertainty.gravity", "number or [lower, upper]", "-", "", 0, 100, false, "", "true over believed; default [1, 1]"},
    Key{"uncertainty.payload", "numbers", "-", "kg", -big, big, false, "", "[lower, upper]: point mass at the effector beyond what the controller believes; default [0, 0]"},
    Key{"uncertainty.viscous", "number pairs", "-", "N m s/rad", 0, big, false, "", "[lower, upper] per joint of a leg, four: the legs differ; default what the controller believes"},
    Key{"uncertainty.coulomb", "number pairs", "-", "N m", 0, big, false, "", "dry friction, likewise"},
    Key{"uncertainty.l1", "number", "0.0", "", 0, 0.5, false, "", "half width as a share, for simulated plants only: no gain answers for lengths"},
    Key{"uncertainty.l2", "number", "0.0", "", 0, 0.5, false, "", "likewise"},
    Key{"uncertainty.half_base", "number", "0.0", "", 0, 0.5, false, "", "likewise, five_bar"},
    Key{"uncertainty.tube", "number", "-", "m or rad", 0, 10, true, "", "largest error the gains are made for, effector (five_bar) or joints (rr); default computed: one that holds the band of the layer"},
    Key{"uncertainty.reaching_time", "number", "0.1", "s", 0, 60, true, "", "in which what cannot leave the tube reaches the sliding surface (in continuous time, without a layer)"},
    Key{"uncertainty.over", "string", "\"reference\"", "", -inf, inf, false, "reference | workspace", "where the gains hold"},

    Key{"reference.type", "string", "", "", -inf, inf, false, "circle | line | polyline | joint_sine | hold | file", "kind of reference"},
    Key{"reference.join", "number", "-", "s", 0, 60, false, "", "from the measured pose onto the reference by a quintic; default 0 in sim and lockstep, 1.0 on hardware"},
    Key{"reference[circle].center", "numbers", "", "m", -1e3, 1e3, false, "", "centre (x, y)"},
    Key{"reference[circle].radius", "number", "", "m", 0, 1e3, true, "", "radius"},
    Key{"reference[circle].speed", "number", "", "rad/s", -1e4, 1e4, false, "", "counter-clockwise positive"},
    Key{"reference[circle].phase", "number", "0.0", "rad", -1e3, 1e3, false, "", "angle at t = 0"},
    Key{"reference[line].from", "numbers", "", "m", -1e3, 1e3, false, "", "start (x, y)"},
    Key{"reference[line].to", "numbers", "", "m", -1e3, 1e3, false, "", "end (x, y)"},
    Key{"reference[line].duration", "number", "", "s", 0, 3600, true, "", "one way, rest to rest by a quintic; rounded to whole ticks"},
    Key{"reference[line].repeat", "boolean", "false", "", -inf, inf, false, "", "go back and forth"},
    Key{"reference[polyline].points", "number pairs", "", "m", -1e3, 1e3, false, "", "two or more corners (x, y); at rest in each"},
    Key{"reference[polyline].speed", "number", "", "m/s", 0, 1e3, true, "", "mean speed along each side; sides last whole ticks"},
    Key{"reference[polyline].repeat", "boolean", "false", "", -inf, inf, false, "", "from the last corner to the first and round again"},
    Key{"reference[joint_sine].offset", "numbers", "", "rad", -100, 100, false, "", "per base joint"},
    Key{"reference[joint_sine].amplitude", "numbers", "", "rad", -100, 100, false, "", "per base joint"},
    Key{"reference[joint_sine].omega", "numbers", "", "rad/s", -1e4, 1e4, false, "", "per base joint"},
    Key{"reference[joint_sine].phase", "numbers", "[0.0, 0.0]", "rad", -1e3, 1e3, false, "", "per base joint"},
    Key{"reference[hold].position", "numbers", "-", "m", -1e3, 1e3, false, "", "effector (x, y); without it: where it is at the start"},
    Key{"reference[file].path", "string", "", "", -inf, inf, false, "", "CSV with a header t,x,y: seconds from 0, metres; relative to the scene file"},

    Key{"initial.at", "string", "-", "", -inf, inf, false, "reference", "on the reference, at rest (the default where there is a reference)"},
    Key{"initial.position", "numbers", "-", "m", -1e3, 1e3, false, "", "effector (x, y) in the working mode"},
    Key{"initial.velocity", "numbers", "[0.0, 0.0]", "m/s", -1e4, 1e4, false, "", "of the effector; with position"},
    Key{"initial.joints", "numbers", "-", "rad", -1e3, 1e3, false, "", "base joints (the rest follows in assembly_mode), or all four; RR: both"},
    Key{"initial.joint_rates", "numbers", "-", "rad/s", -1e4, 1e4, false, "", "of the base joints, or as many as joints; default 0"},

    Key{"limits.min_abs_sin_type1", "number", "0.02", "", 0, 1, false, "", "smallest allowed |sin theta_j2|"},
    Key{"limits.min_abs_sin_type2", "number", "0.05", "", 0, 1, false, "", "smallest allowed |D2|"},
    Key{"limits.joint_speed", "number", "50.0", "rad/s", 0, 1e5, true, "", "base joints"},
    Key{"limits.closure", "number", "0.005", "m", 0, 1e3, true, "", "how far the leg tips may be apart as measured (sensors = all)"},
    Key{"limits.workspace", "table", "-", "m", -inf, inf, false, "", "{ x = [lower, upper], y = [lower, upper] } for the effector"},
    Key{"limits.workspace.x", "numbers", "", "m", -1e3, 1e3, false, "", "lower, upper"},
    Key{"limits.workspace.y", "numbers", "", "m", -1e3, 1e3, false, "", "lower, upper"},
    Key{"limits.joint_angle", "number pairs", "-", "rad", -1e3, 1e3, false, "", "[lower, upper] per base joint"},
    Key{"limits.feedback_jump", "number", "-", "rad", 0, 100, false, "", "how far a measured angle may be, per tick, from where its rate takes it; 0: any; default joint_speed / rate_hz"},
    Key{"limits.join_acceleration", "number", "-", "rad/s2", 1e-6, 1e9, false, "", "base joints on the way onto the reference (reference.join); default any: it is the torque that bounds it"},
    Key{"limits.halt_time", "number", "0.1", "s", 0, 60, false, "", "to rest under control, where a fault allows it; 0: every fault takes the torque away at once"},
    Key{"limits.after_halt", "string", "-", "", -inf, inf, false, "release | hold | lower", "once at rest: torque off, held until the operator ends it, or weight let down; default lower with gravity, release without"},
    Key{"limits.lower_time", "number", "1.0", "s", 0, 600, true, "", "after_halt = lower: in which the weight compensation fades"},
    Key{"limits.max_age_ticks", "integer", "2", "ticks", 0, 100, false, "", "missed samples that are extrapolated; one more is a fault"},

    Key{"drives.protocol", "string", "\"odrive\"", "", -inf, inf, false, "odrive | odrive_0.5 | cia402 | mit", "what the drives speak"},
    Key{"drives.nodes", "integers", "-", "", 0, 127, false, "", "CAN node per motor, base joints first; odrive 0..62, cia402 1..127, mit 1..62 (damiao 15); default 1, 2, ..."},
    Key{"drives.direction", "numbers", "-", "", -1, 1, false, "", "+1: motor turns with the joint angle of the model (leg 2: clockwise seen from the front); -1 against; default +1"},
    Key{"drives.gear_ratio", "numbers", "-", "", 1e-3, 1e4, false, "", "motor turns per joint turn; default 1"},
    Key{"drives.offset", "numbers", "-", "rad", -1e3, 1e3, false, "", "joint angle at encoder zero; default 0"},
    Key{"drives.zero_pose", "numbers", "-", "rad", -1e3, 1e3, false, "", "zero = pose | end_stop: angles of the sensed joints where the operator confirms the zero; default the start"},
    Key{"drives.sign_test", "boolean", "-", "", -inf, inf, false, "", "before running, each motor must answer 5 % of its torque limit as the model says; two motors only; default false in lockstep, in hil and where the bus exists in software only"},
    Key{"drives.watchdog_test", "boolean", "-", "", -inf, inf, false, "", "odrive: before the first arming, the drive's watchdog is starved at zero torque and must expire; in real time only; default true where the bus can carry real drives"},
    Key{"drives.sign_test_move", "number", "2e-3", "rad", 0, 1, true, "", "how far a base joint must move in the sign test"},
    Key{"drives.torque_mismatch", "number", "0.0", "N m", 0, big, false, "", "how far the torque a drive reports may be from its command, at the joint; 0: any (odrive_0.5 reports none)"},
    Key{"drives.torque_time", "number", "5e-3", "s", 0, 10, false, "", "in which a drive follows its command (first-order lag), for torque_mismatch"},
    Key{"drives.torque_lead", "number", "0.0", "s", 0, 1, false, "", "from the instant of a tick to the one at which its torque acts: measured angles are extrapolated by it"},
    Key{"drives.zero", "string", "\"absolute\"", "", -inf, inf, false, "absolute | pose | end_stop", "how the encoder zero is known"},
    Key{"drives.heartbeat_timeout", "number", "0.03", "s", 0, 10, true, "", "silence of a drive's heartbeat that is a fault; the emulated drives beat every 10 ms"},
    Key{"drives.boot_time", "number", "0.75", "s", 0.75, 30, false, "", "from the order to arm to a drive's first frame, then the fault enabling_timeout; more only where the output drive_enable switches the supply of the drives' electronics"},
    Key{"drives.watchdog_timeout", "number", "-", "s", 0, 10, true, "", "the drive's own watchdog: torque off without a setpoint for this long; default 0.01, at least 3 ticks"},
    Key{"drives.rated_torque", "number or numbers", "-", "N m", 0, big, true, "", "cia402: what object 6076 must say, at the shaft; one for all motors or one each; default torque_limit / gear_ratio"},
    Key{"drives.rated_torque_unit", "number", "0.001", "N m", 0, 1e3, true, "", "cia402: unit of object 6076; 1e-3 by the profile, 1e-6 for EPOS4"},
    Key{"drives.counts_per_turn", "integer", "1048576", "", 1, 1000000000, false, "", "cia402: object 6064 per turn of the motor"},
    Key{"drives.velocity_unit", "number", "0.00010471975511965977", "rad/s", 0, 1e3, true, "", "cia402: unit of object 606C; here 0.001 rpm"},
    Key{"drives.controller_node", "integer", "127", "", 1, 127, false, "", "cia402: our own node, whose heartbeat the drives watch"},
    Key{"drives.endpoints", "string", "-", "", -inf, inf, false, "", "odrive: the vendor's flat_endpoints.json of the drives' firmware, relative to the scene file: version and configuration are read back before arming"},
    Key{"drives.torque_constant", "number or numbers", "-", "N m/A", 0, 1e3, true, "", "odrive with endpoints: what the drives must have, one for all motors or one each; with it the current limit is checked as well"},
    Key{"drives.confirmed", "boolean", "-", "", -inf, inf, false, "", "what the drives cannot be asked for has been checked by hand; default true in lockstep, in hil and where the bus exists in software only"},
    Key{"drives.defect", "string", "-", "", -inf, inf, false, "", "what the emulated drives of esmc hil and esmc plant do wrong, a name that esmc drive --help lists"},
    Key{"drives.dialect", "string", "\"mini_cheetah\"", "", -inf, inf, false, "mini_cheetah | cubemars | damiao", "mit: whose replies"},
    Key{"drives.master_id", "integer or integers", "0", "", 0, 2047, false, "", "mit: identifier of the replies, one for all motors or one each; a motor's own node: it replies on that"},
    Key{"drives.position_range", "number or numbers", "12.5", "rad", 0, 1e3, true, "", "mit: half width of the drive's position field, one for all motors or one each"},
    Key{"drives.velocity_range", "number or numbers", "50.0", "rad/s", 0, 1e4, true, "", "mit: likewise, velocity"},
    Key{"drives.torque_range", "number or numbers", "18.0", "N m", 0, 1e4, true, "", "mit: likewise, torque; what the controller may ask for must fit"},
    Key{"sensors.nodes", "integers", "", "", 0, 62, false, "", "sensors = all with base motors: CAN nodes of the two passive encoders"},
    Key{"sensors.direction", "numbers", "-", "", -1, 1, false, "", "as in [drives]"},
    Key{"sensors.offset", "numbers", "-", "rad", -1e3, 1e3, false, "", "as in [drives]"},
    Key{"command", "table", "-", "", -inf, inf, false, "", "interface to a supervisor computer; without it there is none"},
    Key{"command.base_id", "integer", "1920", "", 32, 2016, false, "", "first of 32 identifiers, a multiple of 32 that no drive has (1920 = 0x780)"},
    Key{"command.source", "string", "\"reference\"", "", -inf, inf, false, "hold | reference | stream", "where the motion comes from, until the supervisor computer chooses: rest, [reference], its set points and samples"},
    Key{"command.arm", "string", "\"start\"", "", -inf, inf, false, "start | link", "start: the program arms by itself; link: only the supervisor computer does"},
    Key{"command.speed", "number", "", "m/s or rad/s", 0, 1e3, true, "", "of each coordinate, for set points and samples; x and y, or with joint_sine the base joints"},
    Key{"command.acceleration", "number", "", "m/s2 or rad/s2", 0, big, true, "", "of each coordinate, likewise"},
    Key{"command.stream_age_ticks", "integer", "5", "ticks", 1, 10000, false, "", "without a sample; one more is the fault command_lost"},
    Key{"command.timeout", "number", "-", "s", 0, 3600, false, "", "without any frame while armed, then the fault command_lost; 0: not watched; default 1 with arm = \"link\", else 0"},
    Key{"command.order_age", "number", "0.5", "s", 0, 30, true, "", "how old the Status may be that an order answers"},
    Key{"command.counter_jump", "integer", "2", "", 1, 14, false, "", "alive counter: largest step; 1: no frame may be lost"},
    Key{"command.status_ticks", "integer", "10", "ticks", 1, 100000, false, "", "between two Status"},
    Key{"command.telemetry_ticks", "integer", "20", "ticks", 0, 100000, false, "", "between two sets of telemetry; 0: none"},
    Key{"command.lambda", "numbers", "-", "1/s", 0, 1e5, true, "", "[lower, upper] for lambda by the supervisor computer; without it, it cannot be written"},
    Key{"command.gain", "numbers", "-", "m/s2, rad/s2", 0, 1e9, false, "", "[lower, upper] for the gain, likewise"},
    Key{"bus.bitrate", "integer", "1000000", "bit/s", 10000, 1000000, false, "", "CAN bit rate; `esmc check` computes the bus load from it"},

    Key{"simulation.duration", "number", "", "s", 0, 1e6, true, "", "from t = 0"},
    Key{"simulation.integrator", "string", "\"rk4\"", "", -inf, inf, false, "semi_implicit_euler | rk4 | dopri5 | dopri8 | radau5 | moreau_jean", "method, at the fixed step below; set-valued effects are always stepped by moreau_jean"},
    Key{"simulation.step", "number", "0.0005", "s", 0, 1, true, "", "integration step; a tick is cut into equal steps no longer than this"},
    Key{"simulation.accuracy", "number", "-", "", 1e-12, 1e-2, false, "", "instead of integrator and step: largest absolute error of final_state.q; the program chooses the method and halves the step until it is met"},

    Key{"effects.type", "string", "", "", -inf, inf, false, "viscous_friction | coulomb_friction | joint_flexibility | backlash | end_stops | payload | external_force | torque_lag | torque_saturation | torque_ripple | thermal_limit | encoder | noise | bias | delay | jitter | compute_delay | bit_timing | loss | duplication | corruption | babbling_node | bus_off | drive_dropout", "which effect; each at most once"},
    Key{"effects[viscous_friction].coefficient", "numbers", "", "N m s/rad", 0, big, false, "", "per joint of a leg; four values: the two legs differ"},
    Key{"effects[coulomb_friction].torque", "numbers", "", "N m", 0, big, false, "", "per joint of a leg; four values: the two legs differ"},
    Key{"effects[coulomb_friction].regularised", "number", "-", "rad/s", 1e-9, 1e3, false, "", "tanh(rate / regularised) instead of true stiction"},
    Key{"effects[joint_flexibility].stiffness", "number or numbers", "", "N m/rad", 0, big, true, "", "of the gear at the joint; one for all motors or one each"},
    Key{"effects[joint_flexibility].damping", "number or numbers", "0.0", "N m s/rad", 0, big, false, "", "of the gear"},
    Key{"effects[joint_flexibility].rotor_inertia", "number or numbers", "", "kg m2", 0, big, true, "", "of the rotor, at the joint"},
    Key{"effects[backlash].gap", "number", "", "rad", 0, 1, true, "", "play at the joint, from contact to contact"},
    Key{"effects[backlash].stiffness", "number", "1000.0", "N m/rad", 0, big, true, "", "of the contact; not beside joint_flexibility"},
    Key{"effects[backlash].damping", "number", "0.1", "N m s/rad", 0, big, false, "", "of the contact; likewise"},
    Key{"effects[backlash].rotor_inertia", "number", "0.0001", "kg m2", 0, big, true, "", "of the rotor, at the joint; likewise"},
    Key{"effects[end_stops].lower", "numbers", "", "rad", -1e3, 1e3, false, "", "per base joint"},
    Key{"effects[end_stops].upper", "numbers", "", "rad", -1e3, 1e3, false, "", "per base joint"},
    Key{"effects[end_stops].stiffness", "number", "-", "N m/rad", 0, 1e9, true, "", "springs; without it the stops are rigid"},
    Key{"effects[end_stops].restitution", "number", "0.0", "", 0, 1, false, "", "rebound speed over impact speed"},
    Key{"effects[payload].mass", "number", "", "kg", 0, big, true, "", "taken up at the effector, moving with it"},
    Key{"effects[payload].from", "number", "0.0", "s", 0, 1e6, false, "", "when it is taken up"},
    Key{"effects[payload].to", "number", "1e6", "s", 0, 1e6, false, "", "when it is let go"},
    Key{"effects[external_force].kind", "string", "\"pulse\"", "", -inf, inf, false, "pulse | human", "constant force, or spring and damper of a hand"},
    Key{"effects[external_force].force", "numbers", "", "N", -big, big, false, "", "pulse: (x, y)"},
    Key{"effects[external_force].anchor", "numbers", "", "m", -1e3, 1e3, false, "", "human: where the hand pulls to"},
    Key{"effects[external_force].stiffness", "number", "", "N/m", 0, big, false, "", "human"},
    Key{"effects[external_force].damping", "number", "0.0", "N s/m", 0, big, false, "", "human"},
    Key{"effects[external_force].from", "number", "0.0", "s", 0, 1e6, false, "", "begin"},
    Key{"effects[external_force].to", "number", "1e6", "s", 0, 1e6, false, "", "end"},
    Key{"effects[torque_lag].time_constant", "number", "", "s", 1e-6, 10, false, "", "of the first-order lag from setpoint to torque"},
    Key{"effects[torque_ripple].amplitude", "number", "", "N m", 0, big, false, "", "at the joint"},
    Key{"effects[torque_ripple].per_turn", "number", "", "", 0, 1e5, true, "", "periods per turn of the joint"},
    Key{"effects[thermal_limit].continuous", "number", "", "N m", 0, big, true, "", "torque at the joint that may act for ever"},
    Key{"effects[thermal_limit].time_constant", "number", "", "s", 1e-3, 1e5, false, "", "of the heating; tripped above 1, back below 0.9 of the continuous heat"},
    Key{"effects[noise].sigma", "number", "", "rad", 0, 10, false, "", "standard deviation of each reading of the shaft, at the joint"},
    Key{"effects[noise].bandwidth", "number", "1000.0", "rad/s", 1, 1e5, false, "", "of the drive's observer where no encoder is named"},
    Key{"effects[bias].angle", "numbers", "", "rad", -10, 10, false, "", "zero error per joint of a leg; four values: the two legs differ"},
    Key{"effects[delay].ticks", "integer", "", "ticks", 0, 1000, false, "", "age of what the drives report"},
    Key{"effects[jitter].sigma", "number", "", "s", 0, 1, false, "", "the torque of a tick takes effect late by |N(0, sigma)|"},
    Key{"effects[compute_delay].time", "number", "", "s", 0, 1, false, "", "the torque of a tick takes effect this much later"},
    Key{"effects[loss].probability", "number", "", "", 0, 1, true, "", "that one receiver misses a frame, each for itself"},
    Key{"effects[loss].at", "string", "\"all\"", "", -inf, inf, false, "all | controller | drives", "whose receivers"},
    Key{"effects[loss].from", "number", "0.0", "s", -1e6, 1e6, false, "", "begin; before 0: while arming as well"},
    Key{"effects[loss].to", "number", "1e6", "s", -1e6, 1e6, false, "", "end"},
    Key{"effects[duplication].probability", "number", "", "", 0, 1, true, "", "that a frame is sent and received again"},
    Key{"effects[duplication].from", "number", "0.0", "s", -1e6, 1e6, false, "", "begin; before 0: while arming as well"},
    Key{"effects[duplication].to", "number", "1e6", "s", -1e6, 1e6, false, "", "end"},
    Key{"effects[corruption].detected", "number", "0.0", "", 0, 1, false, "", "probability of a bit error that is seen: error frame, and the frame is repeated"},
    Key{"effects[corruption].undetected", "number", "0.0", "", 0, 1, false, "", "probability that a frame is accepted with wrong data; a real CRC lets this happen hardly ever"},
    Key{"effects[corruption].bits", "integer", "1", "", 1, 64, false, "", "of the payload that are flipped undetected"},
    Key{"effects[corruption].from", "number", "0.0", "s", -1e6, 1e6, false, "", "begin; before 0: while arming as well"},
    Key{"effects[corruption].to", "number", "1e6", "s", -1e6, 1e6, false, "", "end"},
    Key{"effects[babbling_node].identifier", "integer", "", "", 0, 0x1FFFFFFF, false, "", "of its frames; needs bit_timing"},
    Key{"effects[babbling_node].extended", "boolean", "false", "", -inf, inf, false, "", "29 bits of identifier instead of 11"},
    Key{"effects[babbling_node].size", "integer", "8", "bytes", 0, 8, false, "", "of random data"},
    Key{"effects[babbling_node].rate_hz", "number", "", "Hz", 0, 1e6, true, "", "frames; above what the bus carries it always has one ready"},
    Key{"effects[babbling_node].from", "number", "0.0", "s", -1e6, 1e6, false, "", "begin; before 0: while arming as well"},
    Key{"effects[babbling_node].to", "number", "1e6", "s", -1e6, 1e6, false, "", "end"},
    Key{"effects[bus_off].at", "number", "", "s", 0, 1e6, false, "", "when the node's CAN controller gives up"},
    Key{"effects[bus_off].drive", "integer", "0", "", 0, 4, false, "", "whose: 1 for the first entry of [drives], ...; 0: the controller's"},
    Key{"effects[bus_off].restart", "boolean", "false", "", -inf, inf, false, "", "it comes back after 128 times 11 recessive bits"},
    Key{"effects[drive_dropout].drive", "integer", "", "", 1, 4, false, "", "entry of [drives] that is cut off from the bus, from 1"},
    Key{"effects[drive_dropout].from", "number", "0.0", "s", -1e6, 1e6, false, "", "begin; before 0: while arming as well"},
    Key{"effects[drive_dropout].to", "number", "1e6", "s", -1e6, 1e6, false, "", "end"},
    Key{"effects[encoder].bits", "integer", "", "", 4, 32, false, "", "resolution: 2^bits counts per turn of the motor"},
    Key{"effects[encoder].bandwidth", "number", "1000.0", "rad/s", 1, 1e5, false, "", "of the drive's position and velocity observer"},
    Key{"effects[torque_saturation].limit", "number", "", "N m", 0, big, true, "", "largest torque at the joint that a drive delivers"},
};
// clang-format on

/// Edit distance, where a swap of two neighbours counts once.
std::size_t distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> before(b.size() + 1), now(b.size() + 1), next(b.size() + 1);
  std::iota(now.begin(), now.end(), 0U);
  for (std::size_t i = 1; i <= a.size(); ++i) {
    next[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      next[j] = std::min({now[j] + 1, next[j - 1] + 1, now[j - 1] + (a[i - 1] == b[j - 1] ? 0U : 1U)});
      const bool swapped = i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1];
      if (swapped) next[j] = std::min(next[j], before[j - 2] + 1);
    }
    before = now;
    now = next;
  }
  return now[b.size()];
}

}  // namespace

std::string nearest(std::string_view word, const std::vector<std::string>& known) {
  const std::string* best = nullptr;
  std::size_t least = 3;
  for (const std::string& k : known) {
    const std::size_t d = distance(word, k);
    if (d < least && d < k.size()) {
      least = d;
      best = &k;
    }
  }
  return best != nullptr ? *best : std::string();
}

std::span<const Key> scene_keys() { return keys; }

const Key& find_key(std::string_view path, std::span<const Key> among) {
  for (const Key& k : among) {
    if (k.path == path) return k;
  }
  throw std::logic_error("no entry in the key table: " + std::string(path));
}

std::string allowed(const Key& k) {
  std::string out;
  if (!k.choices.empty()) {
    out = fmt::format("{}one of: {}", k.kind == "strings" ? "array of strings, each " : "", k.choices);
  } else {
    out = fmt::format("{}", k.kind);
    const bool low = std::isfinite(k.low), high = std::isfinite(k.high);
    if (low && high) {
      out += k.low_open ? fmt::format(" > {} and <= {}", k.low, k.high)
                        : fmt::format(" from {} to {}", k.low, k.high);
    } else if (low) {
      out += fmt::format(" {} {}", k.low_open ? ">" : ">=", k.low);
    }
  }
  if (!k.unit.empty()) out += fmt::format(", {}", k.unit);
  return out;
}

std::string wanted(const Key& k) {
  std::string out = allowed(k);
  if (!k.choices.empty()) return out;
  if (k.kind.find("{position, angle}") != std::string_view::npos) {
    // The bounds hold for each of the two values.
    return "a number, or a table {position, angle} of numbers," + out.substr(k.kind.size()) +
           (k.kind.ends_with("\"robust\"") ? "; or \"robust\"" : "");
  }
  const bool plural = k.kind.ends_with('s') && k.kind.find(" or ") == std::string_view::npos;
  return plural ? out : (k.kind.starts_with("integer") ? "an " : "a ") + out;
}

std::string keys_markdown(std::span<const Key> of) {
  std::string out = "| key | allowed | default | meaning |\n|---|---|---|---|\n";
  for (const Key& k : of) {
    std::string range = allowed(k), fallback(k.fallback);
    for (std::size_t at = 0; (at = range.find(" | ", at)) != std::string::npos;) range.erase(at, 1)[at] = ',';
    if (fallback.empty()) fallback = "required";
    if (fallback == "-") fallback = "optional";
    out += fmt::format("| `{}` | {} | {} | {} |\n", k.path, range, fallback, k.meaning);
  }
  return out;
}

}  // namespace esmc::host
