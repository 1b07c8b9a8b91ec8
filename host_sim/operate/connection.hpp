#pragma once
/// A console's connection to one controller on a bus: frames in and out, the sign of life, questions and
/// their answers.

#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <vector>

#include "firmware/link/parameters.hpp"
#include "host_sim/bus/host_bus.hpp"
#include "host_sim/error.hpp"
#include "host_sim/loop/waiting.hpp"
#include "host_sim/operate/link_client.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

/// The controller refuses, or has a fault; the text begins with the name of the reason. Exit 1.
class Refused : public RunError {
 public:
  using RunError::RunError;
};

/// The controller has been silent for silence_ms; it may come back.
class ControllerSilent : public RunError {
 public:
  using RunError::RunError;
};

/// Base identifiers of the controllers that send Status on a bus: listens until the first is found,
/// `patience` at most, and then as long as another one may take. Sends nothing.
std::vector<std::uint32_t> find_controllers(HostBus& bus, std::chrono::milliseconds patience);

class Connection {
 public:
  using Clock = std::chrono::steady_clock;
  /// Takes a frame that passed, sent from here or received, and when: us since the connection began.
  using Tap = std::function<void(std::int64_t time_us, const hal::CanFrame&)>;

  /// Waits for a Status and an Identity of the controller at `base`. Throws RunError when nothing is heard,
  /// and for a later version of the protocol. `bus` must outlive this.
  Connection(HostBus& bus, std::uint32_t base);
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  [[nodiscard]] const ControllerNews& news() const { return client_.news(); }
  [[nodiscard]] const link::Status& status() const { return *client_.news().status; }
  [[nodiscard]] LinkClient& client() { return client_; }
  [[nodiscard]] HostBus& bus() { return bus_; }
  /// s since the last frame of the controller.
  [[nodiscard]] double silent_s() const {
    return std::chrono::duration<double>(Clock::now() - heard_).count();
  }
  std::map<const void*, Tap> taps;  ///< by owner: every frame goes to them as well

  enum class Alive : std::uint8_t {
    no,
    unless_another,  ///< only while no other supervisor computer is heard: two of them would confuse the
                     ///< alive counter
    always,          ///< of the console that has armed
  };
  /// Sends a sign of life from now on, at most every 20 ms and for each Status.
  void keep_alive(Alive how);

  /// What the operator's page adds to every wait of this connection. Empty functions: nothing.
  struct Attendant {
    std::function<void()> meanwhile;  ///< in every pump(); may send(), but not pump()
    std::function<bool()> present;    ///< asked for each sign of life that is due: whether it may be sent
    std::function<bool()> stops;      ///< whether waits end now, as after Ctrl-C
  };
  void attend(Attendant a) { attendant_ = std::move(a); }
  /// Whether waits end: Ctrl-C, or the attendant stops them.
  [[nodiscard]] bool stopped() const { return stop_requested() || (attendant_.stops && attendant_.stops()); }

  /// Sends a frame; waits for the bus to take it. Throws RunError when the bus is gone.
  void send(const hal::CanFrame& f);
  /// Reads the frames that wait, up to `patience` for the first, and sends the sign of life when it is due.
  /// Throws BusGone, or ControllerSilent after the attendant's turn.
  void pump(std::chrono::nanoseconds patience);
  /// Pumps until done(); `stoppable`: or stopped().
  template <class Done>
  Waited until(const Done& done, double seconds, bool stoppable = true) {
    const auto end = Clock::now() + std::chrono::duration<double>(seconds);
    while (!done()) {
      if (stoppable && stopped()) return Waited::stopped;
      if (Clock::now() > end) return Waited::silent;
      pump(std::chrono::milliseconds(5));
    }
    return Waited::done;
  }

  /// Reads all parameters, until their checksum is that of the controller's table.
  void read_parameters();
  [[nodiscard]] float parameter(link::Index i) const {
    return news().parameter[static_cast<std::size_t>(i)].value;
  }
  /// s of so many ticks.
  template <class Count>
  [[nodiscard]] double seconds(Count ticks) const {
    return static_cast<double>(ticks) * static_cast<double>(parameter(link::Index::sample_time));
  }
  /// Writes a parameter and returns the answer.
  link::Answer write(std::uint8_t index, float value);
  /// Sends a frame until it arrives in step, and returns whether the controller obeyed. `done`: an effect
  /// that shows it as well.
  bool obeyed(
      const std::function<hal::CanFrame()>& frame, const std::function<bool()>& done = [] { return false; });
  bool obeyed(
      link::Order o, const std::function<bool()>& done = [] { return false; }) {
    return obeyed([&] { return client_.order(o); }, done);
  }
  /// Reads the fault records.
  void read_faults();

 private:
  void tell_taps(Clock::time_point now, const hal::CanFrame& f) const {
    for (const auto& [owner, to] : taps)
      to(std::chrono::duration_cast<std::chrono::microseconds>(now - begin_).count(), f);
  }
  static constexpr double answer_seconds =
      20.0;  // of a slow controller on a busy machine; mostly a few ticks

  /// Sends 15 frames: one of them is in step, whatever counter an earlier program has left.
  void get_in_step(const std::function<hal::CanFrame()>& frame);
  /// Asks with frames of `ask` every 0.2 s until `answered`. Throws RunError without an answer.
  void ask(const std::function<void()>& ask, const std::function<bool()>& answered, const char* what);
  /// The counters after all frames sent so far.
  link::Counters fenced_counters();

  HostBus& bus_;
  LinkClient client_;
  Attendant attendant_;
  /// Whether another supervisor computer was heard just now.
  [[nodiscard]] bool another() const {
    return others_ > 0 &&
           (Clock::now() - other_ < std::chrono::milliseconds(200) || news().statuses - other_status_ < 3);
  }

  Alive alive_ = Alive::no;
  std::uint8_t fence_ = 0;
  std::uint32_t answered_status_ = 0, others_ = 0, other_status_ = 0;
  Clock::time_point begin_ = Clock::now(), heard_ = begin_, alive_at_{}, other_{};
};

}  // namespace esmc::host
