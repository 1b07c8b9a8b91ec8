#include "host_sim/loop/frame_log.hpp"

#include <fmt/format.h>

#include <iterator>
#include <utility>

#include "host_sim/bus/wire.hpp"
#include "host_sim/error.hpp"

namespace esmc::host {

std::string candump_line(std::int64_t time_us, const std::string& interface, const hal::CanFrame& f) {
  std::string out = fmt::format("({:010}.{:06}) {} ", time_us / 1'000'000, time_us % 1'000'000, interface);
  out += f.extended ? fmt::format("{:08X}", f.id) : fmt::format("{:03X}", f.id);
  if (f.remote) return out + fmt::format("#R{}", f.size);
  out += f.fd ? fmt::format("##{}", f.bit_rate_switch ? 1 : 0) : "#";
  for (const std::uint8_t byte : f.payload()) fmt::format_to(std::back_inserter(out), "{:02X}", byte);
  return out;
}

FrameLog::FrameLog(const std::string& path, std::string interface, std::uint32_t bitrate)
    : interface_(std::move(interface)), bitrate_(bitrate) {
  if (path.empty()) return;
  file_ = std::fopen(path.c_str(), "wb");
  if (file_ == nullptr) throw InputError("", path + ": cannot be written");
}

FrameLog::~FrameLog() {
  if (file_ != nullptr) std::fclose(file_);
}

void FrameLog::frame(const hal::CanFrame& f) {
  const std::uint32_t bits = worst_bits(f.remote ? 0U : f.size, f.extended);
  ++frames_;
  bits_ += bits;
  if (bits != last_bits_) {  // a division saved is a frame's time
    last_bits_ = bits;
    last_us_ = (std::int64_t{bits} * 1'000'000 + bitrate_ - 1) / bitrate_;
  }
  time_us_ += last_us_;
  if (file_ != nullptr) write(f);
}

void FrameLog::frame_at(double time_s, std::uint32_t bits, const hal::CanFrame& f) {
  ++frames_;
  bits_ += bits;
  tick(time_s);
  if (file_ != nullptr) write(f);
}

void FrameLog::write(const hal::CanFrame& f) {
  const std::string line = candump_line(time_us_, interface_, f) + "\n";
  std::fwrite(line.data(), 1, line.size(), file_);
}

void FrameLog::close() {
  if (file_ == nullptr) return;
  if (std::fclose(std::exchange(file_, nullptr)) != 0) {
    throw RunError("frames.log could not be written completely (disk full?)");
  }
}

}  // namespace esmc::host
