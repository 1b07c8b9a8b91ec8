#pragma once
/// A run that is repeated, against the files of the one that was recorded: line by line while it writes,
/// nothing is stored.

#include <cstdint>
#include <cstdio>
#include <map>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace esmc::host {

/// The first place of a file at which the repeated run is another.
struct Difference {
  std::string file;
  std::uint64_t line = 0;             ///< of the file, from 1; 0: no line of it
  std::optional<std::uint64_t> tick;  ///< log.csv: from t = 0; frames.log: from the start of arming
  std::string what;                   ///< column, frame or key
  std::string recorded, computed;
};

/// Lines of one file. `describe` says what two lines differ in.
class LineComparison {
 public:
  LineComparison(std::string directory, std::string name, std::vector<std::string> ignored_columns,
                 double tick);
  ~LineComparison();
  LineComparison(const LineComparison&) = delete;
  LineComparison& operator=(const LineComparison&) = delete;

  /// What the run writes, in pieces of any size.
  void take(std::string_view text);
  /// The run writes no more: neither may the recording.
  void end();
  [[nodiscard]] std::uint64_t lines() const { return lines_; }
  [[nodiscard]] const std::optional<Difference>& difference() const { return difference_; }

 private:
  void line(std::string_view computed);
  bool next(std::string& recorded);
  [[nodiscard]] std::optional<Difference> row_difference(std::string_view recorded,
                                                         std::string_view computed) const;
  [[nodiscard]] Difference frame_difference(const std::string& recorded, const std::string& computed) const;

  std::string name_, header_, pending_, recorded_;
  std::vector<std::string> ignored_;
  double tick_;
  std::FILE* file_;
  std::uint64_t lines_ = 0;
  std::optional<Difference> difference_;
};

/// All that a run leaves.
class Comparison {
 public:
  /// `directory` holds what was recorded, with these ticks, s. `realtime`: what the wall clock decided is not
  /// compared. `frames`: they are in the run's output; otherwise something else judges them.
  Comparison(std::string directory, double tick, bool realtime, bool frames)
      : directory_(std::move(directory)), tick_(tick), realtime_(realtime), frames_(frames) {}

  /// Where the run writes this file; null for one that is not compared. Whoever opens it again begins anew.
  [[nodiscard]] std::FILE* open(const std::string& name);
  /// The run's, against the recorded one.
  void summary(const nlohmann::ordered_json& computed, const nlohmann::ordered_json& recorded);
  void add(Difference d) { others_.push_back(std::move(d)); }

  /// One per file, in the order in which they help: frames, log, summary.
  [[nodiscard]] std::vector<Difference> differences();
  /// Lines of a file that were compared.
  [[nodiscard]] std::uint64_t lines(const std::string& name) const;
  /// False: the run did not come to its end.
  [[nodiscard]] bool complete() const { return complete_; }
  [[nodiscard]] bool same_digest() const { return same_digest_; }

 private:
  std::string directory_;
  double tick_;
  bool realtime_, frames_, complete_ = false, same_digest_ = false;
  std::map<std::string, std::unique_ptr<LineComparison>> files_;  // frames.log before log.csv
  std::vector<Difference> others_;
};

}  // namespace esmc::host
