#pragma once
/// What a run has left in a directory, checked: whole, of this program, of the scene that lies beside it.

#include <cstddef>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>

#include "host_sim/bus/recorded_bus.hpp"

namespace esmc::host {

struct Scene;

/// A line of frames.log.
struct CandumpLine {
  std::int64_t time_us = 0;
  std::string interface;
  hal::CanFrame frame{};
  std::size_t text = 0;  ///< where the frame begins in the line
};
/// None: it is not one.
std::optional<CandumpLine> parse_candump(std::string_view line);

/// The digest in summary.json of what was run: the scene and the files that it names.
std::string scene_digest(const Scene& scene);

struct Recording {
  std::string directory;
  std::string command;  ///< sim | hil | plant | controller
  bool realtime = false, single_precision = false;
  std::string interface;  ///< of frames.log
  std::uint64_t seed = 1, ticks = 0;
  bool interrupted = false;
  nlohmann::ordered_json summary;

  /// One half against what the other one said: its frames.log has a frames.csv beside it.
  [[nodiscard]] bool one_half() const { return realtime || command == "plant" || command == "controller"; }
  [[nodiscard]] std::string file(const char* name) const { return directory + "/" + name; }
};

/// Throws InputError that says what is missing, torn or of something else. `any_version`: this program need
/// not be of the version that recorded.
Recording read_recording(const std::string& directory, bool any_version);

/// frames.log with frames.csv. Throws InputError where they do not fit together.
RecordedBus::Source passed_frames(const Recording& r);

}  // namespace esmc::host
