#pragma once
/// CANopen frames written byte by byte from the message layouts, without the firmware's codec, and a slave
/// made of them: an object dictionary behind SDO, a state machine that obeys, two PDOs.

#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <map>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "hal/can.hpp"

namespace esmc::test {

inline hal::CanFrame can(std::uint32_t id, std::initializer_list<int> bytes) {
  hal::CanFrame f;
  f.id = id;
  for (const int b : bytes) f.data[f.size++] = static_cast<std::uint8_t>(b);
  return f;
}
inline std::uint32_t little(const hal::CanFrame& f, std::size_t at, std::size_t bytes) {
  std::uint32_t v = 0;
  for (std::size_t i = bytes; i-- > 0;) v = v * 256 + f.data[at + i];
  return v;
}
inline void put_little(hal::CanFrame& f, std::size_t at, std::uint32_t v, std::size_t bytes) {
  for (std::size_t i = 0; i < bytes; ++i, v /= 256) f.data[at + i] = static_cast<std::uint8_t>(v % 256);
}

inline hal::CanFrame nmt(int command, int node) { return can(0x000, {command, node}); }
inline hal::CanFrame heartbeat_of(unsigned node, int state) { return can(0x700 + node, {state}); }
inline hal::CanFrame emergency_of(unsigned node, unsigned code) {
  return can(0x080 + node, {static_cast<int>(code % 256), static_cast<int>(code / 256), 1, 0, 0, 0, 0, 0});
}
inline hal::CanFrame sdo(unsigned id, int command, unsigned index, unsigned sub, std::uint32_t value = 0) {
  hal::CanFrame f = can(id, {command, static_cast<int>(index % 256), static_cast<int>(index / 256),
                             static_cast<int>(sub), 0, 0, 0, 0});
  put_little(f, 4, value, 4);
  return f;
}
/// TPDO1: statusword, position, torque. TPDO2: velocity, mode.
inline hal::CanFrame report_of(unsigned node, unsigned status, std::int32_t position = 0, int torque = 0) {
  hal::CanFrame f = can(0x180 + node, {0, 0, 0, 0, 0, 0, 0, 0});
  put_little(f, 0, status, 2);
  put_little(f, 2, static_cast<std::uint32_t>(position), 4);
  put_little(f, 6, static_cast<std::uint32_t>(torque), 2);
  return f;
}
inline hal::CanFrame motion_of(unsigned node, std::int32_t velocity = 0, int mode = 10) {
  hal::CanFrame f = can(0x280 + node, {0, 0, 0, 0, mode});
  put_little(f, 0, static_cast<std::uint32_t>(velocity), 4);
  return f;
}

/// Index and sub-index as one number: 0x604100 is 6041:0.
inline constexpr std::uint32_t entry(unsigned index, unsigned sub) { return index * 256 + sub; }

/// A drive that does what it is told, unless a test says otherwise.
struct Slave {
  unsigned node = 3;
  int state = 0x7F;          ///< NMT
  unsigned status = 0x0250;  ///< switch on disabled
  bool obeys = true;         ///< its state machine follows the controlword
  int mode = 10;             ///< that it reports once 6060 is 10
  std::map<std::uint32_t, std::uint32_t> objects{{entry(0x1014, 0), 0x80 + 3},
                                                 {entry(0x1005, 0), 0x80},
                                                 {entry(0x6502, 0), 0x3A5},
                                                 {entry(0x6076, 0), 2000},
                                                 {entry(0x6072, 0), 1500}};
  std::map<std::uint32_t, std::uint32_t> aborts;  ///< of any access, with this code
  std::map<std::uint32_t, std::uint32_t> says;    ///< on reading, whatever was written
  std::map<std::uint32_t, int> command;           ///< on reading, the first byte of the answer
  std::set<std::uint32_t> silent;                 ///< no answer
  std::vector<std::pair<std::uint32_t, std::uint32_t>> writes;
  std::vector<std::uint32_t> reads;
  std::vector<hal::CanFrame> waiting;  ///< to be delivered in the next tick
  unsigned control = 0;
  int torque = 0;

  [[nodiscard]] static unsigned size_of(std::uint32_t object) {
    switch (object >> 8U) {
      case 0x1029:
      case 0x6060:
      case 0x60C2:
        return 1;
      case 0x1017:
      case 0x6007:
      case 0x605A:
      case 0x605E:
      case 0x6040:
      case 0x6072:
      case 0x60B2:
        return 2;
      default:
        break;
    }
    const std::uint32_t index = object >> 8U, sub = object & 0xFFU;
    const bool communication = (index >= 0x1400 && index < 0x1404) || (index >= 0x1800 && index < 0x1804);
    const bool mapping = (index >= 0x1600 && index < 0x1604) || (index >= 0x1A00 && index < 0x1A04);
    if (communication && sub == 5) return 2;
    return (communication && sub == 2) || (mapping && sub == 0) ? 1 : 4;
  }
  void take(const hal::CanFrame& f) {
    if (f.id == 0x000 && f.data[1] == node) state = f.data[0] == 1 ? 5 : (f.data[0] == 2 ? 4 : 0x7F);
    if (f.id == 0x600 + node) serve(f);
    if (f.id == 0x200 + node && state == 5) {
      control = little(f, 0, 2);
      torque = static_cast<std::int16_t>(little(f, 2, 2));
      if (obeys) move();
    }
  }
  void serve(const hal::CanFrame& f) {
    const std::uint32_t object = entry(f.data[1] + 256U * f.data[2], f.data[3]);
    const bool reading = f.data[0] == 0x40;
    if (reading) {
      reads.push_back(object);
    } else {
      writes.emplace_back(object, little(f, 4, 4));
    }
    if (silent.contains(object)) return;
    const unsigned size = size_of(object);
    hal::CanFrame reply = f;
    reply.id = 0x580 + node;
    if (!reading && f.data[0] != 0x2F - 4 * (static_cast<int>(size) - 1)) {
      reply.data[0] = 0x80;
      put_little(reply, 4, 0x0607'0010, 4);  // the length does not match the object's
    } else if (aborts.contains(object)) {
      reply.data[0] = 0x80;
      put_little(reply, 4, aborts[object], 4);
    } else if (reading) {
      reply.data[0] = static_cast<std::uint8_t>(
          command.contains(object) ? command[object] : 0x4F - 4 * (static_cast<int>(size) - 1));
      put_little(reply, 4, says.contains(object) ? says[object] : objects[object], 4);
    } else {
      objects[object] = little(f, 4, 4);
      reply.data[0] = 0x60;
      put_little(reply, 4, 0, 4);
    }
    waiting.push_back(reply);
  }
  void move() {
    if (status == 0x0218) {
      if (control == 0x80) status = 0x0250;
      return;
    }
    if (control == 0x00) status = 0x0250;
    if (control == 0x06) status = 0x0231;
    if (control == 0x07 && status == 0x0231) status = 0x0233;
    if (control == 0x0F && status == 0x0233) status = 0x1237;
  }
  /// What it says in a tick, after what it has to answer.
  std::vector<hal::CanFrame> speak() {
    std::vector<hal::CanFrame> out = std::exchange(waiting, {});
    if (state == 5) {
      out.push_back(report_of(node, status));
      out.push_back(motion_of(node, 0, mode));
    } else {
      out.push_back(heartbeat_of(node, state));
    }
    return out;
  }
};

}  // namespace esmc::test
