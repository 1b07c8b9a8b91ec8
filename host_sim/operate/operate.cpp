#include "host_sim/operate/operate.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>
#include <thread>

#include "host_sim/controller/bake.hpp"
#include "host_sim/operate/console.hpp"
#include "host_sim/operate/line_input.hpp"
#include "host_sim/operate/status_text.hpp"
#include "host_sim/record/output.hpp"
#include "host_sim/scene/edit.hpp"

namespace esmc::host {
namespace {

using Words = Console::Words;

/// Standard input for `jog`, and the prompt.
LineInput& input() {
  static LineInput lines = [] {
    std::vector<std::string> words{"help", "quit", "control.lambda", "control.gain"};
    for (const auto& c : Console::commands()) words.emplace_back(c.name);
    return LineInput(std::move(words));
  }();
  return lines;
}
bool input_is_silent() { return input().silent(); }

/// The words of the command line, taken apart.
struct Call {
  std::optional<Scene> scene;
  Words command;
};
Call call_of(const OperateOptions& o) {
  Call out;
  Words words = o.words;
  const auto known = Console::commands();
  const bool command =
      !words.empty() && std::ranges::any_of(known, [&](const auto& c) { return words.front() == c.name; });
  if (!words.empty() && !command) {
    if (words.front().find('.') == std::string::npos && words.front().find('/') == std::string::npos)
      (void)Console::command_of({words.front()});  // a misspelt command rather than a file
    out.scene = read_scene(words.front(), o.sets);
    if (!out.scene->command)
      refuse_at("", "{}: has no [command]: its controller has no interface to a console", words.front());
    words.erase(words.begin());
  }
  if (!out.scene && !o.sets.empty()) refuse_at("", "--set changes SCENE, and there is none");
  if (!words.empty()) (void)Console::command_of(words);
  if (o.page && (!out.scene || !words.empty() || o.json))
    refuse_at("", "--page takes SCENE, which it draws, and neither a command nor --json");
  out.command = std::move(words);
  return out;
}

std::uint32_t only_controller(HostBus& bus) {
  const auto found = find_controllers(bus, std::chrono::milliseconds(silence_ms));
  if (stop_requested()) throw Interrupted("interrupted before a Status was heard");
  if (found.empty())
    throw RunError(
        fmt::format("no controller was heard for {} s on {}: is it on, and has its scene [command]?",
                    silence_ms / 1000, bus.name()));
  if (found.size() == 1) return found.front();
  refuse_at("", "several controllers are on {}: base_id {:#05x}; SCENE says which one is meant", bus.name(),
            fmt::join(found, ", "));
}

/// A board in lockstep and one in real time are made of different constants.
void require_same_identity(Scene scene, std::uint32_t announced) {
  if (announced == 0) return;
  for (const bool hardware : {false, true}) {
    scene.hardware = hardware;
    for (const Pacing p : {Pacing::lockstep, Pacing::realtime}) {
      if (identity_of(scene, p) == announced) return;
    }
  }
  throw Refused(fmt::format(
      "other_scene: the controller runs scene {:08x}; {} with these --set values is another scene", announced,
      scene.file));
}

/// For "off" the order off, else disarm (to rest first, where configured). Goes out before anything is heard,
/// so three times: a frame may be lost. `base`: base_id of the controller.
void remove_torque(HostBus& bus, std::uint32_t base, const std::string& command) {
  const link::Order order = command == "off" ? link::Order::off : link::Order::disarm;
  LinkClient without_session(base);
  for (int n = 0; n < 3; ++n) {
    (void)bus.try_send(without_session.order(order));
    bus.flush();
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
}

/// Commands line by line until the input ends. Of input that is no terminal the first failure ends it;
/// returns the exit status.
int run_lines(Console& console, Connection& link) {
  LineInput& lines = input();
  State state = link.status().state;
  Fault fault = link.status().fault;
  link.keep_alive(Connection::Alive::unless_another);
  const auto meanwhile = [&] {
    link.pump(std::chrono::milliseconds(5));
    if (const link::Status& s = link.status(); s.state != state || s.fault != fault) {
      state = s.state;
      fault = s.fault;
      lines.notice(fmt::format("[{}{}]", name(state),
                               fault != Fault::none ? fmt::format(", fault {}", name(fault)) : ""));
    }
    return !stop_requested();
  };
  while (!stop_requested()) {
    const auto text = lines.line(fmt::format("{}> ", name(link.status().state)), meanwhile);
    if (!text) break;
    std::istringstream in(*text);
    Words words;
    for (std::string w; in >> w && !w.starts_with("#");) words.push_back(w);
    if (words.empty()) continue;
    if (words == Words{"quit"}) break;
    try {
      if (words == Words{"help"}) {
        fmt::print("{}", operate_commands_text());
      } else {
        console.run(words);
      }
    } catch (const std::runtime_error& e) {
      const bool refused = dynamic_cast<const Refused*>(&e) != nullptr,
                 misread = dynamic_cast<const InputError*>(&e) != nullptr;
      if (!lines.terminal() || !(refused || misread)) throw;
      fmt::print(stderr, "{}\n", printable(e.what()));
    }
    state = link.status().state;
    fault = link.status().fault;
  }
  return stop_requested() ? exit_interrupted : 0;
}

int operate(Console& console, Connection& link, const Call& call, const OperateOptions& o) {
  std::optional<TelemetryMcap> mcap;
  if (call.scene) refuse_overwrite("--mcap", o.mcap, files_of(*call.scene));
  if (!o.mcap.empty()) mcap.emplace(link, call.scene ? &*call.scene : nullptr, o.mcap);
  const Words& command = call.command;
  const bool json = o.json;
  try {
    int status = 0;
    if (o.page) {
      status = run_page(link, console, *call.scene, o.port);
    } else if (command.empty()) {
      status = run_lines(console, link);
    } else {
      console.run(command);
      if (console.interrupted()) status = exit_interrupted;
    }
    console.leave();
    if (mcap) mcap->commit();
    if (json && !command.empty() && command.front() != "status")
      fmt::print("{}", document_text(status_json(link)));
    return status;
  } catch (...) {
    try {
      console.leave();
      if (mcap) mcap->commit();
    } catch (const std::runtime_error&) {  // the first failure is the one to be told
    }
    throw;
  }
}

/// Where points are kept: pick.toml has its points in pick.points.toml. "": nowhere.
std::string points_file(const OperateOptions& o, const Scene* scene) {
  if (!o.points.empty() || scene == nullptr || scene->file == "-") return o.points;
  return std::filesystem::path(scene->file).replace_extension(".points.toml").string();
}

}  // namespace

std::string operate_commands_text() {
  std::string out = "Commands; without one they are read from standard input:\n";
  for (const Console::Command& c : Console::commands())
    out += fmt::format("  {:34} {}\n", fmt::format("{} {}", c.name, c.arguments), c.meaning);
  return out;
}

int run_operate(const OperateOptions& o) {
  const Call call = call_of(o);
  const Scene* const scene = call.scene ? &*call.scene : nullptr;
  const bool interface = o.bus.find(':') == std::string::npos && o.bus != "virtual";
  HostBus bus = open_bus(interface ? "socketcan:" + o.bus : o.bus,
                         scene != nullptr ? scene->bitrate : o.bit_rate, false);
  const bool removes =
      !call.command.empty() && (call.command.front() == "off" || call.command.front() == "halt");
  if (removes && scene != nullptr)
    remove_torque(bus, static_cast<std::uint32_t>(scene->command->base_id), call.command.front());
  Connection link(
      bus, scene != nullptr ? static_cast<std::uint32_t>(scene->command->base_id) : only_controller(bus));
  if (!removes) {
    if (scene != nullptr) require_same_identity(*scene, *link.news().scene);
    link.read_parameters();
  }
  Console console(link, scene, o.json, !call.command.empty());
  console.hold_to_run(input_is_silent);
  console.overrides(o.sets);
  std::optional<Points> points;
  if (const std::string file = points_file(o, scene); !removes && !file.empty())
    points.emplace(file, console.space());
  if (points) console.keep_points(&*points);
  return operate(console, link, call, o);
}

}  // namespace esmc::host
