/// MIT mode: the axis, all dialects, under received frames of any kind and any order of calls.

#include <array>
#include <cmath>
#include <optional>

#include "firmware/drive/mit_axis.hpp"
#include "tests/fuzz/bytes.hpp"
#include "tests/support/mit_bytes.hpp"
#include "tests/support/torque_frame.hpp"

namespace {

using namespace esmc;
using drive::MitAxis;
using drive::Received;
using drive::mit::Dialect;
using fuzz::require;
using hal::CanFrame;

class Run {
 public:
  explicit Run(fuzz::Bytes& in) : in_(in) {
    const unsigned choice = in_.u8();
    settings_.dialect = (choice & 0x60U) == 0x60U ? Dialect::cubemars_v3 : static_cast<Dialect>(choice % 3);
    settings_.velocity_unit = 0.01F;
    settings_.master_id = (choice & 4U) != 0 ? 5 : 0x7E;
    settings_.retry_ticks = 6;
    config_ = {.node = 5,
               .direction = (choice & 8U) != 0 ? -1.0F : 1.0F,
               .gear_ratio = (choice & 16U) != 0 ? 9.0F : 1.0F,
               .offset = -0.5F};
    axis_ = MitAxis(config_, settings_);
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
        9, [&] { tick(); }, [&] { hear(in_.frame()); }, [&] { hear(in_.frame(settings_.master_id)); },
        [&] { hear(reply(in_.u16(), in_.u16() & 0xFFFU, in_.u16() & 0xFFFU, in_.u8())); },
        [&] { enable(in_.below(8) != 7); }, [&] { disable(in_.below(8) != 7); }, [&] { torque(in_.f64()); },
        [&] { axis_.ask_again(); },
        [&] {
          tick();
          hear(reply(0x8000, 0x800, 0x800, settings_.dialect == Dialect::damiao && asked_ == 0xFC ? 1 : 0));
          enable(true);
        });
  }
  [[nodiscard]] CanFrame reply(unsigned p, unsigned v, unsigned t, unsigned error) const {
    if (v3()) {
      const unsigned position = p ^ 0x8000U, speed = (v * 16 + t % 16) ^ 0x8000U;
      CanFrame f = test::bytes(
          0x2905, {position / 256, position % 256, speed / 256, speed % 256, t / 256, t % 256, 20, error});
      f.extended = true;
      return f;
    }
    const bool damiao = settings_.dialect == Dialect::damiao;
    CanFrame f = test::mit_reply(settings_.master_id, damiao ? 5 + error % 16 * 16 : 5, p, v, t,
                                 settings_.dialect == Dialect::mini_cheetah ? 6 : 8);
    if (settings_.dialect == Dialect::cubemars) f.data[7] = static_cast<std::uint8_t>(error);
    return f;
  }

  [[nodiscard]] bool v3() const { return settings_.dialect == Dialect::cubemars_v3; }
  void tick() {
    axis_.begin_tick();
    fresh_ = false;
    if (age_ && *age_ < drive::age_max) ++*age_;
  }

  void hear(const CanFrame& f) {
    const fuzz::Image<MitAxis> before(axis_);
    const Received r = axis_.receive(f);
    if (r != Received::accepted) {
      require(before.is(axis_), "no side effect unless accepted");
      const bool ours = v3() ? f.extended && !f.remote && f.id % 256 == 5 && f.id < 0x1100
                             : !f.extended && !f.remote && f.id == 5;
      require((r == Received::foreign_command) == ours,
              "what comes on the node and is no reply is a foreign command");
      return;
    }
    if (v3()) {
      require(f.extended && !f.remote && !f.fd && f.id == 0x2905 && f.size == 8, "a reply of this drive");
      CanFrame again = drive::mit::encode_v3_reply(5, *drive::mit::decode_reply(f, settings_.dialect));
      std::copy(f.data.begin() + 4, f.data.begin() + 7, again.data.begin() + 4);  // current and temperature
      require(fuzz::same_bytes(again, f, f.size), "a reply is written as it is read");
      return take_v3(f);
    }
    const bool long_enough =
        settings_.dialect == Dialect::mini_cheetah ? f.size >= 5 && f.size <= 7 : f.size == 8;
    require(!f.extended && !f.remote && !f.fd && f.id == settings_.master_id && long_enough,
            "a reply of this dialect");
    const unsigned mask = settings_.dialect == Dialect::damiao ? 15 : 255;
    require((f.data[0] & mask) == 5, "a reply of this drive");
    const auto decoded = drive::mit::decode_reply(f, settings_.dialect);
    require(decoded.has_value(), "an accepted reply is read");
    CanFrame again = drive::mit::encode_reply(f.id, 5, *decoded, settings_.dialect, f.size);
    if (settings_.dialect == Dialect::cubemars) again.data[6] = f.data[6];  // temperatures, supply voltage
    if (settings_.dialect == Dialect::damiao)
      std::copy(f.data.begin() + 6, f.data.begin() + 8, again.data.begin() + 6);
    if (f.size == 7) again.data[6] = f.data[6];
    require(fuzz::same_bytes(again, f, f.size), "a reply is written as it is read");
    take(f);
  }
  void take_v3(const CanFrame& f) {
    const auto number = [&](std::size_t at) { return static_cast<std::int16_t>(test::mit_number(f, at, 2)); };
    const unsigned p = static_cast<unsigned>(number(0) + 0x8000);
    if (age_.has_value() && (p > position_ ? p - position_ : position_ - p) > 0x7FFF) lost_ = true;
    position_ = p;
    age_ = 0;
    const auto rail = [](int v) { return v == -0x8000 || v == 0x7FFF; };
    error_ = f.data[7] != 0 || rail(number(0)) || rail(number(2)) || lost_;
    const auto s = axis_.sample<double>();
    const double per = static_cast<double>(config_.direction) / static_cast<double>(config_.gear_ratio);
    require(std::fabs(s.angle + 0.5 - number(0) * 0.0017453292519943296 * per) < 1e-5,
            "angle in the model's units");
    require(std::fabs(s.rate - number(2) * 0.01 * per) < 1e-4, "rate in the model's units");
  }
  void take(const CanFrame& f) {
    const unsigned p = test::mit_p(f), v = test::mit_v(f);
    const bool damiao = settings_.dialect == Dialect::damiao;
    const unsigned word = damiao ? f.data[0] / 16U : settings_.dialect == Dialect::cubemars ? f.data[7] : 0U;
    if (age_.has_value() && (p > position_ ? p - position_ : position_ - p) > 0x7FFF) lost_ = true;
    position_ = p;
    age_ = 0;
    error_ = (damiao ? word > 1 : word != 0) || p == 0 || p == 0xFFFF || v == 0 || v == 0xFFF || lost_;
    if (damiao && word == 1) knows_mode_ = true;
    const bool denies = knows_mode_ && word == 0;
    if (asked_ == 0xFC && (error_ || denies)) {
      replies_ = 0;
      fresh_ = false;
    } else if (!fresh_) {
      ++replies_;
      fresh_ = true;
    }
    const auto s = axis_.sample<double>();
    const double per = static_cast<double>(config_.direction) / static_cast<double>(config_.gear_ratio);
    require(std::fabs(s.angle + 0.5 - (2.0 * p - 65535) / 65535 * 12.5 * per) < 1e-5,
            "angle in the model's units");
    require(std::fabs(s.rate - (2.0 * v - 4095) / 4095 * 50 * per) < 1e-5, "rate in the model's units");
  }

  void enable(bool takes) {
    axis_.enable([&](const CanFrame& f) {
      special(f, takes);
      return takes;
    });
  }
  void disable(bool takes) {
    axis_.disable([&](const CanFrame& f) {
      require(test::is_special(f, 0xFD), "disabling asks out of motor mode");
      special(f, takes);
      return takes;
    });
  }
  void special(const CanFrame& f, bool taken) {
    require(!v3(), "a drive without motor mode gets no special frame");
    require(hal::well_formed(f) && f.id == 5 && !f.extended && !f.remote, "frames for this node only");
    const bool enter = test::is_special(f, 0xFC);
    require(enter || test::is_special(f, 0xFD), "no other frame than enter and leave");
    if (enter) {
      require(asked_ == 0xFD && replies_ >= 2, "motor mode is asked for after two replies outside it");
      require(!error_, "only a drive without error is asked into motor mode");
    }
    // A repeated request to leave does not make what was heard before worthless.
    if (taken && (enter || asked_ != 0xFD)) {
      asked_ = f.data[7];
      replies_ = 0;
      fresh_ = false;
    }
  }

  void torque(double joint) {
    CanFrame f = test::torque_frame(axis_, joint);
    if (v3()) {  // the same fields in another order
      require(f.id == 0x805 && f.extended, "a command of this drive");
      const std::uint64_t gains = test::mit_number(f, 0, 3), motion = test::mit_number(f, 3, 5);
      const std::uint64_t p = motion >> 24U, v = motion >> 12U & 0xFFFU, t = motion & 0xFFFU;
      f = test::mit_command(5, p, v, gains >> 12U, gains & 0xFFFU, t);
    }
    require(f.id == 5 && f.size == 8 && !f.extended && !f.remote && !f.fd, "a command of this drive");
    require(test::mit_number(f, 0, 2) == 0x8000 && test::mit_number(f, 2, 4) / 256 == 0x800000,
            "no position, no speed, no gains");
    require(test::mit_number(f, 5, 2) / 16 == 0, "no damping");
    const unsigned code = static_cast<unsigned>(test::mit_number(f, 6, 2) % 4096);
    const double told = (2.0 * code - 4095) / 4095 * 18, step = 18.0 / 4095;
    const double shaft =
        joint * static_cast<double>(config_.direction) / static_cast<double>(config_.gear_ratio);
    const double wanted = std::fabs(shaft) < 9999 ? std::fmin(std::fmax(shaft, -18.0), 18.0) : 0;
    if (!(std::fabs(shaft) >= 9999 && std::fabs(shaft) <= 10001)) {
      require(std::fabs(told - wanted) <= step * 1.001, "the torque that was meant, or none");
    }
  }

  void hold() {
    require(axis_.sample_age_ticks() == age_.value_or(drive::age_max), "age of the sample");
    require(axis_.error() == error_, "errors as reported");
    if (lost_) require((axis_.error_code() & MitAxis::position_lost) != 0, "a lost position stays lost");
    if (v3()) return require(!axis_.ready() || !error_, "ready: without error");
    if (axis_.ready())
      require(asked_ == 0xFC && replies_ >= 2 && !error_, "ready: asked for, two replies without error");
    if (axis_.idle()) require(asked_ == 0xFD && replies_ >= 2, "idle: asked for, two replies");
  }

  fuzz::Bytes& in_;
  drive::AxisConfig config_{};
  MitAxis::Settings settings_{};
  MitAxis axis_;
  std::optional<std::uint32_t> age_;
  unsigned asked_ = 0;  // last special frame that the bus took
  unsigned replies_ = 0, position_ = 0;
  bool fresh_ = false, error_ = false, lost_ = false, knows_mode_ = false;
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  fuzz::Bytes in(data, size);
  Run(in).go();
  return 0;
}
