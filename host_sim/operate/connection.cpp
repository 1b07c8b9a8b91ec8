#include "host_sim/operate/connection.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <thread>

#include "host_sim/loop/run.hpp"

namespace esmc::host {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds alive_period(20);
constexpr unsigned counter_values = 16;  // of an alive counter

}  // namespace

std::vector<std::uint32_t> find_controllers(HostBus& bus, milliseconds patience) {
  using Clock = std::chrono::steady_clock;
  constexpr milliseconds others(1500);
  std::map<std::uint32_t, int> intact;  // of several Status no two have a right checksum by chance
  std::vector<std::uint32_t> found;
  auto end = Clock::now() + patience;
  while (Clock::now() < end && !stop_requested()) {
    if (is_gone(bus)) throw BusGone();
    (void)wait_for_frame(bus, 20);
    hal::CanFrame f;
    while (bus.try_receive(f)) {
      const std::uint32_t base = f.id & ~(link::block_size - 1U);
      if (!decode_status(f, base) || ++intact[base] != 2) continue;
      if (found.empty()) end = Clock::now() + others;
      found.push_back(base);
    }
  }
  std::ranges::sort(found);
  return found;
}

Connection::Connection(HostBus& bus, std::uint32_t base) : bus_(bus), client_(base) {
  const Waited w = until([&] { return news().status.has_value(); }, silence_ms / 1000.0 + 1.0);
  if (w == Waited::stopped) throw Interrupted("interrupted before a Status was heard");
  const auto table = [&] { return client_.request(link::Subject::table); };
  get_in_step(table);
  ask([&] { send(table()); }, [&] { return news().scene && news().table && news().counters; }, "Identity");
  require_known_version(news().version);
}

void Connection::send(const hal::CanFrame& f) {
  const auto give_up = Clock::now() + std::chrono::seconds(1);
  while (bus_.try_send(f) != hal::SendStatus::ok) {
    if (is_gone(bus_)) throw BusGone();
    if (Clock::now() > give_up) throw RunError("a frame could not be sent on " + bus_.name());
    std::this_thread::sleep_for(milliseconds(1));
  }
  bus_.flush();
  tell_taps(Clock::now(), f);
}

void Connection::keep_alive(Alive how) {
  if (how != Alive::no && alive_ == Alive::no && !another())
    get_in_step([&] { return client_.order(link::Order::none); });
  alive_ = how;
}

void Connection::get_in_step(const std::function<hal::CanFrame()>& frame) {
  for (unsigned n = 1; n < counter_values; ++n) {
    send(frame());
    std::this_thread::sleep_for(milliseconds(1));
  }
}

void Connection::pump(std::chrono::nanoseconds patience) {
  if (is_gone(bus_)) throw BusGone();
  (void)wait_for_frame(bus_, patience);
  const auto now = Clock::now();
  hal::CanFrame f;
  constexpr int most = 1000;  // a flooded bus must not keep the sign of life back
  for (int n = 0; n < most && bus_.try_receive(f); ++n) {
    if (client_.hear(f)) heard_ = now;
    tell_taps(now, f);
  }
  if (news().others != others_) {
    others_ = news().others;
    other_ = now;
    other_status_ = news().statuses;
  }
  if (attendant_.meanwhile) attendant_.meanwhile();
  if (now - heard_ > milliseconds(silence_ms))
    throw ControllerSilent(fmt::format("no controller with base_id 0x{:03x} was heard for {} s on {}",
                                       client_.base(), silence_ms / 1000, bus_.name()));
  if (alive_ == Alive::no || now - alive_at_ < alive_period || news().statuses == answered_status_) return;
  if (alive_ == Alive::unless_another && another()) return;
  if (attendant_.present && !attendant_.present()) return;
  alive_at_ = now;
  answered_status_ = news().statuses;
  send(client_.order(link::Order::none));
}

void Connection::ask(const std::function<void()>& ask, const std::function<bool()>& answered,
                     const char* what) {
  const auto give_up = Clock::now() + std::chrono::duration<double>(answer_seconds);
  while (!answered()) {
    if (Clock::now() > give_up) throw RunError(fmt::format("the controller does not answer: no {}", what));
    ask();
    (void)until(answered, 0.2, false);
  }
}

void Connection::read_parameters() {
  std::array<std::uint32_t, link::parameter_count> before{};
  for (int round = 0; round < 10; ++round) {
    for (std::size_t i = 0; i < before.size(); ++i) before[i] = news().parameter[i].heard;
    const auto missing = [&](std::uint8_t i) { return news().parameter[i].heard == before[i]; };
    ask(
        [&] {
          for (std::uint8_t i = 0; i < link::parameter_count; ++i) {
            if (missing(i)) send(client_.request(link::Subject::parameter, i));
          }
          send(client_.request(link::Subject::table));
        },
        [&] {
          bool all = true;
          for (std::uint8_t i = 0; i < link::parameter_count; ++i) all = all && !missing(i);
          return all;
        },
        "Parameter_Value");
    link::Parameters::Values values{};
    for (std::size_t i = 0; i < values.size(); ++i) values[i] = news().parameter[i].value;
    const std::uint32_t crc = link::Parameters(values, {}).crc();
    if (until([&] { return news().table == crc; }, 0.5, false) == Waited::done) return;
  }
  throw RunError(
      "the parameters do not fit the checksum of the controller's table: another program writes them, or "
      "frames get lost");
}

link::Answer Connection::write(std::uint8_t index, float value) {
  const std::uint32_t before = news().parameter[index].heard;
  ask([&] { send(client_.write(index, value)); }, [&] { return news().parameter[index].heard != before; },
      "Parameter_Value");
  return news().parameter[index].answer;
}

link::Counters Connection::fenced_counters() {
  // Frames are judged in their order: the answer to a later question shows that those before it were.
  fence_ = static_cast<std::uint8_t>((fence_ + 1U) % link::parameter_count);
  const std::uint32_t values = news().parameter[fence_].heard;
  ask([&] { send(client_.request(link::Subject::parameter, fence_)); },
      [&] { return news().parameter[fence_].heard != values; }, "Parameter_Value");
  const std::uint32_t counters = news().counter_frames;
  ask([&] { send(client_.request(link::Subject::table)); }, [&] { return news().counter_frames != counters; },
      "Link_Counters");
  return *news().counters;
}

bool Connection::obeyed(const std::function<hal::CanFrame()>& frame, const std::function<bool()>& done) {
  link::Counters before = fenced_counters();
  for (unsigned n = 0; n < counter_values; ++n) {
    if (done()) return true;
    // Right after another computer's sign of life its counter is known, and its next one will follow ours.
    if (const std::uint32_t others = others_; another())
      (void)until([&] { return others_ != others; }, 1.0, false);
    send(frame());
    const link::Counters after = fenced_counters();
    if (done()) return true;
    if (after.bad_counter == before.bad_counter && after.bad_crc == before.bad_crc)
      return after.refused == before.refused;
    before = after;  // out of step
  }
  throw RunError(
      "the controller does not accept the alive counter: another supervisor computer sends on this bus");
}

void Connection::read_faults() {
  client_.forget_faults();
  ask(
      [&] {
        if (const auto f = client_.request_faults()) send(*f);
      },
      [&] { return news().readout_over; }, "Fault_Record");
}

}  // namespace esmc::host
