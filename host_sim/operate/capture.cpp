#include "host_sim/operate/capture.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace esmc::host {
namespace {

/// s without an answer, or without another part, after which it was lost: other frames have their turns, too.
double patience(const Connection& link) { return std::max(1.0, link.seconds(20)); }

/// What the controller says that can be read; asks for a block at the same time.
CaptureNews ask_block(Connection& link, std::uint8_t block) {
  const std::uint32_t before = link.news().capture.heard;
  for (int attempt = 0; attempt < 20; ++attempt) {
    link.send(link.client().request(link::Subject::capture, block));
    if (link.until([&] { return link.news().capture.heard != before; }, patience(link), false) ==
        Waited::done)
      return link.news().capture;
  }
  throw RunError("the controller does not answer: no Capture (has its image this message?)");
}

void require_readable(const CaptureNews& c) {
  if (c.state == link::CaptureState::none)
    throw Refused("no_capture: this controller keeps no ticks (ESMC_CAPTURE_TICKS of its image)");
  if (c.state != link::CaptureState::ready)
    throw Refused("not_now: ticks are being recorded; they can be read while disabled, or after a fault");
}

}  // namespace

link::CaptureTick decode_record(const link::CaptureRecord& r, const std::array<float, 2>& torque_max) {
  std::size_t at = 0;
  const auto raw = [&](unsigned bytes) {
    std::uint32_t v = 0;
    for (unsigned i = 0; i < bytes; ++i) v |= static_cast<std::uint32_t>(r[at++]) << (8U * i);
    return v;
  };
  const auto number = [&](unsigned bytes) {
    const unsigned unused = 32U - 8U * bytes;
    return static_cast<float>(static_cast<std::int32_t>(raw(bytes) << unused) >> unused);
  };
  link::CaptureTick t;
  t.torque_max = torque_max;
  t.tick = raw(4);
  for (float& a : t.angle) a = number(3) * link::position_unit;
  for (std::size_t i = 0; i < 2; ++i) t.torque[i] = number(2) / link::capture_torque_steps * torque_max[i];
  for (float& e : t.error) e = number(3) * link::position_unit;
  t.lateness_us = raw(2);
  t.fault = static_cast<Fault>(raw(1));
  const std::uint32_t last = raw(1);
  t.state = static_cast<State>(last & 0x0FU);
  t.obeyed = (last & 0x10U) != 0;
  t.refused = (last & 0x20U) != 0;
  return t;
}

std::vector<link::CaptureTick> read_capture(Connection& link) {
  CaptureNews first = ask_block(link, 0);
  // After a fault it records for an eighth of its length, which in a slow loop takes long.
  bool more = true;
  while (more && first.state == link::CaptureState::recording && link.status().fault != Fault::none) {
    (void)link.until([] { return false; }, 0.25);
    if (link.stopped()) throw Interrupted("interrupted: ticks are being recorded");
    const CaptureNews before = std::exchange(first, ask_block(link, 0));
    more = first.recorded != before.recorded;
  }
  require_readable(first);
  link.client().forget_capture();
  const auto& parts = link.news().capture_parts;
  constexpr std::size_t block = link::Capture::block;
  for (std::size_t from = 0; from < first.count; from += block) {
    const std::size_t begin = from * link::capture_parts,
                      end = std::min<std::size_t>(from + block, first.count) * link::capture_parts;
    const auto all = [&] {
      return std::distance(parts.lower_bound(static_cast<std::uint16_t>(begin)),
                           parts.lower_bound(static_cast<std::uint16_t>(end))) ==
             static_cast<std::ptrdiff_t>(end - begin);
    };
    for (int attempt = 0; !all(); ++attempt) {
      if (attempt == 10) throw RunError("captured ticks are missing: the bus loses frames");
      const CaptureNews now = ask_block(link, static_cast<std::uint8_t>(from / block));
      require_readable(now);
      if (now.recorded != first.recorded)
        throw Refused("not_now: the controller was armed meanwhile; read again");
      for (std::size_t before = parts.size() + 1;
           !all() && parts.size() != before;) {  // as long as they come
        before = parts.size();
        (void)link.until(all, patience(link));
        if (stop_requested()) throw Interrupted("interrupted: not all ticks were read");
      }
    }
  }
  std::vector<link::CaptureTick> out;
  const std::array<float, 2> torque_max{link.parameter(link::Index::torque_limit_1),
                                        link.parameter(link::Index::torque_limit_2)};
  for (std::size_t i = 0; i < first.count; ++i) {
    link::CaptureRecord r{};
    for (std::size_t k = 0; k < link::capture_parts; ++k)
      std::ranges::copy(parts.at(static_cast<std::uint16_t>(i * link::capture_parts + k)),
                        r.begin() + static_cast<std::ptrdiff_t>(k * link::capture_part_size));
    out.push_back(decode_record(r, torque_max));
  }
  return out;
}

std::string capture_csv(const std::vector<link::CaptureTick>& ticks, double sample_time) {
  std::string out = "t,tick,lateness_us,angle1,angle2,tau1,tau2,x_error,y_error,obeyed,refused,fault,state\n";
  const double period_ns = std::round(1e9 * sample_time);
  for (const link::CaptureTick& t : ticks)
    out += fmt::format("{},{},{},{},{},{},{},{},{},{},{},{},{}\n", 1e-9 * (period_ns * t.tick), t.tick,
                       t.lateness_us, t.angle[0], t.angle[1], t.torque[0], t.torque[1], t.error[0],
                       t.error[1], t.obeyed ? 1 : 0, t.refused ? 1 : 0, name(t.fault), name(t.state));
  return out;
}

}  // namespace esmc::host
