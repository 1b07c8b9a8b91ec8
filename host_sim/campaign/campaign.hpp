#pragma once
/// `esmc campaign`: fault injection on a virtual bus, each episode a function of its seed.

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace esmc::host {

struct CampaignOptions {
  std::string scene;  ///< empty: variants of the built-in five-bar
  std::vector<std::string> sets;
  std::uint64_t episodes = 10'000;
  std::uint64_t seed = 1;  ///< of the first episode; the next one has the next
  int jobs = 0;            ///< threads; 0: as many as there are processors
  std::string protocol;    ///< empty: what the scene says
  std::string fault;       ///< the only one; empty: all
  std::optional<std::uint64_t> replay;
  bool json = false;
  std::string out, command_line;
};

/// Runs a campaign. Returns the exit status: 1 where an invariant did not hold or episodes are missing
/// (Ctrl-C). Throws InputError, and RunError for a loop that does not run without a fault.
int run_campaign(const CampaignOptions& o);

}  // namespace esmc::host
