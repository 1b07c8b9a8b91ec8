/// Parameters in flash: two slots with anything in them, orders, operations that fail, last too long or are
/// cut short by losses of power; on memories that tear in five ways and on the flash of both chips at
/// register level. A reader of this file's own says what a slot holds, and of every instant which gains the
/// next power-up may find.

#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <optional>
#include <vector>

#include "firmware/link/parameter_slots.hpp"
#include "hal/flash/bank_slots.hpp"
#include "tests/fuzz/bytes.hpp"
#include "tests/support/flash_model.hpp"
#include "tests/support/slot_memory.hpp"

namespace {

using namespace esmc;
using fuzz::require;
using link::SlotContent;
using link::StoreState;

constexpr unsigned record_words = 8;
using Raw = std::array<std::optional<std::uint32_t>, record_words>;  // none: cannot be read
using Bits = std::array<std::uint32_t, 4>;                           // gains, to the last bit: NaN as well
using Found = std::optional<Bits>;

Bits bits_of(const link::Gains& g) { return std::bit_cast<Bits>(g); }

/// CRC-32/ISO-HDLC, bit by bit.
std::uint32_t check_sum(const Raw& w) {
  std::uint32_t c = ~0U;
  for (unsigned i = 0; i < 32 * (record_words - 1); ++i) {
    const std::uint32_t bit = (w[i / 32].value_or(0) >> (i % 32)) & 1U;
    c = ((c ^ bit) & 1U) != 0 ? (c >> 1U) ^ 0xEDB8'8320U : c >> 1U;
  }
  return ~c;
}

struct Image {
  std::uint32_t scene = 0;
  Bits baked{};
  std::array<link::Bounds, 4> bounds{};
  std::uint32_t polls_max = 0;

  [[nodiscard]] bool takes(const Bits& g) const {
    for (std::size_t i = 0; i < 4; ++i) {
      const auto [low, high] = bounds[i];
      const float v = std::bit_cast<float>(g[i]);
      if (high > low ? !(low <= v && v <= high) : g[i] != baked[i]) return false;
    }
    return true;
  }
};

struct Slot {
  SlotContent content = SlotContent::damaged;
  std::uint32_t sequence = 0;
  Bits gains{};
};
Slot judge(const Image& image, const Raw& w) {
  bool blank = true;
  for (const auto& word : w) {
    if (!word) return {};
    blank = blank && *word == ~0U;
  }
  if (blank) return {SlotContent::empty, 0, {}};
  if (*w[0] >> 8U != 0x45534D) return {};  // "ESM"
  if ((*w[0] & 0xFFU) != 1) return {SlotContent::other_format, 0, {}};
  if (*w[7] != check_sum(w)) return {};
  Slot s{SlotContent::valid, *w[1], {*w[3], *w[4], *w[5], *w[6]}};
  if (*w[2] != image.scene) {
    s.content = SlotContent::other_scene;
  } else if (!image.takes(s.gains)) {
    s.content = SlotContent::out_of_bounds;
  }
  return s;
}

/// A memory whose operations may be cut short in every way.
template <unsigned unit>
struct Plain {
  using Memory = test::SlotMemory<unit>;
  Memory memory{};

  Memory& driver() { return memory; }
  void put(unsigned slot, unsigned at, std::uint32_t word) {
    memory.slots[slot][at] = word;
    memory.programmed[slot][at] = true;
  }
  void damage(unsigned slot, unsigned at) { memory.unreadable[slot][at] = true; }
  void take_away(unsigned) { memory.usable = false; }
  [[nodiscard]] bool usable() const { return memory.usable; }
  [[nodiscard]] Raw look(unsigned slot) const {
    Raw w;
    for (unsigned i = 0; i < record_words; ++i) {
      if (!memory.unreadable[slot][i]) w[i] = memory.slots[slot][i];
    }
    return w;
  }
  [[nodiscard]] bool busy() const {
    Memory copy = memory;
    copy.unreadable = {};
    std::uint32_t word = 0;
    return !copy.read(0, 0, word);
  }
  [[nodiscard]] std::uint32_t begun() const { return static_cast<std::uint32_t>(memory.begun); }
  void lasts(int polls) { memory.duration = polls; }
  void trouble(unsigned kind, unsigned when) {
    const int at = memory.begun + static_cast<int>(when % 12);
    if (kind == 0) memory.fails_at = at;
    if (kind == 1) memory.refused_at = at;
    if (kind == 2) {
      memory.flips_at = at;
      memory.flips_word = when / 12 % unit;
    }
  }
  void cut(unsigned way) {
    memory.lose_power(static_cast<test::Torn>(way % 5));
    memory.fails_at = memory.refused_at = memory.flips_at = -1;
  }
  void no_wrong() const {
    require(memory.wrong.empty(), memory.wrong.empty() ? "" : memory.wrong[0].c_str());
  }
};

/// The flash of a chip behind its driver.
template <class Driver>
struct Chip {
  static constexpr bool g4 = Driver::unit_words == 2;
  test::FlashModel model{g4 ? test::FlashModel::Chip::g4 : test::FlashModel::Chip::h7};
  std::optional<Driver> chip{};

  Driver& driver() { return chip.emplace(test::FlashModelAccess{&model}); }
  [[nodiscard]] std::uint32_t address(unsigned slot, unsigned at) const { return model.slot(slot) + 4 * at; }
  void put(unsigned slot, unsigned at, std::uint32_t word) { model.put(address(slot, at), word); }
  void damage(unsigned slot, unsigned at) { model.tear(address(slot, at)); }
  void take_away(unsigned way) { model.options = g4 ? (way % 2 == 0 ? 1U << 22 : 1U << 20) : 1U << 31; }
  [[nodiscard]] bool usable() const { return model.options == 0; }
  [[nodiscard]] Raw look(unsigned slot) const {
    test::FlashModel copy = model;  // it logs reads and their times
    Raw w;
    for (unsigned i = 0; i < record_words; ++i) {
      std::uint32_t cached = 0;
      if (copy.load(address(slot, i), cached)) w[i] = model.at(address(slot, i));
    }
    return w;
  }
  [[nodiscard]] bool busy() const {
    test::FlashModel copy = model;
    return (copy.read(g4 ? 0x10 : 0x110) & (g4 ? 1U << 16 : 5U)) != 0;
  }
  [[nodiscard]] std::uint32_t begun() const { return model.begun; }
  void lasts(int reads) { model.duration = reads; }
  void trouble(unsigned kind, unsigned when) {
    constexpr std::array<unsigned, 10> g4_errors{1, 3, 4, 5, 6, 7, 8, 9, 14, 15};
    constexpr std::array<unsigned, 5> h7_errors{17, 18, 19, 21, 22};
    if (kind == 0)
      model.spoil = 1U << (g4 ? g4_errors[when % g4_errors.size()] : h7_errors[when % h7_errors.size()]);
    if (kind == 1)
      model.loses = static_cast<int>(Driver::unit_words * (1 + when % 4));  // the last one of a unit
    if (kind == 2) model.write(g4 ? 0x08 : 0x104, 0x1234);                  // locked until the next reset
  }
  void cut(unsigned) {
    model.lose_power();
    model.spoil = 0;
    model.loses = 0;
  }
  void no_wrong() {
    std::erase(model.wrong, "a wrong key");  // was this file's
    require(model.wrong.empty(), model.wrong.empty() ? "" : model.wrong[0].c_str());
  }
};

template <class Rig>
class Run {
 public:
  explicit Run(fuzz::Bytes& in) : in_(in) {
    image_.scene = in_.below(16) == 0 ? 0 : 0x89AB'CDEFU;
    image_.polls_max = in_.below(64);
    link::Parameters::Values values{};
    for (std::size_t i = 0; i < 4; ++i) {
      const unsigned kind = in_.below(8);
      image_.bounds[i] = kind == 0   ? link::Bounds{0, 0}
                         : kind == 1 ? link::Bounds{in_.f32(), in_.f32()}
                                     : link::Bounds{10, 80};
      values[i] = kind == 2 ? in_.f32() : 40;
      image_.baked[i] = std::bit_cast<std::uint32_t>(values[i]);
    }
    parameters_ = link::Parameters(values, image_.bounds);
    fill(0);
    fill(1);
    if (in_.below(32) == 31) rig_.take_away(in_.u8());
    way_ = in_.u8();
    rig_.lasts(static_cast<int>(in_.below(8)));
    possible_ = {newest(rig_)};
    power_up();
  }

  void go() {
    while (!in_.empty()) {
      const unsigned what = in_.u8();
      switch (what % 8) {
        case 0:
        case 1:
          store();
          break;
        case 2:
          order([&] { slots_->forget(); }, {});
          break;
        case 3:
          for (unsigned n = in_.below(48); n > 0; --n) poll();
          break;
        case 4:
          finish();
          break;
        case 5:
          way_ = what / 8;
          rig_.cut(way_);
          power_up();
          break;
        case 6:
          rig_.trouble(in_.below(3), in_.u8());
          break;
        default: {
          const unsigned long_ = in_.below(16);
          rig_.lasts(long_ == 15 ? 1000 : long_ == 14 ? 60 : static_cast<int>(long_));
          break;
        }
      }
    }
    rig_.lasts(2);
    finish();
  }

 private:
  using Slots = link::ParameterSlots<std::remove_reference_t<decltype(std::declval<Rig&>().driver())>>;

  Bits gains() {
    Bits g{};
    for (std::size_t i = 0; i < 4; ++i) {
      const unsigned kind = in_.below(16);
      const auto [low, high] = image_.bounds[i];
      const float v = kind == 0   ? low
                      : kind == 1 ? high
                      : kind == 2 ? std::nextafter(low, -INFINITY)
                      : kind == 3 ? std::nextafter(high, INFINITY)
                      : kind == 4 ? in_.f32()
                                  : low + static_cast<float>(kind) / 16 * (high - low);
      g[i] = kind > 4 && !(high > low) ? image_.baked[i] : std::bit_cast<std::uint32_t>(v);
    }
    return g;
  }
  /// Numbers near to each other, around the corner, and half a round apart.
  std::uint32_t sequence() {
    constexpr std::array<std::uint32_t, 8> near{
        0, 1, 2, ~0U, 0x7FFF'FFFFU, 0x8000'0000U, 0x8000'0001U, 0xFFFF'FFFEU};
    const unsigned kind = in_.below(9);
    return kind == 8 ? in_.u32() : 5U + near[kind];
  }
  void fill(unsigned slot) {
    const unsigned kind = in_.below(8);
    if (kind == 0) return;
    Raw w{0x45534D01U, sequence(), image_.scene, 0, 0, 0, 0, 0};
    const Bits g = gains();
    for (std::size_t i = 0; i < 4; ++i) w[3 + i] = g[i];
    if (kind == 1) w[2] = in_.u8();
    if (kind == 2) w[in_.below(record_words)] = in_.u32();
    w[7] = check_sum(w);
    if (kind == 3) w[in_.below(record_words)].value() ^= 1U << in_.below(32);
    if (kind == 4) {
      for (auto& word : w) word = in_.u32();
    }
    for (unsigned i = 0; i < record_words; ++i) rig_.put(slot, i, w[i].value());
    if (kind == 5) rig_.damage(slot, in_.below(record_words));
  }

  std::array<Slot, 2> both(const Rig& rig) const {
    return {judge(image_, rig.look(0)), judge(image_, rig.look(1))};
  }
  /// Which of them counts; 2: none.
  static unsigned counts(const std::array<Slot, 2>& s) {
    const bool first = s[0].content == SlotContent::valid, second = s[1].content == SlotContent::valid;
    const std::uint32_t ahead = s[1].sequence - s[0].sequence;
    if (first && second) return ahead > 0 && ahead < 0x8000'0000U ? 1 : 0;
    return first ? 0 : second ? 1 : 2;
  }
  Found newest(const Rig& rig) const {
    if (image_.scene == 0 || !rig.usable()) return {};
    const auto s = both(rig);
    const unsigned i = counts(s);
    return i == 2 ? Found() : s[i].gains;
  }
  [[nodiscard]] bool may_be(const Found& f) const {
    return std::ranges::find(possible_, f) != possible_.end();
  }

  void power_up() {
    before_ = rig_.begun();
    slots_.emplace(rig_.driver(), parameters_, image_.scene, image_.polls_max);
    const auto taken = slots_->load();
    const Found is = taken ? Found(bits_of(*taken)) : Found();
    require(is == newest(rig_), "what is taken is the newest whole record, or nothing");
    require(may_be(is), "after a loss of power: the old gains or the new ones");
    possible_ = {is};
    const bool none = image_.scene == 0 || !rig_.usable();
    require(slots_->status().state == (none ? StoreState::none : StoreState::idle), "state at power-up");
    used_ = is ? static_cast<std::uint8_t>(counts(both(rig_)) + 1) : std::uint8_t{0};
    told();
  }
  /// What it says of the slots is what is there.
  void told() {
    const auto& status = slots_->status();
    require(status.used == used_, "the slot of power-up");
    if (status.state == StoreState::none) {
      require(status == link::StoreStatus{} && rig_.begun() == before_,
              "without a store nothing is said and nothing begun");
      return;
    }
    const auto s = both(rig_);
    require(status.slots[0] == s[0].content && status.slots[1] == s[1].content, "contents as they are");
    const unsigned i = counts(s);
    require(status.sequence == (i == 2 ? 0 : s[i].sequence), "the number of the newest");
  }

  void store() {
    const Bits g = gains();
    if (!image_.takes(g)) return;  // the caller of store checks them
    order([&] { slots_->store(std::bit_cast<link::Gains>(g)); }, g);
  }
  template <class Give>
  void order(const Give& give, const Found& wanted) {
    const bool was = slots_->busy();
    give();
    if (was || !slots_->busy()) return;  // one at a time
    wanted_ = wanted;
    possible_.push_back(wanted);
  }

  void poll() {
    const bool was = slots_->busy(), at_work = rig_.busy();
    const std::uint32_t begun = rig_.begun();
    slots_->poll();
    require(rig_.begun() - begun <= 1, "a step at a time");
    rig_.no_wrong();
    Rig cut = rig_;
    cut.cut(way_);
    require(may_be(newest(cut)), "whenever the power goes: the old gains or the new ones");
    if (slots_->busy() || rig_.busy()) return;
    const StoreState state = slots_->status().state;
    if ((was || at_work) && state == StoreState::failed)
      return;  // given up: the next poll sees that the memory is ready
    told();
    if (!was) return;
    if (state == StoreState::stored) {
      require(wanted_ && newest(rig_) == wanted_, "what was stored is what the next power-up takes");
      possible_ = {wanted_};
    } else {
      require(state == StoreState::forgotten, "an order ends well or fails");
      const auto s = both(rig_);
      require(!wanted_ && s[0].content == SlotContent::empty && s[1].content == SlotContent::empty,
              "forgotten: both empty");
      possible_ = {Found()};
    }
  }
  void finish() {
    // Two erasures, eight units, two readings, each with its patience.
    for (unsigned n = 0; slots_->busy(); ++n) {
      require(n < 32 * (image_.polls_max + 2), "an order ends");
      poll();
    }
    poll();
  }

  fuzz::Bytes& in_;
  Rig rig_{};
  Image image_{};
  link::Parameters parameters_{};
  std::optional<Slots> slots_{};
  std::vector<Found> possible_{};
  Found wanted_{};
  std::uint32_t before_ = 0;
  unsigned way_ = 0;
  std::uint8_t used_ = 0;
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  fuzz::Bytes in(data, size);
  in.one_of(
      4, [&] { Run<Plain<2>>(in).go(); }, [&] { Run<Plain<8>>(in).go(); },
      [&] { Run<Chip<hal::flash::G4Slots<test::FlashModelAccess>>>(in).go(); },
      [&] { Run<Chip<hal::flash::H7Slots<test::FlashModelAccess>>>(in).go(); });
  return 0;
}
