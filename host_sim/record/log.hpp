#pragma once
/// log.csv: one row per tick, and the thinned copy of it that the report shows.

#include <fmt/format.h>

#include <chrono>
#include <cstdio>
#include <string>
#include <vector>

#include "host_sim/report/series.hpp"

namespace esmc::host {

/// Rows of doubles and one text column (the supervisor's state). Writes to a file only when it was given one.
class Log {
 public:
  Log() = default;
  /// `file` is closed at the end; null: nothing is written. `rows` expected decides how far the report's copy
  /// is thinned.
  Log(std::FILE* file, std::vector<std::string> columns, std::size_t rows);
  Log(Log&& other) noexcept;
  Log& operator=(Log&& other) noexcept;
  Log(const Log&) = delete;
  Log& operator=(const Log&) = delete;
  ~Log();

  /// True when rows are wanted at all; ask before assembling one.
  [[nodiscard]] bool wanted() const { return file_ != nullptr; }
  /// `values` for all columns but the last, which is `state` (may be empty when there is no such column).
  void row(const std::vector<double>& values, const char* state);
  void close();

  [[nodiscard]] const std::vector<std::string>& columns() const { return columns_; }
  struct Row {
    std::vector<double> values;
    std::string state;  ///< empty when there is no such column
    double chatter =
        0.0;  ///< N m: change of torque from tick to tick, mean over motors and ticks since the row before
  };
  [[nodiscard]] const std::vector<Row>& thinned() const { return thinned_; }
  /// Wall time from one row to the next.
  [[nodiscard]] const Histogram& tick_time() const { return tick_time_; }

 private:
  void update_chatter(const std::vector<double>& values);

  std::FILE* file_ = nullptr;
  fmt::memory_buffer buffer_;
  std::vector<std::string> columns_;
  std::vector<Row> thinned_;
  std::size_t stride_ = 1, written_ = 0;
  std::size_t torque_ = 0, motors_ = 0;  ///< where the torques are
  std::vector<double> last_torque_;
  double change_ = 0.0;
  std::size_t changes_ = 0;
  std::chrono::steady_clock::time_point last_row_;
  Histogram tick_time_;
};

}  // namespace esmc::host
