#pragma once
/// What telemetry says of a fault: the command interface carries its name and its axis alone.

#include <nlohmann/json_fwd.hpp>

#include "host_sim/operate/link_client.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

/// Of a fault that the pose in the last telemetry shows (joint angle, workspace, singularities, closure):
/// `where`, `measured`, `limit`, `unit`; otherwise an empty object.
nlohmann::ordered_json fault_values(Fault fault, const ControllerNews& news, const Scene& scene);

}  // namespace esmc::host
