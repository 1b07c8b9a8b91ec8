#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <sstream>

#include "host_sim/bus/host_bus.hpp"
#include "host_sim/calibrate/calibrate.hpp"
#include "host_sim/campaign/campaign.hpp"
#include "host_sim/check/check.hpp"
#include "host_sim/cli/options.hpp"
#include "host_sim/controller/axes_config.hpp"
#include "host_sim/controller/bake.hpp"
#include "host_sim/controller/board_costs.hpp"
#include "host_sim/export/export.hpp"
#include "host_sim/identify/identify.hpp"
#include "host_sim/live/live_api.hpp"
#include "host_sim/loop/run.hpp"
#include "host_sim/operate/operate.hpp"
#include "host_sim/record/compare.hpp"
#include "host_sim/record/output.hpp"
#include "host_sim/scene/edit.hpp"
#include "host_sim/scene/key.hpp"
#include "host_sim/scene/names.hpp"
#include "host_sim/scene/scene.hpp"
#include "host_sim/spatial/spatial.hpp"
#include "host_sim/studies/studies.hpp"
#include "host_sim/sweep/sweep.hpp"

namespace esmc::host {
namespace {

using SceneCommand = std::pair<CLI::App&, RunOptions&>;

/// Adds a command of a scene that leaves `files` in --out.
SceneCommand add_scene_command(Program& p, const char* name, const char* description,
                               int (*run)(const RunOptions&), const char* files,
                               Signals signals = Signals::request_stop) {
  const SceneCommand added = add(p, name, description, run, signals);
  const auto& [c, o] = added;
  add_scene(c, o);
  add_out(c, o.out, files);
  add_json(c, o.json);
  return added;
}
void add_mcap(CLI::App& c, std::string& file) {
  c.add_option("--mcap", file, "file for the log and the CAN frames as MCAP, for Foxglove and the like")
      ->type_name("FILE");
}
/// Adds a command that runs a scene and leaves a log.
SceneCommand add_run(Program& p, const char* name, const char* description, int (*run)(const RunOptions&)) {
  const SceneCommand added =
      add_scene_command(p, name, description, run, "scene.toml, summary.json, log.csv, report.html");
  const auto& [c, o] = added;
  add_seed(c, o.seed, "of the random effects; the same seed gives the same run");
  c.add_option_function<std::string>(
       "--log", [&npy = o.log.npy](const std::string& s) { npy = s == "npy"; },
       "csv | npy: log.npy, which numpy.load reads, in the place of log.csv")
      ->check(CLI::IsMember({"csv", "npy"}))
      ->default_str("csv");
  c.add_option("--log-every", o.log.every, "a row of the log at every so many ticks")
      ->check(CLI::Range(1, 1'000'000'000))
      ->capture_default_str();
  add_mcap(c, o.mcap);
  return added;
}
void add_bus(CLI::App& c, RunOptions& o) {
  c.add_option("--bus", o.bus, bus_forms)->required();
  c.add_flag("--realtime", o.realtime, "wall-clock ticks instead of lockstep");
}

struct EvalOptions {
  std::string file = "-";
  bool single_precision = false;
};
struct ExportOptions {
  RunOptions run;
  std::string format;
};
struct BakeOptions {
  RunOptions run;
  std::string board;      ///< name in board_costs.hpp; empty: no budget is checked
  bool lockstep = false;  ///< also where a console arms
};
using Word = std::string;  // the one argument of a command without options

int run_init(const Word& mechanism) {
  fmt::print("{}", starting_scene(mechanism));
  return 0;
}

int run_eval(const EvalOptions& o) {
  std::ostringstream text;
  if (o.file == "-") {
    text << std::cin.rdbuf();
  } else {
    std::ifstream in(o.file, std::ios::binary);
    if (!in || std::filesystem::is_directory(o.file)) throw InputError("", o.file + ": cannot be read");
    text << in.rdbuf();
  }
  fmt::print("{}", evaluate(text.str(), o.file == "-" ? "stdin" : o.file, o.single_precision));
  return 0;
}

int run_export(const ExportOptions& o) {
  const Scene scene = read_scene(o.run.scene, o.run.sets);
  refuse_overwrite("--out", o.run.out, files_of(scene));
  print_or_write(o.format == "urdf" ? urdf(scene) : mjcf(scene), o.run.out);
  return 0;
}

int run_keys(const Word& of) {
  fmt::print("{}", keys_markdown(of == "spatial" ? spatial_keys() : scene_keys()));
  return 0;
}

struct CompletionOptions {
  std::string name;
  const CLI::App* app = nullptr;
};

/// Bash takes the words of a command, and of an option's value, from one table: what --help shows, and the
/// keys of scenes.
int run_completion(const CompletionOptions& o) {
  std::vector<std::string> commands, keys;
  std::string words;
  for (const CLI::App* c : o.app->get_subcommands([](const CLI::App*) { return true; })) {
    commands.push_back(c->get_name());
    std::vector<std::string> options;
    for (const CLI::Option* option : c->get_options()) {
      const std::string type = option->get_type_name(), name = option->get_name();
      const std::size_t open = type.find('{');  // the words that an option takes
      if (!option->get_positional()) options.push_back(name.substr(name.rfind(',') + 1));
      if (open == std::string::npos) continue;
      std::string values = type.substr(open + 1, type.find('}') - open - 1);
      std::ranges::replace(values, ',', ' ');
      words += fmt::format("  [{},{}]='{}'\n", c->get_name(), option->get_positional() ? "" : options.back(),
                           values);
    }
    words += fmt::format("  [{}]='{}'\n", c->get_name(), fmt::join(options, " "));
  }
  for (const Key& k : scene_keys()) {
    if (k.path.find('[') == std::string::npos) keys.push_back(fmt::format("{}=", k.path));
  }
  fmt::print(R"(# Completion of esmc for bash; written by `esmc completion bash`.
declare -gA _esmc_words=(
{}  [help]='{}'
)
_esmc_keys='{}'
_esmc() {{
  local word=${{COMP_WORDS[COMP_CWORD]}} before=${{COMP_WORDS[COMP_CWORD-1]}} command=${{COMP_WORDS[1]}} list
  COMPREPLY=()
  if [[ $COMP_CWORD == 1 ]]; then
    list="{} help --help --version"
  elif [[ $before == --set ]]; then
    list=$_esmc_keys
    compopt -o nospace
  elif [[ ${{_esmc_words[$command,$before]}} ]]; then
    list=${{_esmc_words[$command,$before]}}
  elif [[ $word == -* || $command == help ]]; then
    list=${{_esmc_words[$command]}}
  else
    list=${{_esmc_words[$command,]}}
  fi
  mapfile -t COMPREPLY < <(compgen -W "$list" -- "$word")
}}
complete -o default -F _esmc esmc
)",
             words, fmt::join(commands, " "), fmt::join(keys, " "), fmt::join(commands, " "));
  return 0;
}

/// Throws InputError unless the scene stays within 60 % of the tick and of each memory of o.board and has
/// its scalar type. The caller checks that o.board is a name in `boards`: neither empty nor unknown.
void require_budget(const Scene& scene, const BakeOptions& o) {
  const Board* board = std::ranges::find(boards, o.board, [](const Board& b) { return std::string(b.name); });
  if (board->single_precision != o.run.single_precision)
    throw InputError("", o.board + " needs --scalar " + (board->single_precision ? "float" : "double"));
  if (const std::string excess = budget_excess(scene, *board); !excess.empty())
    throw InputError(scene.control_where, excess);
}

/// Refuses a scene that `esmc check` refuses, that a bus cannot run, or that exceeds the budget of the board.
int run_bake(const BakeOptions& o) {
  Scene scene = read_loop_scene(o.run);
  refuse_overwrite("--out", o.run.out, files_of(scene));
  scene.hardware = o.run.realtime;
  const bool observes = o.run.realtime && armed_by_link(scene) && !scene.drives.confirmed.value_or(false);
  if (!observes) require_confirmed(scene);
  if (armed_by_link(scene) && !o.run.realtime && !o.lockstep) {
    throw InputError(
        scene.control_where,
        "command.arm = \"link\" needs --realtime: in lockstep no console arms the image, unless it "
        "is an emulated one (--lockstep) beside a plant in real time");
  }
  if (!o.board.empty()) require_budget(scene, o);
  if (const std::string why = refusal_of(scene); !why.empty())
    throw InputError("", o.run.scene + ": esmc check refuses it: " + why);
  if (observes) {
    fmt::print(
        stderr,
        "esmc: {}: an image that observes and does not arm (drives_not_confirmed) until 'drives.confirmed' "
        "is true; set it after checking: {}\n",
        o.run.scene, to_confirm(scene));
  }
  const Pacing pacing = o.run.realtime ? Pacing::realtime : Pacing::lockstep;
  print_or_write(baked_header(scene, pacing, o.run.single_precision), o.run.out);
  return 0;
}

void add_init_and_eval(Program& p) {
  const auto [init, mechanism] =
      add(p, "init", "print a commented scene to start from", run_init, Signals::end);
  init.add_option("MECHANISM", mechanism, "five_bar | rr")
      ->required()
      ->check(one_of(names_of<MechanismType>));

  const auto [eval, eval_options] =
      add(p, "eval", "evaluate model and laws at given states (JSON in, JSON out)", run_eval, Signals::end);
  eval.add_option("FILE", eval_options.file, "cases in the schema of tests/reference; - is stdin")
      ->capture_default_str();
  add_scalar(eval, eval_options.single_precision, "");
}

constexpr const char* of_controller = ": of the controller; float is what a board without double computes";

void add_loops(Program& p) {
  (void)add_run(p, "sim", "closed loop in one process, torque applied directly", run_sim);

  const auto [hil, hil_options] = add_run(
      p, "hil", "the loop through real CAN frames: controller on one node, drives and plant on the other",
      run_hil);
  hil.add_option("--bus", hil_options.bus, "virtual | socketcan:INTERFACE | slcan:PLANT,CONTROLLER")
      ->capture_default_str();
  hil.add_flag("--realtime", hil_options.realtime, "wall-clock ticks instead of lockstep");
  add_scalar(hil, hil_options.single_precision, of_controller);

  const auto [plant, plant_options] =
      add_run(p, "plant", "the drives' and the mechanism's end of hil, as a process of its own", run_plant);
  add_bus(plant, plant_options);

  const auto [controller, controller_options] =
      add_run(p, "controller", "the controller's end of hil, as a process of its own", run_controller);
  add_bus(controller, controller_options);
  controller.add_flag("--observe", controller_options.observe,
                      "listen only: show joints, effector, modes and ages; send nothing and arm nothing");

  const auto [replay, replay_options] =
      add(p, "replay", "repeat a recorded run from its scene, seed and frames, and compare every bit",
          run_replay);
  replay.add_option("DIR", replay_options.directory, "what sim, hil, plant or controller left with --out")
      ->required();
  replay.add_flag("--any-version", replay_options.any_version,
                  "accept recordings of another version of esmc");
  add_json(replay, replay_options.json);
}

void add_drive(Program& p) {
  const auto [c, d] =
      add(p, "drive", "an emulated drive alone on a CAN interface, with a shaft of its own, in real time",
          run_drive);
  c.add_option("--protocol", d.protocol, "odrive | odrive_0.5 | cia402 | mit | moteus")
      ->required()
      ->check(one_of(names_of<Protocol>));
  c.add_option("--bus", d.bus, bus_forms)->required();
  c.add_option("--duration", d.duration, "s; else until Ctrl-C");
  c.add_option("--defect", d.defects, "a defect of the drive, see below; may be repeated")
      ->type_name("NAME")
      ->expected(1)
      ->take_all();
  add_json(c, d.json, "print the summary as one JSON document, and nothing else");
  c.option_defaults()->always_capture_default();
  c.add_option("--bitrate", d.bit_rate, "of an slcan adapter, bit/s");
  c.add_option("--node", d.node, "of the drive");
  c.add_option("--inertia", d.shaft.inertia, "of the shaft, kg m2");
  c.add_option("--friction", d.shaft.friction, "viscous, N m s/rad");
  c.add_option("--load", d.shaft.load, "torque against the positive direction, N m");
  c.add_option("--angle", d.shaft.angle, "of the shaft at the start, rad");
  c.add_option("--rate", d.rate_hz, "samples and steps of the shaft, Hz");
  c.add_option("--watchdog", d.watchdog, "the drive's time-out, s (cia402: object 1016 sets it)");
  c.add_option("--dialect", d.dialect, "mit: mini_cheetah | cubemars | damiao | cubemars_v3")
      ->check(one_of(names_of<drive::mit::Dialect>));
  c.add_option("--master-id", d.master_id, "mit: identifier of the replies");
  c.add_option("--position-range", d.position_range, "mit: half width of the field, rad");
  c.add_option("--velocity-range", d.velocity_range, "mit: likewise, rad/s");
  c.add_option("--torque-range", d.torque_range, "mit: likewise, N m");
  c.add_option("--rated-torque", d.rated_torque, "cia402: N m");
  c.footer(defects_text());
}

void add_operate(Program& p) {
  const auto [c, o] =
      add(p, "operate", "a console for a running controller: one command, or a prompt", run_operate);
  c.add_option("BUS", o.bus, std::string(bus_forms) + " | INTERFACE")->required();
  c.add_option("WORDS", o.words,
               "[SCENE] [COMMAND ARGUMENT...]: the controller's scene file, and one of the commands below")
      ->type_name("[SCENE] [COMMAND]");
  add_sets(c, o.sets);
  c.add_option("--bitrate", o.bit_rate, "of an slcan adapter without SCENE, bit/s")->capture_default_str();
  add_json(c, o.json, "print the controller's status as one JSON document, and nothing else");
  add_mcap(c, o.mcap);
  c.add_option("--points", o.points, "file of taught points (default: SCENE with .points.toml)");
  c.add_flag("--page", o.page, "serve the operator's page to browsers on this machine, until Ctrl-C");
  c.add_option("--port", o.port, "of the page, on 127.0.0.1; 0: a free one")->check(CLI::Range(0, 65535));
  c.footer(operate_commands_text());
}

void add_scene_commands(Program& p) {
  (void)add_scene_command(
      p, "check",
      "check a scene: reach, singularity and torque margins, gains against "
      "delays, bus load, and 200 ticks of it simulated",
      run_check, "check.json, report.html, scene.toml, and check.csv: the torques along the reference");
  (void)add_scene_command(
      p, "plan",
      "time the program of a scene: how long it takes, which limits it reaches, its path and torques",
      run_plan, "plan.json, path.csv, report.html, scene.toml", Signals::end);
  (void)add_scene_command(p, "margins",
                          "gain, phase and delay margins of the sampled loop, and its ringing frequency",
                          run_margins, "scene.toml and margins.json");

  const auto [bake, bake_options] = add(
      p, "bake", "a scene as the constants of a board's image (C++); scenes that check refuses are refused",
      run_bake, Signals::end);
  add_scene(bake, bake_options.run);
  add_out_file(bake, bake_options.run.out);
  add_scalar(bake, bake_options.run.single_precision, ": of the controller");
  bake.add_flag("--realtime", bake_options.run.realtime,
                "ticks by the board's clock, for real drives; else lockstep with esmc plant");
  bake.add_flag("--lockstep", bake_options.lockstep,
                "lockstep also where command.arm is \"link\": an emulated board beside esmc plant --realtime")
      ->excludes("--realtime");
  std::vector<std::string> names;
  for (const Board& b : boards) names.emplace_back(b.name);
  bake.add_option("--board", bake_options.board,
                  "refuse what takes more than 60 % of this board's tick or memory: " +
                      fmt::format("{}", fmt::join(names, " | ")))
      ->check(CLI::IsMember(names));

  const auto [c, to] = add(
      p, "export", "the scene's mechanism for other programs: MJCF, its loop closed, or URDF, its loop cut",
      run_export, Signals::end);
  add_scene(c, to.run);
  c.add_option("--format", to.format, "mjcf | urdf")->required()->check(CLI::IsMember({"mjcf", "urdf"}));
  add_out_file(c, to.run.out);
}

void add_accuracy(Program& p) {
  const auto [c, o] =
      add(p, "accuracy",
          "the price list of a scene: what integrators, effects and the loop change and cost, and the "
          "cheapest scene that suffices",
          run_accuracy);
  c.add_option("SCENE", o.scene, "scene file (TOML); without it: reference problems of the integrators");
  add_sets(c, o.sets);
  c.add_option("--of", o.metric, "an error of the summary's tracking, or end: final_state.q; default rms_m")
      ->check(CLI::IsMember({"end", "rms_m", "max_m", "rms_rad", "max_rad", "settled_rms_m", "settled_max_m",
                             "settled_rms_rad", "settled_max_rad"}))
      ->type_name("METRIC");
  c.add_option("--tolerance", o.tolerance,
               "how far the cheapest scene may be off in METRIC, in its unit or as a share of the fullest "
               "scene's: 2%; default 1%")
      ->type_name("X");
  c.add_option_function<std::string>(
       "--effects", [&all = o.all_effects](const std::string& s) { all = s == "all"; },
       "named | all: also those that the scene does not name, with plausible parameters")
      ->check(CLI::IsMember({"all", "named"}))
      ->default_str("named");
  c.add_option("--write", o.write, "file for the cheapest scene")->type_name("FILE");
  c.add_flag("--quick", o.quick, "without SCENE: a third of the time");
  add_out(c, o.out, "JSON and report.html; without SCENE: CSV and Markdown tables as well");
  add_json(c, o.json, "print the study as one JSON document");
}

void add_campaign(Program& p) {
  const auto [c, o] =
      add(p, "campaign",
          "faults on a virtual bus, episode after episode, each checked against the safety invariants",
          run_campaign);
  c.add_option("SCENE", o.scene, "scene file (TOML); default: variants of the five-bar on a circle");
  add_sets(c, o.sets);
  add_integer(c, "--episodes", o.episodes, "number of episodes")
      ->check(CLI::Range(std::uint64_t{1}, std::uint64_t{1} << 62U))
      ->default_str("10000");
  add_seed(c, o.seed, "of the first episode; the next one has the next");
  add_jobs(c, o.jobs, "threads, without effect on the result; default: as many as processors");
  c.add_option("--protocol", o.protocol, "in place of the scene's drives.protocol");
  c.add_option("--fault", o.fault, "only this fault, in episodes where it is possible")->type_name("NAME");
  add_integer(c, "--replay", o.replay, "run only the episode of this seed, twice, and print its ticks")
      ->type_name("SEED")
      ->excludes("--episodes");
  add_out(c, o.out, "campaign.json, campaign.md, report.html; with --replay episode.json, episode.txt");
  add_json(c, o.json);
}

void add_design(Program& p) {
  const auto [c, o] =
      add(p, "design", "switching gains from stated uncertainty: per channel, with their guarantees and cost",
          run_design);
  add_scene(c, o.run, "scene file (TOML) with a table [uncertainty], see docs/robust-design.md");
  c.add_flag("--workspace", o.workspace,
             "for every place of the workspace, at the speed and acceleration of the reference");
  c.add_option("--simulate", o.simulate,
               "number of plants from the intervals to run as `esmc sim` does, with these gains")
      ->check(CLI::Range(std::uint64_t{1}, std::uint64_t{1'000'000}))
      ->type_name("UINT");
  add_seed(c, o.run.seed, "of the simulated plants");
  add_out(c, o.run.out, "design.json, report.html");
  add_json(c, o.run.json);
}

void add_compare(Program& p) {
  const auto [c, o] =
      add(p, "compare", "two runs side by side: scenes, metrics, logs; exit status 1 beyond the tolerance",
          run_compare, Signals::end);
  c.add_option("DIR_A", o.a, "directory of a run (--out)")->required();
  c.add_option("DIR_B", o.b, "directory of another")->required();
  c.add_option("--tolerance", o.tolerance, "times max(1, magnitude): by how much numbers may differ")
      ->check(number("a number >= 0", [](double v) { return v >= 0.0; }))
      ->capture_default_str();
  add_out(c, o.out, "comparison.json, report.html");
  add_json(c, o.json);
}

void add_sweep(Program& p) {
  const auto [c, o] =
      add(p, "sweep",
          "parameters, gains and uncertainties: many runs of one scene over all cores, or under mpirun",
          run_sweep);
  c.add_option("SPEC", o.spec, "parameters to vary and objectives (TOML), see docs/sweep.md")->required();
  add_jobs(c, o.jobs, "threads of each process; default: all processors, under mpirun one");
  add_out(c, o.out,
          "cases.csv, summary.json, report.html, timing.json; an unfinished sweep there is continued");
  c.add_flag("--restart", o.restart, "discard an unfinished sweep in DIR");
  c.add_flag("--scalar", o.scalar, "no SIMD lanes: slower, the same numbers");
  add_json(c, o.json, "print the summary as one JSON document");
}

void add_observer_bandwidth(CLI::App& c, double& bandwidth) {
  // A bandwidth below 1 rad/s would hide every motion.
  c.add_option("--observer-bandwidth", bandwidth,
               "rad/s, the least of the drives' observers: motion that they may hide adds to the "
               "uncertainties; 0: no observers")
      ->check(number("0, or 1 to 1e6", [](double v) { return v == 0.0 || (v >= 1.0 && v <= 1e6); }))
      ->capture_default_str();
}

void add_calibrate(Program& p) {
  const auto [c, o] =
      add(p, "calibrate",
          "lengths and encoder offsets from the log of a run with redundant encoders, with their uncertainty",
          run_calibrate, Signals::end);
  c.add_option("LOG", o.log, "directory of a run (log.csv, scene.toml), or a log.csv")->required();
  c.add_option("--scene", o.scene, "nominal mechanism; default scene.toml beside the log")->type_name("FILE");
  c.add_option("--half-base", o.half_base, "m, measured: the scale of all lengths")->check(above_zero());
  c.add_flag("--trust-half-base", o.trust_half_base, "the scene's half_base is exact")
      ->excludes("--half-base");
  c.add_option("--effector", o.effector, "CSV t,x,y: measured positions of the effector, s and m")
      ->type_name("FILE");
  add_positive(c, "--effector-sigma", o.effector_sigma, "standard deviation of each of their coordinates, m");
  c.add_flag("--free-frame", o.free_frame, "they are in a frame of their own, not in that of the base")
      ->needs("--effector");
  c.add_flag("--keep-nominal", o.keep_nominal,
             "parameters that the log does not determine stay nominal, instead of an error");
  add_observer_bandwidth(c, o.observer_bandwidth);
  add_positive(c, "--within", o.within, "relative change of a length beyond which it is another mechanism");
  c.add_option("--write", o.write, "scene file to write: the nominal one, corrected")->type_name("FILE");
  add_out(c, o.out, "calibration.json, report.html");
  add_json(c, o.json);
}

void add_identify(Program& p) {
  const auto [c, o] =
      add(p, "identify",
          "base inertial parameters, friction and torque delay from the log of a run, with intervals",
          run_identify, Signals::end);
  c.add_option("LOG", o.log, "directory of a run (log.csv, scene.toml), or a log.csv")->required();
  c.add_option("--scene", o.scene, "lengths and nominal parameters; default scene.toml beside the log")
      ->type_name("FILE");
  add_positive(c, "--window", o.window, "s under which the equations are taken");
  add_observer_bandwidth(c, o.observer_bandwidth);
  add_positive(c, "--coverage", o.coverage, "half width of the intervals, in standard uncertainties");
  c.add_option("--write", o.write, "scene file to write: its controller believes what was found")
      ->type_name("FILE");
  add_out(c, o.out, "identification.json, report.html");
  add_json(c, o.json);
}

void add_live(Program& p) {
  const auto [c, o] =
      add(p, "live", "a bench in the browser: the running loop, drawn; pull at it, change it, break it",
          run_live);
  add_scene(c, o.run);
  add_seed(c, o.run.seed, "of the random effects");
  c.add_option("--port", o.port, "on 127.0.0.1; 0: any free one")
      ->check(CLI::Range(0, 65535))
      ->capture_default_str();
  c.add_option("--duration", o.duration, "s; else until Ctrl-C")->check(above_zero());
  c.add_option(
       "--bus", o.run.bus,
       "virtual | socketcan:INTERFACE | slcan:ENDPOINT; not virtual: for a controller there, in real time")
      ->capture_default_str();
  c.add_option("--mcap", o.run.mcap, "file for all samples as MCAP, for Foxglove and the like")
      ->type_name("FILE");
  add_json(c, o.run.json, "print the summary as one JSON document, and the URL on stderr");
}

void add_spatial_and_keys(Program& p) {
  const auto [c, o] = add_scene_command(
      p, "spatial",
      "closed loop in space, orientation by unit quaternion: a free body, or a platform on six legs",
      run_spatial, "scene.toml, summary.json, log.csv");
  add_seed(c, o.seed, "of the noise in [measurement]");
  add_scalar(c, o.single_precision, of_controller);

  const auto [keys, of] = add(p, "keys", "print the table of scene keys (Markdown)", run_keys, Signals::end);
  of = "scene";
  keys.add_option("OF", of, "scene | spatial")
      ->check(CLI::IsMember({"scene", "spatial"}))
      ->capture_default_str();

  const auto [completion, shell] =
      add(p, "completion", "print what a shell needs to complete commands, options and scene keys",
          run_completion, Signals::end);
  shell.app = &p.app;
  completion.add_option("SHELL", shell.name, "bash")->required()->check(CLI::IsMember({"bash"}));
}

}  // namespace

void add_commands(Program& p) {
  add_init_and_eval(p);
  add_loops(p);
  add_drive(p);
  add_operate(p);
  add_scene_commands(p);
  add_accuracy(p);
  add_campaign(p);
  add_design(p);
  add_sweep(p);
  add_compare(p);
  add_calibrate(p);
  add_identify(p);
  add_live(p);
  add_spatial_and_keys(p);
}

}  // namespace esmc::host
