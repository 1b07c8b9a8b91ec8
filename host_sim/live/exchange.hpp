#pragma once
/// Data between the loop of a live bench and its server: samples and events one way, orders the other.

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <variant>

#include "host_sim/campaign/injections.hpp"
#include "host_sim/live/ring.hpp"
#include "host_sim/plant/hand.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

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
