#pragma once
/// The ticks that a controller has kept, read over its command interface.

#include <string>
#include <vector>

#include "firmware/link/capture.hpp"
#include "host_sim/operate/connection.hpp"

namespace esmc::host {

/// A record as it was kept; `torque_max`: limits of the base joints, N m. The inverse of
/// link::encode_record, to its rounding: half a step of 1 urad, 1 um, 1/32767 of the limit.
link::CaptureTick decode_record(const link::CaptureRecord& r, const std::array<float, 2>& torque_max);

/// All kept ticks, the oldest first. Throws Refused where the controller keeps none or is recording, RunError
/// where it does not answer.
std::vector<link::CaptureTick> read_capture(Connection& link);

/// capture.csv: a row for each tick. `sample_time` in s.
std::string capture_csv(const std::vector<link::CaptureTick>& ticks, double sample_time);

}  // namespace esmc::host
