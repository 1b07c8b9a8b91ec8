#pragma once
/// `esmc operate --mcap FILE`: what a console hears and sends, for the tools that people own.

#include <string>
#include <vector>

#include "host_sim/operate/connection.hpp"
#include "host_sim/record/run_mcap.hpp"

namespace esmc::host {

class TelemetryMcap {
 public:
  /// A row for each Status, and every frame, from now on. `scene`: null, or names the joints. `connection`
  /// must outlive this. Throws InputError where the file cannot be written.
  TelemetryMcap(Connection& connection, const Scene* scene, const std::string& file);
  ~TelemetryMcap();
  TelemetryMcap(const TelemetryMcap&) = delete;
  TelemetryMcap& operator=(const TelemetryMcap&) = delete;
  /// Ends it and moves the file into place. Throws RunError when it could not be written.
  void commit();

 private:
  void take(std::int64_t time_us, const hal::CanFrame& f);

  Connection& link_;
  RunMcap file_;
  std::size_t motors_;
  std::uint32_t statuses_;
  std::uint64_t begin_;
};

}  // namespace esmc::host
