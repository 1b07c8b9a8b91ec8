#pragma once
/// Telemetry of a controller, written down.

#include <cstdint>
#include <functional>
#include <string>

#include "host_sim/file_handle.hpp"
#include "host_sim/operate/connection.hpp"
#include "host_sim/record/output.hpp"
#include "host_sim/record/run_mcap.hpp"

namespace esmc::host {

/// Every frame of a connection, and a row for each Status, from now on.
class TelemetryTap {
 public:
  /// `t`: s since the tap began, of the controller.
  using Row = std::function<void(double t, const ControllerNews::Values&, const link::Status&)>;
  /// `connection` must outlive this and have its parameters read.
  TelemetryTap(Connection& connection, Connection::Tap frame, Row row);
  ~TelemetryTap() { end(); }
  TelemetryTap(const TelemetryTap&) = delete;
  TelemetryTap& operator=(const TelemetryTap&) = delete;
  void end() { link_.taps.erase(this); }

 private:
  Connection& link_;
};

/// frames.log as of `candump -L`, and log.csv with a row for each Status: the controller's time, state,
/// fault, last telemetry.
class TelemetryRecord {
 public:
  /// Throws InputError where the directory cannot be used. `connection` as of TelemetryTap.
  TelemetryRecord(Connection& connection, const std::string& directory);
  /// Moves the files into place. Throws RunError when they could not be written.
  void close();
  [[nodiscard]] std::uint64_t rows() const { return rows_; }

 private:
  Connection& link_;
  OutputDirectory out_;
  FileHandle frames_, log_;
  std::uint64_t rows_ = 0;
  TelemetryTap tap_;
};

/// `esmc operate --mcap FILE`, for the tools that people own.
class TelemetryMcap {
 public:
  /// `scene`: null, or names the joints. `connection` as of TelemetryTap. Throws InputError where the file
  /// cannot be written.
  TelemetryMcap(Connection& connection, const Scene* scene, const std::string& file);
  /// Ends it and moves the file into place. Throws RunError when it could not be written.
  void commit();

 private:
  RunMcap file_;
  TelemetryTap tap_;
};

}  // namespace esmc::host
