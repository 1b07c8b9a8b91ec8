#pragma once
/// The record of faults that the supervisor computer can read.

#include <array>
#include <cstdint>

#include "firmware/link/link_types.hpp"

namespace esmc::link {

/// One record per fault: number of occurrences; time, motor and drive error of the last one.
class FaultMemory {
 public:
  /// Records and queues faults that are new in this tick; call once per tick. `time_us`: since power-up. Of
  /// `report` axis, drive_error and encoder count.
  void update(const Supervisor& s, std::uint32_t time_us, const Report& report) {
    for (unsigned i = 1; i < count; ++i) {
      FaultRecord& r = records_[i];
      const std::uint16_t n = s.count(r.fault = static_cast<Fault>(i));
      if (n == r.count) continue;
      const bool of_encoder = r.fault == Fault::loop_not_closed && report.axis == no_axis;
      r = {r.fault, of_encoder ? report.encoder : report.axis, n, time_us, report.drive_error};
      pending_[i] = true;
      if (i == detail_of_) detail_of_ = 0;  // the record that was sent is no longer the present one
    }
  }
  /// Queues the records of all faults that have occurred, and the end mark.
  void read_out() {
    for (unsigned i = 1; i < count; ++i) pending_[i] = pending_[i] || records_[i].count > 0;
    pending_[0] = true;
  }
  /// Sends the next frame of a queued record, of `first` before others; the second frame of a record follows
  /// in the next call. A frame that the bus does not take stays queued. False: nothing is queued.
  template <class Send>
  bool transmit(std::uint32_t base, Fault first, Send&& send) {
    unsigned i = detail_of_ != 0 ? detail_of_ : static_cast<unsigned>(first);
    if (i == 0 || !pending_[i]) {
      for (i = 1; i < count && !pending_[i]; ++i) {
      }
      if (i == count) i = 0;
    }
    if (!pending_[i]) return false;
    FaultRecord r = records_[i];
    if (i == 0) r.count = distinct();
    const bool second = detail_of_ != 0;
    if (!send(second ? encode_fault_detail(base, r) : encode_fault_record(base, r))) return true;
    detail_of_ = second ? 0 : i;
    pending_[i] = detail_of_ != 0;
    return true;
  }

 private:
  static constexpr unsigned count = static_cast<unsigned>(fault_count);
  [[nodiscard]] std::uint16_t distinct() const {
    std::uint16_t n = 0;
    for (const FaultRecord& r : records_) n = static_cast<std::uint16_t>(n + (r.count > 0 ? 1 : 0));
    return n;
  }

  std::array<FaultRecord, count> records_{};
  std::array<bool, count> pending_{};
  unsigned detail_of_ = 0;  // fault whose first frame has been sent
};

}  // namespace esmc::link
