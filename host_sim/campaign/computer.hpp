#pragma once
/// A supervisor computer that passes the operator's orders on over the command interface, and may vanish.

#include <cstdint>
#include <utility>

#include "host_sim/campaign/judge.hpp"
#include "host_sim/operate/link_client.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

/// Sends a sign of life every second tick and orders; receives the controller's status.
class Computer {
 public:
  /// `scene` has [command].
  explicit Computer(const Scene& scene) : link_(static_cast<std::uint32_t>(scene.command->base_id)) {}

  /// Takes a frame of the bus; it uses the controller's status and parameter table, and no other.
  void hear(const hal::CanFrame& f) { (void)link_.hear(f); }
  /// Call once per tick: gives `send` the computer's frames. `wanted` replaces an order that still waits: for
  /// the first status, and an order to arm for the parameter table. Returns the order sent in this tick.
  template <class Send>
  Operator act(Operator wanted, const Send& send) {
    if (wanted != Operator::nothing) wanted_ = wanted;
    const bool session = link_.news().status.has_value(), table = link_.news().table.has_value();
    if (session && !table && !asked_) {
      asked_ = true;
      send(link_.request(link::Subject::table));
    }
    if (++ticks_ % 2 == 0) send(link_.order(link::Order::none));
    if (wanted_ == Operator::nothing || !session || (wanted_ == Operator::enable && !table))
      return Operator::nothing;
    const Operator asked = std::exchange(wanted_, Operator::nothing);
    constexpr link::Order orders[] = {link::Order::none, link::Order::arm, link::Order::off,
                                      link::Order::disarm, link::Order::reset};  // as enum Operator
    send(link_.order(orders[static_cast<std::size_t>(asked)]));
    return asked;
  }

 private:
  LinkClient link_;
  std::uint64_t ticks_ = 0;
  bool asked_ = false;
  Operator wanted_ = Operator::nothing;
};

}  // namespace esmc::host
