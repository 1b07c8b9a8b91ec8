#pragma once
/// An FDCAN as a program sees it, by the reference manuals (RM0440 ch. 44, RM0433 ch. 56): registers by their
/// addresses there, write protection, message memory, filters, receive FIFO 0, interrupt line 0, transmit
/// queue, time stamps, error states. What a program must not do is noted in `wrong`. Shares nothing with
/// hal/fdcan.

#include <algorithm>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "tests/support/wire_frame.hpp"

namespace esmc::test {

class FdcanModel {
 public:
  enum class Chip { g4, h7 };
  explicit FdcanModel(Chip chip) : chip_(chip) {
    r_[0x18] = 0x1;         // CCCR: INIT
    r_[0x1C] = 0x06000A03;  // NBTP
    r_[0x0C] = 0x00000A33;  // DBTP
    r_[0x44] = 0x707;       // PSR
  }
  std::vector<std::string> wrong;
  bool clocked = true;              ///< without a kernel clock INIT never follows
  std::function<void()> handler{};  ///< of interrupt line 0
  std::uint32_t interrupts = 0;     ///< calls of it

  /// The processor takes no interrupts; one that is pending comes when they are allowed again.
  void mask(bool masked) {
    masked_ = masked;
    serve();
  }

  // --- the program's side
  std::uint32_t read(std::uint32_t at) {
    if (at == 0x18) {
      if (clocked && settle_ > 0 && --settle_ == 0) init_ = wanted_init_;
      return (r_[0x18] & ~1U) | (init_ ? 1U : 0U);
    }
    if (at == 0x24) return stamp_ / (((r_[0x20] >> 16) & 0xF) + 1) & 0xFFFF;
    if (at == rxf0s()) {
      const auto n = static_cast<std::uint32_t>(fill_);
      return n | (get_ << 8) | (put_ << 16) | (n == depth() ? 1U << 24 : 0U) |
             ((r_[0x50] & lost_flag()) != 0 ? 1U << 25 : 0U);
    }
    if (at == txbrp()) return pending_;
    if (at == txbrp() + 12) return transmitted_;
    if (at == 0xC4) {
      std::uint32_t free = 0;
      while (free < tx_depth() && (pending_ & (1U << free)) != 0) ++free;
      return (free == tx_depth() ? 1U << 21
                                 : free << 16);  // queue mode: fill level and get index read as zero
    }
    if (at == 0x40) return (rec_ << 8) | (tec_ & 0xFF);
    if (at == 0x44) return r_[0x44] | (off_ ? 1U << 7 : 0U) | (tec_ > 127 || rec_ > 127 ? 1U << 5 : 0U);
    return r_.contains(at) ? r_[at] : 0;
  }
  void write(std::uint32_t at, std::uint32_t v) {
    const bool open = (r_[0x18] & 2U) != 0 && init_;
    if (at == 0x18) {
      if ((v & 2U) != 0 && !init_) fault("CCE without INIT");
      const std::uint32_t guarded = 0x0000'B3E0;     // NISO..BRSE, FDOE, TEST, DAR, MON
      const std::uint32_t set = v & ~r_[0x18] & 4U;  // ASM may be cleared at any time
      if ((((v ^ r_[0x18]) & guarded) != 0 || set != 0) && !open) fault("a protected bit of CCCR");
      if (init_ && (v & 1U) == 0 && !off_) {  // its memory has no defined parity before it is written
        const std::uint32_t end = g4() ? 0x350U / 4 : std::max(rx_at(depth()), tx_at(tx_depth()));
        for (std::uint32_t w = 0; w < end; ++w) {
          if (!ram_.contains(w)) return fault("joins the bus with memory that was never written");
        }
      }
      wanted_init_ = (v & 1U) != 0;
      settle_ = 3;
      r_[0x18] = (v & ~1U) & (wanted_init_ ? ~0U : ~2U);
      return;
    }
    if (at == 0x10 && (r_[0x18] & 1U << 7) == 0) return fault("TEST without CCCR.TEST");
    if (guarded_register(at) && !open) return fault("register " + std::to_string(at) + " while protected");
    if (at == 0x50) {
      r_[0x50] &= ~v;
    } else if (at == rxf0a()) {
      if (fill_ == 0 || v != get_) return fault("acknowledges what is not there");
      get_ = (get_ + 1) % depth();
      --fill_;
    } else if (at == txbar()) {
      if (init_) return fault("asks to send while not on the bus");
      if ((v & pending_) != 0) fault("writes a buffer that is pending");
      pending_ |= v;
      transmitted_ &= ~v;
      for (std::uint32_t i = 0; i < tx_depth(); ++i) {
        for (std::uint32_t k = 0; k < i; ++k) {
          if ((pending_ >> i & pending_ >> k & 1U) != 0 && rank(i) == rank(k))
            fault("two pending frames of one identifier: their order is not defined");
        }
      }
    } else if (at == txbcr()) {
      if (!queue_mode()) fault("cancels in FIFO mode");
      for (std::uint32_t i = 0; i < tx_depth(); ++i) {
        if ((v & (1U << i)) == 0) continue;
        if (on_wire_ == static_cast<int>(i)) cancelled_ = true;  // decided by the end of the frame
        if (on_wire_ != static_cast<int>(i)) pending_ &= ~(1U << i);
      }
    } else {
      r_[at] = v;
    }
  }
  std::uint32_t read_ram(std::uint32_t word) {
    if (!ram_.contains(word)) fault("reads memory that was never written");
    return ram_[word];
  }
  void write_ram(std::uint32_t word, std::uint32_t v) {
    if (word >= (chip_ == Chip::g4 ? 0x350U / 4 : 2560U)) fault("outside of the message memory");
    for (std::uint32_t i = 0; i < tx_depth(); ++i) {
      if ((pending_ & (1U << i)) != 0 && word >= tx_at(i) && word < tx_at(i) + 18)
        fault("changes a pending frame");
    }
    ram_[word] = v;
  }

  // --- the bus's side
  [[nodiscard]] bool on_bus() const { return !init_ && !off_ && !restricted(); }
  /// Its memory was too slow for a frame: it listens and acknowledges, but sends no frame (CCCR.ASM).
  void restrict() { r_[0x18] |= 4U; }
  [[nodiscard]] bool restricted() const { return (r_.at(0x18) & 4U) != 0; }
  void bits(std::uint32_t n) { stamp_ += (reg(0x20) & 3U) == 1U ? n : 0U; }  // TSCC.TSS
  /// The frame that wins the arbitration among those asked for; it stays pending until delivered().
  std::optional<WireFrame> begin_frame() {
    if (!on_bus() || pending_ == 0) return {};
    std::uint64_t best = ~std::uint64_t{0};
    for (std::uint32_t i = 0; i < tx_depth(); ++i) {
      if ((pending_ & (1U << i)) == 0) continue;
      if (rank(i) < best) best = rank(i), on_wire_ = static_cast<int>(i);
    }
    return element(tx_at(static_cast<std::uint32_t>(on_wire_)));
  }
  /// CCCR.TEST, CCCR.MON and TEST.LBCK: the pins see nothing, and its frames come back to it.
  [[nodiscard]] bool internal_loop_back() { return (reg(0x18) & 0xA0U) == 0xA0U && (reg(0x10) & 0x10U) != 0; }
  void delivered() {
    if (internal_loop_back()) deliver(element(tx_at(static_cast<std::uint32_t>(on_wire_))));
    pending_ &= ~(1U << static_cast<unsigned>(on_wire_));
    transmitted_ |= 1U << static_cast<unsigned>(on_wire_);
    on_wire_ = -1;
    cancelled_ = false;
    if (tec_ > 0) --tec_;
  }
  std::optional<WireFrame> take() {
    auto f = begin_frame();
    if (f) delivered();
    return f;
  }
  /// No acknowledgement, or the bits came back wrong: 8 more errors; above 255 off the bus.
  void spoiled() {
    lost();
    tec_ += 8;
    if (tec_ > 255) off_ = true, init_ = wanted_init_ = true, settle_ = 0;
  }
  /// Recessive bits: 129 sequences of 11 of them after INIT was cleared bring it back.
  void idle(std::uint32_t n) {
    bits(n);
    if (off_ && !init_ && (idle_ += n) >= 129 * 11) off_ = false, tec_ = rec_ = idle_ = 0;
  }
  /// Another controller has won the bus: the frame begun stays pending, unless it was asked to be cancelled.
  void lost() {
    if (cancelled_) pending_ &= ~(1U << static_cast<unsigned>(on_wire_));
    cancelled_ = false;
    on_wire_ = -1;
  }
  /// `length`: bits since the frame began, of which the stamp tells.
  void deliver(const WireFrame& f, std::uint32_t length = 0) {
    if (!on_bus()) return;
    if (f.fd && (r_[0x18] & (1U << 8)) == 0) return;  // a form error, there
    if (!heard(f)) return;
    if (depth() == 0 || fill_ == depth()) {
      r_[0x50] |= lost_flag();
      return serve();
    }
    const std::uint32_t at = rx_at(put_);
    ram_[at] = (f.extended ? f.id | 1U << 30 : f.id << 18) | (f.remote ? 1U << 29 : 0U);
    ram_[at + 1] = 1U << 31 | (f.fd ? 1U << 21 : 0U) | (f.brs ? 1U << 20 : 0U) | f.dlc << 16 |
                   ((stamp_ - length) / (((r_[0x20] >> 16) & 0xF) + 1) & 0xFFFF);
    for (std::uint32_t w = 0; 4 * w < f.bytes.size(); ++w) {
      std::uint32_t v = 0;
      for (std::uint32_t k = 0; k < 4 && 4 * w + k < f.bytes.size(); ++k)
        v |= std::uint32_t{f.bytes[4 * w + k]} << (8 * k);
      ram_[at + 2 + w] = v;
    }
    put_ = (put_ + 1) % depth();
    ++fill_;
    r_[0x50] |= 1;  // RF0N
    serve();
  }

  struct Bit {
    double rate, sample_point, quanta;
  };
  [[nodiscard]] Bit nominal(double clock) {
    const std::uint32_t v = r_[0x1C];
    return bit(clock, ((v >> 16) & 0x1FF) + 1, ((v >> 8) & 0xFF) + 1, (v & 0x7F) + 1);
  }
  [[nodiscard]] Bit data(double clock) {
    const std::uint32_t v = r_[0x0C];
    return bit(clock, ((v >> 16) & 0x1F) + 1, ((v >> 8) & 0x1F) + 1, ((v >> 4) & 0xF) + 1);
  }

 private:
  static Bit bit(double clock, double prescaler, double before, double after) {
    const double quanta = 1 + before + after;
    return {clock / prescaler / quanta, (1 + before) / quanta, quanta};
  }
  void fault(const std::string& what) { wrong.push_back(what); }
  [[nodiscard]] bool g4() const { return chip_ == Chip::g4; }
  [[nodiscard]] std::uint32_t rxf0s() const { return g4() ? 0x90 : 0xA4; }
  [[nodiscard]] std::uint32_t rxf0a() const { return g4() ? 0x94 : 0xA8; }
  [[nodiscard]] std::uint32_t txbrp() const { return g4() ? 0xC8 : 0xCC; }
  [[nodiscard]] std::uint32_t txbar() const { return g4() ? 0xCC : 0xD0; }
  [[nodiscard]] std::uint32_t txbcr() const { return g4() ? 0xD0 : 0xD4; }
  [[nodiscard]] std::uint32_t lost_flag() const { return g4() ? 1U << 2 : 1U << 3; }
  [[nodiscard]] bool guarded_register(std::uint32_t at) const {
    static const std::set<std::uint32_t> both{0x0C, 0x10, 0x14, 0x1C, 0x20, 0x28, 0x48, 0x80, 0xC0};
    static const std::set<std::uint32_t> full{0x84, 0x88, 0x90, 0xA0, 0xAC, 0xB0, 0xBC, 0xC8, 0xF0};
    return both.contains(at) || (g4() ? at == 0x84 || at == 0x100 : full.contains(at));
  }
  [[nodiscard]] bool asserted() {  // a flag that is enabled, on line 0, and the line is enabled
    const std::uint32_t line = g4() ? (reg(0x58) & 1U) != 0 ? 7U : 0U : reg(0x58);
    return (reg(0x50) & reg(0x54) & ~line) != 0 && (reg(0x5C) & 1U) != 0;
  }
  void serve() {
    if (serving_) return;
    serving_ = true;
    for (int n = 0; handler && !masked_ && asserted(); ++n) {
      if (n == 100) {
        fault("an interrupt that does not end");
        break;
      }
      ++interrupts;
      handler();
    }
    serving_ = false;
  }
  /// The first matching filter decides; frames without one go where GFC says.
  bool heard(const WireFrame& f) {
    const std::uint32_t gfc = reg(0x80);
    if (f.remote && (gfc & (f.extended ? 1U : 2U)) != 0) return false;
    const std::uint32_t list = reg(f.extended ? 0x88 : 0x84);
    const std::uint32_t begin = g4() ? (f.extended ? 0x70U / 4 : 0U) : (list & 0xFFFC) >> 2;
    const std::uint32_t count = g4() ? gfc >> (f.extended ? 24 : 16) & (f.extended ? 0xFU : 0x1FU)
                                     : list >> 16 & (f.extended ? 0x7FU : 0xFFU);
    if (g4() && count > (f.extended ? 8U : 28U)) fault("more filters than there is room for");
    for (std::uint32_t i = 0; i < count; ++i) {
      const std::uint32_t one = read_ram(begin + i * (f.extended ? 2 : 1));
      const std::uint32_t two = f.extended ? read_ram(begin + 2 * i + 1) : 0;
      const std::uint32_t kind = (f.extended ? two : one) >> 30, where = one >> (f.extended ? 29 : 27) & 7;
      const std::uint32_t id = f.extended ? one & 0x1FFFFFFF : one >> 16 & 0x7FF;
      const std::uint32_t mask = f.extended ? two & 0x1FFFFFFF : one & 0x7FF;
      if (kind != 2 || where != 1) fault("a filter that is no mask into FIFO 0");
      if (((f.id ^ id) & mask) == 0) return true;
    }
    const std::uint32_t others = gfc >> (f.extended ? 2 : 4) & 3U;
    if (others == 1) fault("frames into FIFO 1, which is not read");
    return others == 0;
  }
  std::uint64_t rank(std::uint32_t i) {
    const std::uint32_t t0 = ram_[tx_at(i)];
    return (t0 & (1U << 30)) != 0 ? (std::uint64_t{t0 & 0x1FFFFFFF} << 1) | 1
                                  : std::uint64_t{t0 & 0x1FFC0000} << 1;
  }
  std::uint32_t reg(std::uint32_t at) { return r_.contains(at) ? r_[at] : 0; }
  std::uint32_t depth() { return g4() ? 3 : (reg(0xA0) >> 16) & 0x7F; }
  std::uint32_t tx_depth() { return g4() ? 3 : (reg(0xC0) >> 24) & 0x3F; }
  bool queue_mode() { return (reg(0xC0) & (g4() ? 1U << 24 : 1U << 30)) != 0; }
  /// Words of an element whose data field has the size that RXESC and TXESC give.
  static std::uint32_t words(std::uint32_t code) {
    static const std::uint32_t bytes[] = {8, 12, 16, 20, 24, 32, 48, 64};
    return 2 + bytes[code & 7] / 4;
  }
  std::uint32_t rx_at(std::uint32_t i) {
    return g4() ? 0xB0 / 4 + 18 * i : ((reg(0xA0) & 0xFFFC) >> 2) + words(reg(0xBC)) * i;
  }
  std::uint32_t tx_at(std::uint32_t i) {
    return g4() ? 0x278 / 4 + 18 * i : ((reg(0xC0) & 0xFFFC) >> 2) + words(reg(0xC8)) * i;
  }
  WireFrame element(std::uint32_t at) {
    static const unsigned sizes[] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64};
    const std::uint32_t t0 = read_ram(at), t1 = read_ram(at + 1);
    WireFrame f;
    f.extended = (t0 >> 30 & 1) != 0;
    f.remote = (t0 >> 29 & 1) != 0;
    f.id = f.extended ? t0 & 0x1FFFFFFF : t0 >> 18 & 0x7FF;
    f.dlc = t1 >> 16 & 0xF;
    const bool fd_on = (r_[0x18] & (1U << 8)) != 0;
    f.fd = fd_on && (t1 >> 21 & 1) != 0;
    f.brs = f.fd && (t1 >> 20 & 1) != 0 && (r_[0x18] & (1U << 9)) != 0;
    const unsigned n = f.fd ? sizes[f.dlc] : (f.dlc > 8 ? 8 : f.dlc);
    const unsigned field =
        4 * (words(g4() ? 7 : reg(0xC8)) - 2);  // what the element does not hold goes out as CC
    for (unsigned i = 0; i < n && !f.remote; ++i) {
      f.bytes.push_back(i < field ? static_cast<std::uint8_t>(read_ram(at + 2 + i / 4) >> (8 * (i % 4)))
                                  : std::uint8_t{0xCC});
    }
    return f;
  }

  Chip chip_;
  std::map<std::uint32_t, std::uint32_t> r_, ram_;
  bool init_ = true, wanted_init_ = true, off_ = false, masked_ = false, serving_ = false;
  bool cancelled_ = false;  // the frame on the wire is asked to be
  int settle_ = 0, on_wire_ = -1;
  std::uint32_t pending_ = 0, transmitted_ = 0, get_ = 0, put_ = 0, stamp_ = 0, tec_ = 0, rec_ = 0, idle_ = 0;
  std::size_t fill_ = 0;
};

/// The driver's way to it.
struct FdcanModelAccess {
  FdcanModel* model;
  [[nodiscard]] std::uint32_t read(std::uint32_t at) const { return model->read(at); }
  void write(std::uint32_t at, std::uint32_t v) { model->write(at, v); }
  [[nodiscard]] std::uint32_t read_ram(std::uint32_t at) const { return model->read_ram(at); }
  void write_ram(std::uint32_t at, std::uint32_t v) { model->write_ram(at, v); }
};

}  // namespace esmc::test
