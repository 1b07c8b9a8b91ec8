#pragma once
/// Configuration, input and output of the controller's end of the command interface.

#include <array>
#include <cstdint>

#include "firmware/link/codec.hpp"
#include "firmware/link/parameters.hpp"

namespace esmc::link {

/// Identifiers, times and rights of the link.
struct LinkConfig {
  std::uint32_t base_id = 0;          ///< of the block of identifiers, a multiple of block_size; 0: no link
  std::uint8_t session = 1;           ///< 1..255; drawn at every power-up where the board has a random source
  std::uint8_t counter_jump_max = 2;  ///< largest step of an alive counter
  std::uint16_t command_age_ticks_max = 0;  ///< largest age of the Status that an order answers
  std::uint32_t status_ticks = 1;           ///< between two Status, > 0
  std::uint32_t telemetry_ticks = 0;        ///< between two sets of telemetry; 0: none
  std::uint32_t table_ticks = 0;            ///< between two Parameter_Table; 0: on request only
  std::uint32_t period_ns = 0;              ///< of a tick
  Source source = Source::reference;        ///< at power-up, until an order changes it
  Space space = Space::effector;            ///< of set points and samples; others are refused
  std::array<Bounds, 2> position{};         ///< of set points and samples, m or rad
  std::uint32_t scene = 0;                  ///< CRC-32 of the values of the scene; 0: not known
  Parameters parameters{};
  bool has_path = true;     ///< the reference moves on a path, so it can be slowed or held
  bool unattended = false;  ///< once running, the reference needs no sign of life
};

/// Result of a received frame.
enum class Outcome : std::uint8_t {
  not_mine,
  obeyed,
  malformed,  ///< not a classic data frame of 8 bytes, or with a value that has no meaning
  bad_crc,
  bad_counter,      ///< repeated, or further ahead than counter_jump_max
  refused,          ///< out of bounds, too old, or not in this state
  foreign_command,  ///< an identifier of ours, sent by another node
};

/// Requests for the next tick. Set points and samples are in the controller's space.
struct Request {
  Command command = Command::none;
  Source source = Source::reference;
  bool hold = false;                ///< come to rest
  bool has_point = false;           ///< `position` is a set point
  bool has_sample = false;          ///< `position`, `velocity` are a sample of a stream
  bool has_gains = false;           ///< the gains of CommandLink::parameters() have changed
  bool has_rate = false;            ///< `percent` is a new rate of the reference
  std::array<float, 2> position{};  ///< of the set point or the sample
  std::array<float, 2> velocity{};  ///< of the sample
  std::uint8_t percent = 100;       ///< of the speed of the reference; 0: hold on its path
};

/// Request to the store of parameters.
enum class StoreRequest : std::uint8_t { none, store, forget };

/// State of the controller at the end of a tick, for telemetry.
struct Report {
  std::array<float, 2> effector{}, error{};         ///< m
  std::array<float, joints_max> angle{}, torque{};  ///< rad, N m
  std::uint8_t joints = 0;                          ///< entries of `angle` and `torque` that are used
  std::uint8_t axis = no_axis;                      ///< motor with a drive error
  std::uint8_t encoder = no_axis;                   ///< that contradicts the others, on loop_not_closed
  std::uint32_t drive_error = 0;                    ///< error code of that drive
};

}  // namespace esmc::link
