#pragma once
/// The loop of a live bench, tick by tick and without a clock: the controller's cycle, the bus, drives and
/// mechanism, and the orders of an operator between ticks. Deterministic: same orders at the same ticks, same
/// bits.
///
/// Changes that the firmware does not allow under torque (other gains, another law) are made as an operator
/// would make them: halt, brake, drives and controller anew from the new scene, start; the reference is
/// joined from where the mechanism stands.

#include <fmt/format.h>

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "host_sim/campaign/injections.hpp"
#include "host_sim/plant/inputs.hpp"
#include "host_sim/record/digest.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

/// A bounded queue from one thread to one other, without locks: neither side ever waits. What does not fit is
/// refused, and the sender decides what that means. `Capacity`: a power of two.
template <class T, std::size_t Capacity>
class Ring {
  static_assert((Capacity & (Capacity - 1)) == 0 && Capacity > 0);

 public:
  /// Appends `value`; the sender's thread alone. False: full, `value` is unchanged.
  [[nodiscard]] bool push(T&& value) {
    const std::size_t at = written_.load(std::memory_order_relaxed);
    if (at - taken_.load(std::memory_order_acquire) == Capacity) return false;
    slots_[at % Capacity] = std::move(value);
    written_.store(at + 1, std::memory_order_release);
    return true;
  }
  /// Takes the oldest value; the receiver's thread alone. False: empty, `value` is unchanged.
  [[nodiscard]] bool pop(T& value) {
    const std::size_t at = taken_.load(std::memory_order_relaxed);
    if (at == written_.load(std::memory_order_acquire)) return false;
    value = std::exchange(slots_[at % Capacity], T{});  // what it owned is let go of on this side
    taken_.store(at + 1, std::memory_order_release);
    return true;
  }

 private:
  std::array<T, Capacity> slots_{};
  // On cache lines of their own: each is written by one thread and read by the other.
  alignas(64) std::atomic<std::size_t> written_{0};
  alignas(64) std::atomic<std::size_t> taken_{0};
};

// Between the loop and its server: samples and events one way, orders the other.

/// A tick as a page shows it.
struct LiveSample {
  double t = 0.0;          ///< s since the bench began, by ticks
  const char* state = "";  ///< of the supervisor, or of the plant where there is none
  const char* fault = "none";
  std::array<double, 6> q{};         ///< final_state.q of the scene's mechanism
  std::array<double, 2> effector{};  ///< m, the truth
  std::array<double, 2> desired{};   ///< m; NaN while nothing is desired
  std::array<double, 4> torque{};    ///< N m at the joint, per motor, as the drives apply it
  std::array<double, 2> sliding{};   ///< s of the first two channels; 0 where the law has none
  std::array<double, 2> force{};     ///< N of the hand, as it acts on the effector
  std::array<double, 2> anchor{};    ///< m; of the hand while it holds
  bool holding = false, brake = true, saturated = false;
  std::string_view injecting;  ///< name of the fault that acts; empty: none
};

/// A line of the page's log.
struct LiveEvent {
  double t = 0.0;    ///< s, as in LiveSample
  std::string kind;  ///< "state" | "fault" | "order" | "scene" | "note"
  std::string text;
};

enum class LiveCommand : std::uint8_t { start, halt, stop, reset, home };
template <>
inline constexpr auto names_of<LiveCommand> = std::to_array({"start", "halt", "stop", "reset", "home"});

/// What a change of the scene restarts.
enum class RestartLevel : std::uint8_t {
  nothing,  ///< the mechanism goes on with other effects
  restart,  ///< stop, brake, drives and controller anew, start
  home,     ///< and the mechanism where the scene begins
};
/// Another scene, read and checked.
struct SceneOrder {
  std::shared_ptr<const Scene> scene;
  RestartLevel takes = RestartLevel::restart;
  std::string what;  ///< for the event
};

/// An Injection without a row ends the fault that acts.
using LiveOrder = std::variant<LiveCommand, Hand, Injection, SceneOrder>;

/// The loop sends samples and events and takes orders; the server the other way round.
struct Exchange {
  Ring<LiveSample, 8192> samples;
  Ring<LiveEvent, 256> events;
  Ring<LiveOrder, 256> orders;
};

class HostBus;

inline constexpr int for_ever = 1'000'000;  ///< ticks: a fault of this length lasts until it is ended

/// A fault of the campaign that begins when it is ordered.
class LiveFault {
 public:
  [[nodiscard]] const Injection& injection() const { return injection_; }
  [[nodiscard]] bool active() const { return since_ >= 0; }
  [[nodiscard]] Injected kind() const { return active() ? injection_.kind() : Injected::nothing; }
  [[nodiscard]] const hal::CanFrame& foreign() const { return foreign_; }

  /// Begins the fault `o` with the next tick, in place of one that acts; without a row, ends that one.
  /// Returns the text of the event; "": nothing has changed.
  std::string order(const Injection& o, const ProtocolTraits& traits, const Scene& scene) {
    if (o.row == nullptr) {
      if (!active()) return {};
      since_ = -1;
      return fmt::format("{}: over", injection_.row->name);
    }
    injection_ = o;
    since_ = 0;
    first_ = true;
    foreign_ = foreign_command(traits, scene, injection_);
    const std::string time = o.length >= for_ever
                                 ? "until it is ended"
                                 : fmt::format("for {:.6g} ms", 1e3 * o.length * scene.tick());
    return fmt::format("{} at drive {} {}", o.row->name, o.drive + 1, time);
  }
  /// Call once at the beginning of a tick. Ends the fault if it has acted for its length. True: this is the
  /// fault's first tick. A fault of length 0 ends without having acted.
  [[nodiscard]] bool begin_tick() {
    if (since_ >= injection_.length) since_ = -1;
    return std::exchange(first_, false) && active();
  }
  /// Call once at the end of a tick: counts it, unless the fault was ordered since begin_tick().
  void end_tick() {
    if (active() && !first_) ++since_;
  }

 private:
  Injection injection_{.row = &injection_rows()[0]};
  int since_ = -1;  ///< ticks since it began; -1: none
  bool first_ = false;
  hal::CanFrame foreign_{};
};

/// True if a fault can begin while the loop runs on these drives.
bool can_inject(const InjectionRow& row, Protocol protocol);

class LiveSession {
 public:
  virtual ~LiveSession() = default;
  LiveSession(const LiveSession&) = delete;
  LiveSession& operator=(const LiveSession&) = delete;

  /// Called between ticks. An order that is impossible now becomes an event.
  void order(const LiveOrder& o) {
    std::visit([&](const auto& x) { take(x); }, o);
  }
  virtual void tick() = 0;  ///< runs one period()
  /// The last tick() has thrown: the mechanism stays where it is until the order home.
  void fail(const char* why) {
    if (!std::exchange(diverged_, true)) emit("fault", fmt::format("{}: home", why));
  }
  /// Sample of the last tick.
  [[nodiscard]] const LiveSample& sample() const { return sample_; }
  /// Events since the last call.
  [[nodiscard]] std::vector<LiveEvent> take_events() { return std::exchange(events_, {}); }
  [[nodiscard]] const Scene& scene() const { return *scene_; }
  /// Whether there is neither torque nor a pending start.
  [[nodiscard]] virtual bool at_rest() const { return true; }
  /// Digest of the motion as in `esmc hil`, from the first tick under control on.
  [[nodiscard]] std::string digest() const { return digest_.text(); }
  /// Ticks since the session began, and those of them that are in the digest.
  [[nodiscard]] std::uint64_t ticks() const { return ticks_; }
  [[nodiscard]] std::uint64_t run_ticks() const { return run_ticks_; }
  /// s since the session began, whatever its tick was.
  [[nodiscard]] double now() const {
    return before_s_ + (static_cast<double>(ticks_) + part_) * scene_->tick();
  }
  /// s between calls of tick(): a tick, or a part of one where the controller is on a bus.
  [[nodiscard]] virtual double period() const { return scene_->tick(); }

 protected:
  explicit LiveSession(std::shared_ptr<const Scene> scene) : scene_(std::move(scene)) {}

  virtual void take(LiveCommand c) = 0;
  virtual void take(const SceneOrder& o) = 0;
  void take(const Hand& h) { hand_ = h; }
  void take(const Injection& o) {
    // Drives of another protocol may have been ordered, and not be there yet.
    if (o.row != nullptr && !can_inject(*o.row, scene_->drives.protocol))
      return emit("note", fmt::format("{}: no fault of these drives", o.row->name));
    std::string text = fault_.order(o, traits(), *scene_);
    if (!text.empty()) emit("order", std::move(text));
  }
  void emit(const char* kind, std::string text) { events_.push_back({now(), kind, std::move(text)}); }
  /// s under control since the last home(), from which the effects count.
  [[nodiscard]] double run_time() const {
    return run_before_s_ + static_cast<double>(run_ticks_) * scene_->tick();
  }
  /// Another scene, whose tick may be another: times go on.
  void use(std::shared_ptr<const Scene> scene) {
    const double then = now(), ran = run_time();
    scene_ = std::move(scene);
    before_s_ += then - now();
    run_before_s_ += ran - run_time();
  }
  void restart_run_time() {
    run_ticks_ = 0;
    run_before_s_ = 0.0;
  }
  [[nodiscard]] const ProtocolTraits& traits() const { return protocol_traits(scene_->drives.protocol); }

  std::shared_ptr<const Scene> scene_;
  Hand hand_{.most = 1.0};
  LiveFault fault_;
  LiveSample sample_;
  std::vector<LiveEvent> events_;
  Digest digest_;
  std::uint64_t ticks_ = 0, run_ticks_ = 0;
  double before_s_ = 0.0, run_before_s_ = 0.0;  ///< what ticks of other lengths have left
  double part_ = 0.0;                           ///< of the tick that has begun
  bool diverged_ = false;                       ///< the state is not finite: only home helps
};

/// A loop on the virtual bus, which starts by itself. Throws InputError where that cannot run the scene.
std::unique_ptr<LiveSession> make_live_session(std::shared_ptr<const Scene> scene);

/// Drives and mechanism alone, in real time, for a controller on `bus`: another process or a board. `bus`
/// lives longer.
std::unique_ptr<LiveSession> make_live_plant(std::shared_ptr<const Scene> scene, HostBus& bus);

/// The scene of a bench as it runs: where it does not say otherwise, the reference is joined in 1 s, as on
/// hardware, or as fast as it turns. A bench starts again and again, from wherever the mechanism stands.
/// Throws InputError for what a bench cannot do: effects of the bus (faults are injected instead), a
/// supervisor computer that arms. `controller_elsewhere`: only effects are checked, nothing is changed.
void prepare_live_scene(Scene& scene, bool controller_elsewhere = false);

/// What a change from one scene to the next restarts. Throws InputError where another bench is needed.
RestartLevel restart_level(const Scene& from, const Scene& to);

/// A fault with its usual amount and length; `drive` from 0.
Injection usual_injection(const InjectionRow& row, std::size_t drive);
/// True if the fault can begin without access to the controller, from the bus, drives and sensors.
bool can_inject_from_outside(const InjectionRow& row);

}  // namespace esmc::host
