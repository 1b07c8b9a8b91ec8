/// CANopen and CiA 402: set-up and axis under received frames of any kind and any order of calls. The model
/// beside it keeps what the drive has been asked, what it answered, and in which state it said it is.

#include <array>
#include <cmath>
#include <optional>
#include <vector>

#include "firmware/drive/cia402_axis.hpp"
#include "tests/fuzz/bytes.hpp"
#include "tests/support/canopen_bytes.hpp"
#include "tests/support/torque_frame.hpp"

namespace {

using namespace esmc;
using drive::Cia402Axis;
using drive::Received;
using fuzz::require;
using hal::CanFrame;
using test::entry;
using test::little;

constexpr unsigned node = 3, master = 100;

/// Values by object: few, so a search is quick.
class Objects {
 public:
  [[nodiscard]] const std::uint32_t* find(std::uint32_t object) const {
    for (const auto& e : list_) {
      if (e[0] == object) return &e[1];
    }
    return nullptr;
  }
  void set(std::uint32_t object, std::uint32_t value) {
    erase(object);
    list_.push_back({object, value});
  }
  void erase(std::uint32_t object) {
    std::erase_if(list_, [&](const auto& e) { return e[0] == object; });
  }
  void clear() { list_.clear(); }

 private:
  std::vector<std::array<std::uint32_t, 2>> list_;
};

class Run {
 public:
  explicit Run(fuzz::Bytes& in) : in_(in) {
    const unsigned choice = in_.u8();
    settings_.rated_torque = 2.0F;
    settings_.torque_limit = 2.5F;
    settings_.counts_per_turn = 4096;
    settings_.velocity_unit = 0.01F;
    settings_.heartbeat_ms = 8;
    settings_.consumer_ms = 15;
    settings_.master_node = master;
    settings_.retry_ticks = 12;
    settings_.sdo_ticks = 3;
    constexpr std::array<std::uint32_t, 4> periods{1000, 250, 1234, 3'000'000'000};
    settings_.period_us = periods[(choice & 1U) + ((choice & 8U) != 0 ? 2 : 0)];
    config_ = {.node = node,
               .direction = (choice & 2U) != 0 ? -1.0F : 1.0F,
               .gear_ratio = (choice & 4U) != 0 ? 5.0F : 1.0F,
               .offset = 0.5F};
    axis_ = Cia402Axis(config_, settings_);
  }
  void go() {
    while (!in_.empty()) {
      step();
      hold();
    }
  }

 private:
  void step() {
    in_.one_of(
        14, [&] { tick(); }, [&] { hear(in_.frame()); },
        [&] { hear(in_.frame(in_.below(16) * 0x80U + node)); },
        [&] { hear(test::heartbeat_of(node, in_.yes() ? 0x7F : in_.u8())); },
        [&] { hear(test::emergency_of(node, in_.u16())); },
        [&] {
          hear(test::report_of(node, in_.u16(), static_cast<std::int32_t>(in_.u32()),
                               static_cast<std::int16_t>(in_.u16())));
        },
        [&] { hear(test::motion_of(node, static_cast<std::int32_t>(in_.u32()), in_.yes() ? 10 : in_.u8())); },
        [&] { answer(in_.u8()); },
        [&] {
          const unsigned how = in_.below(8);
          enable(how == 7 ? 0 : how == 6 ? 1 : 99);
        },
        [&] { disable(); }, [&] { torque(in_.f64()); },
        [&] { ++asked_again_ % 3 == 1 ? axis_.ask_again() : sync(asked_again_ % 3 == 2); },
        [&] {
          // what a set-up takes, many times in a row
          for (unsigned n = in_.below(128); n > 0 && left_ > 0; --n, --left_) {
            tick();
            answer(0);
            enable(99);
            hold();
          }
        },
        [&] { obey(); });
  }
  /// A drive that does what it is told, for one tick.
  void obey() {
    tick();
    if (nmt_ == 5) {
      const unsigned control = little(test::torque_frame(axis_, 0.0), 0, 2);
      if (control == 0) status_ = 0x250;
      if (control == 6) status_ = 0x231;
      if (control == 7 && status_ == 0x231) status_ = 0x233;
      if (control == 15 && status_ == 0x233) status_ = 0x237;
      hear(test::report_of(node, status_));
      hear(test::motion_of(node));
    } else {
      hear(test::heartbeat_of(node, 0x7F));
    }
    answer(0);
    enable(99);
  }

  void tick() {
    axis_.begin_tick();
    if (has_report_ && has_motion_) has_report_ = has_motion_ = false;
    torque_.reset();
    if (sample_age_ && *sample_age_ < drive::age_max) ++*sample_age_;
    if (heartbeat_age_ && *heartbeat_age_ < drive::age_max) ++*heartbeat_age_;
  }

  /// Between two ticks, or in one.
  void sync(bool in_tick) {
    axis_.expect_set(in_tick);
    has_report_ = has_motion_ = false;
    if (in_tick && sample_age_ == 0) sample_age_ = 1;
  }

  void hear(const CanFrame& f) {
    const fuzz::Image<Cia402Axis> before(axis_);
    const Received r = axis_.receive(f);
    if (r != Received::accepted) require(before.is(axis_), "no side effect unless accepted");
    if (f.extended) {
      require(r == Received::not_mine, "29 bits are not ours");
      return;
    }
    const unsigned function = f.id & ~0x7FU, to = f.id & 0x7FU;
    const bool ours = to == node && function <= 0x780;
    const bool order = (ours && (function == 0x200 || function == 0x300 || function == 0x400 ||
                                 function == 0x500 || function == 0x600)) ||
                       f.id == 0x080 || f.id == 0x700 + master ||
                       (f.id == 0 && f.size >= 2 && (f.data[1] == 0 || f.data[1] == node));
    require((r == Received::foreign_command) == (order && !f.remote), "only we command this axis");
    if (order || !ours) {
      require(r != Received::accepted, "what is not from the axis is not taken");
      return;
    }
    if (r != Received::accepted) return;
    require(!f.remote && !f.fd, "data frames only");
    if (function == 0x700) {
      heartbeat_age_ = 0;
      nmt_ = f.data[0];
      if (nmt_ == 0) booted_ = true;
      if (nmt_ == 0 || nmt_ == 4) at_rest_ = true;  // pre-operational is no promise
    }
    if (function == 0x080) emergency_ = f.data[0] + 256U * f.data[1];
    if (function == 0x180) {
      state_ = little(f, 0, 2);
      // Not ready, switch on disabled, ready to switch on, fault: without torque, and everything else may
      // have it.
      at_rest_ = (state_ & 0x4FU) == 0 || (state_ & 0x4FU) == 0x40 || (state_ & 0x6FU) == 0x21 ||
                 (state_ & 0x4FU) == 8;
      has_report_ = true;
      torque_ = static_cast<std::int16_t>(little(f, 6, 2));
      position_ = static_cast<std::int32_t>(little(f, 2, 4));
    }
    if (function == 0x280) {
      has_motion_ = true;
      velocity_ = static_cast<std::int32_t>(little(f, 0, 4));
      mode_ = f.data[4];
    }
    if (function == 0x180 || function == 0x280) {
      require(f.size == (function == 0x180 ? 8 : 5), "length of a PDO");
      configured();  // before that, a PDO may be anything
      nmt_ = 5;
      if (has_report_ && has_motion_) sampled();
    }
    if (function == 0x580) take_answer(f);
  }
  void sampled() {
    sample_age_ = 0;
    const auto s = axis_.sample<double>();
    const double per = static_cast<double>(config_.direction) / static_cast<double>(config_.gear_ratio);
    require(std::fabs(s.angle - 0.5 - position_ / 4096.0 * 2 * M_PI * per) <= 1e-9 * (1 + std::fabs(s.angle)),
            "angle in the model's units");
    require(std::fabs(s.rate - velocity_ * 0.01 * per) <= 1e-6 * (1 + std::fabs(s.rate)),
            "rate in the model's units");
  }

  // ---- set-up
  // ---------------------------------------------------------------------------------------------------

  /// An answer to the last request, defective where `defect` says so.
  void answer(unsigned defect) {
    if (!asked_) return;
    const unsigned index = *asked_ / 256, sub = *asked_ % 256;
    const std::uint32_t* const written = written_.find(*asked_);
    std::uint32_t value = written != nullptr ? *written : 0;
    if (*asked_ == entry(0x1014, 0)) value = 0x80 + node;
    if (*asked_ == entry(0x1005, 0)) value = 0x80;
    if (*asked_ == entry(0x6502, 0)) value = 0x3A5;
    if (*asked_ == entry(0x6076, 0)) value = 2000;
    if (*asked_ == entry(0x6072, 0)) value = 1500;
    CanFrame f = test::sdo(0x580 + node, reads_ ? 0x42 : 0x60, index, sub, reads_ ? value : 0);
    if (defect % 4 == 1) f.data[in_.below(8)] = in_.u8();
    const std::uint32_t absent = (defect & 8U) != 0 ? 0x06090011 : 0x06020000;  // sub-index, object
    if (defect % 4 == 2) f = test::sdo(0x580 + node, 0x80, index, sub, in_.yes() ? absent : in_.u32());
    if (defect % 4 == 3) test::put_little(f, 4, (defect & 8U) != 0 ? in_.u8() : in_.u32(), 4);
    hear(f);
  }
  void take_answer(const CanFrame& f) {
    require(f.size == 8, "an SDO reply has eight bytes");
    if (!asked_ || entry(f.data[1] + 256U * f.data[2], f.data[3]) != *asked_) return;
    const bool value = (f.data[0] & 0xF2U) == 0x42;
    if (reads_ && value) read_.set(*asked_, little(f, 4, 4));
    if (f.data[0] == 0x80 || (reads_ ? value : f.data[0] == 0x60)) asked_.reset();  // once
  }
  /// What must have been read back before the drive goes operational.
  void configured() const {
    const auto has = [&](unsigned index, unsigned sub, std::uint32_t value, std::uint32_t mask) {
      const std::uint32_t* const is = read_.find(entry(index, sub));
      return is != nullptr && ((*is ^ value) & mask) == 0;
    };
    require(has(0x6060, 0, 10, 0xFF), "cyclic torque mode was read back");
    require(has(0x1016, 1, master * 0x10000U + 15, 0xFFFFFFFF), "its reaction to our silence was read back");
    require(has(0x6007, 0, 1, 0xFFFF) && has(0x605E, 0, 0, 0xFFFF) && has(0x605A, 0, 0, 0xFFFF),
            "its option codes were read back");
    require(has(0x1400, 1, 0x200 + node, 0xBFFFFFFF) && has(0x1600, 0, 2, 0xFF) &&
                has(0x1600, 1, 0x60400010, 0xFFFFFFFF) && has(0x1600, 2, 0x60710010, 0xFFFFFFFF),
            "what it listens to was read back");
    require(has(0x1800, 1, 0x180 + node, 0xBFFFFFFF) && has(0x1801, 1, 0x280 + node, 0xBFFFFFFF) &&
                has(0x1A00, 2, 0x60640020, 0xFFFFFFFF),
            "what it sends was read back");
    const std::uint32_t *const rated = read_.find(entry(0x6076, 0)), *const most =
                                                                         read_.find(entry(0x6072, 0));
    require(rated != nullptr && std::fabs(*rated - 2000.0) <= 20.3, "the rated torque is the scale");
    require(axis_.torque_limit_unread() == (most == nullptr), "it says whether the drive has a torque limit");
    require(most == nullptr || (*most & 0xFFFF) * 1e-6 * *rated >= 2.499, "the drive allows the torque");
    const auto absent_or = [&](unsigned index, unsigned sub, std::uint32_t value) {
      return read_.find(entry(index, sub)) == nullptr || has(index, sub, value, 0xFFFF);
    };
    require(absent_or(0x60B2, 0, 0) && absent_or(0x1400, 5, 15), "its torque offset and its deadline");
  }

  // ---- what is sent
  // ----------------------------------------------------------------------------------------------

  /// The bus takes so many frames.
  void enable(unsigned room) {
    axis_.enable([&](const CanFrame& f) {
      const bool takes = room > 0;
      if (takes) --room;
      sent(f, takes);
      return takes;
    });
  }
  void sent(const CanFrame& f, bool taken) {
    require(hal::well_formed(f) && !f.extended && !f.remote && !f.fd, "classic data frames");
    if (f.id == 0) {
      require(f.size == 2 && f.data[1] == node && (f.data[0] == 0x80 || f.data[0] == 1),
              "NMT: pre-operational or start, this node");
      if (f.data[0] == 1) configured();
      if (f.data[0] == 0x80) booted_ = false;  // what it is told from now on may enable it
      if (f.data[0] == 0x80 && taken) read_.clear();
      operational_asked_ = f.data[0] == 1;
      return;
    }
    require(f.id == 0x600 + node && f.size == 8, "everything else is an SDO request to this node");
    require(f.data[0] == 0x40 || (f.data[0] & 0xF3U) == 0x23, "read, or expedited write with its size");
    if (!taken) return;
    reads_ = f.data[0] == 0x40;
    asked_ = entry(f.data[1] + 256U * f.data[2], f.data[3]);
    if (!reads_) {
      written_.set(*asked_, little(f, 4, 4));
      read_.erase(*asked_);
    }
  }
  void disable() {
    axis_.disable([&](const CanFrame& f) {
      require(f.id == 0 && f.data[0] == 2 && f.data[1] == node, "disabling stops the node");
      return in_.yes();
    });
    require(control() == 0, "disabled: no voltage");
  }
  [[nodiscard]] unsigned control() const { return little(test::torque_frame(axis_, 0.0), 0, 2); }

  void torque(double joint) {
    const CanFrame f = test::torque_frame(axis_, joint);
    require(f.id == 0x200 + node && f.size == 4, "RPDO1");
    const double told = static_cast<std::int16_t>(little(f, 2, 2));
    const auto lsb = static_cast<double>(axis_.torque_lsb());
    const double shaft =
        joint * static_cast<double>(config_.direction) / static_cast<double>(config_.gear_ratio);
    if (!(std::fabs(shaft) < 10001) || !(lsb > 0))
      require(told == 0, "no torque that cannot be carried, none without a scale");
    if (lsb > 0 && std::fabs(shaft) < 9999) {
      const double wanted = std::fmin(std::fmax(shaft / lsb, -32767.0), 32767.0);
      require(std::fabs(told - wanted) <= 0.51 + 1e-6 * std::fabs(wanted), "the torque that was meant");
    }
  }

  void hold() {
    require(axis_.sample_age_ticks() == sample_age_.value_or(drive::age_max), "age of the sample");
    require(axis_.heartbeat_age_ticks() == heartbeat_age_.value_or(drive::age_max), "age of the heartbeat");
    const auto observed = axis_.observed_torque();
    require(observed.has_value() == torque_.has_value(),
            "the torque of a report counts in the tick that it comes in");
    if (observed) {
      const double wanted =
          *torque_ * static_cast<double>(axis_.torque_lsb() * config_.direction * config_.gear_ratio);
      require(std::fabs(static_cast<double>(*observed) - wanted) <= 1e-6 * std::fabs(wanted),
              "torque at the joint");
    }
    const unsigned c = control();
    require(c == 0 || c == 6 || c == 7 || c == 15 || c == 0x80, "a controlword that means something");
    require(little(test::torque_frame(axis_, 0.0), 2, 2) == 0, "no torque is no torque");
    if (axis_.closed_loop())
      require((state_ & 0x6FU) == 0x27 && mode_ == 10 && nmt_ == 5, "torque control as said");
    if (axis_.ready())
      require(c == 15 && axis_.closed_loop() && !axis_.error(), "ready: enabled, without error");
    if (axis_.idle())
      require(c == 0 && (at_rest_ || booted_),
              "idle: no voltage, and it has said since that it is without torque");
    if (c != 0) at_rest_ = false;
    if (c == 15) require(operational_asked_ && !axis_.config_mismatch(), "enabled after the set-up only");
  }

  fuzz::Bytes& in_;
  unsigned left_ = 150;  ///< of those many times
  unsigned asked_again_ = 0;
  drive::AxisConfig config_{};
  Cia402Axis::Settings settings_{};
  Cia402Axis axis_;
  std::optional<std::uint32_t> sample_age_, heartbeat_age_;
  Objects written_, read_;  ///< since it was called to pre-operational
  std::optional<std::uint32_t> asked_;
  std::optional<int> torque_;  ///< thousandths
  bool reads_ = false, operational_asked_ = false, at_rest_ = false, booted_ = false, has_report_ = false,
       has_motion_ = false;
  unsigned state_ = 0, status_ = 0x250, mode_ = 0, nmt_ = 0, emergency_ = 0;
  std::int32_t position_ = 0, velocity_ = 0;
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  fuzz::Bytes in(data, size);
  Run(in).go();
  return 0;
}
