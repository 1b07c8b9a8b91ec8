#pragma once
/// Files of a recorded run, checked: complete, of this program, of the scene beside them.

#include <cstddef>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "host_sim/bus/recorded_bus.hpp"
#include "host_sim/record/table.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

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

/// Throws InputError for an incomplete or inconsistent directory. `any_version`: of this program.
Recording read_recording(const std::string& directory, bool any_version);

/// Gives the frames of frames.log with their rows of frames.csv. Throws InputError where they do not fit.
RecordedBus::Source passed_frames(const Recording& r);

/// A run that was recorded, or a log alone: for estimations, which need no other file.
struct RecordedRun {
  std::string log, scene_file;
  Scene scene;
};

/// `log`: a directory of a run, or a log.csv. `scene` empty: the scene.toml beside it. Throws InputError.
RecordedRun open_run(const std::string& log, const std::string& scene);

/// "theta11", ...: the joints of a mechanism, in the order of the model.
std::vector<std::string> joint_names(MechanismType type);

}  // namespace esmc::host
