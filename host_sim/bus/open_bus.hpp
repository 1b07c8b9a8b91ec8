#pragma once
/// Opens the bus that --bus names. All functions throw InputError that says what to do.

#include <string>

#include "host_sim/bus/host_bus.hpp"

namespace esmc::host {

inline constexpr const char* bus_forms = "socketcan:INTERFACE | slcan:ENDPOINT";

/// Opens a bus, named in one of the bus_forms, for one node. `bit_rate`: bit/s, for an adapter on a serial
/// line; that of an interface is set by the administrator.
HostBus open_bus(const std::string& bus, int bit_rate);

/// Two nodes on one bus.
struct BusEnds {
  HostBus plant, control;
};
/// Opens a bus for two nodes. An interface serves both; adapters on serial lines are two,
/// slcan:PLANT,CONTROLLER.
BusEnds open_both_ends(const std::string& bus, int bit_rate);

/// Whether real drives may be on the bus: true for every serial line and for an interface of a device, false
/// for a virtual interface or an unknown one.
bool carries_real_drives(const std::string& bus);

}  // namespace esmc::host
