#pragma once
/// Worst-case latencies of the frames of a bus.
///
/// Response-time analysis for frames with fixed priorities that cannot be interrupted: K. Tindell, A. Burns
/// and A. Wellings, "Calculating controller area network (CAN) message response times", Control Engineering
/// Practice 3 (1995) 1163-1169, in the form corrected by R. I. Davis, A. Burns, R. J. Bril and J. J. Lukkien,
/// "Controller Area Network (CAN) schedulability analysis: Refuted, revisited and revised", Real-Time Systems
/// 35 (2007) 239-272. Without bus errors; every node offers its most urgent frame first.

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "host_sim/scene/scene.hpp"

namespace esmc::host {

/// Times in bit times.
struct BusMessage {
  enum class Role : std::uint8_t { sample, command, other };
  std::string name;
  std::uint32_t id = 0;
  bool extended = false;
  std::uint32_t key = 0;    ///< arbitration(); another frame with the same one counts as more urgent
  std::uint32_t bits = 0;   ///< with the most stuff bits there can be
  std::uint32_t least = 0;  ///< to its last bit, with none
  double period = 0.0;
  double jitter = 0.0;  ///< how much later than periodically it may be asked for
  Role role = Role::other;
  bool in_turn = false;  ///< of these the controller sends one in a tick at most
};

/// Longest time, in bit times, from the nominal request of a message (jitter included) to the end of its
/// interframe space. `of` must be an element of `all`, no copy. Empty: none below 20 of the longest periods.
[[nodiscard]] std::optional<double> response_time(const std::vector<BusMessage>& all, const BusMessage& of);

struct BusAnalysis {
  struct Message {
    std::string name;
    std::uint32_t id = 0;
    bool extended = false;
    double period_s = 0.0;
    std::uint32_t bits = 0;
    std::optional<double> response_s;  ///< from its request to its last bit, as the loop asks for it
  };
  std::vector<Message> messages;
  double load = 0.0;
  double rate_max_hz = 0.0;      ///< largest control.rate_hz at which all frames of a tick fit into it
  double tick_s = 0.0;           ///< all frames that one tick may have, one after the other
  std::optional<double> loop_s;  ///< from the tick's samples to its last torque
  double answers_s = 0.0;        ///< SYNC and its answers, with nothing else on the bus; 0 without SYNC
};
/// Share of a tick that the controller waits for answers to SYNC, against the clock: later ones belong to the
/// next tick.
inline constexpr double patience_ticks = 0.4;
/// The messages of a scene's loop on the bus, the most urgent first.
[[nodiscard]] std::vector<BusMessage> bus_messages(const Scene& scene);
/// Worst latencies, s, of bus_messages(scene), and the load of the bus (1: full).
[[nodiscard]] BusAnalysis analyse_bus(const Scene& scene);

}  // namespace esmc::host
