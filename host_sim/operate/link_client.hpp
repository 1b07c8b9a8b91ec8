#pragma once
/// The supervisor computer's end of the command interface: makes its frames and reads those of the
/// controller. Bytes and state alone: no bus, no clock. docs/command-interface.md is the contract.

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <vector>

#include "firmware/link/codec.hpp"

namespace esmc::host {

/// Status of an intact frame of a controller at `base`; empty: another frame, a wrong checksum, or a value
/// without a name.
[[nodiscard]] std::optional<link::Status> decode_status(const hal::CanFrame& f, std::uint32_t base);

/// Which ticks a controller has kept.
struct CaptureNews {
  link::CaptureState state = link::CaptureState::none;
  std::uint16_t count = 0, recorded = 0;
  std::uint32_t heard = 0;  ///< how often it was said
};

/// What a controller has said last. Telemetry and records carry no checksum: nothing is decided by them.
struct ControllerNews {
  static constexpr unsigned parameters_max = 16;
  using Values = std::array<float, 4 + 2 * link::joints_max>;
  /// Parameter_Value; its value need not be finite.
  struct Parameter {
    link::Answer answer = link::Answer::ok;
    bool writable = false;
    float value = 0.0F;
    std::uint32_t heard = 0;  ///< how many came so far
  };

  std::optional<link::Status> status;
  std::optional<std::array<float, 2>> effector, error;                      ///< m, of one tick
  std::array<std::optional<std::array<float, 2>>, link::joints_max> joint;  ///< rad, N m
  std::optional<std::uint32_t> scene;                                       ///< of Identity
  std::uint8_t version = 0;                                                 ///< of Identity
  bool unattended = false;                                                  ///< of Identity
  std::optional<std::uint32_t> table;                                       ///< CRC-32 of the parameters
  std::optional<link::Counters> counters;
  std::optional<link::StoreStatus> store;
  std::array<Parameter, parameters_max> parameter;
  std::vector<link::FaultRecord> faults;  ///< of the last readout, or since then
  bool readout_over = false;              ///< all records have come
  CaptureNews capture;
  std::map<std::uint16_t, link::CapturePart> capture_parts;       ///< by number
  std::uint32_t statuses = 0, counter_frames = 0, telemetry = 0;  ///< frames heard
  std::uint64_t ticks = 0;   ///< of the controller since the first Status, unless it starts again
  std::uint32_t others = 0;  ///< orders and signs of life of another computer

  /// The effector, m; empty: none was heard, or the controller has no pose, for which it sends 0 and 0.
  [[nodiscard]] std::optional<std::array<float, 2>> pose() const;
  /// The telemetry: x, y, their errors, then angle and torque of each motor; NaN where none was heard.
  [[nodiscard]] Values values() const;
};

/// One controller as a supervisor computer sees it.
class LinkClient {
 public:
  /// `base`: first identifier of the block, a multiple of link::block_size.
  explicit LinkClient(std::uint32_t base) : base_(base) {}

  [[nodiscard]] std::uint32_t base() const { return base_; }
  [[nodiscard]] const ControllerNews& news() const { return news_; }
  /// Of the last Status; link::any_session before the first one.
  [[nodiscard]] std::uint8_t session() const {
    return news_.status ? news_.status->session : link::any_session;
  }

  /// Takes a frame of the bus. Others than this controller's are ignored, but for intact ones of another
  /// supervisor computer: its alive counter is followed, so that both stay in step. Returns whether the frame
  /// was an intact Status.
  bool hear(const hal::CanFrame& f);

  // Frames to the controller, each with the next alive counter and the checksum of the session.

  /// An order that answers the last Status, with the checksum of the parameter table if it is known.
  /// `percent`: of override.
  hal::CanFrame order(link::Order o, std::uint8_t percent = 0);
  /// Positions in m or rad. Empty: not finite, or beyond the 24 bits of the wire.
  std::optional<hal::CanFrame> set_point(link::Space space, const std::array<double, 2>& position);
  /// A sample: its two frames, with one counter. Empty as set_point(); velocities in m/s or rad/s.
  std::optional<std::array<hal::CanFrame, 2>> sample(link::Space space, const std::array<double, 2>& position,
                                                     const std::array<double, 2>& velocity);
  hal::CanFrame write(std::uint8_t index, float value);
  /// Forgets the fault records, before a readout.
  void forget_faults() {
    news_.faults.clear();
    news_.readout_over = false;
    record_tick_.reset();
  }
  /// The request for a readout: at first, and after 20 ticks of the controller without a record. A request
  /// makes the controller begin anew, so that one of a low rate would end no readout that is asked for often.
  std::optional<hal::CanFrame> request_faults();
  /// Forgets the parts of captured ticks, before a readout.
  void forget_capture() { news_.capture_parts.clear(); }
  hal::CanFrame request(link::Subject subject, std::uint8_t index = 0);

 private:
  hal::CanFrame frame(link::Message m, std::uint8_t high_bits = 0);
  [[nodiscard]] hal::CanFrame sealed(hal::CanFrame f) const;
  std::optional<hal::CanFrame> pair(link::Message m, link::Space space, const std::array<double, 2>& v,
                                    double unit);
  void read_tracking_error(const hal::CanFrame& f);
  void read_value(const hal::CanFrame& f);
  void read_record(link::Message m, const hal::CanFrame& f);
  void read_store(const hal::CanFrame& f);
  void read_capture(const hal::CanFrame& f);

  std::uint32_t base_;
  ControllerNews news_;
  std::optional<std::array<float, 2>> effector_;  ///< whose tracking error is still to come
  std::optional<std::uint64_t> record_tick_;      ///< of the last record or request of this readout
  std::array<std::uint8_t, link::incoming_count> counter_{};
};

}  // namespace esmc::host
