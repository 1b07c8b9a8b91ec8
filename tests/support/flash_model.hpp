#pragma once
/// Bank 2 of the flash of an STM32G4 or H7 as a program sees it, by the reference manuals (RM0440 ch. 3,
/// RM0433 ch. 4): keys, locks, operations that take time, error flags, error correction, a data cache, losses
/// of power. What a program must not do is noted in `wrong`. Shares nothing with hal/flash.

#include <array>
#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <vector>

namespace esmc::test {

class FlashModel {
 public:
  enum class Chip { g4, h7 };
  explicit FlashModel(Chip chip) : chip_(chip) { reset(); }

  std::vector<std::string> wrong;
  int duration = 3;           ///< reads of the status register that an operation takes
  std::uint32_t options = 0;  ///< bits of OPTR (G4) or OPTCR (H7) that are turned over
  std::uint32_t spoil = 0;    ///< error flags that the next operation ends with
  std::uint32_t begun = 0;    ///< operations, of either kind
  int loses = 0;              ///< the store with this number from now on does not arrive

  [[nodiscard]] bool g4() const { return chip_ == Chip::g4; }
  [[nodiscard]] std::uint32_t slot(unsigned i) const {
    return g4() ? 0x0807'F000U + 0x800U * i : 0x081C'0000U + 0x2'0000U * i;
  }
  [[nodiscard]] std::uint32_t unit_bytes() const { return g4() ? 8 : 32; }

  /// The power goes: what is under way leaves its page, or its unit, half done. Then it is back.
  void lose_power() {
    if (busy_ > 0) {
      for (const std::uint32_t u : units_) torn_.insert(u);
    }
    reset();
  }
  /// As a programmer with wires would do it.
  void put(std::uint32_t address, std::uint32_t word) {
    memory_[address] = word;
    programmed_.insert(address / unit_bytes());
  }
  [[nodiscard]] std::uint32_t at(std::uint32_t address) const {
    const auto i = memory_.find(address);
    return i == memory_.end() ? ~0U : i->second;
  }
  void tear(std::uint32_t address) { torn_.insert(address / unit_bytes()); }
  /// Locked, and what the program found of the cache is as it was.
  [[nodiscard]] bool at_rest() const {
    return busy_ == 0 && locked_ && pg_ == 0 && (!g4() || (acr_ & 0x1400U) == 0x400U);
  }

  // --- the program's side
  std::uint32_t read(std::uint32_t at) {
    if (at == (g4() ? 0x20U : 0x18U)) return (g4() ? 0xFFEF'F8AAU : 1U) ^ options;
    if (at == status_at()) {
      const std::uint32_t now =
          status_ | (busy_ > 0 ? (g4() ? 1U << 16 : 5U) : 0U) | (!g4() && !buffer_.empty() ? 2U : 0U);
      if (busy_ > 0 && --busy_ == 0) end();
      return now;
    }
    if (at == control_at()) return control_ | (locked_ ? lock_bit() : 0U);
    if (g4() && at == 0) return acr_;
    note("reads register " + std::to_string(at));
    return 0;
  }
  void write(std::uint32_t at, std::uint32_t v) {
    if (at == (g4() ? 0x08U : 0x104U)) {
      if (v != (keys_ == 0 ? 0x4567'0123U : 0xCDEF'89ABU) || !locked_ || dead_) {
        dead_ = true;  // until the next reset
        return note("a wrong key");
      }
      if (++keys_ == 2) locked_ = false, keys_ = 0;
    } else if (at == (g4() ? 0x10U : 0x114U)) {
      if (busy_ > 0) note("clears flags of an operation under way");
      status_ &= ~v;
    } else if (at == control_at()) {
      control(v);
    } else if (g4() && at == 0) {
      if ((v & (1U << 12)) != 0 && ((v | acr_) & (1U << 10)) != 0)
        note("resets the data cache while it is on");
      if ((v & (1U << 12)) != 0) cache_.clear();
      if ((v & 0xFU) != 4) note("changes the wait states");
      if ((v & (1U << 10)) != 0 && busy_ > 0) note("data cache on while it writes");
      acr_ = v;
    } else {
      note("writes register " + std::to_string(at));
    }
  }
  bool load(std::uint32_t address, std::uint32_t& word) {
    if (busy_ > 0) note("reads the bank that is being written: the processor stands still");
    if (torn_.contains(address / unit_bytes())) {
      if (!g4()) status_ |= 1U << 26;  // DBECCERR
      return false;
    }
    const bool cached = g4() && (acr_ & (1U << 10)) != 0;
    if (cached && cache_.contains(address)) {
      word = cache_[address];
      return true;
    }
    word = at(address);
    if (cached) cache_[address] = word;
    return true;
  }
  void store(std::uint32_t address, std::uint32_t word) {
    if (loses > 0 && --loses == 0) return;
    if (locked_ || pg_ == 0 || busy_ > 0 || (status_ & errors()) != 0) {
      note("programs without PG, or with errors that were not cleared");
      status_ |= pgserr();
      return;
    }
    if (g4() && (acr_ & (1U << 10)) != 0) note("data cache on while it writes");
    if (address % 4 != 0 ||
        address / unit_bytes() != (buffer_.empty() ? address : buffer_[0].first) / unit_bytes() ||
        (address % unit_bytes()) / 4 != buffer_.size()) {
      note("words of a unit out of order");
      status_ |= g4() ? 1U << 6 : 1U << 21;  // SIZERR, INCERR
      return;
    }
    buffer_.emplace_back(address, word);
    if (buffer_.size() * 4 < unit_bytes()) return;
    units_ = {address / unit_bytes()};
    if (programmed_.contains(*units_.begin())) {
      note("programs what is not erased");
      if (g4()) {
        status_ |= 1U << 3;  // PROGERR
      } else {
        torn_.insert(*units_.begin());  // the flash does it, and the error correction no longer fits
      }
      buffer_.clear();
      return;
    }
    start();
  }

 private:
  void note(const std::string& what) { wrong.push_back(what); }
  [[nodiscard]] std::uint32_t status_at() const { return g4() ? 0x10 : 0x110; }
  [[nodiscard]] std::uint32_t control_at() const { return g4() ? 0x14 : 0x10C; }
  [[nodiscard]] std::uint32_t lock_bit() const { return g4() ? 1U << 31 : 1U; }
  [[nodiscard]] std::uint32_t pgserr() const { return g4() ? 1U << 7 : 1U << 18; }
  [[nodiscard]] std::uint32_t errors() const { return g4() ? 0xC3FAU : 0x006E'0000U; }

  void reset() {
    status_ = g4() ? 1U << 7 : (1U << 18) | (1U << 23);  // left over by whatever ran before: PGSERR; RDPERR
    control_ = g4() ? 0 : 0x30;
    acr_ = 4U | (7U << 8);
    locked_ = true;
    dead_ = false;
    keys_ = busy_ = 0;
    pg_ = 0;
    buffer_.clear();
    cache_.clear();
    units_.clear();
  }
  void control(std::uint32_t v) {
    if (locked_ || busy_ > 0) return note("writes the control register while it is locked or at work");
    const std::uint32_t start_bit = g4() ? 1U << 16 : 1U << 7, erase_bit = g4() ? 2U : 4U;
    control_ = v & ~(lock_bit() | start_bit);
    pg_ = v & (g4() ? 1U : 2U);
    if (!g4() && (v & 0x30U) != 0x30U) note("a parallelism other than 64 bits");
    if ((v & (g4() ? 0x0000'8004U : 0x8U)) != 0) note("a mass erase");
    if (pg_ == 0 && g4()) buffer_.clear();  // of an H7 the manual does not say so
    if ((v & lock_bit()) != 0) locked_ = true;
    if ((v & start_bit) == 0) return;
    if ((v & erase_bit) == 0) return note("starts nothing");
    if ((status_ & errors()) != 0) {
      status_ |= pgserr();
      return note("begins with errors that were not cleared");
    }
    if (g4() && (acr_ & (1U << 10)) != 0) note("data cache on while it writes");
    if (g4() && (v & (1U << 11)) == 0) return note("erases in bank 1: the program");
    const std::uint32_t size = g4() ? 2048 : 0x2'0000, n = g4() ? (v >> 3) & 0x7FU : (v >> 8) & 7U;
    const std::uint32_t from = (g4() ? 0x0804'0000U : 0x0810'0000U) + n * size;
    if (from != slot(0) && from != slot(1)) note("erases another page");
    units_.clear();
    // Of a page what a record may lie in is enough.
    for (std::uint32_t u = from / unit_bytes(); u < (from + 64) / unit_bytes(); ++u) units_.insert(u);
    erasing_ = true;
    start();
  }
  void start() {
    ++begun;
    busy_ = duration;
    if (busy_ == 0) end();
  }
  void end() {
    status_ |= spoil;
    for (const std::uint32_t u : units_) {
      if (!erasing_ && spoil == 0) programmed_.insert(u);
      if (erasing_ && spoil == 0) {
        programmed_.erase(u);
        torn_.erase(u);
        for (std::uint32_t a = 0; a < unit_bytes(); a += 4) memory_.erase(u * unit_bytes() + a);
      }
    }
    if (!erasing_ && spoil == 0) {
      for (const auto& [address, word] : buffer_) memory_[address] = word;
    }
    buffer_.clear();
    units_.clear();
    erasing_ = false;
    spoil = 0;
  }

  Chip chip_;
  std::map<std::uint32_t, std::uint32_t> memory_, cache_;
  std::set<std::uint32_t> programmed_, torn_, units_;
  std::vector<std::pair<std::uint32_t, std::uint32_t>> buffer_;
  std::uint32_t status_ = 0, control_ = 0, acr_ = 0, pg_ = 0;
  int keys_ = 0, busy_ = 0;
  bool locked_ = true, dead_ = false, erasing_ = false;
};

/// The driver's way to it.
struct FlashModelAccess {
  FlashModel* model;
  [[nodiscard]] std::uint32_t read(std::uint32_t at) const { return model->read(at); }
  void write(std::uint32_t at, std::uint32_t v) { model->write(at, v); }
  bool load(std::uint32_t address, std::uint32_t& word) { return model->load(address, word); }
  void store(std::uint32_t address, std::uint32_t word) { model->store(address, word); }
};

}  // namespace esmc::test
