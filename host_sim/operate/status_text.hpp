#pragma once
/// What a controller has said, for people and for programs.

#include <array>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "host_sim/operate/connection.hpp"

namespace esmc::host {

/// In the order of link::Index, as in docs/esmc.dbc.
inline constexpr std::array<const char*, link::parameter_count> parameter_names{
    "lambda_position", "lambda_angle", "gain_position", "gain_angle",   "sample_time", "torque_limit_1",
    "torque_limit_2",  "joint_speed",  "speed",         "acceleration", "stream_age",  "silence"};

/// The document of `status --json`.
nlohmann::ordered_json status_json(const Connection& c);
std::string status_text(const Connection& c);

}  // namespace esmc::host
