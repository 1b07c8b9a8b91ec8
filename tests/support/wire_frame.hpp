#pragma once
/// A frame on the wire of a modelled bus.

#include <cstdint>
#include <vector>

namespace esmc::test {

struct WireFrame {
  std::uint32_t id = 0;
  bool extended = false, remote = false, fd = false, brs = false;
  unsigned dlc = 0;
  std::vector<std::uint8_t> bytes{};  // as many as the code says
  friend bool operator==(const WireFrame&, const WireFrame&) = default;
};

}  // namespace esmc::test
