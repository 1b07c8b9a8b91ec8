#pragma once
/// A supervisor computer that passes the operator's orders on over the command interface, and may vanish.

#include <cstdint>
#include <optional>
#include <utility>

#include "firmware/link/codec.hpp"
#include "host_sim/campaign/judge.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

/// Sends a sign of life every second tick and orders; receives the controller's status.
class Computer {
 public:
  /// `scene` has [command].
  explicit Computer(const Scene& scene) : base_(static_cast<std::uint32_t>(scene.command->base_id)) {}

  /// Takes a frame of the bus; it uses the controller's status and parameter table, and no other.
  void hear(const hal::CanFrame& f) {
    if (f.id == base_ + static_cast<std::uint32_t>(link::Message::status)) {
      tick_ = static_cast<std::uint16_t>(f.data[4] | f.data[5] << 8);
      session_ = f.data[7];
    } else if (f.id == base_ + static_cast<std::uint32_t>(link::Message::parameter_table)) {
      table_ = static_cast<std::uint16_t>(f.data[0] | f.data[1] << 8);
    }
  }
  /// Call once per tick: gives `send` the computer's frames. `wanted` replaces an order that still waits: for
  /// the first status, and an order to arm for the parameter table. Returns the order sent in this tick.
  template <class Send>
  Operator act(Operator wanted, const Send& send) {
    if (wanted != Operator::nothing) wanted_ = wanted;
    if (session_ && !table_ && !asked_) {
      asked_ = true;
      send(sealed(link::Message::request, static_cast<std::uint8_t>(link::Subject::table)));
    }
    if (++ticks_ % 2 == 0) send(order(link::Order::none));
    if (wanted_ == Operator::nothing || !session_ || (wanted_ == Operator::enable && !table_))
      return Operator::nothing;
    const Operator asked = std::exchange(wanted_, Operator::nothing);
    constexpr link::Order orders[] = {link::Order::none, link::Order::arm, link::Order::off,
                                      link::Order::disarm, link::Order::reset};  // as enum Operator
    send(order(orders[static_cast<std::size_t>(asked)]));
    return asked;
  }

 private:
  hal::CanFrame order(link::Order o) {
    return sealed(link::Message::command, static_cast<std::uint8_t>(o), tick_, table_.value_or(0));
  }
  hal::CanFrame sealed(link::Message m, std::uint8_t what, std::uint16_t first = 0,
                       std::uint16_t second = 0) {
    hal::CanFrame f = link::detail::frame(base_, m);
    std::uint8_t& counter = m == link::Message::command ? orders_ : requests_;
    counter = (counter + 1) & 0x0F;
    f.data[1] = counter;
    f.data[2] = what;
    hal::put_field(f, 4, first, 2);
    hal::put_field(f, 6, second, 2);
    f.data[0] = link::checksum(f, session_.value_or(link::any_session));
    return f;
  }

  std::uint32_t base_;
  std::uint64_t ticks_ = 0;
  std::uint16_t tick_ = 0;
  std::optional<std::uint8_t> session_;
  std::optional<std::uint16_t> table_;
  std::uint8_t orders_ = 0, requests_ = 0;
  bool asked_ = false;
  Operator wanted_ = Operator::nothing;
};

}  // namespace esmc::host
