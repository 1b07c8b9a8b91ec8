#include "host_sim/operate/link_client.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <utility>

namespace esmc::host {
namespace {

using link::Message;

float real(const hal::CanFrame& f, unsigned at) { return link::detail::get_float(f, at); }

/// A classic data frame of 8 bytes in a block of identifiers.
bool in_block(const hal::CanFrame& f, std::uint32_t base) {
  return !f.extended && !f.remote && !f.fd && f.size == 8 && f.id - base < link::block_size;
}

}  // namespace

std::optional<link::Status> decode_status(const hal::CanFrame& f, std::uint32_t base) {
  if (!in_block(f, base) || f.id != base + static_cast<std::uint32_t>(Message::status)) return std::nullopt;
  const std::uint8_t session = f.data[7];
  const unsigned state = f.data[1] >> 4U, reaction = f.data[3] & 3U, source = (f.data[3] >> 2U) & 3U,
                 pace = f.data[3] >> 6U;
  if (session == link::any_session || !link::intact(f, session) || state >= state_count || reaction > 2 ||
      source > 2 || pace > 2)
    return std::nullopt;
  return link::Status{
      static_cast<State>(state),
      static_cast<Fault>(f.data[2]),  // a later firmware may have faults that have no name here
      static_cast<link::Reacted>(reaction),
      static_cast<link::Source>(source),
      (f.data[3] & 0x10U) != 0,
      hal::get_field(f, 4, 3),
      session,
      static_cast<link::Pace>(pace),
      (f.data[3] & 0x20U) != 0};
}

std::optional<std::array<float, 2>> ControllerNews::pose() const {
  return effector == std::array{0.0F, 0.0F} ? std::nullopt : effector;
}

ControllerNews::Values ControllerNews::values() const {
  Values out{};
  auto at = out.begin();
  const auto add = [&](const std::optional<std::array<float, 2>>& pair) {
    at = std::ranges::copy(pair.value_or(std::array{std::nanf(""), std::nanf("")}), at).out;
  };
  add(effector);
  add(error);
  std::ranges::for_each(joint, add);
  return out;
}

bool LinkClient::hear(const hal::CanFrame& f) {
  if (!in_block(f, base_)) return false;
  const std::uint32_t offset = f.id - base_;
  if (offset < link::incoming_count) {  // of another supervisor computer
    if (!link::intact(f, session())) return false;
    counter_[offset] = link::counter_of(f);
    news_.others += offset == 0 ? 1U : 0U;
    return false;
  }
  const auto m = static_cast<Message>(offset);
  switch (m) {
    case Message::status: {
      const auto status = decode_status(f, base_);
      if (!status) return false;
      if (news_.status) news_.ticks += (status->tick - news_.status->tick) & 0xFF'FFFFU;
      news_.status = status;
      ++news_.statuses;
      return true;
    }
    case Message::fault_record:
    case Message::fault_detail:
      read_record(m, f);
      return false;
    case Message::parameter_value:
      read_value(f);
      return false;
    case Message::parameter_table:
      news_.table = hal::get_field(f, 0, 4);
      return false;
    case Message::link_counters: {
      const auto at = [&](unsigned byte) { return static_cast<std::uint16_t>(hal::get_field(f, byte, 2)); };
      news_.counters = link::Counters{at(0), at(2), at(4), at(6)};
      ++news_.counter_frames;
      return false;
    }
    case Message::effector:
      effector_ = {real(f, 0), real(f, 4)};
      return false;
    case Message::tracking_error:
      read_tracking_error(f);
      return false;
    case Message::identity:
      news_.scene = hal::get_field(f, 0, 4);
      news_.version = f.data[4];
      news_.unattended = (f.data[5] & 1U) != 0;
      return false;
    case Message::parameter_slots:
      read_store(f);
      return false;
    case Message::capture:
      read_capture(f);
      return false;
    default:
      break;
  }
  const std::uint32_t joint = offset - static_cast<std::uint32_t>(Message::joint_1);
  if (joint < link::joints_max) news_.joint[joint] = {real(f, 0), real(f, 4)};
  return false;
}

void LinkClient::read_tracking_error(const hal::CanFrame& f) {
  if (!effector_) return;  // it was lost
  news_.effector = std::exchange(effector_, std::nullopt);
  news_.error = {real(f, 0), real(f, 4)};
  ++news_.telemetry;
}

void LinkClient::read_value(const hal::CanFrame& f) {
  if (f.data[0] >= ControllerNews::parameters_max || f.data[1] > static_cast<unsigned>(link::Answer::not_now))
    return;
  ControllerNews::Parameter& p = news_.parameter[f.data[0]];
  p = {static_cast<link::Answer>(f.data[1]), (f.data[2] & 1U) != 0, real(f, 4), p.heard + 1};
}

void LinkClient::read_record(link::Message m, const hal::CanFrame& f) {
  const auto fault = static_cast<Fault>(f.data[0]);
  const auto count = static_cast<std::uint16_t>(hal::get_field(f, 2, 2));
  record_tick_ = news_.ticks;
  if (m == Message::fault_detail) {
    if (!news_.faults.empty() && news_.faults.back().fault == fault)
      news_.faults.back().drive_error = hal::get_field(f, 4, 4);
    return;
  }
  if (fault == Fault::none) {
    news_.readout_over = news_.faults.size() >= count;  // else frames were lost, or it was another readout
    return;
  }
  std::erase_if(news_.faults, [&](const link::FaultRecord& r) { return r.fault == fault; });
  news_.faults.push_back({fault, f.data[1], count, hal::get_field(f, 4, 4), 0});
}

std::optional<hal::CanFrame> LinkClient::request_faults() {
  constexpr std::uint64_t pause = 20;
  if (record_tick_ && news_.ticks - *record_tick_ < pause) return {};
  record_tick_ = news_.ticks;
  return request(link::Subject::faults);
}

void LinkClient::read_store(const hal::CanFrame& f) {
  if (f.data[0] >= link::store_state_names.size() || f.data[2] >= link::slot_content_names.size() ||
      f.data[3] >= link::slot_content_names.size())
    return;
  news_.store = link::StoreStatus{
      static_cast<link::StoreState>(f.data[0]),
      f.data[1],
      {static_cast<link::SlotContent>(f.data[2]), static_cast<link::SlotContent>(f.data[3])},
      hal::get_field(f, 4, 4)};
}

void LinkClient::read_capture(const hal::CanFrame& f) {
  const auto number = static_cast<std::uint16_t>(hal::get_field(f, 0, 2));
  if (number != link::capture_status) {
    link::CapturePart& part = news_.capture_parts[number];
    for (unsigned i = 0; i < part.size(); ++i) part[i] = f.data[2 + i];
  } else if (f.data[2] < link::capture_state_names.size()) {
    news_.capture = {static_cast<link::CaptureState>(f.data[2]),
                     static_cast<std::uint16_t>(hal::get_field(f, 4, 2)),
                     static_cast<std::uint16_t>(hal::get_field(f, 6, 2)), news_.capture.heard + 1};
  }
}

hal::CanFrame LinkClient::frame(link::Message m, std::uint8_t high_bits) {
  hal::CanFrame f = link::detail::frame(base_, m);
  std::uint8_t& counter = counter_[static_cast<std::size_t>(m)];
  counter = (counter + 1U) & 0x0FU;
  f.data[1] = static_cast<std::uint8_t>(counter | high_bits << 4U);
  return f;
}
hal::CanFrame LinkClient::sealed(hal::CanFrame f) const {
  f.data[0] = link::checksum(f, session());
  return f;
}

hal::CanFrame LinkClient::order(link::Order o, std::uint8_t percent) {
  hal::CanFrame f = frame(Message::command);
  f.data[2] = static_cast<std::uint8_t>(o);
  f.data[3] = percent;
  hal::put_field(f, 4, news_.status ? news_.status->tick & 0xFFFFU : 0U, 2);
  hal::put_field(f, 6, news_.table.value_or(0) & 0xFFFFU, 2);
  return sealed(f);
}

std::optional<hal::CanFrame> LinkClient::pair(link::Message m, link::Space space,
                                              const std::array<double, 2>& v, double unit) {
  constexpr double most = 0x7F'FFFF;
  std::array<std::uint32_t, 2> raw{};
  for (unsigned i = 0; i < 2; ++i) {
    const double n = std::round(v[i] / unit);
    if (!(n >= -most && n <= most)) return std::nullopt;
    raw[i] = static_cast<std::uint32_t>(static_cast<std::int32_t>(n)) & 0xFF'FFFFU;
  }
  hal::CanFrame f = frame(m, static_cast<std::uint8_t>(space));
  hal::put_field(f, 2, raw[0], 3);
  hal::put_field(f, 5, raw[1], 3);
  return sealed(f);
}

std::optional<hal::CanFrame> LinkClient::set_point(link::Space space, const std::array<double, 2>& position) {
  return pair(Message::set_point, space, position, 1e-6);
}

std::optional<std::array<hal::CanFrame, 2>> LinkClient::sample(link::Space space,
                                                               const std::array<double, 2>& position,
                                                               const std::array<double, 2>& velocity) {
  const auto first = pair(Message::stream_position, space, position, 1e-6);
  if (!first) return std::nullopt;
  std::uint8_t& counter = counter_[static_cast<std::size_t>(Message::stream_velocity)];
  counter = (link::counter_of(*first) - 1U) & 0x0FU;
  const auto second = pair(Message::stream_velocity, space, velocity, 1e-5);
  if (!second) return std::nullopt;
  return std::array{*first, *second};
}

hal::CanFrame LinkClient::write(std::uint8_t index, float value) {
  hal::CanFrame f = frame(Message::parameter_write);
  f.data[2] = index;
  hal::put_field(f, 4, std::bit_cast<std::uint32_t>(value), 4);
  return sealed(f);
}

hal::CanFrame LinkClient::request(link::Subject subject, std::uint8_t index) {
  hal::CanFrame f = frame(Message::request);
  f.data[2] = static_cast<std::uint8_t>(subject);
  f.data[3] = index;
  return sealed(f);
}

}  // namespace esmc::host
