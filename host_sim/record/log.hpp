#pragma once
/// log.csv or log.npy: rows of ticks, and the thinned copy of them that the report shows.

#include <fmt/format.h>

#include <chrono>
#include <cstdio>
#include <string>
#include <vector>

#include "host_sim/file_handle.hpp"
#include "host_sim/record/run_mcap.hpp"
#include "host_sim/record/run_options.hpp"
#include "host_sim/report/series.hpp"
#include "host_sim/report/spectrum.hpp"

namespace esmc::host {

/// Where the rows of a run go.
struct LogSink {
  LogSink(std::FILE* f = nullptr, LogOptions o = {}, RunMcap* m = nullptr) : file(f), options(o), mcap(m) {}
  std::FILE* file;     ///< closed at the end; null: none
  LogOptions options;  ///< of `file` and `mcap`
  RunMcap* mcap;       ///< outlives the log; null: none
};

/// Rows of doubles and one text column (the supervisor's state). Writes to a file only when it was given one.
class Log {
 public:
  /// `rows`: expected, for thinning the report's copy.
  Log(const LogSink& to, std::vector<std::string> columns, std::size_t rows);

  /// Keeps the rows in `to`, which outlives this and is cleared; null: it does not.
  void keep(KeptLog* to);
  /// Whether there is a file or a place in memory. Without one row() must not be called.
  [[nodiscard]] bool wanted() const { return file_ != nullptr || kept_ != nullptr || mcap_ != nullptr; }
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
  void add_text(const std::vector<double>& values, const char* state);
  void add_binary(const std::vector<double>& values, const char* state);
  [[nodiscard]] std::string npy_header() const;
  void watch_torques(const std::vector<double>& values, bool running);

  FileHandle file_;
  LogOptions options_;
  RunMcap* mcap_ = nullptr;
  KeptLog* kept_ = nullptr;
  fmt::memory_buffer buffer_;
  std::vector<std::string> columns_;
  std::vector<SeriesRow> thinned_;
  std::size_t stride_ = 1, ticks_ = 0, written_ = 0;
  std::size_t torque_ = 0, motors_ = 0;  ///< first column and number of the torques
  std::vector<double> last_torque_;
  std::vector<Spectrum> spectra_;
  double change_ = 0.0;
  std::size_t changes_ = 0;
  std::chrono::steady_clock::time_point last_row_;
  Histogram tick_time_;
};

}  // namespace esmc::host
