#pragma once
/// Data between the loop of a live bench and its server: samples and events one way, orders the other.

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <variant>

#include "host_sim/campaign/injections.hpp"
#include "host_sim/plant/inputs.hpp"
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
  bool holding = false, brake = true, injecting = false, saturated = false;
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

}  // namespace esmc::host
