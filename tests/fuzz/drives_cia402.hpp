#pragma once
/// The emulated CiA 402 drive as a target: what the standards say of each state of the network, of PDOs and
/// of torque.

#include <array>

#include "host_sim/drives/cia402_axis.hpp"
#include "tests/fuzz/drives.hpp"
#include "tests/support/canopen_bytes.hpp"

namespace esmc::fuzz {

class Cia402Run final : public DriveRun {
 public:
  explicit Cia402Run(Bytes& in) : DriveRun(in) {
    const unsigned how = in_.u8();
    settings_.lockstep = (how & 1U) == 0;
    settings_.rated_torque = (how & 2U) != 0 ? 0.5 : 3.0;
    settings_.max_torque = (how & 4U) != 0 ? 100.0 : 2.0;
    settings_.counts_per_turn = (how & 8U) != 0 ? 1e9 : 4096.0;
    settings_.defects.watchdog_off = (how & 16U) != 0;
    settings_.defects.short_frames_stale = (how & 32U) != 0;
    settings_.defects.pre_operational_keeps_torque = (how & 64U) != 0;
    node_ = 1 + in_.below(127);
    mount(static_cast<int>(node_));
    auto axis = std::make_unique<host::Cia402Axis>(mount_, settings_, sensor_, 0, 1);
    drive_ = axis.get();
    axis_ = std::move(axis);
  }

 private:
  static constexpr unsigned operational = 5, stopped = 4, pre_operational = 127, master = 100;

  [[nodiscard]] std::uint32_t object(unsigned index, unsigned sub) const {
    return drive_->value(static_cast<std::uint16_t>(index), static_cast<std::uint8_t>(sub));
  }
  [[nodiscard]] hal::CanFrame write(unsigned index, unsigned sub, std::uint32_t value, unsigned bytes) const {
    return test::sdo(0x600 + node_, bytes == 1 ? 0x2F : bytes == 2 ? 0x2B : 0x23, index, sub, value);
  }
  [[nodiscard]] hal::CanFrame control(unsigned word, unsigned torque) const {
    hal::CanFrame f = test::can(0x200 + node_, {0, 0, 0, 0});
    test::put_little(f, 0, word, 2);
    test::put_little(f, 2, torque, 2);
    return f;
  }

  hal::CanFrame ours() override {
    static constexpr std::array<unsigned, 8> words{0x0F, 0x06, 0x07, 0x00, 0x02, 0x80, 0x0B, 0x8F};
    static constexpr std::array<int, 6> orders{0x01, 0x80, 0x02, 0x81, 0x82, 0x03};
    static constexpr std::array<unsigned, 34> indices{
        0x1000, 0x1001, 0x1005, 0x1006, 0x1014, 0x1016, 0x1017, 0x1018, 0x1029, 0x1400, 0x1403, 0x1404,
        0x1600, 0x1601, 0x1603, 0x1604, 0x1800, 0x1801, 0x1803, 0x1A00, 0x1A01, 0x1A03, 0x6007, 0x603F,
        0x6040, 0x6041, 0x605A, 0x605E, 0x6060, 0x6064, 0x6071, 0x6072, 0x6076, 0x6502};
    static constexpr std::array<std::uint32_t, 22> values{
        0,           1,           2,           3,           4,           5,          8,      9,
        10,          40,          240,         241,         253,         254,        0xFFFF, 0x6040'0010,
        0x6071'0010, 0x6041'0010, 0x6064'0020, 0x6060'0008, 0x6060'0010, 0x1000'0020};
    struct Entry {
      unsigned index, subs, bytes;
    };
    static constexpr std::array<Entry, 16> writable{{{0x1017, 0, 2},
                                                     {0x1029, 1, 1},
                                                     {0x6007, 0, 2},
                                                     {0x605A, 0, 2},
                                                     {0x605E, 0, 2},
                                                     {0x6060, 0, 1},
                                                     {0x6040, 0, 2},
                                                     {0x6071, 0, 2},
                                                     {0x6072, 0, 2},
                                                     {0x1400, 2, 1},
                                                     {0x1800, 2, 1},
                                                     {0x1600, 0, 1},
                                                     {0x1600, 1, 4},
                                                     {0x1A00, 0, 1},
                                                     {0x1A01, 2, 4},
                                                     {0x60C2, 1, 1}}};
    const unsigned index = indices[in_.u8() % indices.size()];
    switch (in_.below(11)) {
      case 0:
        return control(words[in_.below(8)], in_.u16());
      case 1:
        return test::can(0x080, {});
      case 2:
        return test::can(0x700 + master, {5});
      case 3: {
        const int order = orders[in_.below(6)];
        return test::nmt(order, in_.below(8) == 7 ? in_.u8() : in_.yes() ? 0 : static_cast<int>(node_));
      }
      case 4:
        return test::sdo(0x600 + node_, 0x40, index, in_.below(12));
      case 5:
        return write(index, in_.below(10), in_.u32(), 1U << in_.below(3));
      case 6: {
        const Entry e = writable[in_.below(16)];
        return write(e.index, e.subs, values[in_.u8() % values.size()], e.bytes);
      }
      case 7: {  // a PDO elsewhere, off or on; its type or its entries
        const unsigned pdo = in_.below(4), first = in_.yes() ? 0x1400U : 0x1800U;
        const std::uint32_t id = (first == 0x1400U ? 0x200U : 0x180U) + pdo * 0x100U;
        switch (in_.below(4)) {
          case 0:
            return write(first + pdo, 1, (in_.u8() & 7U) << 29U | (id + (in_.yes() ? node_ : in_.u8())), 4);
          case 1:
            return write(first + pdo, 1, 0x8000'0000U | (id + node_), 4);
          case 2:
            return write(first + pdo, 2, values[in_.u8() % values.size()], 1);
          default:
            return write(first + 0x200U + pdo, in_.yes() ? 0 : 1, values[in_.u8() % values.size()],
                         in_.yes() ? 1 : 4);
        }
      }
      case 8:
        return write(0x1016, 1, master << 16U | in_.below(32), 4);
      case 9:
        return in_.yes() ? write(0x1014, 0, (in_.u8() & 3U) << 30U | (0x080U + node_), 4)
                         : write(0x1005, 0, 0x7FU + in_.below(3), 4);
      default:
        return test::sdo(0x600 + node_, in_.yes() ? 0x80 : in_.u8(), index, in_.below(4), in_.u32());
    }
  }
  /// A PDO by the rules: off, remapped, on.
  void map(bool in, unsigned pdo, std::uint32_t id, std::uint32_t type,
           std::initializer_list<std::uint32_t> entries) {
    const unsigned communication = (in ? 0x1400U : 0x1800U) + pdo, mapping = communication + 0x200;
    hear(write(communication, 1, 0x8000'0000U | id, 4));
    hear(write(mapping, 0, 0, 1));
    hear(write(communication, 2, type, 1));
    unsigned sub = 0;
    for (const std::uint32_t e : entries) hear(write(mapping, ++sub, e, 4));
    hear(write(mapping, 0, sub, 1));
    hear(write(communication, 1, id, 4));
  }
  [[nodiscard]] std::uint32_t mappable() {
    static constexpr std::array<std::uint32_t, 16> objects{
        0x6040'0010, 0x6060'0008, 0x6071'0010, 0x6072'0010, 0x1001'0008, 0x603F'0010,
        0x6041'0010, 0x6061'0008, 0x6064'0020, 0x606C'0020, 0x6077'0010, 0x6071'0020,
        0x6076'0020, 0x2000'0010, 0,           0x1A01'0108};
    return objects[in_.below(16)];
  }
  /// As the controller does it: mode, one PDO each way, start, and the steps to operation enabled.
  void arm(unsigned how) override {
    if ((how & 1U) != 0) hear(write(0x1016, 1, master << 16U | 5U, 4));
    if ((how & 2U) != 0) hear(write(0x6007, 0, how >> 6U, 2));
    if ((how & 4U) != 0) hear(write(0x605A, 0, 2, 2));
    if ((how & 8U) != 0) hear(write(0x1017, 0, 4, 2));
    if (const unsigned behaviour = in_.below(4); behaviour != 0) hear(write(0x1029, 1, behaviour - 1, 1));
    hear(write(0x6060, 0, 10, 1));
    map(true, 0, 0x200 + node_, 255, {0x6040'0010, 0x6071'0010});
    map(false, 0, 0x4000'0180 + node_, 1, {0x6041'0010, 0x6064'0020, 0x6077'0010});
    if (in_.yes()) {  // and others, as somebody likes them
      const bool in = in_.yes();
      const unsigned pdo = in_.below(4);
      map(in, pdo, (in ? 0x200U : 0x180U) + pdo * 0x100U + node_, in_.u8(),
          {mappable(), mappable(), mappable()});
    }
    hear(test::nmt(1, static_cast<int>(node_)));
    if ((how & 16U) != 0) hear(test::can(0x700 + master, {5}));
    for (const unsigned word : {0x06U, 0x07U, 0x0FU}) hear(control(word, 300));
    if ((how & 32U) != 0) hear(test::can(0x080, {}));
  }

  /// An RPDO by its object.
  [[nodiscard]] bool is_rpdo(std::uint32_t id) const {
    for (unsigned i = 0; i < 4; ++i) {
      const std::uint32_t cob = object(0x1400 + i, 1);
      if (cob < 0x8000'0000U && (cob & 0x7FFU) == id) return true;
    }
    return false;
  }
  [[nodiscard]] bool concerns(const hal::CanFrame& f) const override {
    if (f.extended || f.remote || f.fd) return false;
    if (f.id == 0) return f.size == 2 && (f.data[1] == 0 || f.data[1] == node_);
    const std::uint32_t watched = object(0x1016, 1) >> 16U;
    return f.id == 0x080 || f.id == 0x600 + node_ || f.id == 0x200 + node_ || is_rpdo(f.id) ||
           f.id == 0x500 + node_ || f.id == 0x300 + node_ || f.id == 0x400 + node_ ||
           (watched != 0 && f.id == 0x700 + watched);
  }

  void said(const hal::CanFrame& f) override {
    if (f.id == 0x700 + node_) {
      require(f.size == 1 && (f.data[0] == 0 || f.data[0] == 4 || f.data[0] == 5 || f.data[0] == 127),
              "a state of the network");
      return;
    }
    if (f.id == 0x080 + node_)
      return require(f.size == 8 && object(0x1014, 0) == 0x080 + node_, "an emergency, where 1014 has them");
    if (f.id == 0x580 + node_) return require(f.size == 8, "an answer of the SDO server");
    for (unsigned i = 0; i < 4; ++i) {
      const std::uint32_t cob = object(0x1800 + i, 1), count = object(0x1A00 + i, 0);
      if (cob >= 0x8000'0000U || (cob & 0x7FFU) != f.id || (cob & 0x2000'0000U) != 0) continue;
      bool same = true;
      std::size_t at = 0;
      for (unsigned sub = 1; sub <= count; ++sub) {
        const std::uint32_t entry = object(0x1A00 + i, sub), bytes = entry % 256 / 8;
        if (at + bytes > 8) break;
        const std::uint32_t value = object(entry >> 16U, entry >> 8U & 0xFFU);
        same = same && test::little(f, at, bytes) == value;
        at += bytes;
      }
      if (same && at == f.size && f.size > 0) {
        ++pdos_;
        return;
      }
    }
    require(false, "a PDO as it is mapped, on the identifier of its object");
  }

  void heard(const hal::CanFrame& f) override {
    const unsigned was = nmt_;
    const bool knows = was != stopped;
    if (f.id == 0) order(f.data[0]);
    const std::uint32_t watched = object(0x1016, 1) >> 16U;
    if (f.id != 0x080 && watched != 0 && f.id == 0x700 + watched) {
      watching_ = true;
      silent_ = 0;
    }
    unsigned answers = 0;
    for (const hal::CanFrame& r : sent_) {
      if (r.id == 0x580 + node_) {
        ++answers;
        answer(f, r);
      }
      if (r.id == 0x700 + node_)
        require(f.id == 0 && !settings_.lockstep && r.data[0] == 0, "it says by itself that it has booted");
      if (!knows) require(r.id == 0x700 + node_, "a stopped node has nothing to say");
    }
    const bool asked = f.id == 0x600 + node_ && f.size == 8 && f.data[0] != 0x80 && knows;
    require(answers == (asked ? 1 : 0), "one answer for each request");
    if (pdos_ > 0)
      require(f.id == 0x080 && !settings_.lockstep && was == operational, "PDOs for SYNC, in operation");
    pdos_ = 0;
    demanded();
  }
  void order(unsigned command) {
    switch (command) {
      case 0x01:
        nmt_ = operational;
        break;
      case 0x02:
        nmt_ = stopped;
        break;
      case 0x80:
        nmt_ = pre_operational;
        break;
      case 0x81:
      case 0x82:
        nmt_ = pre_operational;
        watching_ = false;
        booted_ = !settings_.lockstep;  // by its own clock it has said so at once
        require(!axis_->closed_loop(), "a node that starts anew is not enabled");
        require(object(0x1016, 1) == 0 && (command == 0x82 || object(0x6060, 0) == 0),
                "and as from the factory");
        break;
      default:
        break;
    }
  }
  void answer(const hal::CanFrame& f, const hal::CanFrame& r) {
    require(f.id == 0x600 + node_ && std::equal(f.data.begin() + 1, f.data.begin() + 4, r.data.begin() + 1),
            "of this object");
    const unsigned index = test::little(f, 1, 2), sub = f.data[3];
    switch (r.data[0]) {
      case 0x80:
        require(test::little(r, 4, 4) != 0, "an abort has a reason");
        break;
      case 0x60:
        require((f.data[0] & 0xE2U) == 0x22U, "written, because that was asked");
        if (index == 0x1016) watching_ = false;
        break;
      case 0x43:
      case 0x4B:
      case 0x4F: {
        require(f.data[0] == 0x40, "read, because that was asked");
        require(test::little(r, 4, 4) == object(index, sub), "what the object holds");
        require(r.data[0] == 0x43 || test::little(r, 4, 4) < (r.data[0] == 0x4B ? 0x1'0000U : 0x100U),
                "in so many bytes");
        break;
      }
      default:
        require(false, "an answer of the SDO server");
    }
  }
  void passed() override {
    unsigned beats = 0;
    for (const hal::CanFrame& r : sent_) {
      if (r.id != 0x700 + node_) continue;
      ++beats;
      if (r.data[0] == 0) require(!booted_, "it boots once");
      booted_ = booted_ || r.data[0] == 0;
    }
    require(beats <= 1, "one heartbeat a period");
    if (pdos_ > 0)
      require(settings_.lockstep && nmt_ == operational, "PDOs at the begin of a tick, in operation");
    pdos_ = 0;
    ++silent_;
    // Whole milliseconds and periods of one: it is missed when that many have passed and one more.
    if (watching_ && (object(0x1016, 1) & 0xFFFFU) != 0 && silent_ > (object(0x1016, 1) & 0xFFFFU) &&
        !settings_.defects.watchdog_off) {
      watching_ = false;
      if (object(0x6007, 0) != 0)
        require(axis_->joint_torque() == 0.0, "without its master it applies no torque");
      const std::uint32_t behaviour = object(0x1029, 1);
      if (behaviour == 2) nmt_ = stopped;
      if (behaviour == 0 && nmt_ == operational) nmt_ = pre_operational;
    }
    for (const hal::CanFrame& r : sent_) {
      if (r.id == 0x700 + node_ && r.data[0] != 0) require(r.data[0] == nmt_, "the state that it was told");
    }
    demanded();
  }
  /// Torque as the objects have it, in cyclic torque mode.
  void demanded() {
    if (!axis_->closed_loop()) return;
    require(object(0x6060, 0) == 10, "torque control is its mode");
    const unsigned word = object(0x6040, 0);
    require((word & 0x80U) != 0 || (word & 0x0FU) == 0x0FU, "and it was enabled");
    const double limit = object(0x6072, 0), target = static_cast<std::int16_t>(object(0x6071, 0)) +
                                                     static_cast<std::int16_t>(object(0x60B2, 0));
    const double shaft = std::clamp(target, -limit, limit) / 1000.0 * settings_.rated_torque;
    require(std::fabs(axis_->joint_torque() - shaft * per_shaft()) < 1e-9,
            "the torque of objects 6071 and 60B2");
  }
  [[nodiscard]] double most() const override {
    return std::min(32768.0, static_cast<double>(object(0x6072, 0))) / 1000.0 * settings_.rated_torque;
  }

  host::Cia402Axis::Settings settings_{};
  host::Cia402Axis* drive_ = nullptr;
  unsigned node_ = 1, nmt_ = pre_operational, pdos_ = 0;
  std::uint32_t silent_ = 0;
  bool watching_ = false, booted_ = false;
};

}  // namespace esmc::fuzz
