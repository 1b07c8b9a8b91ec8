/// ODrive: codec, read-back and axis under received frames of any kind, in any order of calls, on a bus that
/// takes frames or not. The model beside it counts what was said and asked, byte by byte.

#include <array>
#include <cmath>
#include <optional>

#include "firmware/drive/odrive_axis.hpp"
#include "tests/fuzz/bytes.hpp"
#include "tests/support/odrive_bytes.hpp"
#include "tests/support/torque_frame.hpp"

namespace {

using namespace esmc;
using drive::OdriveAxis;
using drive::Received;
using fuzz::require;
using hal::CanFrame;

constexpr std::array<std::uint16_t, 3> endpoints{9, 300, 0xFFFF};
constexpr std::array<float, 3> lower{1.0F, 0.01F, -4.0F}, upper{1.0F, 0.1F, 70000.0F};

drive::OdriveTable table(bool version) {
  drive::OdriveTable t;
  t.checks[0] = {endpoints[0], drive::odrive::ValueType::u8, lower[0], upper[0]};
  t.checks[1] = {endpoints[1], drive::odrive::ValueType::f32, lower[1], upper[1]};
  t.checks[2] = {endpoints[2], drive::odrive::ValueType::u32, lower[2], upper[2]};
  t.count = 3;
  t.check_version = version;
  t.firmware = {0, 6, 10};
  return t;
}

class Run {
 public:
  explicit Run(fuzz::Bytes& in) : in_(in) {
    const unsigned choice = in_.u8();
    newer_ = (choice & 1U) == 0;
    checked_ = (choice & 2U) != 0;
    check_version_ = (choice & 4U) != 0;
    config_ = {.node = static_cast<std::uint8_t>((choice & 8U) != 0 ? 0x3E : 3),
               .direction = (choice & 16U) != 0 ? -1.0F : 1.0F,
               .gear_ratio = (choice & 32U) != 0 ? 6.5F : 1.0F,
               .offset = 0.25F};
    axis_ = OdriveAxis(config_, newer_ ? OdriveAxis::Version::v0_6 : OdriveAxis::Version::v0_5_6, 5,
                       checked_ ? table(check_version_) : drive::OdriveTable{});
    if ((choice & 64U) != 0) axis_.prove_watchdog(4);
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
        12, [&] { tick(); }, [&] { hear(in_.frame()); },
        [&] { hear(in_.frame(config_.node * 32U + in_.below(32))); },
        [&] { hear(test::heartbeat(config_.node, in_.yes() ? 8 : in_.u8(), in_.yes() ? in_.u32() : 0)); },
        [&] { hear(test::encoder(config_.node, in_.f32(), in_.f32())); }, [&] { enable(); },
        [&] { disable(); }, [&] { acknowledge(); }, [&] { axis_.ask_again(); }, [&] { answer(); },
        [&] { torque(in_.f64()); },
        [&] {
          tick();
          hear(test::heartbeat(config_.node, asked_state_));
          enable();
        });
  }

  void tick() {
    axis_.begin_tick();
    fresh_ = stopped_now_ = false;
    estimate_.reset();
    if (sample_age_ && *sample_age_ < drive::age_max) ++*sample_age_;
    if (heartbeat_age_ && *heartbeat_age_ < drive::age_max) ++*heartbeat_age_;
  }

  void hear(const CanFrame& f) {
    const fuzz::Image<OdriveAxis> before(axis_);
    const Received r = axis_.receive(f);
    if (r != Received::accepted) require(before.is(axis_), "no side effect unless accepted");
    const unsigned message = test::command_of(f), to = test::node_of(f);
    const bool stop = !f.extended && message == 2 && (to == config_.node || (newer_ && to == 0x3F));
    if (stop) {
      require(r == Received::accepted, "an emergency stop is always taken");
      stopped_ = stopped_now_ = true;
      return;
    }
    const bool for_all = newer_ && to == 0x3F;
    const bool command = test::is_command(message, newer_) && !(newer_ && f.remote);
    if (!f.extended && command && (to == config_.node || for_all)) {
      require(r == Received::foreign_command, "only we command this axis");
      return;
    }
    if (!f.extended && for_all && message == 4) return;  // a write to everybody, or a question
    if (f.extended || to != config_.node) {
      require(r == Received::not_mine, "what is for another node is not ours");
      return;
    }
    const bool plain = f.size == 8 && !f.remote && !f.fd;
    if (message == test::cmd_heartbeat) {
      require(r == (plain ? Received::accepted : Received::malformed), "heartbeats have eight bytes");
      if (plain) take_heartbeat(f);
    }
    if (message == test::cmd_encoder) {
      require(r == (plain ? Received::accepted : Received::malformed), "samples have eight bytes");
      if (plain) take_sample(f);
    }
    if (message == test::cmd_torques && newer_ && !f.remote) {
      require(r == (plain ? Received::accepted : Received::malformed), "torques have eight bytes");
      if (plain) estimate_ = test::real(f, 4);
    } else if (message == test::cmd_torques && !f.remote && f.size > 0) {
      require(r == Received::not_mine, "0.5.6 says something else there");
    }
    if (r == Received::accepted && (message == 0 || message == 5)) take_answer(f);
  }

  void take_heartbeat(const CanFrame& f) {
    const auto h = drive::odrive::decode_heartbeat(
        f, newer_ ? drive::odrive::Version::v0_6 : drive::odrive::Version::v0_5_6);
    require(h.has_value() && h->axis_error == test::word(f, 0) &&
                static_cast<std::uint8_t>(h->axis_state) == f.data[4],
            "a heartbeat is read as it is written");
    require(
        fuzz::same_bytes(drive::odrive::encode_heartbeat(config_.node, h->axis_error, h->axis_state), f, 5),
        "a heartbeat is written as it is read");
    error_ = test::word(f, 0) != 0 || (!newer_ && (f.data[5] != 0 || f.data[6] != 0 || f.data[7] % 128 != 0));
    state_ = f.data[4];
    heartbeat_age_ = 0;
    const std::uint32_t stop_bit = newer_ ? 0x2000000U : 0x4000U;
    reports_stop_ = (test::word(f, 0) & stop_bit) != 0;
    if (!reports_stop_) forgiven_ = false;
    if (reports_stop_ && !forgiven_) stopped_ = true;
    if (state_ != test::axis_closed_loop || error_) {
      confirmations_ = 0;
      fresh_ = false;
    } else if (!fresh_) {
      ++confirmations_;
      fresh_ = true;
    }
    ever_connected_ = ever_connected_ || (confirmations_ >= 2 && asked_state_ == test::axis_closed_loop);
    away_ = false;
    answered_ = true;
  }
  void take_sample(const CanFrame& f) {
    const auto e = drive::odrive::decode_encoder_estimates(f);
    require(e.has_value(), "a sample is read");
    const CanFrame again =
        drive::odrive::encode_encoder_estimates(config_.node, e->position_rev, e->velocity_rev_s);
    require(again.id == f.id && again.size == f.size && fuzz::same_bytes(again, f, 8),
            "a sample is written as it is read");
    const bool zero = e->position_rev == 0.0F && e->velocity_rev_s == 0.0F;
    require(!axis_.encoder_unconnected() || (!newer_ && zero), "only zeros of 0.5.6 are no sample");
    require(newer_ || !zero || ever_connected_ || axis_.encoder_unconnected(),
            "zeros before the first closed loop are no sample");
    require(newer_ || !zero || !away_ || axis_.encoder_unconnected(), "nor are zeros from a distance");
    away_ = std::fabs(e->position_rev) > 1e-3F;
    ever_connected_ = ever_connected_ || !zero;
    if (axis_.encoder_unconnected()) return;
    sample_age_ = 0;
    const auto s = axis_.sample<double>();
    const double per_rev =
        2 * M_PI * static_cast<double>(config_.direction) / static_cast<double>(config_.gear_ratio);
    same(s.angle, static_cast<double>(test::real(f, 0)) * per_rev + 0.25);
    same(s.rate, static_cast<double>(test::real(f, 4)) * per_rev);
  }
  static void same(double a, double b) {
    require((std::isnan(a) && std::isnan(b)) || a == b || std::fabs(a - b) <= 1e-12 * (1 + std::fabs(b)),
            "a sample in the model's units");
  }

  // ---- read-back
  // ------------------------------------------------------------------------------------------------

  /// An answer to the last question: as it should be, or not.
  void answer() {
    CanFrame f;
    f.size = 8;
    if (question_ == 0) {
      f.id = config_.node * 32U;
      f.data = {2, 4, 4, 58, 0, 6, 10, 0};
    } else {
      f = test::message(config_.node, 5, endpoint_ * 0x100U, 0);
      const std::uint32_t good = endpoint_ == endpoints[0]   ? 1
                                 : endpoint_ == endpoints[1] ? std::bit_cast<std::uint32_t>(0.05F)
                                                             : 60000;
      for (std::size_t i = 0; i < 4; ++i) f.data[4 + i] = static_cast<std::uint8_t>(good >> (8 * i));
    }
    if (in_.below(4) == 3) f.data[in_.below(8)] = in_.u8();
    hear(f);
  }
  /// Accepted: so it was asked for, and it counts if it is as it should be.
  void take_answer(const CanFrame& f) {
    require(newer_ && checked_ && question_ >= 0, "nothing is answered that was not asked");
    if (question_ == 0) {
      require(test::command_of(f) == 0, "the version was asked for");
      if (f.data[4] == 0 && f.data[5] == 6 && f.data[6] == 10) version_good_ = true;
    } else {
      require(test::command_of(f) == 5 && f.data[1] + 256U * f.data[2] == endpoint_,
              "this endpoint was asked for");
      for (std::size_t i = 0; i < endpoints.size(); ++i) {
        if (endpoints[i] != endpoint_) continue;
        const double v = i == 0   ? f.data[4]
                         : i == 1 ? static_cast<double>(test::real(f, 4))
                                  : test::word(f, 4);
        good_[i] = v >= static_cast<double>(lower[i]) && v <= static_cast<double>(upper[i]);
      }
    }
    question_ = -1;
  }
  [[nodiscard]] bool all_read() const {
    if (!newer_ || !checked_) return true;
    return (!check_version_ || version_good_) && good_[0] && good_[1] && good_[2];
  }

  // ---- what is sent
  // ----------------------------------------------------------------------------------------------

  void enable() {
    const bool takes = in_.below(8) != 7;
    const bool silent = axis_.tx_suspended();
    axis_.enable([&](const CanFrame& f) {
      require(!silent, "nothing is sent while the watchdog is starved");
      sent(f, takes);
      return takes;
    });
  }
  void sent(const CanFrame& f, bool taken) {
    require(hal::well_formed(f) && !f.extended && !f.fd && test::node_of(f) == config_.node,
            "frames for this node only");
    switch (test::command_of(f)) {
      case test::cmd_axis_state:
        require(f.size == 8 && test::word(f, 0) == test::axis_closed_loop,
                "enabling asks for closed-loop control");
        require(heartbeat_age_.has_value() && !error_,
                "only an axis without error is asked into closed loop");
        require(!axis_.emergency_stopped(), "no closed loop with an emergency stop");
        require(all_read(), "no closed loop before all has been read back");
        if (taken) {
          confirmations_ = 0;
          fresh_ = false;
          asked_state_ = test::axis_closed_loop;
          answered_ = false;
        }
        break;
      case test::cmd_mode:
        require(test::word(f, 0) == 1 && test::word(f, 4) == 1, "torque, passed through");
        break;
      case test::cmd_clear_errors:
        require(error_ && *heartbeat_age_ == 0 && !stopped_,
                "errors are cleared in the tick of their report");
        if (taken) forgiven_ = false;
        break;
      case 0:
        require(f.remote && newer_ && check_version_, "the version is asked for");
        question_ = taken ? 0 : question_;
        break;
      case 4:
        require(f.size == 8 && f.data[0] == 0 && newer_ && checked_, "an endpoint is read, none is written");
        if (taken) {
          question_ = 1;
          endpoint_ = static_cast<std::uint16_t>(f.data[1] + 256U * f.data[2]);
        }
        break;
      default:
        require(false, "no other frame while enabling");
    }
  }
  void disable() {
    axis_.disable([&](const CanFrame& f) {
      require(test::node_of(f) == config_.node && test::command_of(f) == test::cmd_axis_state &&
                  test::word(f, 0) == test::axis_idle,
              "disabling asks for idle");
      return in_.yes();
    });
    confirmations_ = 0;
    asked_state_ = test::axis_idle;
    answered_ = version_good_ = false;
    good_ = {};
    question_ = -1;
  }
  void acknowledge() {
    axis_.acknowledge();
    stopped_ = stopped_now_;  // the operator has not seen a stop of this tick
    forgiven_ = reports_stop_;
  }
  void torque(double joint) {
    const CanFrame f = test::torque_frame(axis_, joint);
    require(test::node_of(f) == config_.node && test::command_of(f) == test::cmd_torque && f.size == 8,
            "a torque command");
    const double shaft =
        joint * static_cast<double>(config_.direction) / static_cast<double>(config_.gear_ratio);
    const double told = static_cast<double>(test::real(f, 0));
    require(std::isfinite(told) && std::fabs(told) <= 1e4, "a torque that a motor may have");
    require(axis_.can_carry(joint) || told == 0, "no torque that cannot be carried");
    if (std::fabs(shaft) < 9999)
      require(std::fabs(told - shaft) <= 1e-6 * std::fabs(shaft) + 1e-40, "the torque that was meant");
    if (!(std::fabs(shaft) < 10001)) require(told == 0, "no torque that no motor has");
  }

  /// What always holds.
  void hold() {
    require(axis_.emergency_stopped() == stopped_, "an emergency stop lasts until it is acknowledged");
    require(axis_.sample_age_ticks() == sample_age_.value_or(drive::age_max), "age of the sample");
    require(axis_.heartbeat_age_ticks() == heartbeat_age_.value_or(drive::age_max), "age of the heartbeat");
    if (axis_.ready()) {
      require(confirmations_ >= 2 && state_ == test::axis_closed_loop && !error_,
              "ready: said twice, without error");
      require(asked_state_ == test::axis_closed_loop && all_read(), "ready: asked for, and read back");
      require(!axis_.encoder_unconnected(), "ready: the last report was a sample");
    }
    const auto torque = axis_.observed_torque();
    require(torque.has_value() == estimate_.has_value(), "a torque in the tick that brought it");
    if (torque) {
      const float joint = *estimate_ * config_.direction * config_.gear_ratio;
      require(*torque == joint || (std::isnan(*torque) && std::isnan(joint)),
              "the torque as estimated, at the joint");
    }
    if (axis_.idle()) require(answered_ && state_ == test::axis_idle, "idle: said so after it was asked");
    require(axis_.closed_loop() == (heartbeat_age_.has_value() && state_ == test::axis_closed_loop),
            "state as said");
  }

  fuzz::Bytes& in_;
  bool newer_ = true, checked_ = false, check_version_ = false;
  drive::AxisConfig config_{};
  OdriveAxis axis_;
  // the model
  std::optional<std::uint32_t> sample_age_, heartbeat_age_;
  std::optional<float> estimate_;  ///< of this tick
  std::uint8_t state_ = 0, asked_state_ = test::axis_idle;
  std::uint32_t confirmations_ = 0;
  bool fresh_ = false, error_ = false, answered_ = false;
  bool ever_connected_ = false;  ///< closed loop was asked for and said twice, or a number reported
  bool away_ = false;            ///< the last sample was not near zero, and no heartbeat came after it
  bool stopped_ = false, stopped_now_ = false, reports_stop_ = false, forgiven_ = false;
  int question_ = -1;  // 0: version, 1: `endpoint_`
  std::uint16_t endpoint_ = 0;
  bool version_good_ = false;
  std::array<bool, 3> good_{};
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  fuzz::Bytes in(data, size);
  Run(in).go();
  return 0;
}
