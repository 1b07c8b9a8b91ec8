#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iostream>
#include <sstream>

#include "host_sim/bus/open_bus.hpp"
#include "host_sim/calibrate/calibrate.hpp"
#include "host_sim/campaign/campaign.hpp"
#include "host_sim/check/check.hpp"
#include "host_sim/cli/bake.hpp"
#include "host_sim/cli/export.hpp"
#include "host_sim/error.hpp"
#include "host_sim/identify/identify.hpp"
#include "host_sim/live/live.hpp"
#include "host_sim/loop/drive.hpp"
#include "host_sim/loop/replay.hpp"
#include "host_sim/loop/run.hpp"
#include "host_sim/scene/keys.hpp"
#include "host_sim/scene/starting_scene.hpp"
#include "host_sim/spatial/spatial.hpp"
#include "host_sim/studies/accuracy.hpp"
#include "host_sim/studies/design_report.hpp"
#include "host_sim/studies/eval.hpp"
#include "host_sim/sweep/sweep.hpp"
#include "host_sim/version.hpp"

namespace esmc::host {
namespace {

constexpr int exit_failed_run = 1;
constexpr int exit_bad_input = 2;

extern "C" void request_stop(int) { stop_requested() = true; }

/// For commands whose loops ask stop_requested(); the others end by the signal itself.
void handle_signals() {
  std::signal(SIGINT, request_stop);
  std::signal(SIGTERM, request_stop);
}

/// No file or socket may become the standard output that a caller has closed: there, writing must fail.
void occupy_standard_streams() {
  for (const int fd : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO}) {
    if (::fcntl(fd, F_GETFD) == -1 && ::open("/dev/null", O_RDONLY) != fd) return;  // NOLINT(*-vararg)
  }
}

void flush_standard_output() {
  errno = 0;
  if (std::fflush(stdout) == 0 && std::ferror(stdout) == 0) return;
  const std::string why = errno != 0 ? std::string(": ") + std::strerror(errno) : "";
  throw RunError("standard output could not be written" + why);
}

std::string read_all(const std::string& file) {
  std::ostringstream text;
  if (file == "-") {
    text << std::cin.rdbuf();
  } else {
    std::ifstream in(file, std::ios::binary);
    if (!in || std::filesystem::is_directory(file)) throw InputError("", file + ": cannot be read");
    text << in.rdbuf();
  }
  return text.str();
}

int run_eval(const std::string& file, const std::string& scalar) {
  const auto type = scalar == "float" ? ScalarType::single_precision : ScalarType::double_precision;
  const auto result = evaluate(read_all(file), file == "-" ? "stdin" : file, type);
  fmt::print("{}\n", result);
  return 0;
}

std::string joined(int argc, char** argv) {
  std::string out = argc > 0 ? argv[0] : "esmc";
  for (int i = 1; i < argc; ++i) {
    const std::string a = argv[i];
    const bool plain = a.find_first_of(" \"'[]{}*?$") == std::string::npos;
    out += " " + (plain ? a : "'" + a + "'");
  }
  return out;
}

std::uint64_t read_integer(const std::string& text, const std::string& option = "--seed") {
  std::uint64_t seed = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), seed);
  if (error != std::errc() || end != text.data() + text.size())
    throw InputError("", option + " " + text + ": an integer from 0 to 18446744073709551615 is needed");
  return seed;
}

/// --set, of everything that reads a scene.
void add_sets(CLI::App& c, std::vector<std::string>& sets) {
  c.add_option("--set", sets, "section.key=value instead of what the scene says; may be repeated")
      ->type_name("KEY=VALUE")
      ->expected(1)
      ->take_all();
}

/// And the other options of most of them.
void add_scene_options(CLI::App& c, RunOptions& o, const std::string& files) {
  c.add_option("SCENE", o.scene, "scene file (TOML)")->required();
  add_sets(c, o.sets);
  c.add_option("--out", o.out, "directory for " + files)->type_name("DIR");
  c.add_flag("--json", o.json, "print the result as one JSON document");
}
void add_run_options(CLI::App& c, RunOptions& o) {
  add_scene_options(c, o, "scene.toml, summary.json, log.csv, report.html");
  c.add_option_function<std::string>(
       "--seed", [&o](const std::string& text) { o.seed = read_integer(text); },
       "of the effects noise and jitter; the same seed gives the same run")
      ->type_name("UINT")
      ->default_str("1");
}
void add_scalar_option(CLI::App& c, RunOptions& o) {
  c.add_option_function<std::string>(
       "--scalar", [&o](const std::string& s) { o.single_precision = s == "float"; },
       "double | float: of the controller; float is what a board without double computes")
      ->check(CLI::IsMember({"double", "float"}))
      ->default_str("double");
}
void add_bus_options(CLI::App& c, RunOptions& o, bool required) {
  if (required) {
    c.add_option("--bus", o.bus, bus_forms)->required();
  } else {
    c.add_option("--bus", o.bus, "virtual | socketcan:INTERFACE | slcan:PLANT,CONTROLLER")
        ->capture_default_str();
  }
  c.add_flag("--realtime", o.realtime, "wall-clock ticks instead of lockstep");
}

void add_drive_options(CLI::App& c, DriveOptions& d) {
  c.add_option("--protocol", d.protocol, "odrive | odrive_0.5 | cia402 | mit")
      ->required()
      ->check(CLI::IsMember({"odrive", "odrive_0.5", "cia402", "mit"}));
  c.add_option("--bus", d.bus, bus_forms)->required();
  c.add_option("--bitrate", d.bit_rate, "told to an slcan adapter, bit/s")->capture_default_str();
  c.add_option("--node", d.node, "of the drive")->capture_default_str();
  c.add_option("--duration", d.duration, "s; else until Ctrl-C");
  c.add_option("--inertia", d.shaft.inertia, "of the shaft, kg m2")->capture_default_str();
  c.add_option("--friction", d.shaft.friction, "viscous, N m s/rad")->capture_default_str();
  c.add_option("--load", d.shaft.load, "torque against the positive direction, N m")->capture_default_str();
  c.add_option("--angle", d.shaft.angle, "of the shaft at the start, rad")->capture_default_str();
  c.add_option("--rate", d.rate_hz, "samples and steps of the shaft, Hz")->capture_default_str();
  c.add_option("--watchdog", d.watchdog, "the drive's time-out, s (cia402: object 1016 says it)")
      ->capture_default_str();
  c.add_option("--defect", d.defects, "what the drive does wrong, see below; may be repeated")
      ->type_name("NAME")
      ->expected(1)
      ->take_all();
  c.add_option("--dialect", d.dialect, "mit: mini_cheetah | cubemars | damiao")
      ->check(CLI::IsMember({"mini_cheetah", "cubemars", "damiao"}))
      ->capture_default_str();
  c.add_option("--master-id", d.master_id, "mit: identifier of the replies")->capture_default_str();
  c.add_option("--position-range", d.position_range, "mit: half width of the field, rad")
      ->capture_default_str();
  c.add_option("--velocity-range", d.velocity_range, "mit: likewise, rad/s")->capture_default_str();
  c.add_option("--torque-range", d.torque_range, "mit: likewise, N m")->capture_default_str();
  c.add_option("--rated-torque", d.rated_torque, "cia402: N m")->capture_default_str();
  c.add_flag("--json", d.json, "print the summary as one JSON document, and nothing else");
  c.footer(defects_text());
}

void add_campaign(CLI::App& app, CampaignOptions& o, const std::function<void()>& run) {
  auto* c = app.add_subcommand(
      "campaign",
      "faults on a virtual bus, episode after episode, each judged against the invariants of safety");
  c->add_option("SCENE", o.scene, "scene file (TOML); without it, variants of the five-bar on a circle");
  add_sets(*c, o.sets);
  c->add_option_function<std::string>(
       "--episodes", [&o](const std::string& text) { o.episodes = read_integer(text, "--episodes"); },
       "how many")
      ->check(CLI::Range(std::uint64_t{1}, std::uint64_t{1} << 62U))
      ->type_name("UINT")
      ->default_str("10000");
  c->add_option_function<std::string>(
       "--seed", [&o](const std::string& text) { o.seed = read_integer(text); },
       "of the first episode; the next one has the next")
      ->type_name("UINT")
      ->default_str("1");
  c->add_option("--jobs", o.jobs, "threads; the result does not depend on it; default: as many as processors")
      ->check(CLI::Range(1, 1024));
  c->add_option("--protocol", o.protocol, "instead of the scene's drives.protocol");
  c->add_option("--fault", o.fault, "this fault alone; nothing where it is not possible")->type_name("NAME");
  c->add_option_function<std::string>(
       "--replay", [&o](const std::string& text) { o.replay = read_integer(text, "--replay"); },
       "run the episode of this seed alone, twice, and print its ticks")
      ->type_name("SEED");
  c->add_option(
       "--out", o.out,
       "directory for campaign.json, campaign.md, report.html; with --replay episode.json, episode.txt")
      ->type_name("DIR");
  c->add_flag("--json", o.json, "print the result as one JSON document");
  c->callback(run);
}

void add_sweep(CLI::App& app, SweepOptions& o, const std::function<void()>& run) {
  auto* c = app.add_subcommand(
      "sweep", "parameters, gains and uncertainties: many runs of one scene over all cores, or under mpirun");
  c->add_option("SPEC", o.spec, "what to vary and what to judge by (TOML), see docs/sweep.md")->required();
  c->add_option("--jobs", o.jobs, "threads of each process; default: all processors, under mpirun one")
      ->check(CLI::Range(1, 1024));
  c->add_option(
       "--out", o.out,
       "directory for cases.csv, summary.json, report.html, timing.json; an unfinished sweep there goes on")
      ->type_name("DIR");
  c->add_flag("--restart", o.restart, "throw away what an unfinished sweep has left in DIR");
  c->add_flag("--scalar", o.scalar, "no SIMD lanes: slower, the same numbers");
  c->add_flag("--json", o.json, "print the summary as one JSON document");
  c->callback(run);
}

void add_design(CLI::App& app, DesignOptions& o, const std::function<void()>& run) {
  auto* c = app.add_subcommand(
      "design", "switching gains from stated uncertainty: per channel, with what they promise and cost");
  c->add_option("SCENE", o.run.scene,
                "scene file (TOML) with a table [uncertainty], see docs/robust-design.md")
      ->required();
  add_sets(*c, o.run.sets);
  c->add_flag("--workspace", o.workspace,
              "for every place of the workspace, at the speed and acceleration of the reference");
  c->add_option("--simulate", o.simulate,
                "plants out of the intervals to run as `esmc sim` does, with these gains")
      ->check(CLI::Range(std::uint64_t{1}, std::uint64_t{1'000'000}))
      ->type_name("UINT");
  c->add_option_function<std::string>(
       "--seed", [&o](const std::string& text) { o.run.seed = read_integer(text); },
       "of the simulated plants")
      ->type_name("UINT")
      ->default_str("1");
  c->add_flag("--json", o.run.json, "print the result as one JSON document");
  c->callback(run);
}

void add_live(CLI::App& app, LiveOptions& o, const std::function<void()>& run) {
  auto* c = app.add_subcommand(
      "live", "a bench in the browser: the running loop, drawn; pull at it, change it, break it");
  c->add_option("SCENE", o.run.scene, "scene file (TOML)")->required();
  c->add_option("--set", o.run.sets, "section.key=value instead of what the scene says; may be repeated")
      ->type_name("KEY=VALUE")
      ->expected(1)
      ->take_all();
  c->add_option_function<std::string>(
       "--seed", [&o](const std::string& text) { o.run.seed = read_integer(text); },
       "of the effects noise and jitter")
      ->type_name("UINT")
      ->default_str("1");
  c->add_option("--port", o.port, "on 127.0.0.1; 0: one that is free")
      ->check(CLI::Range(0, 65535))
      ->capture_default_str();
  c->add_option("--duration", o.duration, "s; else until Ctrl-C")->check([](const std::string& text) {
    char* end = nullptr;
    const double v = std::strtod(text.c_str(), &end);
    return *end == '\0' && std::isfinite(v) && v > 0.0 ? std::string() : "must be a number > 0, not " + text;
  });
  c->add_option(
       "--bus", o.run.bus,
       "virtual | socketcan:INTERFACE | slcan:ENDPOINT; not virtual: for a controller there, in real time")
      ->capture_default_str();
  c->add_flag("--json", o.run.json, "print the summary as one JSON document, and the URL on stderr");
  c->callback(run);
}

/// A number that is finite and > 0.
std::string above_zero(const std::string& text) {
  char* end = nullptr;
  const double v = std::strtod(text.c_str(), &end);
  return !text.empty() && *end == '\0' && std::isfinite(v) && v > 0.0 ? std::string()
                                                                      : "must be a number > 0, not " + text;
}

void add_observer(CLI::App& c, double& bandwidth) {
  c.add_option("--observer-bandwidth", bandwidth,
               "rad/s, of the drives' observers at least: what they may hide goes into the uncertainties; 0: "
               "there are none")
      ->check([](const std::string& text) {
        char* end = nullptr;
        const double v = std::strtod(text.c_str(), &end);
        const bool allowed = v == 0.0 || (v >= 1.0 && v <= 1e6);  // slower ones would hide every motion
        return !text.empty() && *end == '\0' && allowed ? std::string()
                                                        : "must be 0, or 1 to 1e6, not " + text;
      })
      ->capture_default_str();
}

void add_calibrate(CLI::App& app, CalibrateOptions& o, const std::function<void()>& run) {
  auto* c = app.add_subcommand(
      "calibrate",
      "lengths and encoder offsets from the log of a run with redundant encoders, with their uncertainty");
  c->add_option("LOG", o.log, "directory of a run (log.csv, scene.toml), or a log.csv")->required();
  c->add_option("--scene", o.scene, "nominal mechanism; default scene.toml beside the log")
      ->type_name("FILE");
  c->add_option("--half-base", o.half_base, "m, measured: the scale of everything")->check(above_zero);
  c->add_flag("--trust-half-base", o.trust_half_base, "the scene's half_base is right")
      ->excludes("--half-base");
  c->add_option("--effector", o.effector, "CSV t,x,y: measured positions of the effector, s and m")
      ->type_name("FILE");
  c->add_option("--effector-sigma", o.effector_sigma, "standard deviation of each of their coordinates, m")
      ->check(above_zero)
      ->capture_default_str();
  c->add_flag("--free-frame", o.free_frame, "they are in a frame of their own, not in that of the base")
      ->needs("--effector");
  c->add_flag("--keep-nominal", o.keep_nominal,
              "what the log does not determine stays nominal, instead of an error");
  add_observer(*c, o.observer_bandwidth);
  c->add_option("--within", o.within, "relative change of a length beyond which it is another mechanism")
      ->check(above_zero)
      ->capture_default_str();
  c->add_option("--write", o.write, "scene file to write: the nominal one, corrected")->type_name("FILE");
  c->add_flag("--json", o.json, "print the result as one JSON document");
  c->callback(run);
}

void add_identify(CLI::App& app, IdentifyOptions& o, const std::function<void()>& run) {
  auto* c = app.add_subcommand(
      "identify",
      "base inertial parameters, friction and torque delay from the log of a run, with intervals");
  c->add_option("LOG", o.log, "directory of a run (log.csv, scene.toml), or a log.csv")->required();
  c->add_option("--scene", o.scene, "lengths and nominal parameters; default scene.toml beside the log")
      ->type_name("FILE");
  c->add_option("--window", o.window, "s under which the equations are taken")
      ->check(above_zero)
      ->capture_default_str();
  add_observer(*c, o.observer_bandwidth);
  c->add_option("--coverage", o.coverage, "half width of the intervals, in standard uncertainties")
      ->check(above_zero)
      ->capture_default_str();
  c->add_flag("--json", o.json, "print the result as one JSON document");
  c->callback(run);
}

/// The first word after the program must be a subcommand or an option.
void require_subcommand(const CLI::App& app, int argc, char** argv) {
  if (argc < 2 || argv[1][0] == '-') return;
  const std::string word = argv[1];
  std::vector<std::string> known;
  for (const CLI::App* sub : app.get_subcommands(nullptr)) known.push_back(sub->get_name());
  if (std::find(known.begin(), known.end(), word) != known.end()) return;
  const std::string close = nearest(word, known);
  throw InputError("", "unknown subcommand '" + word + "'; " +
                           (close.empty() ? "" : "did you mean " + close + "? ") + "see esmc --help");
}

/// What is wrong with the arguments, in the words of this program.
std::string argument_error(const CLI::App& app, const CLI::ParseError& e, int argc, char** argv) {
  const auto chosen = app.get_subcommands();
  if (chosen.empty()) return std::string(e.what()) + "; see esmc --help";
  const CLI::App& sub = *chosen.front();
  const std::string help = "; see esmc " + sub.get_name() + " --help";
  if (dynamic_cast<const CLI::ExtrasError*>(&e) == nullptr) return e.what() + help;
  for (int i = 2; i < argc; ++i) {
    const std::string option = std::string(argv[i]).substr(0, std::string(argv[i]).find('='));
    if (option.starts_with("-") && sub.get_option_no_throw(option) == nullptr) {
      return sub.get_name() + " has no " + option + help;
    }
  }
  const auto rest = sub.remaining();
  return (rest.empty() ? std::string(e.what())
                       : sub.get_name() + " takes no further argument '" + rest.front() + "'") +
         help;
}

int run(int argc, char** argv) {
  CLI::App app{"Extended sliding-mode control of the RR arm and the 5R five-bar over CAN"};
  app.name("esmc");
  app.set_version_flag("--version", version);
  app.require_subcommand(1);
  RunOptions o;
  o.command_line = joined(argc, argv);
  int status = 0;

  std::string kind;
  auto* init = app.add_subcommand("init", "print a commented scene to start from");
  init->add_option("MECHANISM", kind, "five_bar | rr")->required()->check(CLI::IsMember({"five_bar", "rr"}));
  init->callback([&] { fmt::print("{}", starting_scene(kind)); });

  std::string file = "-", scalar = "double";
  auto* eval = app.add_subcommand("eval", "evaluate model and laws at given states (JSON in, JSON out)");
  eval->add_option("FILE", file, "cases in the schema of tests/reference; - is stdin")->capture_default_str();
  eval->add_option("--scalar", scalar, "double | float")
      ->check(CLI::IsMember({"double", "float"}))
      ->capture_default_str();
  eval->callback([&] { status = run_eval(file, scalar); });

  auto* sim = app.add_subcommand("sim", "closed loop in one process, torque applied directly");
  add_run_options(*sim, o);
  sim->callback([&] {
    handle_signals();
    status = run_sim(o);
  });

  auto* hil = app.add_subcommand(
      "hil", "the loop through real CAN frames: controller on one node, drives and plant on the other");
  add_run_options(*hil, o);
  add_bus_options(*hil, o, false);
  add_scalar_option(*hil, o);
  hil->callback([&] {
    handle_signals();
    status = run_hil(o);
  });

  auto* plant =
      app.add_subcommand("plant", "the drives' and the mechanism's half of hil, as a process of its own");
  add_run_options(*plant, o);
  add_bus_options(*plant, o, true);
  plant->callback([&] {
    handle_signals();
    status = run_plant(o);
  });

  auto* controller =
      app.add_subcommand("controller", "the controller's half of hil, as a process of its own");
  add_run_options(*controller, o);
  add_bus_options(*controller, o, true);
  controller->add_flag("--observe", o.observe,
                       "listen only: show joints, effector, modes and ages; nothing is sent, nothing armed");
  controller->callback([&] {
    handle_signals();
    status = run_controller(o);
  });

  ReplayOptions p;
  auto* replay = app.add_subcommand(
      "replay", "a recorded run again, from its scene, seed and frames: is it equal to the last bit?");
  replay->add_option("DIR", p.directory, "what sim, hil, plant or controller has left with --out")
      ->required();
  replay->add_flag("--any-version", p.any_version, "also where another version of esmc has recorded");
  replay->add_flag("--json", p.json, "print the result as one JSON document");
  replay->callback([&] {
    handle_signals();
    status = run_replay(p);
  });

  DriveOptions d;
  auto* drive = app.add_subcommand(
      "drive", "an emulated drive alone on a CAN interface, with a shaft of its own, in real time");
  add_drive_options(*drive, d);
  drive->callback([&] {
    handle_signals();
    status = run_drive(d);
  });

  auto* check = app.add_subcommand("check",
                                   "check a scene without running it: reach, singularity and torque margins, "
                                   "gains against delays, bus load");
  add_scene_options(*check, o, "scene.toml and check.csv: the torques along the reference");
  check->callback([&] {
    handle_signals();
    status = run_check(o);
  });

  AccuracyOptions a;
  auto* bake = app.add_subcommand(
      "bake", "a scene as the constants of a board's image (C++); what check refuses is refused");
  bake->add_option("SCENE", o.scene, "scene file (TOML)")->required();
  add_sets(*bake, o.sets);
  bake->add_option("--out", o.out, "file to write instead of printing")->type_name("FILE");
  bake->add_option_function<std::string>(
          "--scalar", [&o](const std::string& t) { o.single_precision = t == "float"; },
          "double | float: of the controller")
      ->check(CLI::IsMember({"double", "float"}))
      ->default_str("double");
  bake->add_flag("--realtime", o.realtime,
                 "ticks by the board's clock, for real drives; else lockstep with esmc plant");
  bake->callback([&] { status = run_bake(o); });

  std::string format;
  auto* to = app.add_subcommand(
      "export", "the scene's mechanism for other programs: MJCF, its loop closed, or URDF, its loop cut");
  to->add_option("SCENE", o.scene, "scene file (TOML)")->required();
  to->add_option("--format", format, "mjcf | urdf")->required()->check(CLI::IsMember({"mjcf", "urdf"}));
  add_sets(*to, o.sets);
  to->add_option("--out", o.out, "file to write instead of printing")->type_name("FILE");
  to->callback([&] { status = run_export(o, format); });

  auto* accuracy =
      app.add_subcommand("accuracy", "what accuracy costs in time: integrators, tick rate, sensors, effects");
  accuracy->add_flag("--quick", a.quick, "a minute instead of several");
  accuracy->add_option("--out", a.out, "directory for CSV, JSON, Markdown tables and report.html")
      ->type_name("DIR");
  accuracy->add_flag("--json", a.json, "print the study as one JSON document");
  accuracy->callback([&] {
    a.command_line = o.command_line;
    status = run_accuracy(a);
  });

  CampaignOptions f;
  add_campaign(app, f, [&] {
    handle_signals();
    f.command_line = o.command_line;
    status = run_campaign(f);
  });

  DesignOptions design;
  add_design(app, design, [&] {
    handle_signals();
    status = run_design(design);
  });

  SweepOptions w;
  add_sweep(app, w, [&] {
    handle_signals();
    w.command_line = o.command_line;
    status = run_sweep(w);
  });

  CalibrateOptions calibrate;
  add_calibrate(app, calibrate, [&] { status = run_calibrate(calibrate); });

  IdentifyOptions n;
  add_identify(app, n, [&] { status = run_identify(n); });

  LiveOptions l;
  add_live(app, l, [&] {
    handle_signals();
    l.run.command_line = o.command_line;
    status = run_live(l);
  });

  auto* spatial = app.add_subcommand(
      "spatial",
      "closed loop in space, orientation by unit quaternion: a free body, or a platform on six legs");
  add_scene_options(*spatial, o, "scene.toml, summary.json, log.csv");
  spatial
      ->add_option_function<std::string>(
          "--seed", [&o](const std::string& text) { o.seed = read_integer(text); },
          "of the noise in [measurement]")
      ->type_name("UINT")
      ->default_str("1");
  add_scalar_option(*spatial, o);
  spatial->callback([&] {
    handle_signals();
    status = run_spatial(o);
  });

  std::string of = "scene";
  auto* keys = app.add_subcommand("keys", "print the table of scene keys (Markdown)");
  keys->add_option("OF", of, "scene | spatial")
      ->check(CLI::IsMember({"scene", "spatial"}))
      ->capture_default_str();
  keys->callback([&] { fmt::print("{}", keys_markdown(of == "spatial" ? spatial_keys() : scene_keys())); });

  require_subcommand(app, argc, argv);
  try {
    app.parse(argc, argv);
  } catch (const CLI::Success& e) {  // --help, --version
    std::ostringstream text;
    status = app.exit(e, text, text);
    fmt::print("{}", text.str());
  } catch (const CLI::ParseError& e) {
    throw InputError("", argument_error(app, e, argc, argv));
  }
  flush_standard_output();
  return status;
}

}  // namespace
}  // namespace esmc::host

int main(int argc, char** argv) {
  esmc::host::occupy_standard_streams();
  const auto say = [](const char* what) {
    std::string line = what;  // one line, whatever a library put into it
    for (char& c : line) c = c == '\n' || c == '\r' ? ' ' : c;
    std::cerr << "esmc: " << esmc::host::printable(line) << "\n";
  };
  try {
    return esmc::host::run(argc, argv);
  } catch (const esmc::host::InputError& e) {
    say(e.what());
    return esmc::host::exit_bad_input;
  } catch (const std::exception& e) {
    say(e.what());
    return esmc::host::exit_failed_run;
  }
}
