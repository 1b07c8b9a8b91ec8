/// Lines on a serial port: bytes of any kind against a reader of this file's own, and frames there and back.

#include <cctype>
#include <cstdlib>
#include <optional>
#include <string>

#include "hal/slcan/slcan.hpp"
#include "tests/fuzz/bytes.hpp"

namespace {

using namespace esmc;
using fuzz::require;
using hal::CanFrame;

/// Digits of a line as the manual has them; nothing where one is none.
std::optional<unsigned long> digits(const std::string& line, std::size_t at, std::size_t n) {
  const std::string part = at <= line.size() ? line.substr(at, n) : "";
  if (part.size() != n) return {};
  for (const char c : part) {
    if (std::isxdigit(static_cast<unsigned char>(c)) == 0) return {};
  }
  return std::strtoul(part.c_str(), nullptr, 16);
}

std::optional<CanFrame> read_line(const std::string& line) {
  const std::size_t kind = line.empty() ? std::string::npos : std::string("tTrR").find(line[0]);
  if (kind == std::string::npos) return {};
  CanFrame f;
  f.extended = kind % 2 == 1;
  f.remote = kind > 1;
  const std::size_t wide = f.extended ? 8 : 3;
  const auto id = digits(line, 1, wide), length = digits(line, 1 + wide, 1);
  if (!id || *id > (f.extended ? 0x1FFFFFFFUL : 0x7FFUL) || !length || *length > 8) return {};
  f.id = static_cast<std::uint32_t>(*id);
  f.size = static_cast<std::uint8_t>(*length);
  std::size_t at = 2 + wide;
  for (std::size_t i = 0; i < f.size && !f.remote; ++i, at += 2) {
    const auto byte = digits(line, at, 2);
    if (!byte) return {};
    f.data[i] = static_cast<std::uint8_t>(*byte);
  }
  if (at != line.size() && (at + 4 != line.size() || !digits(line, at, 4))) return {};
  return f;
}

void bytes(fuzz::Bytes& in) {
  hal::SlcanDecoder decoder;
  std::string line;
  CanFrame before;
  before.id = 0x555;
  while (!in.empty()) {
    const char c = static_cast<char>(in.u8());
    CanFrame f = before;
    const bool frame = decoder.feed(c, f);
    if (c == '\r') {
      const auto wanted = read_line(line);
      require(frame == wanted.has_value(), "a frame where there is one");
      if (wanted) {
        require(f == *wanted && f.data == wanted->data && hal::well_formed(f), "that frame and no other");
        std::array<char, hal::slcan_line_max> again{};
        const int n = hal::slcan_encode(f, again);
        require(n > 0 && static_cast<std::size_t>(n) <= line.size() + 1, "it can be said again");
        for (int i = 1; i + 1 < n; ++i) {
          const auto k = static_cast<std::size_t>(i);
          require(again[k] == std::toupper(static_cast<unsigned char>(line[k])), "as it was heard");
        }
      }
      line.clear();
    } else {
      require(!frame, "a frame ends with CR");
      if (c != '\a' || !line.empty()) line.push_back(c);
    }
    if (!frame) require(f == before, "what was there stays");
  }
}

void frames(fuzz::Bytes& in) {
  hal::SlcanDecoder decoder;
  while (!in.empty()) {
    const CanFrame f = in.frame();
    std::array<char, hal::slcan_line_max> line{};
    const int n = hal::slcan_encode(f, line);
    require((n == 0) == (!hal::well_formed(f) || f.fd || f.bit_rate_switch), "what cannot be said");
    CanFrame back;
    for (int i = 0; i < n; ++i) {
      require(decoder.feed(line[static_cast<std::size_t>(i)], back) == (i + 1 == n), "one frame per line");
    }
    if (n == 0) continue;
    CanFrame wanted = f;
    if (f.remote) wanted.data = {};
    require(back == wanted, "there and back");
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  fuzz::Bytes in(data, size);
  if (in.yes()) {
    frames(in);
  } else {
    bytes(in);
  }
  return 0;
}
