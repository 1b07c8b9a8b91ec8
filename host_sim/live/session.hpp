#pragma once
/// The loop of a live bench, tick by tick and without a clock: the controller's cycle on a wire, drives and
/// mechanism on the other, and what an operator orders in between. Deterministic: the same orders at the same
/// ticks, the same bits.
///
/// What the firmware does not allow under torque (other gains, another law) the session does as an operator
/// would: halt, brake, drives and controller anew from the new scene, start; the reference is joined from
/// where the mechanism stands.

#include <memory>
#include <string>
#include <vector>

#include "host_sim/live/exchange.hpp"

namespace esmc::host {

class HostBus;

class LiveSession {
 public:
  virtual ~LiveSession() = default;
  LiveSession(const LiveSession&) = delete;
  LiveSession& operator=(const LiveSession&) = delete;

  /// Between ticks. What is impossible now becomes an event that says so.
  virtual void order(const LiveOrder& o) = 0;
  virtual void tick() = 0;
  /// The tick that was.
  [[nodiscard]] virtual const LiveSample& sample() const = 0;
  /// Since they were taken last.
  [[nodiscard]] virtual std::vector<LiveEvent> take_events() = 0;
  [[nodiscard]] virtual const Scene& scene() const = 0;
  /// Nothing has torque any more, and nobody is about to give it one.
  [[nodiscard]] virtual bool at_rest() const = 0;
  /// As `esmc hil` has it: from the first tick under control on, for as long as nothing but the mechanism's
  /// own time passes.
  [[nodiscard]] virtual std::string digest() const = 0;
  /// Ticks since the session began, and those of them that the digest is of.
  [[nodiscard]] virtual std::uint64_t ticks() const = 0;
  [[nodiscard]] virtual std::uint64_t run_ticks() const = 0;
  /// s between calls of tick(): a tick, or a part of one where somebody else keeps the ticks.
  [[nodiscard]] virtual double period() const { return scene().tick(); }

 protected:
  LiveSession() = default;
};

/// A loop on the virtual bus. It asks for the start itself. Throws InputError where the scene cannot be run
/// so.
std::unique_ptr<LiveSession> make_live_session(std::shared_ptr<const Scene> scene);

/// Drives and mechanism alone, in real time, for a controller on `bus`: another process or a board. `bus`
/// lives longer.
std::unique_ptr<LiveSession> make_live_plant(std::shared_ptr<const Scene> scene, HostBus& bus);

/// The scene of a bench as it runs: where it does not say otherwise, the reference is joined in 1 s, as on
/// hardware, or as fast as it turns. A bench starts again and again, from wherever the mechanism stands.
/// Throws InputError for what a bench cannot do: effects of the bus (faults are injected instead), no closed
/// loop, a supervisor computer that arms. `controller_elsewhere`: only the first of these is ours to decide.
void prepare_live_scene(Scene& scene, bool controller_elsewhere = false);

/// What it takes to go from one scene to the next. Throws InputError where another bench is needed.
RestartLevel what_it_takes(const Scene& from, const Scene& to);

/// What a fault does where nobody says how much: amount and, in ticks, length.
InjectOrder usual_injection(const InjectionRow& row, std::size_t drive);
/// Whether a fault can begin while the loop runs on these drives.
bool can_inject(const InjectionRow& row, Protocol protocol);
/// And where the controller is out of our reach.
bool can_inject_from_outside(const InjectionRow& row);

}  // namespace esmc::host
