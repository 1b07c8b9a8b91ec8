#include <CLI/CLI.hpp>
#include <csignal>
#include <fstream>
#include <iostream>
#include <sstream>

#include "host_sim/commands/check.hpp"
#include "host_sim/commands/eval.hpp"
#include "host_sim/commands/init.hpp"
#include "host_sim/commands/run.hpp"
#include "host_sim/error.hpp"
#include "host_sim/scene/keys.hpp"
#include "host_sim/version.hpp"

namespace esmc::host {
namespace {

constexpr int exit_failed_run = 1;
constexpr int exit_bad_input = 2;

extern "C" void request_stop(int) { stop_requested() = true; }

std::string read_all(const std::string& file) {
  std::ostringstream text;
  if (file == "-") {
    text << std::cin.rdbuf();
  } else {
    std::ifstream in(file, std::ios::binary);
    if (!in) throw InputError("", file + ": cannot be read");
    text << in.rdbuf();
  }
  return text.str();
}

int run_eval(const std::string& file, const std::string& scalar) {
  const auto type = scalar == "float" ? ScalarType::single_precision : ScalarType::double_precision;
  const auto result = evaluate(read_all(file), file == "-" ? "stdin" : file, type);
  std::cout << result << "\n";
  return 0;
}

std::string joined(int argc, char** argv) {
  std::string out = "esmc";
  for (int i = 1; i < argc; ++i) {
    const std::string a = argv[i];
    const bool plain = a.find_first_of(" \"'[]{}*?$") == std::string::npos;
    out += " " + (plain ? a : "'" + a + "'");
  }
  return out;
}

/// Options that the run commands share.
void add_run_options(CLI::App& c, RunOptions& o) {
  c.add_option("SCENE", o.scene, "scene file (TOML)")->required();
  c.add_option("--set", o.sets, "section.key=value instead of what the scene says; may be repeated")
      ->type_name("KEY=VALUE")->expected(1)->take_all();
  c.add_option("--out", o.out, "directory for scene.toml, summary.json, log.csv, report.html")->type_name("DIR");
  c.add_option("--seed", o.seed, "makes every run repeatable")->capture_default_str();
  c.add_flag("--json", o.json, "print the summary as one JSON document");
}
void add_bus_options(CLI::App& c, RunOptions& o, bool required) {
  auto* bus = c.add_option("--bus", o.bus, "virtual | socketcan:INTERFACE")->capture_default_str();
  if (required) bus->required();
  c.add_flag("--realtime", o.realtime, "wall-clock ticks instead of lockstep");
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
  init->callback([&] { std::cout << starting_scene(kind); });

  std::string file = "-", scalar = "double";
  auto* eval = app.add_subcommand("eval", "evaluate model and laws at given states (JSON in, JSON out)");
  eval->add_option("FILE", file, "cases in the schema of tests/reference; - is stdin")->capture_default_str();
  eval->add_option("--scalar", scalar, "double | float")->check(CLI::IsMember({"double", "float"}))->capture_default_str();
  eval->callback([&] { status = run_eval(file, scalar); });

  auto* sim = app.add_subcommand("sim", "closed loop in one process, torque applied directly");
  add_run_options(*sim, o);
  sim->callback([&] { status = run_sim(o); });

  auto* hil = app.add_subcommand("hil", "the loop through real CAN frames: controller on one node, drives and plant on the other");
  add_run_options(*hil, o);
  add_bus_options(*hil, o, false);
  hil->callback([&] { status = run_hil(o); });

  auto* plant = app.add_subcommand("plant", "the drives' and the mechanism's half of hil, as a process of its own");
  add_run_options(*plant, o);
  add_bus_options(*plant, o, true);
  plant->callback([&] { status = run_plant(o); });

  auto* controller = app.add_subcommand("controller", "the controller's half of hil, as a process of its own");
  add_run_options(*controller, o);
  add_bus_options(*controller, o, true);
  controller->callback([&] { status = run_controller(o); });

  auto* check = app.add_subcommand("check", "lint a scene: reach, singularity and torque margins, bus load");
  add_run_options(*check, o);
  check->callback([&] { status = run_check(o); });

  auto* keys = app.add_subcommand("keys", "print the table of scene keys (Markdown)");
  keys->callback([&] { std::cout << keys_markdown(); });

  try {
    app.parse(argc, argv);
  } catch (const CLI::Success& e) {  // --help, --version
    return app.exit(e);
  } catch (const CLI::ParseError& e) {
    throw InputError("", std::string(e.what()) + "; see esmc --help");
  }
  std::cout.flush();
  if (!std::cout) throw RunError("standard output could not be written");
  return status;
}

}  // namespace
}  // namespace esmc::host

int main(int argc, char** argv) {
  std::signal(SIGINT, esmc::host::request_stop);
  std::signal(SIGTERM, esmc::host::request_stop);
  const auto say = [](const char* what) {
    std::string line = what;  // one line, whatever a library put into it
    for (char& c : line) c = c == '\n' || c == '\r' ? ' ' : c;
    std::cerr << "esmc: " << line << "\n";
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
