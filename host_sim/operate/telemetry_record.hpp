#pragma once
/// What a console hears of a controller, written to a directory.

#include <cstdint>
#include <string>

#include "host_sim/file_handle.hpp"
#include "host_sim/operate/connection.hpp"
#include "host_sim/record/output.hpp"

namespace esmc::host {

/// frames.log as of `candump -L`, and log.csv with a row for each Status: the controller's time, state,
/// fault, last telemetry.
class TelemetryRecord {
 public:
  /// Throws InputError where the directory cannot be used. `connection` must outlive this and have its
  /// parameters read.
  TelemetryRecord(Connection& connection, const std::string& directory);
  ~TelemetryRecord();
  TelemetryRecord(const TelemetryRecord&) = delete;
  TelemetryRecord& operator=(const TelemetryRecord&) = delete;
  /// Moves the files into place. Throws RunError when they could not be written.
  void close();
  [[nodiscard]] std::uint64_t rows() const { return rows_; }

 private:
  void take(std::int64_t time_us, const hal::CanFrame& f);
  void row();

  Connection& link_;
  OutputDirectory out_;
  FileHandle frames_, log_;
  std::uint32_t statuses_;
  std::uint64_t begin_, rows_ = 0;
};

}  // namespace esmc::host
