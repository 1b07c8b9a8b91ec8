#pragma once
/// Options that several subcommands have, and subcommands themselves.

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <array>
#include <charconv>
#include <cmath>
#include <csignal>
#include <cstdlib>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "host_sim/error.hpp"
#include "host_sim/record/run_options.hpp"

namespace esmc::host {

/// The running program as its subcommands see it.
struct Program {
  CLI::App& app;
  std::string command_line;  ///< for reports
  int status = 0;            ///< exit status of the command that ran
};

/// Adds every subcommand with its options. Parsing runs the one that is named; `program` must outlive that.
void add_commands(Program& program);

/// What SIGINT and SIGTERM do: end the process, or request the end of its loop. Either way with the exit
/// status exit_interrupted.
enum class Signals { end, request_stop };

/// Adds a subcommand that calls run(options). Returns it and its options; `p` must outlive the parsing.
template <class Options>
std::pair<CLI::App&, Options&> add(Program& p, const char* name, const char* description,
                                   int (*run)(const Options&), Signals signals = Signals::request_stop) {
  const auto o = std::make_shared<Options>();
  if constexpr (requires { o->command_line; }) o->command_line = p.command_line;
  if constexpr (requires { o->run.command_line; }) o->run.command_line = p.command_line;
  CLI::App* app = p.app.add_subcommand(name, description);
  app->callback([o, run, signals, &p] {
    for (const int signal : {SIGINT, SIGTERM}) {
      std::signal(
          signal, signals == Signals::request_stop ? +[](int) { stop_requested() = true; }
                                                   : +[](int) { std::quick_exit(exit_interrupted); });
    }
    p.status = run(*o);
  });
  return {*app, *o};
}

/// A validator: a finite number that `allowed` accepts; `range` completes "must be".
inline auto number(const char* range, bool (*allowed)(double)) {
  return [range, allowed](const std::string& text) {
    char* end = nullptr;
    const double v = std::strtod(text.c_str(), &end);
    const bool valid = !text.empty() && *end == '\0' && std::isfinite(v) && allowed(v);
    return valid ? std::string() : fmt::format("must be {}, not {}", range, text);
  };
}
inline auto above_zero() {
  return number("a number > 0", [](double v) { return v > 0.0; });
}

/// Adds an option for a finite number > 0 into `to`, which must outlive the parsing.
inline void add_positive(CLI::App& c, const char* option, double& to, const char* help) {
  c.add_option(option, to, help)->check(above_zero())->capture_default_str();
}

/// A validator: one of some names.
template <std::size_t n>
CLI::IsMember one_of(const std::array<const char*, n>& names) {
  return CLI::IsMember(std::vector<std::string>(names.begin(), names.end()));
}

/// Adds an option for an integer >= 0 into `to`, which may be a std::optional. Other text makes the parsing
/// throw InputError. The variable that an option fills, here and below, must outlive the parsing.
template <class T>
CLI::Option* add_integer(CLI::App& c, const std::string& option, T& to, const std::string& help) {
  return c
      .add_option_function<std::string>(
          option,
          [&to, option](const std::string& text) {
            std::uint64_t v = 0;
            const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), v);
            if (error != std::errc() || end != text.data() + text.size()) {
              throw InputError("",
                               option + " " + text + ": an integer from 0 to 18446744073709551615 is needed");
            }
            to = v;
          },
          help)
      ->type_name("UINT");
}
inline void add_seed(CLI::App& c, std::uint64_t& seed, const std::string& help) {
  add_integer(c, "--seed", seed, help)->default_str("1");
}
inline void add_json(CLI::App& c, bool& json,
                     const std::string& help = "print the result as one JSON document") {
  c.add_flag("--json", json, help);
}
inline void add_out(CLI::App& c, std::string& out, const std::string& files) {
  c.add_option("--out", out, "directory for " + files)->type_name("DIR");
}
inline void add_out_file(CLI::App& c, std::string& out) {
  c.add_option("--out", out, "file to write instead of printing")->type_name("FILE");
}
inline void add_sets(CLI::App& c, std::vector<std::string>& sets) {
  c.add_option("--set", sets, "section.key=value in place of the scene's; may be repeated")
      ->type_name("KEY=VALUE")
      ->expected(1)
      ->allow_extra_args(false)
      ->take_all();
}
inline void add_scene(CLI::App& c, RunOptions& o, const std::string& file = "scene file (TOML); - is stdin") {
  c.add_option("SCENE", o.scene, file)->required();
  add_sets(c, o.sets);
}
inline void add_scalar(CLI::App& c, bool& single_precision, const std::string& help) {
  c.add_option_function<std::string>(
       "--scalar", [&single_precision](const std::string& s) { single_precision = s == "float"; },
       "double | float" + help)
      ->check(CLI::IsMember({"double", "float"}))
      ->default_str("double");
}
inline void add_jobs(CLI::App& c, int& jobs, const std::string& help) {
  c.add_option("--jobs", jobs, help)->check(CLI::Range(1, 1024));
}

}  // namespace esmc::host
