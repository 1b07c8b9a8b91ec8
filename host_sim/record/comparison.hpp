#pragma once
/// Compares a repeated run with the files of the recorded one, line by line while it writes.

#include <cstdint>
#include <cstdio>
#include <fstream>
#include <map>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace esmc::host {

/// The first difference in a file.
struct Difference {
  std::string file;
  std::uint64_t line = 0;             ///< of the file, from 1; 0: no line of it
  std::optional<std::uint64_t> tick;  ///< log.csv: from t = 0; frames.log: from the start of arming
  std::string what;                   ///< column, frame or key
  std::string recorded, computed;
};

/// Lines of one file.
class LineComparison {
 public:
  /// Throws InputError where the recording `directory` has no file `name`. `tick`: s.
  LineComparison(const std::string& directory, std::string name, std::vector<std::string> ignored_columns,
                 double tick);
  LineComparison(const LineComparison&) = delete;  // streams point to it
  LineComparison& operator=(const LineComparison&) = delete;

  /// Takes text that the run writes, in pieces of any size, and compares each line that is complete.
  void take(std::string_view text);
  /// The run writes no more; more lines in the recording are a difference.
  void end();
  [[nodiscard]] std::uint64_t lines() const { return lines_; }  ///< compared so far
  [[nodiscard]] const std::optional<Difference>& difference() const { return difference_; }  ///< the first

 private:
  void line(std::string_view computed);
  [[nodiscard]] std::optional<Difference> row_difference(std::string_view recorded,
                                                         std::string_view computed) const;
  [[nodiscard]] Difference frame_difference(const std::string& recorded, const std::string& computed) const;

  std::string name_, header_, pending_, recorded_;
  std::vector<std::string> ignored_;
  double tick_;
  std::ifstream file_;
  std::uint64_t lines_ = 0;
  std::optional<Difference> difference_;
};

/// All files of a run.
class Comparison {
 public:
  /// `directory`: of the recording; `tick`: s. `realtime`: values that the wall clock decided are not
  /// compared. `frames`: frames.log is compared here; false: by a RecordedBus.
  Comparison(std::string directory, double tick, bool realtime, bool frames)
      : directory_(std::move(directory)), tick_(tick), realtime_(realtime), frames_(frames) {}

  /// Stream for the run's file of this name, to be closed before this ends; null: it is not compared. Opened
  /// again, it begins anew. Throws InputError where the recording has no such file.
  [[nodiscard]] std::FILE* open(const std::string& name);
  /// Compares the summaries; call once, at the end of the run: complete() is true from then on.
  void summary(nlohmann::ordered_json computed, const nlohmann::ordered_json& recorded);
  void add(Difference d) { others_.push_back(std::move(d)); }

  /// The first difference of frames.log, of log.csv, and all of the summary.
  [[nodiscard]] std::vector<Difference> differences();
  /// Lines of a file that were compared.
  [[nodiscard]] std::uint64_t lines(const std::string& name) const;
  /// Whether the run came to its end: summary() has been called.
  [[nodiscard]] bool complete() const { return complete_; }
  [[nodiscard]] bool same_digest() const { return same_digest_; }  ///< of both summaries; false before them

 private:
  std::string directory_;
  double tick_;
  bool realtime_, frames_, complete_ = false, same_digest_ = false;
  std::map<std::string, std::unique_ptr<LineComparison>> files_;  // frames.log before log.csv
  std::vector<Difference> others_;
};

}  // namespace esmc::host
