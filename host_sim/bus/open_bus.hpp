#pragma once
/// --bus: what it may say, and the bus or buses that it means. Everything here throws InputError with what to
/// do about it.

#include <string>

#include "host_sim/bus/host_bus.hpp"

namespace esmc::host {

inline constexpr const char* bus_forms = "socketcan:INTERFACE | slcan:ENDPOINT";

/// One node. `bit_rate`: bit/s, told to an adapter on a serial line; of an interface it is the
/// administrator's.
HostBus open_bus(const std::string& bus, int bit_rate);

/// Two nodes on one bus.
struct BusEnds {
  HostBus plant, control;
};
/// An interface serves both; adapters on serial lines are two, slcan:PLANT,CONTROLLER.
BusEnds open_both_ends(const std::string& bus, int bit_rate);

/// Whether more than software may be behind it. Nobody can know that of a serial line.
bool carries_real_drives(const std::string& bus);

}  // namespace esmc::host
