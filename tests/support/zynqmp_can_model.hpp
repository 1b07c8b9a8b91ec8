#pragma once
/// The CAN controller of a Zynq UltraScale+ as a program sees it, by UG1085 and UG1087: registers by their
/// addresses there, modes, FIFOs of four-word messages, events that are kept until they are cleared, error
/// states. What a program must not do is noted in `wrong`. `Words::qemu` lays messages out as QEMU 7.2's
/// model does. Shares nothing with hal/zynqmp_can.

#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "tests/support/wire_frame.hpp"

namespace esmc::test {

class ZynqmpCanModel {
 public:
  enum class Words { manual, qemu };
  explicit ZynqmpCanModel(Words words) : words_(words) { reset(); }
  std::vector<std::string> wrong;
  bool clocked = true;  ///< without a clock nothing follows
  bool stuck = false;   ///< a dominant bus: no 11 recessive bits, no way onto it

  // --- the program's side
  std::uint32_t read(std::uint32_t at) {
    if (!clocked) return 0;
    switch (at) {
      case 0x00:
        return enabled_ ? 2U : 0U;
      case 0x18:
        return status();
      case 0x1C:
        return events_;
      case 0x50:
      case 0x54:
      case 0x58:
      case 0x5C:
        return take_word((at - 0x50) / 4);
      default:
        return r_.contains(at) ? r_[at] : 0U;
    }
  }
  void write(std::uint32_t at, std::uint32_t v) {
    if (!clocked) return;
    switch (at) {
      case 0x00:
        if ((v & 1U) != 0) {
          reset();
        } else {
          enable((v & 2U) != 0);
        }
        return;
      case 0x04:
      case 0x08:
      case 0x0C:
        if (enabled_) return fault("register " + std::to_string(at) + " outside of configuration mode");
        if (at == 0x04 && v != 0) fault("not normal mode");
        break;
      case 0x10:
      case 0x18:
      case 0x1C:
        return fault("writes a register that is for reading");
      case 0x20:
        if (v != 0) fault("asks for interrupts without a handler");
        break;
      case 0x24:
        events_ = (events_ & ~v) | (rx_.empty() ? 0U : 1U << 7);
        return;
      case 0x60:
        if ((v & ~0xFU) != 0) fault("reserved bits of AFR");
        break;
      case 0x30:
      case 0x34:
      case 0x38:
      case 0x3C:
        return put_word((at - 0x30) / 4, v);
      default:
        fault("register " + std::to_string(at));
        return;
    }
    r_[at] = v;
  }

  // --- the bus's side
  [[nodiscard]] bool on_bus() const { return enabled_ && joined_ && !off_; }
  /// The frame that is being sent: the oldest one, again and again until it is acknowledged.
  std::optional<WireFrame> begin_frame() {
    if (!on_bus() || tx_.empty()) return {};
    return message(tx_.front());
  }
  void delivered() {
    tx_.pop_front();
    events_ |= 1U << 1 | (tx_.empty() ? 1U << 14 : 0U);
    if (tec_ > 0) --tec_;
  }
  std::optional<WireFrame> take() {
    auto f = begin_frame();
    if (f) delivered();
    return f;
  }
  /// No acknowledgement, or the bits came back wrong: 8 more errors; above 255 off the bus. FIFOs keep what
  /// they have.
  void spoiled() {
    tec_ += 8;
    events_ |= 1U << 8;
    if (tec_ > 255) off_ = true, events_ |= 1U << 9, idle_ = 0;
  }
  /// Recessive bits: 11 let it join, 128 times as many let it recover, by itself.
  void idle(std::uint32_t n) {
    if (stuck) return;
    if (enabled_ && n >= 11) joined_ = true;
    if (off_ && (idle_ += n) >= 128 * 11) off_ = false, tec_ = 0;
  }
  void deliver(const WireFrame& f) {
    if (!on_bus()) return;
    if ((r_.contains(0x60) ? r_[0x60] : 0U) != 0) return;  // a filter that this model's messages never pass
    if (rx_.size() == 64) {
      events_ |= 1U << 6;
      return;
    }
    rx_.push_back(words(f));
    events_ |= 1U << 4 | 1U << 7;
  }
  struct Bit {
    double rate, sample_point, quanta, jump;
  };
  [[nodiscard]] Bit nominal(double clock) {
    const std::uint32_t v = r_[0x0C];
    const double before = (v & 0xFU) + 1.0, after = ((v >> 4) & 7U) + 1.0, quanta = 1.0 + before + after;
    return {clock / ((r_[0x08] & 0xFFU) + 1.0) / quanta, (1.0 + before) / quanta, quanta,
            ((v >> 7) & 3U) + 1.0};
  }

 private:
  using Four = std::vector<std::uint32_t>;
  void fault(const std::string& what) { wrong.push_back(what); }
  void reset() {
    r_.clear();
    tx_.clear();
    rx_.clear();
    half_.clear();
    enabled_ = joined_ = off_ = false;
    events_ = 1U << 13 | 1U << 14;  // TXFWMEMP, TXFEMP
    tec_ = settle_ = read_words_ = 0;
  }
  void enable(bool on) {
    if (!on) joined_ = false, tec_ = 0, off_ = false;
    if (on && !enabled_) settle_ = 3;
    enabled_ = on;
  }
  /// On a bus that is free it joins within a few reads.
  std::uint32_t status() {
    if (enabled_ && !joined_ && !stuck && settle_ > 0 && --settle_ == 0) joined_ = true;
    if (!joined_) return 1U;
    const std::uint32_t error = off_ ? 2U : (tec_ > 127 ? 3U : 1U);
    return 1U << 3 | error << 7 | (tx_.size() == 64 ? 1U << 10 : 0U);
  }
  void put_word(std::uint32_t i, std::uint32_t v) {
    if (half_.size() != i) fault("words of a message out of order");
    half_.push_back(v);
    if (i != 3) return;
    if (tx_.size() == 64) {
      fault("writes a message into a full FIFO");
    } else {
      tx_.push_back(half_);
    }
    half_.clear();
  }
  std::uint32_t take_word(std::uint32_t i) {
    if (rx_.empty()) {
      events_ |= 1U << 5;
      fault("reads a message from an empty FIFO");
      return 0;
    }
    if (read_words_ != i) fault("reads the words of a message out of order");
    const std::uint32_t v = rx_.front()[i];
    read_words_ = (i + 1) % 4;
    if (i == 3) rx_.pop_front();
    return v;
  }
  [[nodiscard]] std::uint32_t byte_at(unsigned i) const {
    return words_ == Words::manual ? 24 - 8 * (i % 4) : 8 * (i % 4);
  }
  [[nodiscard]] Four words(const WireFrame& f) const {
    Four w(4, 0U);
    if (words_ == Words::qemu) {
      w[0] = f.id | (f.extended ? 0x80000000U : 0U) | (f.remote ? 0x40000000U : 0U);
    } else if (f.extended) {
      w[0] = (f.id & 0x1FFC0000U) << 3 | 3U << 19 | (f.id & 0x3FFFFU) << 1 | (f.remote ? 1U : 0U);
    } else {
      w[0] = f.id << 21 | (f.remote ? 1U << 20 : 0U);
    }
    w[1] = f.dlc << 28 | 0x1234U;  // length, and a time stamp
    for (unsigned i = 0; i < f.bytes.size(); ++i) w[2 + i / 4] |= std::uint32_t{f.bytes[i]} << byte_at(i);
    return w;
  }
  WireFrame message(const Four& w) {
    WireFrame f;
    if (words_ == Words::qemu) {
      f.extended = (w[0] >> 31) != 0;
      f.remote = (w[0] >> 30 & 1U) != 0;
      f.id = w[0] & (f.extended ? 0x1FFFFFFFU : 0x7FFU);
      if (!f.extended && (w[0] & 0x1FFFF800U) != 0) fault("a standard identifier of more than 11 bits");
    } else {
      f.extended = (w[0] >> 19 & 1U) != 0;
      f.id = f.extended ? (w[0] >> 21) << 18 | (w[0] >> 1 & 0x3FFFFU) : w[0] >> 21;
      f.remote = (w[0] >> (f.extended ? 0 : 20) & 1U) != 0;
      if (f.extended && (w[0] >> 20 & 1U) == 0) fault("SRR of an extended frame is 0");
      if (!f.extended && (w[0] & 0x7FFFFU) != 0) fault("IDL or RTR of a standard frame is not 0");
    }
    f.dlc = w[1] >> 28;
    if ((w[1] & 0x0FFFFFFFU) != 0) fault("reserved bits of DLC");
    for (unsigned i = 0; i < f.dlc && i < 8 && !f.remote; ++i) {
      f.bytes.push_back(static_cast<std::uint8_t>(w[2 + i / 4] >> byte_at(i)));
    }
    return f;
  }

  Words words_;
  std::map<std::uint32_t, std::uint32_t> r_;
  std::deque<Four> tx_, rx_;
  Four half_;
  bool enabled_ = false, joined_ = false, off_ = false;
  std::uint32_t events_ = 0, tec_ = 0, settle_ = 0, idle_ = 0, read_words_ = 0;
};

/// The driver's way to it.
struct ZynqmpCanModelAccess {
  ZynqmpCanModel* model;
  [[nodiscard]] std::uint32_t read(std::uint32_t at) const { return model->read(at); }
  void write(std::uint32_t at, std::uint32_t v) { model->write(at, v); }
};

}  // namespace esmc::test
