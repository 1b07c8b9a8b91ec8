#pragma once
/// The CAN bus of a command: an interface of Linux, an adapter on a serial line, or a recording.

#include <poll.h>

#include <memory>
#include <string>
#include <utility>
#include <variant>

#include "hal/linux/byte_port.hpp"
#include "hal/linux/socketcan.hpp"
#include "host_sim/bus/recorded_bus.hpp"

namespace esmc::host {

class HostBus {
 public:
  /// `name`: for messages. A recording must outlive the bus.
  HostBus(std::string name, hal::SocketCan socket) : name_(std::move(name)), bus_(std::move(socket)) {}
  HostBus(std::string name, std::unique_ptr<hal::SlcanAdapter> adapter)
      : name_(std::move(name)), bus_(std::move(adapter)) {}
  explicit HostBus(RecordedBus& recorded) : name_(recorded.interface()), bus_(&recorded) {}

  [[nodiscard]] const std::string& name() const { return name_; }  ///< for messages
  /// Name for frames.log: "slcan" on a serial line, else name().
  [[nodiscard]] std::string interface() const { return serial() ? "slcan" : name_; }

  hal::SendStatus try_send(const hal::CanFrame& f) {
    if (RecordedBus* r = recorded()) return r->try_send(f);
    return serial() ? adapter().try_send(f) : std::get<hal::SocketCan>(bus_).try_send(f);
  }
  [[nodiscard]] bool try_receive(hal::CanFrame& f) {
    if (RecordedBus* r = recorded()) return r->try_receive(f);
    return serial() ? adapter().try_receive(f) : std::get<hal::SocketCan>(bus_).try_receive(f);
  }
  /// Age, us, of the frame last received, when it was received; 0, not known, on a serial line.
  [[nodiscard]] std::uint32_t frame_age_us() const {
    if (const RecordedBus* r = recorded()) return r->frame_age_us();
    return serial() ? 0U : std::get<hal::SocketCan>(bus_).frame_age_us();
  }

  /// The recording that this bus is; null: it is an interface or a serial line.
  [[nodiscard]] RecordedBus* recorded() const {
    return bus_.index() == 2 ? std::get<RecordedBus*>(bus_) : nullptr;
  }
  /// Call before each look at the bus: see RecordedBus::look. No effect on an interface or a serial line.
  void look() {
    if (RecordedBus* r = recorded()) r->look();
  }

  /// Whether the other end of a serial line is gone for good; false on a recording, and on an interface,
  /// which may come up again.
  [[nodiscard]] bool gone() { return serial() && adapter().port().gone(); }
  /// Whether received bytes wait in the serial port, unknown to poll().
  [[nodiscard]] bool has_input() { return serial() && adapter().port().has_input(); }
  /// Argument of poll(): input, and room for unsent bytes; descriptor -1, which poll() skips, once gone().
  /// Not for a recording: throws bad_variant_access.
  [[nodiscard]] pollfd polled() {
    if (!serial()) return {std::get<hal::SocketCan>(bus_).descriptor(), POLLIN, 0};
    hal::SerialPort& p = adapter().port();
    // A closed socket stays "readable".
    return {p.gone() ? -1 : p.descriptor(), static_cast<short>(POLLIN | (p.has_output() ? POLLOUT : 0)), 0};
  }
  /// Sends unsent bytes of a serial line as far as it takes them.
  void flush() {
    if (serial()) adapter().port().flush();
  }

 private:
  [[nodiscard]] bool serial() const { return bus_.index() == 1; }
  [[nodiscard]] hal::SlcanAdapter& adapter() { return *std::get<1>(bus_); }

  std::string name_;
  std::variant<hal::SocketCan, std::unique_ptr<hal::SlcanAdapter>, RecordedBus*> bus_;
};

static_assert(hal::TimesFrames<HostBus>);

/// Forms of what --bus names. The InputError that the functions below throw says what to do.

inline constexpr const char* bus_forms = "socketcan:INTERFACE | slcan:ENDPOINT";

/// Opens a bus, named in one of the bus_forms, for one node, or throws InputError. `bit_rate`: bit/s, for an
/// adapter on a serial line; that of an interface is set by the administrator. `fd`: it must carry CAN FD.
HostBus open_bus(const std::string& bus, int bit_rate, bool fd);

/// Two nodes on one bus.
struct BusEnds {
  HostBus plant, control;
};
/// Opens a bus for two nodes, or throws InputError. An interface serves both; adapters on serial lines are
/// two, slcan:PLANT,CONTROLLER.
BusEnds open_both_ends(const std::string& bus, int bit_rate, bool fd);

/// Whether real drives may be on the bus: true for every serial line and for an interface of a device, false
/// for a virtual interface or an unknown one. Throws InputError unless `bus` has one of the bus_forms.
bool carries_real_drives(const std::string& bus);

}  // namespace esmc::host
