#pragma once
/// Gains in a non-volatile memory: records in two slots, of which the newest valid one is used at power-up. A
/// new record goes into the other slot, so that a loss of power at any step leaves the older one.

#include <array>
#include <bit>
#include <cstdint>
#include <optional>
#include <span>
#include <utility>

#include "firmware/link/command_link.hpp"
#include "firmware/link/parameters.hpp"
#include "hal/slot_memory.hpp"

namespace esmc::link {

/// A record of gains in a slot. Words of 32 bits: mark and format, sequence number, scene, gains,
/// CRC-32/ISO-HDLC over the bytes of all previous words, little endian. The first word keeps its meaning in
/// every later format.
struct SlotRecord {
  static constexpr unsigned words = 4 + gain_count;
  static constexpr std::uint32_t mark = 0x4553'4D00U, format_mask = 0xFF;  // "ESM", then the format
  static constexpr std::uint32_t format = 1;
  using Words = std::array<std::uint32_t, words>;

  std::uint32_t sequence = 0;  ///< one more than in the previous record, modulo 2^32
  std::uint32_t scene = 0;     ///< LinkConfig::scene of the image that wrote it
  Gains gains{};

  /// CRC-32/ISO-HDLC of all words but the last, which must hold it.
  static constexpr std::uint32_t sum(const Words& w) {
    std::uint32_t c = crc32_start;
    for (unsigned i = 0; i + 1 < words; ++i) {
      for (unsigned k = 0; k < 4; ++k) c = crc32_add(c, static_cast<std::uint8_t>(w[i] >> (8U * k)));
    }
    return ~c;
  }
  /// The words of this record, checksum included.
  [[nodiscard]] constexpr Words encode() const {
    Words w{mark | format, sequence, scene};
    for (unsigned i = 0; i < gain_count; ++i) w[3 + i] = std::bit_cast<std::uint32_t>(gains[i]);
    w[words - 1] = sum(w);
    return w;
  }
};

/// Store of gains on a hal::SlotMemory. poll() carries out operations, a small step per call.
template <hal::SlotMemory Memory>
class ParameterSlots {
 public:
  static_assert(SlotRecord::words % Memory::unit_words == 0, "a record is whole units of the memory");

  /// `memory` must outlive this; there is no store before load(). `baked`: values and bounds of the image;
  /// `scene`: identity of the image, 0 (not known): no store. An operation of the memory that takes more than
  /// `polls_max` calls of poll() has failed.
  ParameterSlots(Memory& memory, const Parameters& baked, std::uint32_t scene, std::uint32_t polls_max)
      : memory_(memory), baked_(baked), scene_(scene), polls_max_(polls_max) {}

  /// Reads, at power-up, the gains of the newest record that this image can use as a whole. Empty: use the
  /// baked gains.
  [[nodiscard]] std::optional<Gains> load() {
    if (scene_ == 0 || !memory_.available()) return std::nullopt;
    status_.state = StoreState::idle;
    survey();
    if (current_ == none) return std::nullopt;
    status_.used = static_cast<std::uint8_t>(current_ + 1);
    return slots_[current_].gains;
  }

  [[nodiscard]] const StoreStatus& status() const { return status_; }  ///< of store and slots
  /// True while poll() carries out a store() or forget().
  [[nodiscard]] bool busy() const {
    return status_.state == StoreState::storing || status_.state == StoreState::forgetting;
  }

  /// Begins to store gains, which poll() carries out; status() shows the result. Ignored while busy() or
  /// without a store; fails while an operation that timed out may still go on.
  void store(const Gains& gains) {
    if (!begin(StoreState::storing)) return;
    std::uint32_t next = newest_ + 1;
    // The newest record may belong to another scene: the new one must be later than the record in use.
    if (current_ != none && !later(next, slots_[current_].sequence)) next = slots_[current_].sequence + 1;
    record_ = SlotRecord{next, scene_, gains}.encode();
  }
  /// Begins to erase both records, as store(); the older first: a loss of power must not bring it back.
  void forget() {
    if (!begin(StoreState::forgetting)) return;
    record_.fill(hal::erased_word);
    second_ = true;
  }

  /// Makes one step of the present operation without waiting; call between ticks, also if not busy().
  void poll() {
    if (!busy()) {
      // An operation that timed out may still end and leave the memory as ordered.
      if (memory_.poll() != hal::MemoryStatus::busy && std::exchange(status_.memory_busy, false)) survey();
      return;
    }
    switch (memory_.poll()) {
      case hal::MemoryStatus::ready:
        polls_ = 0;
        break;
      case hal::MemoryStatus::busy:
        if (++polls_ > polls_max_) {
          fail();
          status_.memory_busy = true;
        }
        return;
      case hal::MemoryStatus::failed:
        fail();
        return;
    }
    if (step_ == Step::erase) return erase();
    if (step_ == Step::program) return program();
    verify();
  }

 private:
  enum class Step : std::uint8_t { erase, program, verify };
  static constexpr unsigned none = hal::memory_slots;

  struct Slot {
    SlotContent content = SlotContent::empty;
    std::uint32_t sequence = 0;
    Gains gains{};
    /// True if the record is whole, whatever its scene.
    [[nodiscard]] bool intact() const {
      return content == SlotContent::valid || content == SlotContent::other_scene ||
             content == SlotContent::out_of_bounds;
    }
  };
  /// Sequence numbers wrap: `a` is later if it is less than half of the range ahead.
  static bool later(std::uint32_t a, std::uint32_t b) { return static_cast<std::int32_t>(a - b) > 0; }

  [[nodiscard, gnu::noinline]] Slot judge(unsigned slot) {
    SlotRecord::Words w{};
    Slot s;
    bool readable = true, erased = true;
    for (unsigned i = 0; i < SlotRecord::words; ++i) {
      readable = memory_.read(slot, i, w[i]) && readable;
      erased = erased && w[i] == hal::erased_word;
    }
    s.content = erased ? SlotContent::empty : SlotContent::damaged;  // an unreadable word stays 0
    if (!readable || (w[0] & ~SlotRecord::format_mask) != SlotRecord::mark) return s;
    if ((w[0] & SlotRecord::format_mask) != SlotRecord::format) {
      s.content = SlotContent::other_format;
      return s;
    }
    if (w[SlotRecord::words - 1] != SlotRecord::sum(w)) return s;
    s.sequence = w[1];
    for (unsigned i = 0; i < gain_count; ++i) s.gains[i] = std::bit_cast<float>(w[3 + i]);
    s.content = w[2] != scene_                ? SlotContent::other_scene
                : !baked_.acceptable(s.gains) ? SlotContent::out_of_bounds
                                              : SlotContent::valid;
    return s;
  }

  /// Reads both slots and chooses the record in use.
  void survey() {
    current_ = none;
    newest_ = status_.sequence = 0;
    bool any = false;
    for (unsigned i = 0; i < hal::memory_slots; ++i) {
      slots_[i] = judge(i);
      const Slot& s = slots_[i];
      status_.slots[i] = s.content;
      if (s.intact() && (!any || later(s.sequence, newest_))) newest_ = s.sequence;
      any = any || s.intact();
      if (s.content == SlotContent::valid &&
          (current_ == none || later(s.sequence, slots_[current_].sequence)))
        current_ = i;
    }
    if (current_ != none) status_.sequence = slots_[current_].sequence;
  }

  /// The slot for the next record: not that of the record in use; without one, the older of other scenes.
  [[nodiscard]] unsigned spare() const {
    if (current_ != none) return 1U - current_;
    if (!slots_[0].intact() || !slots_[1].intact()) return slots_[0].intact() ? 1 : 0;
    return later(slots_[0].sequence, slots_[1].sequence) ? 1 : 0;
  }

  bool begin(StoreState operation) {
    if (busy() || status_.state == StoreState::none) return false;
    if (status_.memory_busy) {  // the only record might be in the slot that would be erased
      status_.state = StoreState::failed;
      return false;
    }
    status_.state = operation;
    target_ = spare();
    step_ = Step::erase;
    second_ = false;
    polls_ = 0;
    return true;
  }
  void erase() {
    at_ = 0;
    step_ = status_.state == StoreState::storing ? Step::program : Step::verify;
    if (!memory_.begin_erase(target_)) fail();
  }
  void program() {
    constexpr unsigned unit = Memory::unit_words;
    if (!memory_.begin_program(target_, at_,
                               std::span<const std::uint32_t, unit>(record_.data() + at_, unit)))
      return fail();
    at_ += unit;
    if (at_ < SlotRecord::words) return;
    at_ = 0;
    step_ = Step::verify;
  }
  void verify() {
    std::uint32_t word = 0;
    if (!memory_.read(target_, at_, word) || word != record_[at_]) return fail();
    if (++at_ < SlotRecord::words) return;
    if (second_) {
      second_ = false;
      target_ = 1U - target_;
      step_ = Step::erase;
      return;
    }
    status_.state = status_.state == StoreState::storing ? StoreState::stored : StoreState::forgotten;
    survey();
  }
  /// The status then shows the slots as the next power-up will find them.
  void fail() {
    status_.state = StoreState::failed;
    survey();
  }

  Memory& memory_;
  Parameters baked_;
  std::uint32_t scene_, polls_max_;
  StoreStatus status_{};
  std::array<Slot, hal::memory_slots> slots_{};
  unsigned current_ = none, target_ = 0, at_ = 0;
  std::uint32_t newest_ = 0, polls_ = 0;
  SlotRecord::Words record_{};
  Step step_ = Step::erase;
  bool second_ = false;
};

/// Gives the stored gains, if they can be used, to the link; call at power-up, before the first tick.
template <class Memory>
void restore(CommandLink& link, ParameterSlots<Memory>& slots) {
  if (!link.active()) return;  // no orders can come
  if (const auto gains = slots.load()) (void)link.restore(*gains);
  link.store_status(slots.status());
}
/// Passes a request of the link (store, forget) to the store, and polls it once; call between two ticks.
template <class Memory>
void serve(CommandLink& link, ParameterSlots<Memory>& slots) {
  const StoreRequest request = link.take_store_request();
  if (request == StoreRequest::store) slots.store(link.parameters().gains());
  if (request == StoreRequest::forget) slots.forget();
  slots.poll();
  link.store_status(slots.status());
}

}  // namespace esmc::link
