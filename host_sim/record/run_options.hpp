#pragma once
/// What is asked of a run: the commands sim, hil, plant, controller, and those that run a scene for another
/// reason.

#include <atomic>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

namespace esmc::host {

class Comparison;
class RecordedBus;

/// A run that repeats a recorded one: nothing is written or printed, all is compared.
struct ReplayContext {
  Comparison* comparison = nullptr;                  ///< null: not one
  const nlohmann::ordered_json* recorded = nullptr;  ///< its summary
  std::optional<std::uint64_t> ticks;                ///< after which it ended, if before its time
  std::string interface;                             ///< of its frames.log
  RecordedBus* bus = nullptr;                        ///< one half: what the other one said
  bool of_hil = false;  ///< the plant's half began together with the controller's
};

struct RunOptions {
  std::string scene;
  std::vector<std::string> sets;
  std::string out;
  std::string bus = "virtual";
  std::string command_line;
  std::uint64_t seed = 1;
  bool json = false;
  bool realtime = false;
  bool observe = false;           ///< controller only: listen, arm nothing, send nothing
  bool single_precision = false;  ///< of the controller, as on a board without double; hil only
  ReplayContext again{};
};

/// Set by SIGINT and SIGTERM: loops end with zero torque and a summary.
std::atomic<bool>& stop_requested();
/// The same for a run that has recorded so many ticks, and perhaps repeats one that was ended then.
inline bool must_stop(const RunOptions& o, std::uint64_t ticks) {
  return stop_requested() || (o.again.ticks && ticks >= *o.again.ticks);
}

}  // namespace esmc::host
