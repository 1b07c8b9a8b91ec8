#pragma once
/// A CAN bus in virtual time: arbitration, error counters and bus-off after ISO 11898-1, and the
/// disturbances of a scene. The caller moves time. Deterministic for a seed.

#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <vector>

#include "hal/can.hpp"
#include "host_sim/bus/wire.hpp"
#include "host_sim/effects/effects.hpp"
#include "host_sim/effects/random.hpp"

namespace esmc::host {

/// Fault confinement of one node: the error counters of ISO 11898-1, which the events below change.
class ErrorCounters {
 public:
  enum class State : std::uint8_t { active, passive, off };
  [[nodiscard]] int transmit() const { return transmit_; }
  [[nodiscard]] int receive() const { return receive_; }
  [[nodiscard]] State state() const {
    if (transmit_ > 255) return State::off;
    return transmit_ > 127 || receive_ > 127 ? State::passive : State::active;
  }
  void sent() { transmit_ -= transmit_ > 0 ? 1 : 0; }
  void transmit_error() { transmit_ += 8; }
  /// Counts a good frame received, which takes the counter back below the limit of passive.
  void received() { receive_ = receive_ > 127 ? 119 : receive_ - (receive_ > 0 ? 1 : 0); }
  void receive_error() { receive_ += receive_ < 255 ? 1 : 0; }
  void give_up() { transmit_ = 256; }         ///< to bus-off at once
  void reset() { transmit_ = receive_ = 0; }  ///< to active

 private:
  int transmit_ = 0, receive_ = 0;
};

class TimedBus {
 public:
  using Time = std::int64_t;                       ///< bit times since the bus began
  static constexpr std::size_t controller = 0;     ///< node; drive i of the scene is node i + 1
  static constexpr std::size_t queue_frames = 10;  ///< per node: Linux's default for a CAN interface
  static constexpr std::uint32_t error_frame_bits =
      12 + 8 + interframe_bits;                     ///< two flags, one after the other
  static constexpr std::uint32_t suspend_bits = 8;  ///< that a passive node waits after its own frame

  struct Config {
    std::size_t drives = 0;  ///< <= 14
    double bitrate = 1e6;    ///< bit/s
    std::vector<Effect> effects;
    std::uint64_t seed = 1;
    double fast_bit = 0.0;  ///< time of a bit of CAN FD data, in bit times; 0: the bus is classic
  };
  struct Delivery {
    Time at = 0;                  ///< last bit of the frame; its interframe space follows
    hal::CanFrame frame;          ///< as received
    std::uint32_t receivers = 0;  ///< bit i: node i has it
    std::uint32_t bits = 0;       ///< on the wire
    Time asked = 0;               ///< instant of the request to send
  };
  /// Latency of the frames of one identifier: from the request to send to the last bit.
  struct Latency {
    std::uint32_t key = 0, id = 0;
    bool extended = false;
    std::uint64_t frames = 0;
    Time largest = 0, sum = 0;
  };
  struct Counts {
    std::uint64_t refused = 0;  ///< the node's queue was full, or it was not on the bus
    std::uint64_t errors = 0;   ///< error frames, each followed by a retransmission
    std::uint64_t missed = 0;   ///< frames times receivers that missed them
    std::uint64_t duplicated = 0;
    std::uint64_t corrupted = 0;  ///< accepted with flipped bits
  };

  explicit TimedBus(const Config& config);

  [[nodiscard]] Time now() const { return now_; }                                           ///< bit times
  [[nodiscard]] double seconds(Time t) const { return static_cast<double>(t) / bitrate_; }  ///< t in s
  /// Makes now t = 0 of the scene. Latencies count from here on, without the frames of arming.
  void begin_run() {
    origin_ = now_;
    latency_.clear();
  }

  /// Asks `node` to send; the frame waits behind those of the same identifier. refused: ill-formed, or CAN FD
  /// on a classic bus; bus_off; bus_full: its queue is full or the node cut off.
  hal::SendStatus send(std::size_t node, const hal::CanFrame& f);
  /// Moves time to the end of the next frame, which it returns; if none ends by `until`, to `until`: empty.
  std::optional<Delivery> next(Time until);
  /// Whether no frame is on the wire and no node has one to send now.
  [[nodiscard]] bool quiet();

  /// Restarts a node in bus-off: it returns after 128 times 11 recessive bits. No effect on another node.
  void restart(std::size_t node);
  [[nodiscard]] ErrorCounters counters(std::size_t node);  ///< of a node, now
  [[nodiscard]] const Counts& counts() const { return counts_; }
  [[nodiscard]] const std::vector<Latency>& latencies() const { return latency_; }  ///< since begin_run()
  [[nodiscard]] std::uint64_t busy_bits() const { return busy_; }  ///< frames and error frames

 private:
  struct Pending {
    hal::CanFrame frame;
    std::uint32_t key = 0;
    Time asked = 0;
    bool again = false;  ///< the receivers have it already
  };
  struct Node {
    std::vector<Pending> queue;
    ErrorCounters errors;
    Time not_before = 0;  ///< suspended until then
    bool restarting = false;
    int sequences = 0;        ///< of 11 recessive bits, since its restart
    Time recessive_from = 0;  ///< the bus is recessive, and not counted yet, from here on
  };
  enum class Outcome : std::uint8_t { good, disturbed, unacknowledged, collided };
  struct Flight {
    Time begin = 0, end = 0;  ///< end: of the last bit, or of the bit in which the error is seen
    std::uint32_t senders = 0, receivers = 0;
    std::uint32_t losers = 0;  ///< dropped out of a collision
    std::uint32_t bits = 0;
    Pending what;
    Outcome outcome = Outcome::good;
  };

  [[nodiscard]] bool during(const Span& s) const;
  [[nodiscard]] bool connected(std::size_t node) const;
  [[nodiscard]] bool online(std::size_t node);
  void refresh(std::size_t node);
  [[nodiscard]] std::optional<Time> babble_time() const;
  void babble();
  [[nodiscard]] static Pending* front(Node& n);
  [[nodiscard]] std::optional<Time> next_start();
  void start();
  [[nodiscard]] Time settle_collision(Flight& f);
  std::optional<Delivery> finish();
  Delivery deliver(const Flight& f);
  void blame(std::size_t node);
  void end_frame(const Flight& f, std::uint32_t trailing);
  void account(const Pending& p);
  void corrupt(hal::CanFrame& f);

  double bitrate_, fast_bit_;
  bool timed_;
  std::optional<Loss> loss_;
  std::optional<Duplication> duplication_;
  std::optional<Corruption> corruption_;
  std::optional<BabblingNode> babbler_;
  std::optional<BusOff> off_;
  std::optional<DriveDropout> dropout_;
  Uniform loss_random_, duplication_random_, corruption_random_, babble_random_;
  std::vector<Node> nodes_;
  std::optional<Flight> flight_;
  std::optional<Time> origin_;
  Time now_ = 0, free_ = 0;  ///< free_: the first bit that a frame may begin in
  Time babble_at_ = 0;
  bool was_off_ = false;
  Counts counts_;
  std::vector<Latency> latency_;
  std::uint64_t busy_ = 0;
};

/// A node's access to the bus, which must outlive it, with the frames that wait to be read.
class BusPort {
 public:
  BusPort(TimedBus& bus, std::size_t node) : bus_(&bus), node_(node) {}
  [[nodiscard]] hal::SendStatus try_send(const hal::CanFrame& f) { return bus_->send(node_, f); }
  [[nodiscard]] bool try_receive(hal::CanFrame& f) {
    if (waiting_.empty()) return false;
    f = waiting_.front();
    waiting_.pop_front();
    return true;
  }
  [[nodiscard]] std::size_t waiting() const { return waiting_.size(); }  ///< frames to be read
  void deliver(const hal::CanFrame& f) { waiting_.push_back(f); }        ///< to be read by try_receive()

 private:
  TimedBus* bus_;
  std::size_t node_;
  std::deque<hal::CanFrame> waiting_;
};
static_assert(hal::CanBus<BusPort>);

}  // namespace esmc::host
