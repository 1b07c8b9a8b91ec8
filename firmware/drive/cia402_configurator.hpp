#pragma once
/// Carries out cia402::setup on a drive by SDO: one request at a time, each sent at most four times.

#include <cstdint>
#include <optional>

#include "firmware/drive/cia402_setup.hpp"

namespace esmc::drive {

/// Carries out cia402::setup on one drive: the present entry and the request that waits for its answer.
class Cia402Configurator {
 public:
  /// Starts with the first entry and clears refused(); config_mismatch() stays.
  void begin() {
    entry_ = 0;
    refused_.reset();
    limit_unread_ = false;
    begin_transfer(false);
  }
  void clear_mismatch() { config_mismatch_ = false; }  ///< clears config_mismatch(); refused() stays

  [[nodiscard]] bool in_flight() const { return in_flight_; }  ///< a request waits for its answer
  /// True if the request in flight was sent four times without an answer.
  [[nodiscard]] bool exhausted() const { return sent_ > repetitions_max; }
  /// True once a value read back was not the required one or the drive refused; until clear_mismatch().
  [[nodiscard]] bool config_mismatch() const { return config_mismatch_; }
  /// The last object with a wrong value or a refusal; empty: none since begin().
  [[nodiscard]] std::optional<canopen::Object> refused() const { return refused_; }
  /// N m at the shaft per thousandth of the rated torque, as read from the drive; 0 before.
  [[nodiscard]] float torque_lsb() const { return rated_torque_ / 1000.0F; }
  /// Rated torque, N m at the shaft, as read from the drive; 0 before.
  [[nodiscard]] float rated_torque() const { return rated_torque_; }

  /// True if the drive has no object 6072 (maximum torque): its limit was not compared with torque_limit.
  [[nodiscard]] bool limit_unread() const { return limit_unread_; }

  /// Sends the read or write of the present entry, again if it is in flight. False: the bus did not take it,
  /// nothing has changed. Not to be called after the last entry is complete.
  template <class Send>
  bool request(Send&& send, const Cia402Settings& settings, std::uint8_t node) {
    const cia402::Entry& e = cia402::setup[entry_];
    const bool reads = reading_ || e.task >= cia402::Task::expect;
    const hal::CanFrame f =
        reads ? canopen::encode_sdo_read(node, e.object)
              : canopen::encode_sdo_write(node, e.object, cia402::value_of(e, settings, node), e.bytes);
    if (!send(f)) return false;
    reading_ = reads;
    in_flight_ = true;
    ++sent_;
    return true;
  }

  /// Takes an answer of the drive. True: it completes the last entry; false: more entries, a mismatch, or an
  /// answer to no request, which has no effect.
  bool take(const canopen::Sdo& reply, const Cia402Settings& settings, std::uint8_t node) {
    const cia402::Entry& e = cia402::setup[entry_];
    if (!in_flight_ || !(reply.object == e.object)) return false;
    if (reply.kind == canopen::SdoKind::abort) {
      if (e.task != cia402::Task::attempt && !(e.optional && cia402::absent(reply.value))) {
        refuse(e);
        return false;
      }
      if (e.task == cia402::Task::at_least) limit_unread_ = true;
      return next_entry();
    }
    if (reply.kind == (reading_ ? canopen::SdoKind::value : canopen::SdoKind::written)) {
      if (!reading_ && e.task == cia402::Task::verify) {
        begin_transfer(true);
      } else if (!reading_ || agrees(e, reply, settings, node)) {
        return next_entry();
      } else {
        refuse(e);
      }
    }
    return false;
  }

 private:
  void begin_transfer(bool reading) {
    reading_ = reading;
    in_flight_ = false;
    sent_ = 0;
  }
  /// True: there was no further one.
  bool next_entry() {
    begin_transfer(false);
    return ++entry_ == cia402::setup.size();
  }
  void refuse(const cia402::Entry& e) {
    config_mismatch_ = true;
    refused_ = e.object;
  }
  /// The value read is the required one.
  bool agrees(const cia402::Entry& e, const canopen::Sdo& reply, const Cia402Settings& settings,
              std::uint8_t node) {
    if (reply.size != 0 && reply.size != e.bytes) return false;
    const std::uint32_t used = e.bytes == 4 ? 0xFFFF'FFFFU : (1U << (8U * e.bytes)) - 1U;
    const std::uint32_t value = reply.value & used;
    if (e.task == cia402::Task::rated) {
      rated_torque_ = static_cast<float>(value) * settings.rated_torque_unit;
      const float off = rated_torque_ - settings.rated_torque, allowed = 0.01F * rated_torque_;
      return rated_torque_ > 0.0F && off <= allowed && -off <= allowed;
    }
    if (e.task == cia402::Task::at_least) {
      // 0.9999: rounding of the scale.
      return static_cast<float>(value) * torque_lsb() >= settings.torque_limit * 0.9999F;
    }
    const std::uint32_t wanted = cia402::value_of(e, settings, node) & used;
    return ((value ^ wanted) & e.mask) == 0;
  }

  static constexpr std::uint8_t repetitions_max = 3;

  float rated_torque_ = 0.0F;
  std::optional<canopen::Object> refused_;
  std::uint8_t entry_ = 0;
  std::uint8_t sent_ = 0;   // times that the request in flight was sent
  bool in_flight_ = false;  // a request waits for its answer
  bool reading_ = false;    // the request in flight, or the next one, is a read
  bool config_mismatch_ = false;
  bool limit_unread_ = false;
};

}  // namespace esmc::drive
