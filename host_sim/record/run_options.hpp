#pragma once
/// Options of the run commands: sim, hil, plant, controller, and commands that run a scene.

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "host_sim/stop.hpp"

namespace esmc::host {

class Comparison;
class RecordedBus;

/// Rows of a log in memory.
struct KeptLog {
  std::vector<std::string> columns;  ///< without the text column
  std::vector<double> values;        ///< row by row
  std::vector<const char*> states;   ///< of the supervisor, per row; empty: there is no such column
};
/// What a command leaves in memory in the place of files and printed text.
struct Capture {
  std::string document;  ///< what --json prints
  KeptLog log;
};

/// A run that repeats a recorded one: it is compared, and writes and prints nothing.
struct ReplayContext {
  Comparison* comparison = nullptr;                  ///< null: not a replay
  const nlohmann::ordered_json* recorded = nullptr;  ///< its summary
  std::optional<std::uint64_t> ticks;                ///< after which it ended; none: after its duration
  std::string interface;                             ///< of its frames.log
  RecordedBus* bus = nullptr;  ///< of a plant or controller alone: the frames of the other end
  bool of_hil = false;         ///< plant and controller began together
};

/// Form of the log.
struct LogOptions {
  bool npy = false;         ///< log.npy in the place of log.csv
  std::uint32_t every = 1;  ///< a row at every so many ticks, from the first one on
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
  LogOptions log{};
  std::string mcap;               ///< file; "": none
  bool observe = false;           ///< controller only: listen, arm nothing, send nothing
  bool single_precision = false;  ///< of the controller, as on a board without double; hil only
  ReplayContext again{};
  Capture* capture =
      nullptr;  ///< sim, hil, check, margins: takes the result, nothing is printed; outlives the run
};

/// Whether a run that has recorded so many ticks must end, as a replay at the tick of the recording's end.
inline bool must_stop(const RunOptions& o, std::uint64_t ticks) {
  return stop_requested() || (o.again.ticks && ticks >= *o.again.ticks);
}

}  // namespace esmc::host
