#include "host_sim/bus/host_bus.hpp"

#include <cerrno>
#include <filesystem>
#include <string_view>

#include "host_sim/error.hpp"

namespace esmc::host {
namespace {

constexpr std::string_view socketcan = "socketcan:", slcan = "slcan:";

/// The text after the prefix; empty: another prefix.
std::string behind(std::string_view prefix, const std::string& bus) {
  return bus.starts_with(prefix) ? bus.substr(prefix.size()) : "";
}

[[noreturn]] void refuse_form(const std::string& bus) {
  refuse(
      "--bus {}: allowed are socketcan:INTERFACE, slcan:ENDPOINT (a tty, unix:PATH, tcp:HOST:PORT) and, for "
      "hil, virtual",
      bus);
}

HostBus open_socketcan(const std::string& interface, bool fd) {
  std::error_code error;
  hal::SocketCan bus = hal::SocketCan::open(interface, error, fd);
  if (bus.is_open()) return {interface, std::move(bus)};
  std::string why = error.message();
  if (error.value() == ENODEV) why = "no such CAN interface (ip link show type vcan, type can)";
  if (error.value() == ENETDOWN) why = "the interface is down (ip link set up " + interface + ")";
  if (error.value() == EMSGSIZE)
    why = "the interface carries classic frames only, and these drives speak CAN FD (vcan: ip link set " +
          interface + " mtu 72; can: ip link set " + interface + " type can ... dbitrate 5000000 fd on)";
  if (error.value() == EAFNOSUPPORT || error.value() == EPROTONOSUPPORT)
    why =
        "this kernel has no CAN (docs/hil.md, \"When the kernel has no CAN\"); hil and live need none with "
        "--bus virtual";
  refuse("--bus socketcan:{}: {}", interface, why);
}

HostBus open_slcan(const std::string& endpoint, int bit_rate, bool fd) {
  if (fd)
    refuse(
        "--bus slcan:{}: slcan carries classic frames only, and these drives speak CAN FD: take "
        "socketcan:INTERFACE",
        endpoint);
  const int speed = hal::slcan_speed(bit_rate);
  if (speed < 0)
    refuse(
        "--bus slcan:{}: slcan has no command for {} bit/s (10, 20, 50, 100, 125, 250, 500, 800 kbit/s and 1 "
        "Mbit/s)",
        endpoint, bit_rate);
  std::string why;
  hal::SerialPort port = hal::SerialPort::open(endpoint, why);
  if (!port.is_open()) refuse("--bus slcan:{}: {}", endpoint, why);
  return {endpoint, std::make_unique<hal::SlcanAdapter>(std::move(port), speed)};
}

}  // namespace

HostBus open_bus(const std::string& bus, int bit_rate, bool fd) {
  if (const std::string interface = behind(socketcan, bus); !interface.empty())
    return open_socketcan(interface, fd);
  if (const std::string endpoint = behind(slcan, bus); !endpoint.empty())
    return open_slcan(endpoint, bit_rate, fd);
  refuse_form(bus);
}

BusEnds open_both_ends(const std::string& bus, int bit_rate, bool fd) {
  const std::string endpoints = behind(slcan, bus);
  if (endpoints.empty()) return {open_bus(bus, bit_rate, fd), open_bus(bus, bit_rate, fd)};
  const std::size_t comma = endpoints.find(',');
  const std::string plant = endpoints.substr(0, comma),
                    control = comma == std::string::npos ? "" : endpoints.substr(comma + 1);
  if (plant.empty() || control.empty() || control.find(',') != std::string::npos)
    refuse(
        "--bus {}: hil is two nodes, and an adapter is one: slcan:PLANT,CONTROLLER names two adapters on one "
        "cable; with one, run esmc plant or esmc controller on it",
        bus);
  return {open_slcan(plant, bit_rate, fd), open_slcan(control, bit_rate, fd)};
}

bool carries_real_drives(const std::string& bus) {
  if (!behind(slcan, bus).empty()) return true;
  const std::string interface = behind(socketcan, bus);
  if (interface.empty()) refuse_form(bus);
  std::error_code error;
  return std::filesystem::exists("/sys/class/net/" + interface + "/device", error);
}

}  // namespace esmc::host
