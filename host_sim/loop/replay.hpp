#pragma once
/// `esmc replay`: a recorded run again, and whether it is equal to the last bit.

#include <string>

namespace esmc::host {

struct ReplayOptions {
  std::string directory;
  bool any_version = false;  ///< the recording may be of another version of this program
  bool json = false;
};

/// Exit status 1 where the repeated run is another.
int run_replay(const ReplayOptions& o);

}  // namespace esmc::host
