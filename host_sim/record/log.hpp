#pragma once
/// log.csv: one row per tick, and the thinned copy of it that the report shows.

#include <fmt/format.h>

#include <chrono>
#include <cstdio>
#include <string>
#include <vector>

#include "host_sim/file_handle.hpp"
#include "host_sim/report/series.hpp"
#include "host_sim/report/spectrum.hpp"

namespace esmc::host {

/// Rows of doubles and one text column (the supervisor's state). Writes to a file only when it was given one.
class Log {
 public:
  /// `file` is closed at the end; null: nothing is written. `rows`: expected, for thinning the report's copy.
  Log(std::FILE* file, std::vector<std::string> columns, std::size_t rows);

  /// Whether there is a file. Without one row() must not be called.
  [[nodiscard]] bool wanted() const { return file_ != nullptr; }
  /// Adds a row: `values` of all columns but the last, which is `state`; "": there is no such column.
  void row(const std::vector<double>& values, const char* state);
  /// Writes what is left and closes the file. Throws RunError when it could not be written completely.
  void close();

  [[nodiscard]] const std::vector<std::string>& columns() const { return columns_; }
  [[nodiscard]] const std::vector<SeriesRow>& thinned() const { return thinned_; }  ///< every so many rows
  /// Of each torque, in the order of the columns, over the rows of a running controller.
  [[nodiscard]] const std::vector<Spectrum>& spectra() const { return spectra_; }
  /// Wall time from one row to the next.
  [[nodiscard]] const Histogram& tick_time() const { return tick_time_; }

 private:
  void watch_torques(const std::vector<double>& values, bool running);

  FileHandle file_;
  fmt::memory_buffer buffer_;
  std::vector<std::string> columns_;
  std::vector<SeriesRow> thinned_;
  std::size_t stride_ = 1, written_ = 0;
  std::size_t torque_ = 0, motors_ = 0;  ///< first column and number of the torques
  std::vector<double> last_torque_;
  std::vector<Spectrum> spectra_;
  double change_ = 0.0;
  std::size_t changes_ = 0;
  std::chrono::steady_clock::time_point last_row_;
  Histogram tick_time_;
};

}  // namespace esmc::host
