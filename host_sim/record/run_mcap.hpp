#pragma once
/// --mcap FILE: the rows of log.csv and the frames of a run as topics.

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "hal/can.hpp"
#include "host_sim/record/mcap.hpp"

namespace esmc::host {

/// Topics /effector, /joints, /torques, /sliding and /controller with the columns of the log, under their
/// names; /can. A number that is not finite is null.
class RunMcap {
 public:
  /// Throws InputError where the file cannot be written. It appears under its name with commit(), and not
  /// before.
  explicit RunMcap(const std::string& file);
  RunMcap(const RunMcap&) = delete;
  RunMcap& operator=(const RunMcap&) = delete;
  ~RunMcap();

  /// Columns of the log, the state last where there is one. Once, before the first row.
  void columns(const std::vector<std::string>& names);
  /// A row; its first value is the time, s.
  void row(const std::vector<double>& values, const char* state);
  /// A frame, at the time of frames.log, us. Rows begin when the drives are armed, frames before that.
  void frame(std::int64_t time_us, const hal::CanFrame& f);
  /// Completes the file and moves it into place. Throws RunError when it could not be written.
  void commit();

 private:
  struct Topic {
    std::uint16_t channel = 0;
    std::vector<std::size_t> columns;
  };
  std::string file_, part_;
  std::optional<McapWriter> writer_;
  std::vector<std::string> names_;
  std::vector<Topic> topics_;
  std::string text_;
  std::uint16_t can_ = 0, controller_ = 0;
  bool with_state_ = false, begun_ = false;
  std::uint64_t now_ns_ = 0, begin_ns_ = 0;
};

}  // namespace esmc::host
