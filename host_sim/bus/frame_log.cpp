#include "host_sim/bus/frame_log.hpp"

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

FrameLog::FrameLog(std::FILE* file, std::string interface, std::uint32_t bitrate, double fast_bit,
                   std::FILE* passage)
    : file_(file),
      passage_(passage),
      interface_(std::move(interface)),
      bitrate_(bitrate),
      fast_bit_(fast_bit) {
  if (passage_ != nullptr) std::fputs("look,sent,age_us\n", passage);
}

void FrameLog::frame(const hal::CanFrame& f) {
  const std::uint32_t bits = worst_bits(f, fast_bit_);
  ++frames_;
  bits_ += bits;
  if (bits != last_bits_) {  // saves a division
    last_bits_ = bits;
    last_us_ = (std::int64_t{bits} * 1'000'000 + bitrate_ - 1) / bitrate_;
  }
  time_us_ += last_us_;
  write(f);
}

void FrameLog::frame_at(double time_s, std::uint32_t bits, const hal::CanFrame& f) {
  ++frames_;
  bits_ += bits;
  tick(time_s);
  write(f);
}

void FrameLog::write(const hal::CanFrame& f) {
  if (also_) also_(time_us_, f);
  if (file_ == nullptr) return;
  const std::string line = candump_line(time_us_, interface_, f) + "\n";
  std::fwrite(line.data(), 1, line.size(), file_.get());
}

void FrameLog::pass(bool sent, std::uint32_t age_us) {
  const std::string row = fmt::format("{},{},{}\n", looks_, sent ? 1 : 0, age_us);
  std::fwrite(row.data(), 1, row.size(), passage_.get());
}

void FrameLog::close() {
  for (const auto& [file, what] : {std::pair{&file_, "frames.log"}, std::pair{&passage_, "frames.csv"}}) {
    if (*file != nullptr && std::fclose(file->release()) != 0) {
      throw RunError(std::string(what) + " could not be written completely (disk full?)");
    }
  }
}

}  // namespace esmc::host
