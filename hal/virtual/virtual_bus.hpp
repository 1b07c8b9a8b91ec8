#pragma once
/// A CAN bus inside one process: every frame reaches every other port at once, in the order of sending.
/// Deterministic, without threads and time.

#include <array>
#include <cstddef>

#include "hal/can.hpp"

namespace esmc::hal {

/// A bus of `Ports` nodes that receive each other's frames.
template <std::size_t Ports>
class VirtualBus {
 public:
  /// CanBus of one node. If one receiver already holds `capacity` frames, no node gets the frame (bus_full).
  class Port {
   public:
    static constexpr std::size_t capacity = 256;

    [[nodiscard]] SendStatus try_send(const CanFrame& f) { return bus_->send(*this, f); }
    [[nodiscard]] bool try_receive(CanFrame& f) {
      if (count_ == 0) return false;
      copy_used(queue_[first_], f);
      first_ = (first_ + 1) % capacity;
      // Reuse the slots that are in the cache: a queue is mostly emptied between ticks.
      if (--count_ == 0) first_ = 0;
      return true;
    }
    [[nodiscard]] std::size_t waiting() const { return count_; }  ///< frames not received yet

   private:
    friend class VirtualBus;
    VirtualBus* bus_ = nullptr;
    std::array<CanFrame, capacity> queue_{};
    std::size_t first_ = 0, count_ = 0;
  };

  VirtualBus() {
    for (Port& p : ports_) p.bus_ = this;
  }
  VirtualBus(const VirtualBus&) = delete;
  VirtualBus& operator=(const VirtualBus&) = delete;

  [[nodiscard]] Port& port(std::size_t i) { return ports_[i]; }  ///< i < Ports, not checked

 private:
  SendStatus send(const Port& from, const CanFrame& f) {
    if (!well_formed(f)) return SendStatus::refused;
    for (const Port& p : ports_) {
      if (&p != &from && p.count_ == Port::capacity) return SendStatus::bus_full;
    }
    for (Port& p : ports_) {
      if (&p == &from) continue;
      copy_used(f, p.queue_[(p.first_ + p.count_) % Port::capacity]);
      ++p.count_;
    }
    return SendStatus::ok;
  }

  std::array<Port, Ports> ports_{};
};

static_assert(CanBus<VirtualBus<2>::Port>);

}  // namespace esmc::hal
