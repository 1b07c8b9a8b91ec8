#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <iostream>
#include <sstream>
#include <string_view>

#include "host_sim/cli/options.hpp"
#include "host_sim/error.hpp"
#include "host_sim/scene/key.hpp"
#include "host_sim/version.hpp"

namespace esmc::host {
namespace {

constexpr int exit_failed_run = 1;
constexpr int exit_bad_input = 2;

/// Keeps files and sockets from becoming a standard output that the caller has closed.
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

/// The arguments as a command line of a shell.
std::string command_line_of(int argc, char** argv) {
  std::string out = argc > 0 ? argv[0] : "esmc";
  for (int i = 1; i < argc; ++i) {
    const std::string a = argv[i];
    const bool plain = !a.empty() && std::ranges::all_of(a, [](unsigned char c) {
      return std::isalnum(c) != 0 ||
             std::string_view("_./:=,+@%-").find(static_cast<char>(c)) != std::string_view::npos;
    });
    if (plain) {
      out += " " + a;
      continue;
    }
    out += " '";
    for (const char c : a) out += c == '\'' ? std::string("'\\''") : std::string(1, c);
    out += "'";
  }
  return out;
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

/// An empty argument is what a variable of a shell that is not set gives: it names nothing and is no number.
void require_values(int argc, char** argv) {
  for (int i = 1; i < argc; ++i) {
    const std::string_view a = argv[i];
    const bool option = a.starts_with("--") && a.ends_with('=');
    if (!a.empty() && !option) continue;
    throw InputError("", fmt::format("{}: an empty argument; is a variable of the shell not set?",
                                     option  ? a.substr(0, a.size() - 1)
                                     : i > 1 ? std::string_view(argv[i - 1])
                                             : "esmc"));
  }
}

/// The error of CLI11, with the name of what is unknown and where help is.
std::string argument_error(const CLI::App& app, const CLI::ParseError& e, int argc, char** argv) {
  const auto chosen = app.get_subcommands();
  if (chosen.empty()) return std::string(e.what()) + "; see esmc --help";
  const CLI::App& sub = *chosen.front();
  const std::string help = "; see esmc " + sub.get_name() + " --help";
  if (dynamic_cast<const CLI::ExtrasError*>(&e) == nullptr) return e.what() + help;
  for (int i = 2; i < argc; ++i) {
    const std::string option = std::string(argv[i]).substr(0, std::string(argv[i]).find('='));
    if (option.starts_with("-") && sub.get_option_no_throw(option) == nullptr)
      return sub.get_name() + " has no " + option + help;
  }
  const auto rest = sub.remaining();
  return (rest.empty() ? std::string(e.what())
                       : sub.get_name() + " takes no further argument '" + rest.front() + "'") +
         help;
}

int run(int argc, char** argv) {
  CLI::App app{"Extended sliding-mode control of the RR arm and the 5R five-bar over CAN"};
  app.name("esmc");
  app.set_version_flag("-V,--version", version);
  app.require_subcommand(1);
  Program program{app, command_line_of(argc, argv)};
  add_commands(program);
  require_values(argc, argv);
  std::vector<std::string> words(argv + 1, argv + std::max(argc, 1));
  if (!words.empty() && words.front() == "help") {  // esmc help, esmc help sim
    require_subcommand(app, argc - 1, argv + 1);
    words.erase(words.begin());
    words.resize(std::min<std::size_t>(words.size(), 1));
    words.emplace_back("--help");
  } else {
    require_subcommand(app, argc, argv);
  }
  try {
    std::ranges::reverse(words);  // as CLI11 takes them
    app.parse(std::move(words));
  } catch (const CLI::Success& e) {  // --help, --version
    std::ostringstream text;
    program.status = app.exit(e, text, text);
    fmt::print("{}", text.str());
  } catch (const CLI::ParseError& e) {
    throw InputError("", argument_error(app, e, argc, argv));
  }
  flush_standard_output();
  return program.status;
}

/// One line on stderr, whatever a library put into `what`.
int failed(const char* what, int status) {
  std::string line = what;
  std::ranges::replace_if(
      line, [](char c) { return c == '\n' || c == '\r'; }, ' ');
  std::cerr << "esmc: " << printable(line) << "\n";
  return status;
}

}  // namespace
}  // namespace esmc::host

int main(int argc, char** argv) {
  using namespace esmc::host;
  occupy_standard_streams();
  try {
    return run(argc, argv);
  } catch (const InputErrors& e) {
    for (const std::string& line : e.lines()) failed(line.c_str(), exit_bad_input);
    return exit_bad_input;
  } catch (const InputError& e) {
    return failed(e.what(), exit_bad_input);
  } catch (const Interrupted& e) {
    return failed(e.what(), exit_interrupted);
  } catch (const std::exception& e) {
    return failed(e.what(), exit_failed_run);
  }
}
