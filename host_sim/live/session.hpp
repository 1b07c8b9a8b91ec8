#pragma once
/// The loop of a live bench, tick by tick and without a clock: the controller's cycle, the bus, drives and
/// mechanism, and the orders of an operator between ticks. Deterministic: same orders at the same ticks, same
/// bits.
///
/// Changes that the firmware does not allow under torque (other gains, another law) are made as an operator
/// would make them: halt, brake, drives and controller anew from the new scene, start; the reference is
/// joined from where the mechanism stands.

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

  /// Called between ticks. An order that is impossible now becomes an event.
  virtual void order(const LiveOrder& o) = 0;
  virtual void tick() = 0;
  /// Sample of the last tick.
  [[nodiscard]] virtual const LiveSample& sample() const = 0;
  /// Events since the last call.
  [[nodiscard]] virtual std::vector<LiveEvent> take_events() = 0;
  [[nodiscard]] virtual const Scene& scene() const = 0;
  /// Whether there is neither torque nor a pending start.
  [[nodiscard]] virtual bool at_rest() const = 0;
  /// Digest of the motion as in `esmc hil`, from the first tick under control on.
  [[nodiscard]] virtual std::string digest() const = 0;
  /// Ticks since the session began, and those of them that are in the digest.
  [[nodiscard]] virtual std::uint64_t ticks() const = 0;
  [[nodiscard]] virtual std::uint64_t run_ticks() const = 0;
  /// s between calls of tick(): a tick, or a part of one where the controller is on a bus.
  [[nodiscard]] virtual double period() const { return scene().tick(); }

 protected:
  LiveSession() = default;
};

/// A loop on the virtual bus, which starts by itself. Throws InputError where that cannot run the scene.
std::unique_ptr<LiveSession> make_live_session(std::shared_ptr<const Scene> scene);

/// Drives and mechanism alone, in real time, for a controller on `bus`: another process or a board. `bus`
/// lives longer.
std::unique_ptr<LiveSession> make_live_plant(std::shared_ptr<const Scene> scene, HostBus& bus);

/// The scene of a bench as it runs: where it does not say otherwise, the reference is joined in 1 s, as on
/// hardware, or as fast as it turns. A bench starts again and again, from wherever the mechanism stands.
/// Throws InputError for what a bench cannot do: effects of the bus (faults are injected instead), no closed
/// loop, a supervisor computer that arms. `controller_elsewhere`: only the first of these is checked.
void prepare_live_scene(Scene& scene, bool controller_elsewhere = false);

/// What a change from one scene to the next restarts. Throws InputError where another bench is needed.
RestartLevel restart_level(const Scene& from, const Scene& to);

/// A fault on `drive` (from 0) with its usual amount and length; one without a longest lasts 1e6 ticks.
InjectOrder usual_injection(const InjectionRow& row, std::size_t drive);
/// True if a fault can begin while the loop runs on these drives.
bool can_inject(const InjectionRow& row, Protocol protocol);
/// True if that needs no access to the controller.
bool can_inject_from_outside(const InjectionRow& row);

}  // namespace esmc::host
