#pragma once
/// Shared by the loops of a live bench, with the controller in this process or on a bus.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "host_sim/campaign/episode.hpp"
#include "host_sim/campaign/faulty_plant.hpp"
#include "host_sim/live/session.hpp"
#include "host_sim/record/recorder.hpp"

namespace esmc::host {

/// A fault of the campaign that begins when it is ordered.
class LiveFault {
 public:
  [[nodiscard]] const Injection& injection() const { return injection_; }
  [[nodiscard]] bool active() const { return since_ >= 0; }
  [[nodiscard]] Injected kind() const { return active() ? injection_.kind() : Injected::nothing; }
  [[nodiscard]] const hal::CanFrame& foreign() const { return foreign_; }

  /// Returns the text of the event; "": nothing has changed.
  std::string order(const InjectOrder& o, const ProtocolTraits& traits, const Scene& scene) {
    if (o.row == nullptr) {
      if (!active()) return {};
      since_ = -1;
      return fmt::format("{}: over", injection_.row->name);
    }
    injection_ = {.row = o.row, .length = o.ticks, .drive = o.drive, .amount = o.amount, .choice = o.choice};
    since_ = 0;
    first_ = true;
    foreign_ = foreign_command(traits, scene, injection_);
    return fmt::format("{} at drive {} for {:g} ms", o.row->name, o.drive + 1, 1e3 * o.ticks * scene.tick());
  }
  void clear() {
    injection_ = {.row = &injection_rows()[0]};
    since_ = -1;
    first_ = false;
  }
  /// Begins a tick. True in the first tick of the fault, which acts at least in that one.
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
bool show_mechanism(LiveSample& s, const FaultyPlant<Plant>& world, const Hand& hand) {
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

/// State of a session that does not depend on the controller's place.
class SessionParts : public LiveSession {
 public:
  [[nodiscard]] const LiveSample& sample() const override { return sample_; }
  [[nodiscard]] std::vector<LiveEvent> take_events() override { return std::exchange(events_, {}); }
  [[nodiscard]] const Scene& scene() const override { return *scene_; }
  [[nodiscard]] std::string digest() const override { return digest_.text(); }
  [[nodiscard]] std::uint64_t ticks() const override { return ticks_; }
  [[nodiscard]] std::uint64_t run_ticks() const override { return run_ticks_; }

 protected:
  explicit SessionParts(std::shared_ptr<const Scene> scene) : scene_(std::move(scene)) {}

  void emit(const char* kind, std::string text) { events_.push_back({now(), kind, std::move(text)}); }
  [[nodiscard]] double now() const { return (static_cast<double>(ticks_) + part_) * scene_->tick(); }
  [[nodiscard]] const ProtocolTraits& traits() const { return dialect(scene_->drives.protocol); }
  void inject(const InjectOrder& o) {
    std::string text = fault_.order(o, traits(), *scene_);
    if (!text.empty()) emit("order", std::move(text));
  }
  /// Mechanism, drives, hand and fault into sample and digest.
  template <class Plant>
  void sample_mechanism(const FaultyPlant<Plant>& world) {
    if (world.released()) {
      const typename Plant::Output o = world.motion().output();
      digest_.add(o.q);
      digest_.add(o.qd);
    }
    if (!show_mechanism(sample_, world, hand_) && !std::exchange(diverged_, true)) {
      emit("fault", "the simulated state is not finite any more: home");
    }
    sample_.t = now();
    sample_.injecting = fault_.active();
  }

  std::shared_ptr<const Scene> scene_;
  Hand hand_{.most = 1.0};
  LiveFault fault_;
  LiveSample sample_;
  std::vector<LiveEvent> events_;
  Digest digest_;
  std::uint64_t ticks_ = 0, run_ticks_ = 0;
  double part_ = 0.0;      ///< of the tick that has begun
  bool diverged_ = false;  ///< the state is not finite: only home helps
};

}  // namespace esmc::host
