#pragma once
/// `esmc drive`: one emulated drive with a shaft of its own on a CAN interface, in real time.

#include <optional>
#include <string>
#include <vector>

#include "host_sim/drives/lone_shaft.hpp"

namespace esmc::host {

struct DriveOptions {
  std::string protocol, bus;
  int node = 1;
  int bit_rate = 1'000'000;        ///< bit/s, slcan only
  std::optional<double> duration;  ///< s; else until Ctrl-C
  double rate_hz = 1000.0;         ///< of samples (odrive) and of the shaft's steps
  double watchdog = 0.1;           ///< s
  LoneShaft shaft;
  std::vector<std::string> defects;
  // mit
  std::string dialect = "mini_cheetah";
  int master_id = 0;
  double position_range = 12.5, velocity_range = 50.0, torque_range = 18.0;
  double rated_torque = 1.0;  ///< cia402, N m
  bool json = false;
};

/// Names of the defects and what they mean, one per line.
std::string defects_text();
int run_drive(const DriveOptions& o);

}  // namespace esmc::host
