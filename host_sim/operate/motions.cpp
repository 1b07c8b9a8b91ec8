/// The commands that arm, move and bring to rest.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "host_sim/controller/bake.hpp"
#include "host_sim/operate/console.hpp"
#include "host_sim/operate/sample_stream.hpp"

namespace esmc::host {
namespace {

constexpr double by_controller = 1e9;  // s, where the controller itself bounds the time, in its own ticks
constexpr double rest_seconds = 60.0;
constexpr double arrived = 3e-6;  // m; positions on the wire are integers of 1 um, telemetry is 32-bit

/// Least time, s, from rest to rest within speed and acceleration.
double least_time(double distance, double speed, double acceleration) {
  return distance * acceleration > speed * speed ? distance / speed + speed / acceleration
                                                 : 2.0 * std::sqrt(distance / acceleration);
}

/// After Ctrl-C, or a stop on the page, nothing begins to move.
void require_not_interrupted(const Connection& link) {
  if (link.stopped()) throw Interrupted("interrupted: nothing moves");
}

}  // namespace

void Console::leave_disabled(link::Order order, const char* refusal) {
  require_not_interrupted(link_);
  own_ = true;
  link_.keep_alive(Connection::Alive::always);
  const auto left = [&] { return now().state != State::disabled || now().fault != Fault::none; };
  if (link_.obeyed(order, left) && link_.until(left, order_seconds) != Waited::silent) return;
  own_ = false;
  refuse("refused", refusal);
}

void Console::home(const Words&) {
  require_no_fault();
  if (now().state != State::disabled) refuse("not_now", "homing begins while disabled");
  leave_disabled(link::Order::home,
                 "the order to home was not taken; the scene must have drives.homing_speed");
  const auto over = [&] { return now().state == State::disabled || now().state == State::fault; };
  if (link_.until(over, by_controller) == Waited::stopped) return interrupt();
  own_ = false;
  if (now().zero_unknown) refuse("not_homed", "homing was ended before both stops were met");
  require_no_fault();
  say("homed: both joints were on their end stops");
}

void Console::start(link::Source source) {
  require_no_fault();
  if (now().state != State::disabled) refuse("not_now", "arming begins while disabled");
  const link::Order wanted = source == link::Source::stream ? link::Order::stream : link::Order::reference;
  const auto chosen = [&] { return now().source == source; };
  if (!chosen() && (!link_.obeyed(wanted, chosen) || link_.until(chosen, order_seconds) == Waited::silent))
    refuse("refused", "the source of motion was not taken");
  leave_disabled(link::Order::arm, "the order to arm was not taken");
  const auto over = [&] {
    const bool arming = now().state == State::enabling || now().state == State::testing;
    return !arming || now().fault != Fault::none;
  };
  if (link_.until(over, by_controller) == Waited::stopped) halt();
  require_not_interrupted(link_);
  require_running();
}

void Console::require_running() const {
  require_no_fault();
  if (now().state != State::running)
    throw Refused(fmt::format("not_armed: the controller is {}", name(now().state)));
}

void Console::require_guided() {
  require_no_fault();
  if (single_ && now().state == State::disabled) return start(link::Source::stream);
  require_running();
  if (!own_) link_.keep_alive(Connection::Alive::unless_another);
  if (now().source != link::Source::stream)
    refuse("not_now", "the source of motion is not set points: halt, then arm");
}

void Console::stay() {
  const auto ended = [&] { return now().state != State::running; };
  if (link_.until(ended, 1e9) == Waited::stopped) return interrupt();
  if (now().state == State::halting || now().state == State::lowering || now().state == State::stopping)
    (void)link_.until(
        [&] {
          return now().state == State::disabled || now().state == State::holding ||
                 now().state == State::fault;
        },
        by_controller);
  own_ = false;
  require_no_fault();
}

void Console::insist(link::Order order, const std::function<bool()>& done, const char* reason,
                     const char* what) {
  auto since = Connection::Clock::now();
  while (!done()) {
    const State s = now().state;  // lowering alone may be set to ten minutes
    if (s == State::halting || s == State::lowering || s == State::stopping) since = Connection::Clock::now();
    if (Connection::Clock::now() - since > std::chrono::duration<double>(rest_seconds)) refuse(reason, what);
    if (order == link::Order::off || now().state != State::stopping) link_.send(link_.client().order(order));
    (void)link_.until(done, 0.1, false);  // once more every 0.1 s, for a frame may be lost
  }
  own_ = false;
  say(name(now().state));
}

void Console::halt(const Words&) {
  const auto resting = [&] {
    return !armed() ? now().state != State::stopping : now().state == State::holding;
  };
  insist(link::Order::disarm, resting, "not_at_rest", "the mechanism did not come to rest");
}

void Console::off(const Words&) {
  const auto without = [&] { return now().state == State::disabled || now().state == State::fault; };
  insist(link::Order::off, without, "refused", "the controller did not switch off");
}

void Console::interrupt() {
  interrupted_ = true;
  halt();
}

void Console::arm(const Words&) {
  start(link::Source::stream);
  const auto silence = static_cast<unsigned>(link_.parameter(link::Index::silence));
  if (!single_) return say(name(now().state));
  say(fmt::format("running; this call is the sign of life ({}): Ctrl-C halts",
                  silence > 0 ? fmt::format("without it the controller comes to rest after {} ticks", silence)
                              : "the scene asks for none"));
  stay();
}

void Console::run_reference(const Words& words) {
  if (words.size() > 1) return run_file(words[1]);
  start(link::Source::reference);
  if (link_.news().unattended) {
    own_ = false;  // leaving this console does not end it
    return say("running unattended: follows the scene's reference until halt, off or a fault");
  }
  say("running: follows the scene's reference");
  if (single_) stay();
}

void Console::hold(const Words&) {
  require_running();
  if (!link_.obeyed(link::Order::hold)) refuse("not_now", "there is no motion to hold");
  say("holds");
}

void Console::resume(const Words&) {
  require_running();
  if (!link_.obeyed(link::Order::resume)) refuse("not_now", "the reference is not held");
  say("resumes");
}

void Console::override_speed(const Words& words) {
  const double percent = number_of(words[1], "override: PERCENT");
  if (!(percent >= 0.0 && percent <= 100.0) || percent != std::floor(percent))
    refuse_at("", "override: PERCENT must be a whole number from 0 to 100, not {}", printable(words[1]));
  require_no_fault();
  if (!link_.obeyed(
          [&] { return link_.client().order(link::Order::override, static_cast<std::uint8_t>(percent)); }))
    refuse("not_now", "override is for a reference that moves: while it leads or, above 0, while disabled");
  say(fmt::format("the reference at {} %", percent));
}

link::Space Console::space() const {
  return scene_ != nullptr && scene_->reference.type == ReferenceType::joint_sine ? link::Space::base_joints
                                                                                  : link::Space::effector;
}

std::array<std::size_t, 2> Console::base_joints() const {
  const auto& joint = link_.news().joint;
  return joint[3] ? std::array<std::size_t, 2>{0, 2} : std::array<std::size_t, 2>{0, 1};
}

std::array<double, 2> Console::position(link::Space space) {
  const ControllerNews& n = link_.news();
  const auto heard = [&] { return n.effector && n.error && n.joint[0] && n.joint[1]; };
  if (link_.until(heard, order_seconds) == Waited::silent)
    throw Refused("no_telemetry: command.telemetry_ticks of the controller's scene is 0");
  const auto real = [](float v) { return static_cast<double>(v); };
  if (space == link::Space::base_joints) {
    const auto [a, b] = base_joints();
    return {real((*n.joint[a])[0]), real((*n.joint[b])[0])};
  }
  const auto &x = *n.effector, &error = *n.error;
  return {real(x[0]) + real(error[0]), real(x[1]) + real(error[1])};
}

void Console::go_to(const Words& words) {
  const std::array<double, 2> to = words.size() == 2 ? points().at(words[1])
                                                     : std::array<double, 2>{number_of(words[1], "goto: X"),
                                                                             number_of(words[2], "goto: Y")};
  if (!link_.client().set_point(space(), to))
    throw Refused("out_of_bounds: the command interface carries +-8.388607");
  require_guided();
  (void)move_to(to);
}

bool Console::move_to(const std::array<double, 2>& to) {
  const auto from = position(space());
  require_not_interrupted(link_);
  if (!link_.obeyed([&] { return *link_.client().set_point(space(), to); }))
    refuse("out_of_bounds",
           fmt::format("{:g} {:g} is outside the scene's limits or out of reach", to[0], to[1]));
  const double distance = std::max(std::abs(to[0] - from[0]), std::abs(to[1] - from[1]));
  const double least = least_time(distance, static_cast<double>(link_.parameter(link::Index::speed)),
                                  static_cast<double>(link_.parameter(link::Index::acceleration)));
  const auto begin = Connection::Clock::now();
  const std::uint32_t sets = link_.news().telemetry;
  std::array<double, 2> last = from;
  std::uint32_t steady = sets;
  // Of base joints only the measured angles are heard: they have arrived when they rest.
  const auto there = [&] {
    if (now().state != State::running || now().fault != Fault::none) return true;
    if (link_.news().telemetry < sets + 2) return false;
    const auto at = position(space());
    if (space() == link::Space::effector)
      return std::max(std::abs(at[0] - to[0]), std::abs(at[1] - to[1])) <= arrived;
    if (std::max(std::abs(at[0] - last[0]), std::abs(at[1] - last[1])) > 1e-3) {
      last = at;
      steady = link_.news().telemetry;
    }
    return link_.news().telemetry > steady + 5 &&
           std::chrono::duration<double>(Connection::Clock::now() - begin).count() > least;
  };
  const Waited w = link_.until(there, 20.0 * least + 30.0);
  if (w == Waited::stopped) {
    interrupt();
    return false;
  }
  require_running();
  if (w == Waited::silent) refuse("not_reached", "the set point was not reached in time");
  const auto at = position(space());
  say(fmt::format("at {:.6f} {:.6f}", at[0], at[1]));
  return true;
}

namespace {

/// Space and axis 0 or 1 that a word names. Throws InputError for another word.
std::pair<link::Space, std::size_t> axis_of_word(const std::string& word) {
  if (word == "x" || word == "y") return {link::Space::effector, word == "x" ? 0 : 1};
  if (word == "1" || word == "theta11" || word == "theta1") return {link::Space::base_joints, 0};
  if (word == "2" || word == "theta21" || word == "theta2") return {link::Space::base_joints, 1};
  refuse_at("", "jog: '{}' is no axis; allowed are x, y, and 1, 2 or the name of a base joint",
            printable(word));
}

/// FILE may differ from the controller's scene in what is not the controller's, in its reference, and so in
/// its start, and in its [command].
void require_same_controller(const Scene& scene, Scene file) {
  file.reference = scene.reference;
  file.command = scene.command;
  file.hardware = scene.hardware;
  file.start_angle = scene.start_angle;
  if (identity_of(file, Pacing::lockstep) != identity_of(scene, Pacing::lockstep))
    throw Refused(
        fmt::format("other_scene: {} differs from {} in more than its reference: mechanism, gains, limits, "
                    "drives or rate",
                    file.file, scene.file));
}

}  // namespace

void Console::jog(const Words& words) {
  const auto [own, axis] = axis_of_word(words[1]);
  const double speed = number_of(words[2], "jog: SPEED"),
               seconds = words.size() > 3 ? number_of(words[3], "jog: SECONDS") : 0.0;
  if (words.size() > 3 && !(seconds > 0.0)) refuse_at("", "jog: SECONDS must be > 0");
  if (own != space() && scene_ == nullptr)
    throw Refused("other_space: this controller takes x and y, or base joints; the other space needs SCENE");
  SampleStream stream(link_, space(), own, scene_);
  const auto require_speed = [&](double gain) {
    if (!(std::abs(speed) * gain <= stream.speed()))
      refuse("out_of_bounds", fmt::format("jog: command.speed is {} m/s or rad/s", stream.speed()));
  };
  if (own == space()) require_speed(1.0);
  require_guided();
  std::array<double, 2> from = position(space());
  if (own != space()) {
    const auto other = in_other_space(*scene_, space(), {from, {}});
    if (!other) refuse("out_of_bounds", "jog: the mechanism is at a singularity");
    from = other->position;
    require_speed(stream.gain(from, axis));
  }
  if (!stream.begin(from)) refuse("refused", "the stream was not taken");
  const auto begin = Connection::Clock::now();
  const auto go_on = [&] {
    if (!may_go_on()) return false;
    if (words.size() > 3)
      return std::chrono::duration<double>(Connection::Clock::now() - begin).count() < seconds;
    return !held_ || held_();
  };
  const bool limit = !jog_along(stream, from, axis, speed, go_on);
  require_running();
  if (link_.stopped()) return interrupt();
  const auto at = position(own);
  say(fmt::format("{}holds near {:.6f} {:.6f}", limit ? "at the scene's limit: " : "", at[0], at[1]));
}

bool Console::may_go_on() const {
  return !link_.stopped() && now().state == State::running && now().fault == Fault::none;
}

void Console::overrides(const std::vector<std::string>& sets) {
  for (const std::string& s : sets) {
    if (!s.starts_with("reference")) overrides_.push_back(s);
  }
}

void Console::run_file(const std::string& file) {
  if (scene_ == nullptr) refuse_at("", "run FILE needs SCENE, whose controller is to follow it");
  const Scene other = read_scene(file, overrides_);
  require_same_controller(*scene_, other);
  const StreamedPath path(other);
  SampleStream stream(link_, space(), path.space(), scene_);
  path.require_within(stream);
  const auto start = stream.sample(path.at(0.0));
  require_guided();
  if (!move_to(start->position)) return;
  if (!stream.begin(path.at(0.0).position)) refuse("refused", "the stream was not taken");
  const bool over = follow_path(stream, path, [&] { return may_go_on(); });
  require_running();
  if (link_.stopped()) return interrupt();
  // A sample that came late left a difference.
  if (over && !move_to(stream.sample(path.at(path.duration()))->position)) return;
  const std::uint32_t sets = link_.news().telemetry;
  (void)link_.until([&] { return link_.news().telemetry > sets + 1; }, 1.0, false);  // of the end
  const auto at = position(space());
  say(fmt::format("{} {:.6f} {:.6f}", over ? "end of the path:" : "holds near", at[0], at[1]));
}

}  // namespace esmc::host
