#include "host_sim/operate/console.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <nlohmann/json.hpp>

#include "host_sim/operate/capture.hpp"
#include "host_sim/operate/status_text.hpp"
#include "host_sim/record/output.hpp"

namespace esmc::host {
namespace {

constexpr double store_seconds = 60.0;  // of a flash

/// Parameters that a key of the scene names, or a name of docs/esmc.dbc; none: nothing has this name.
std::vector<std::uint8_t> parameters_of(std::string key) {
  if (key.starts_with("control.")) key.erase(0, 8);
  std::ranges::replace(key, '.', '_');
  std::vector<std::uint8_t> out;
  for (std::uint8_t i = 0; i < link::parameter_count; ++i) {
    const std::string name = parameter_names[i];
    if (name == key || (i < link::gain_count && name.starts_with(key + "_"))) out.push_back(i);
  }
  return out;
}

constexpr std::array answer_names{"ok", "unknown_index", "read_only", "out_of_bounds", "not_now"};

}  // namespace

double number_of(const std::string& word, const char* what) {
  char* end = nullptr;
  const double v = std::strtod(word.c_str(), &end);
  if (word.empty() || *end != '\0' || !std::isfinite(v))
    refuse_at("", "{} must be a finite number, not '{}'", what, printable(word));
  return v;
}

std::span<const Console::Command> Console::commands() {
  static constexpr std::array table{
      Command{"status", "", "state, fault, position, parameters, records of faults", 0, 0, &Console::status},
      Command{"arm", "", "enable; the mechanism holds its pose until goto, jog", 0, 0, &Console::arm},
      Command{"goto", "X Y | NAME",
              "to a point, m (base joints, rad, where the scene's reference is joint_sine), or to one that "
              "was taught",
              1, 2, &Console::go_to},
      Command{"teach", "NAME", "keep the point where the mechanism is", 1, 1, &Console::teach},
      Command{"points", "", "the points that were taught", 0, 0, &Console::list_points},
      Command{"jog", "x|y|JOINT SPEED [SECONDS]",
              "at constant speed, m/s or rad/s, while standard input is open and silent; or for a time", 2, 3,
              &Console::jog},
      Command{"run", "[FILE]", "enable and follow the scene's reference; or stream that of FILE", 0, 1,
              &Console::run_reference},
      Command{"override", "PERCENT", "the reference at 0 to 100 % of its speed, along its path; 0: hold", 1,
              1, &Console::override_speed},
      Command{"hold", "", "come to rest now, the reference on its path, and hold", 0, 0, &Console::hold},
      Command{"resume", "", "after hold: the reference goes on", 0, 0, &Console::resume},
      Command{"halt", "", "to rest under control, then as limits.after_halt says", 0, 0, &Console::halt},
      Command{"off", "", "no torque from the next tick on; not a brake", 0, 0, &Console::off},
      Command{"reset", "", "acknowledge the fault, which is printed", 0, 0, &Console::reset},
      Command{"zero", "", "confirm that the mechanism stands in its zero pose", 0, 0, &Console::zero},
      Command{"home", "", "press one base joint after the other on its end stop, which sets the zero", 0, 0,
              &Console::home},
      Command{"set", "KEY VALUE",
              "a gain within the bounds of [command]: control.lambda, control.gain.angle, ...", 2, 2,
              &Console::set},
      Command{"store", "", "keep the gains for the power-ups to come", 0, 0, &Console::store},
      Command{"record", "[DIR]",
              "write received frames and telemetry to DIR, until Ctrl-C; at the prompt until `record`", 0, 1,
              &Console::record},
      Command{"capture", "DIR", "write the last ticks that the controller has kept to DIR", 1, 1,
              &Console::capture}};
  return table;
}

const Console::Command& Console::command_of(const Words& words) {
  const auto table = commands();
  const auto at = std::ranges::find_if(table, [&](const Command& c) { return words.front() == c.name; });
  if (at == table.end()) {
    std::string known;  // clang 14 does not take the views of this standard library
    for (const Command& c : table) known += std::string(known.empty() ? "" : ", ") + c.name;
    refuse_at("", "there is no command '{}'; allowed are {}", printable(words.front()), known);
  }
  if (words.size() - 1 < at->least || words.size() - 1 > at->most)
    refuse_at("", "{} takes {}", at->name, *at->arguments == '\0' ? "no argument" : at->arguments);
  return *at;
}

void Console::run(const Words& words) { (this->*command_of(words).run)(words); }

void Console::say(const std::string& text) const {
  if (teller_) return teller_(text);
  if (json_) return;
  fmt::print("{}\n", text);
  std::fflush(stdout);
}

bool Console::armed() const {
  const State s = now().state;
  return s != State::disabled && s != State::stopping && s != State::fault;
}

void Console::require_no_fault() const {
  if (now().fault != Fault::none)
    throw Refused(
        fmt::format("{}: the controller has this fault, in state {}", name(now().fault), name(now().state)));
}

void Console::refuse(const char* reason, const std::string& what) const {
  require_no_fault();
  throw Refused(fmt::format("{}: {}; the controller is {}", reason, what, name(now().state)));
}

void Console::status(const Words&) {
  link_.read_faults();
  const std::uint32_t sets = link_.news().telemetry;
  const double patience = std::max(1.0, link_.seconds(60));  // three sets, as often as they come by default
  (void)link_.until([&] { return link_.news().telemetry > sets + 1; }, patience, false);  // a whole set
  if (json_) {
    fmt::print("{}", document_text(status_json(link_)));
  } else {
    say(status_text(link_));
  }
}

void Console::reset(const Words&) {
  if (now().fault == Fault::none) return say("no fault to acknowledge");
  const auto at_rest = [&] { return now().state == State::fault || now().state == State::holding; };
  if (link_.until(at_rest, order_seconds) == Waited::silent)
    refuse("not_now", "the mechanism is not at rest");
  const Fault fault = now().fault;
  say(fmt::format("acknowledges {}", name(fault)));
  const auto gone = [&] { return now().fault == Fault::none && now().state == State::disabled; };
  if (!link_.obeyed(link::Order::reset, gone) || link_.until(gone, order_seconds) != Waited::done)
    throw Refused(fmt::format("{}: the fault persists", name(now().fault)));
}

Points& Console::points() const {
  if (points_ == nullptr)
    refuse_at("", "points are kept beside SCENE, or in --points FILE: give one of them");
  return *points_;
}

void Console::teach(const Words& words) {
  Points& kept = points();
  auto at = position(space());
  const auto measured = link_.news().pose();
  if (!measured || now().zero_unknown)
    refuse("not_now", "the controller has no pose: it needs fresh samples of all encoders, and a zero");
  // Without torque the measured pose counts, for every reference.
  if (space() == link::Space::effector && now().state != State::running)
    for (std::size_t i = 0; i < at.size(); ++i) at[i] = static_cast<double>((*measured)[i]);
  kept.teach(words[1], at);
  say(fmt::format("{} = {:.6f} {:.6f}, in {}", words[1], at[0], at[1], kept.file()));
}

void Console::list_points(const Words&) {
  for (const auto& [name, p] : points().all()) say(fmt::format("{} = {:.6f} {:.6f}", name, p[0], p[1]));
}

void Console::zero(const Words&) {
  if (now().state != State::disabled || !link_.obeyed(link::Order::confirm_zero))
    refuse("not_now", "zero is confirmed while disabled, with fresh samples of all encoders");
  say("zero confirmed");
}

void Console::set(const Words& words) {
  const auto which = parameters_of(words[1]);
  if (which.empty())
    refuse_at("",
              "set: there is no parameter '{}'; allowed are control.lambda and control.gain, also with "
              ".position or .angle",
              printable(words[1]));
  const double value = number_of(words[2], "set: VALUE");
  const auto real = static_cast<float>(value);
  if (!std::isfinite(real)) refuse_at("", "set: {} is beyond the range of a 32-bit float", words[2]);
  std::vector<std::pair<std::uint8_t, float>> before;
  for (const std::uint8_t i : which) {
    const float was = link_.news().parameter[i].value;
    const link::Answer answer = link_.write(i, real);
    if (answer == link::Answer::ok) {
      before.emplace_back(i, was);
      continue;
    }
    for (const auto& [done, old] : before) (void)link_.write(done, old);  // all or nothing
    link_.read_parameters();
    refuse(answer_names[static_cast<std::size_t>(answer)],
           fmt::format("{} = {}", parameter_names[i], words[2]));
  }
  link_.read_parameters();
  for (const std::uint8_t i : which)
    say(fmt::format("{} = {}", parameter_names[i], link_.news().parameter[i].value));
}

void Console::store(const Words&) {
  if (!link_.news().store || link_.news().store->state == link::StoreState::none)
    refuse("no_store", "this controller keeps no parameters");
  if (!link_.obeyed(link::Order::store)) refuse("not_now", "gains are stored while disabled");
  const auto over = [&] {
    const link::StoreState s = link_.news().store->state;
    return s == link::StoreState::stored || s == link::StoreState::failed;
  };
  (void)link_.until(over, store_seconds);
  if (link_.news().store->state != link::StoreState::stored) refuse("failed", "the gains are not stored");
  say("stored");
}

void Console::record(const Words& words) {
  if (words.size() == 1) {
    if (!record_) refuse_at("", "record takes DIR");
    record_->close();
    say(fmt::format("{} rows recorded", record_->rows()));
    record_.reset();
    return;
  }
  if (record_) throw Refused("not_now: a record is being written; `record` ends it");
  record_ = std::make_unique<TelemetryRecord>(link_, words[1]);
  if (!single_) return;
  (void)link_.until([] { return false; }, 1e9);
  record({"record"});
}

void Console::capture(const Words& words) {
  OutputDirectory out(words[1]);
  const std::vector<link::CaptureTick> ticks = read_capture(link_);
  out.write("capture.csv", capture_csv(ticks, link_.seconds(1)));
  out.write("summary.json",
            document_text({{"command", "operate"}, {"rows", ticks.size()}, {"fault", name(now().fault)}}));
  out.commit();
  say(fmt::format("{} ticks", ticks.size()));
}

void Console::leave() {
  if (own_ && armed()) halt();
  link_.keep_alive(Connection::Alive::no);
  if (record_) record({"record"});
}

}  // namespace esmc::host
