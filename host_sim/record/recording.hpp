#pragma once
/// Files of a recorded run, checked: complete, of this program, of the scene beside them.

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
/// Reads a line of candump -L, without its newline; none: it is no such line.
std::optional<CandumpLine> parse_candump(std::string_view line);

/// Digest of the scene and the files that it names, as in summary.json.
std::string scene_digest(const Scene& scene);

struct Recording {
  std::string directory;
  std::string command;  ///< sim | hil | plant | controller
  bool realtime = false, single_precision = false;
  std::string interface;  ///< of frames.log
  std::uint64_t seed = 1, ticks = 0;
  bool interrupted = false;
  nlohmann::ordered_json summary;

  /// Replayed as one end against the frames of the other: its frames.log has a frames.csv beside it.
  [[nodiscard]] bool one_end() const { return realtime || command == "plant" || command == "controller"; }
  [[nodiscard]] std::string file(const char* name) const { return directory + "/" + name; }
};

/// Throws InputError for a directory that is incomplete or inconsistent. `any_version`: of any version of
/// this program.
Recording read_recording(const std::string& directory, bool any_version);

/// Gives the frames of frames.log with their rows of frames.csv. Throws InputError where they do not fit.
RecordedBus::Source passed_frames(const Recording& r);

}  // namespace esmc::host
