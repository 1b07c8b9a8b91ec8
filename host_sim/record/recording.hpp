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
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

/// The requested columns, in that order, each with one value per row.
struct RecordedTable {
  std::string file;
  std::vector<std::string> header;           ///< of all columns of the file
  std::vector<std::vector<double>> columns;  ///< finite
  std::vector<std::string> words;            ///< of the column `word`, if there is one
  [[nodiscard]] std::size_t rows() const { return columns.empty() ? 0 : columns.front().size(); }
  /// FILE:LINE of a row.
  [[nodiscard]] std::string where(std::size_t row) const { return file + ":" + std::to_string(row + 2); }
};

/// Texts between the commas of `line`, which must outlive them.
std::vector<std::string_view> fields_of(std::string_view line);

/// Throws InputError unless `file` is a regular file: a pipe would wait, a device would never end.
void require_regular_file(const std::string& file);
/// Its bytes. Throws InputError unless it is a regular, readable file of at most 4 GiB.
[[nodiscard]] std::string bytes_of(const std::string& file);

/// Reads the columns `names` of a CSV with a header; their values must be finite. Every row must have as many
/// fields as the header, and the last line must end with a newline. `hint` follows "there is no column X";
/// `word` names an optional column of words. Throws InputError that names file and line.
RecordedTable read_table(const std::string& file, const std::vector<std::string>& names,
                         const std::string& hint, const std::string& word = "");

/// Throws InputError unless the values ascend strictly: `column` of the table, a time.
void require_ascending(const RecordedTable& table, std::size_t column);

/// Throws InputError unless row i is i ticks after the first one: `column` of the table, a time; `tick`: s.
void require_every_tick(const RecordedTable& table, std::size_t column, double tick);

/// Throws InputError unless the rows are equidistant, but for rounding; `hint` ends the message.
void require_even(const RecordedTable& table, std::size_t column, const std::string& hint);

/// A line of frames.log.
struct CandumpLine {
  std::int64_t time_us = 0;
  std::string interface;
  hal::CanFrame frame{};
  std::size_t text = 0;  ///< where the frame begins in the line
};
/// Reads a line of candump -L, without its newline; none: it is no such line.
std::optional<CandumpLine> parse_candump(std::string_view line);

/// Throws InputError where a run has left its log in another form than log.csv, with how to get that one.
void require_csv(const std::string& directory);

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
