#pragma once
/// The orders of an operator, one function each. What may move is decided by the controller; a console asks
/// and reports.

#include <array>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "host_sim/operate/connection.hpp"
#include "host_sim/operate/points.hpp"
#include "host_sim/operate/telemetry_record.hpp"

namespace esmc::host {

/// Finite number of a word. Throws InputError; `what` names it.
double number_of(const std::string& word, const char* what);

inline constexpr double order_seconds = 10.0;  ///< until an order shows in a Status; mostly a few ticks

class Console {
 public:
  using Words = std::vector<std::string>;
  struct Command {
    const char* name;
    const char* arguments;
    const char* meaning;
    std::size_t least, most;  ///< arguments
    void (Console::*run)(const Words&);
  };
  static std::span<const Command> commands();
  /// Throws InputError unless the words are a command with as many arguments as it takes.
  static const Command& command_of(const Words& words);

  /// `scene`: null, or that of the controller; outlives this, as `connection`. `single`: each command is a
  /// call of its own; what implies motion then stays until it is done, and this console brings to rest what
  /// it has armed.
  Console(Connection& connection, const Scene* scene, bool json, bool single)
      : link_(connection), scene_(scene), json_(json), single_(single) {}

  /// Carries out a command. Throws InputError, Refused, RunError.
  void run(const Words& words);
  /// The end of this console: what it has armed comes to rest under control, as after `halt`, and drives to
  /// idle.
  void leave();
  /// Whether Ctrl-C ended a motion.
  [[nodiscard]] bool interrupted() const { return interrupted_; }
  /// Overrides of the scene, which hold for the FILE of `run` too, but those of its reference.
  void overrides(const std::vector<std::string>& sets);
  /// For `jog` without a duration: whether it goes on.
  void hold_to_run(std::function<bool()> held) { held_ = std::move(held); }
  /// Where `teach` keeps points; null: nowhere. Outlives this.
  void keep_points(Points* in) { points_ = in; }
  [[nodiscard]] const Points* known_points() const { return points_; }
  [[nodiscard]] link::Space space() const;  ///< of set points and samples
  /// Receives the output in place of standard output.
  void tell(std::function<void(const std::string&)> to) { teller_ = std::move(to); }

 private:
  void status(const Words& words);
  void arm(const Words& words);
  void off(const Words& words);
  /// The order to come to rest, until the controller is.
  void halt(const Words& words = {});
  void reset(const Words& words);
  void zero(const Words& words);
  void home(const Words& words);
  void go_to(const Words& words);
  void teach(const Words& words);
  void list_points(const Words& words);
  void jog(const Words& words);
  void run_reference(const Words& words);
  void run_file(const std::string& file);
  void hold(const Words& words);
  void resume(const Words& words);
  void override_speed(const Words& words);
  void set(const Words& words);
  void store(const Words& words);
  void record(const Words& words);
  void capture(const Words& words);

  void say(const std::string& text) const;
  /// Throws InputError where there is no file of points.
  [[nodiscard]] Points& points() const;
  [[nodiscard]] const link::Status& now() const { return link_.status(); }
  [[nodiscard]] bool armed() const;
  /// Throws Refused with the fault's name where there is one.
  void require_no_fault() const;
  [[noreturn]] void refuse(const char* reason, const std::string& what) const;
  /// To a set point; reports where it arrived. False: Ctrl-C has ended it.
  bool move_to(const std::array<double, 2>& to);
  /// Gives an order that arms, now being the sign of life; returns when `disabled` is left, at a fault, at a
  /// stop: the caller looks. Throws Refused (`refusal`) if not taken in 10 s, Interrupted if already stopped.
  void leave_disabled(link::Order order, const char* refusal);
  /// Arms with this source of motion and waits for `running`.
  void start(link::Source source);
  /// For a motion: running under set points; in a call of its own it arms first.
  void require_guided();
  /// Throws Refused where the controller is not running any more.
  void require_running() const;
  /// Running without a fault, and no Ctrl-C.
  [[nodiscard]] bool may_go_on() const;
  /// Stays, as the sign of life, until Ctrl-C or until the controller is not running.
  void stay();
  /// halt, after Ctrl-C or a stop on the page.
  void interrupt();
  /// Sends an order that needs neither counter nor tick until `done`. Throws Refused after a minute outside
  /// of the states on the way to rest, whose duration the controller bounds.
  void insist(link::Order order, const std::function<bool()>& done, const char* reason, const char* what);
  /// The reference's position, m, or the measured base joints, rad. Throws Refused without telemetry.
  std::array<double, 2> position(link::Space space);
  [[nodiscard]] std::array<std::size_t, 2> base_joints() const;

  Connection& link_;
  const Scene* scene_;
  std::vector<std::string> overrides_;
  bool json_, single_;
  bool own_ = false;  ///< armed by this console
  bool interrupted_ = false;
  Points* points_ = nullptr;
  std::function<bool()> held_;
  std::function<void(const std::string&)> teller_;
  std::unique_ptr<TelemetryRecord> record_;
};

/// `esmc operate BUS SCENE --page`: the operator's page, another console over the same connection. Prints its
/// address and serves it until Ctrl-C; orders of a page are commands of `console`. The sign of life is given
/// only while the page in control answers. `port` 0: one that is free. Returns the exit status 0.
/// Throws InputError where the port is taken, and RunError when bus or controller are gone.
int run_page(Connection& link, Console& console, const Scene& scene, int port);

}  // namespace esmc::host
