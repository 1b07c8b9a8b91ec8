#pragma once
/// What the loops of a live bench share, whether the controller is in this process or on a bus.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "host_sim/campaign/episode.hpp"
#include "host_sim/campaign/world.hpp"
#include "host_sim/live/exchange.hpp"

namespace esmc::host {

/// A fault of the campaign that begins when somebody says so.
class LiveFault {
 public:
  [[nodiscard]] const Injection& injection() const { return injection_; }
  [[nodiscard]] bool active() const { return since_ >= 0; }
  [[nodiscard]] Injected kind() const { return active() ? injection_.kind() : Injected::nothing; }
  [[nodiscard]] const hal::CanFrame& foreign() const { return foreign_; }

  /// What to say of it; "": nothing has changed.
  std::string order(const InjectOrder& o, const ProtocolTraits& words, const Scene& scene) {
    if (o.row == nullptr) {
      if (!active()) return {};
      since_ = -1;
      return fmt::format("{}: over", injection_.row->name);
    }
    injection_ = {.row = o.row, .length = o.ticks, .drive = o.drive, .amount = o.amount, .choice = o.choice};
    since_ = 0;
    first_ = true;
    foreign_ = foreign_command(words, scene, injection_);
    return fmt::format("{} at drive {} for {:g} ms", o.row->name, o.drive + 1, 1e3 * o.ticks * scene.tick());
  }
  void clear() {
    injection_ = {.row = &injection_rows()[0]};
    since_ = -1;
    first_ = false;
  }
  /// Whether this tick is its first; then it acts at least in this one.
  [[nodiscard]] bool begin_tick() {
    if (since_ >= injection_.length) since_ = -1;
    return std::exchange(first_, false) && active();
  }
  /// One that was ordered within the tick has not begun.
  void end_tick() {
    if (active() && !first_) ++since_;
  }

 private:
  Injection injection_{.row = &injection_rows()[0]};
  int since_ = -1;  ///< ticks since it began; -1: none
  bool first_ = false;
  hal::CanFrame foreign_{};
};

/// Mechanism, drives and hand into a sample. False: the state is not finite.
template <class Plant>
bool show_mechanism(LiveSample& s, const World<Plant>& world, const Hand& hand) {
  const typename Plant::Output o = world.motion().output();
  std::copy(o.q.begin(), o.q.end(), s.q.begin());
  s.effector = {o.effector.x, o.effector.y};
  for (std::size_t i = 0; i < world.motors(); ++i) s.torque[i] = world.motor(i).torque;
  const V2 f = hand.force(o.effector, o.effector_rate);
  s.force = {f.x, f.y};
  s.anchor = {hand.anchor.x, hand.anchor.y};
  s.holding = hand.holding;
  s.brake = !world.released();
  return std::all_of(o.q.begin(), o.q.end(), [](double v) { return std::isfinite(v); });
}

}  // namespace esmc::host
