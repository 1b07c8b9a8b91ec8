/// Emulated drives, which `esmc drive` puts on a bus of others: each protocol, with what can be made wrong
/// about it, under frames of any kind and under time.

#include <cstring>
#include <limits>
#include <map>

#include "host_sim/drives/mit_axis.hpp"
#include "host_sim/drives/odrive_axis.hpp"
#include "tests/fuzz/drives.hpp"
#include "tests/fuzz/drives_cia402.hpp"
#include "tests/support/mit_bytes.hpp"
#include "tests/support/odrive_bytes.hpp"

namespace {

using namespace esmc;
using fuzz::Bytes;
using fuzz::DriveRun;
using fuzz::require;
using hal::CanFrame;

/// Eight bytes as a drive has them that does not look at the length: those that a frame lacks are of the
/// frame before.
class Buffer {
 public:
  CanFrame fill(CanFrame f) {
    std::memcpy(bytes_.data(), f.data.data(), f.size);
    std::memcpy(f.data.data(), bytes_.data(), bytes_.size());
    f.size = 8;
    return f;
  }

 private:
  std::array<std::uint8_t, 8> bytes_{};
};

class OdriveRun final : public DriveRun {
 public:
  explicit OdriveRun(Bytes& in) : DriveRun(in) {
    const unsigned how = in_.u8(), wrong = in_.u8();
    older_ = (how & 1U) != 0;
    settings_.version = older_ ? host::OdriveAxis::Version::v0_5_6 : host::OdriveAxis::Version::v0_6;
    settings_.period = fuzz::period;
    settings_.says_torque = (how & 2U) != 0;
    settings_.overspeed_error = (how & 4U) != 0;
    settings_.torque_max = 7.0;
    patience_ = 1 + (how >> 3U);
    settings_.watchdog_timeout = patience_ * fuzz::period;
    host::Defects& d = settings_.defects;
    d.watchdog_off = (wrong & 1U) != 0;
    d.watchdog_any_frame = (wrong & 2U) != 0;
    d.short_frames_stale = (wrong & 4U) != 0;
    d.no_nan_check = (wrong & 8U) != 0;
    d.unsynchronised = (wrong & 16U) != 0;
    d.timeout_stays_enabled = (wrong & 32U) != 0;
    d.latched_timeout = (wrong & 64U) != 0;
    d.torque_mode_limit = (wrong & 128U) != 0;
    settings_.endpoints.firmware = {0, 6, 10};
    for (const host::OdriveValueName& v : host::odrive_values) {
      settings_.endpoints.list.push_back(
          {v.value, static_cast<std::uint16_t>(endpoint + settings_.endpoints.list.size()), v.type});
    }
    node_ = in_.below(63);
    mount(static_cast<int>(node_));
    axis_ = std::make_unique<host::OdriveAxis>(mount_, settings_, sensor_, 0, 1);
  }

 private:
  static constexpr unsigned endpoint = 500;

  CanFrame ours() override {
    switch (in_.below(8)) {
      case 0:
        return torque(static_cast<float>(static_cast<std::int8_t>(in_.u8())) / 16);
      case 1:
        return torque(in_.f32());
      case 2:
        return test::message(node_, test::cmd_axis_state, in_.yes() ? 8 : in_.u8(), 0);
      case 3:
        return test::message(node_, test::cmd_mode, in_.below(4), in_.below(4));
      case 4:
        return test::message(node_, test::cmd_clear_errors, 0, 0, older_ ? 0 : 1);
      case 5:
        return test::message(node_, 0x02, 0, 0, 0);
      case 6:
        return test::message(node_, 0x04, (endpoint + in_.below(12)) * 0x100U, 0);
      default: {
        CanFrame f = test::message(node_, in_.below(32), 0, 0);
        f.remote = true;
        return f;
      }
    }
  }
  [[nodiscard]] CanFrame torque(float t) const {
    return test::message(node_, test::cmd_torque, std::bit_cast<std::uint32_t>(t), 0);
  }
  void arm(unsigned how) override {
    if ((how & 1U) != 0) hear(test::message(node_, test::cmd_clear_errors, 0, 0, 1));
    hear(test::message(node_, test::cmd_mode, 1, 1));
    hear(test::message(node_, test::cmd_axis_state, 8, 0));
    hear(torque(static_cast<float>(how) / 64));
  }
  [[nodiscard]] bool concerns(const CanFrame& f) const override {
    return !f.extended && !f.fd && test::node_of(f) == node_;
  }

  void said(const CanFrame& f) override {
    require(test::node_of(f) == node_ && f.size == 8, "a message of this node, in eight bytes");
    switch (test::command_of(f)) {
      case test::cmd_heartbeat:
        require(test::word(f, 0) == axis_->error(), "a heartbeat says the error");
        require(f.data[4] == (axis_->closed_loop() ? test::axis_closed_loop : test::axis_idle),
                "and the state");
        break;
      case test::cmd_encoder:
        require(std::isfinite(test::real(f, 0)) && std::isfinite(test::real(f, 4)), "finite estimates");
        break;
      case test::cmd_torques: {
        const double told = static_cast<double>(test::real(f, 4)) * per_shaft();
        require(std::fabs(told - axis_->joint_torque()) < 1e-5, "the torque that it applies");
        break;
      }
      case 0x00:
        require(!older_ && f.data[4] == 0 && f.data[5] == 6 && f.data[6] == 10, "its version");
        break;
      case 0x03:
        require(!older_ && test::word(f, 0) == axis_->error(), "its errors");
        break;
      case 0x05:
        value(f);
        break;
      default:
        require(false, "a message that drives send");
    }
  }
  /// What is read back is what the drive does.
  void value(const CanFrame& f) {
    const unsigned at = test::word(f, 0) / 0x100U - endpoint;
    require(!older_ && f.data[0] == 0 && at < settings_.endpoints.list.size(), "an endpoint that it has");
    switch (settings_.endpoints.list[at].value) {
      case host::OdriveValue::enable_watchdog:
        require((test::word(f, 4) != 0) != settings_.defects.watchdog_off, "its watchdog");
        break;
      case host::OdriveValue::watchdog_timeout:
        require(std::fabs(test::real(f, 4) * 1000 - static_cast<float>(patience_)) < 1e-3F, "its time");
        break;
      case host::OdriveValue::control_mode:
        require(test::word(f, 4) == control_, "its mode");
        break;
      case host::OdriveValue::input_mode:
        require(test::word(f, 4) == input_, "its input");
        break;
      case host::OdriveValue::torque_mode_limit:
        require((test::word(f, 4) != 0) == settings_.defects.torque_mode_limit, "its limiter");
        break;
      case host::OdriveValue::overspeed_error:
        require((test::word(f, 4) != 0) == settings_.overspeed_error, "its speed error");
        break;
      case host::OdriveValue::heartbeat_period:
        require(std::fabs(test::word(f, 4) - 1e3 * settings_.heartbeat_period) <= 0.5, "its heartbeat");
        break;
      case host::OdriveValue::vel_limit:
      case host::OdriveValue::torque_constant:
      case host::OdriveValue::current_limit:
        require(test::real(f, 4) > 0, "numbers of its configuration");
        break;
    }
  }

  void heard(const CanFrame& received) override {
    if (older_ || settings_.defects.watchdog_any_frame) silent_ = 0;
    const unsigned command = test::command_of(received);
    require(sent_.size() <= 1, "one answer");
    if (!sent_.empty()) {
      const unsigned answer = test::command_of(sent_[0]);
      require(received.remote ? answer == command : command == 0x04 && answer == 0x05, "to what was asked");
    }
    if (received.remote) return demanded();
    const CanFrame f = settings_.defects.short_frames_stale ? buffer_.fill(received) : received;
    if (command == test::cmd_axis_state && f.size >= 4) asked_ = test::word(f, 0) == 8;
    if (command == 0x02) asked_ = false;
    if (command == test::cmd_mode && f.size == 8) {
      control_ = test::word(f, 0);
      input_ = test::word(f, 4);
    }
    if (command == test::cmd_torque && f.size >= 4) {
      silent_ = 0;
      told_ = test::real(f, 0);
      if (!std::isfinite(told_) && !settings_.defects.no_nan_check) {
        require(!axis_->closed_loop() && axis_->error() != 0, "NaN disarms");
      }
    }
    if (axis_->closed_loop() && !was_closed_) {
      require(command == test::cmd_axis_state && asked_, "closed loop because that was asked");
      silent_ = 0;
      told_ = 0.0F;
    }
    demanded();
  }
  void passed() override {
    ++silent_;
    ++beat_;
    std::map<unsigned, int> count;
    for (const CanFrame& f : sent_) ++count[test::command_of(f)];
    require(count[test::cmd_encoder] == 1 && test::command_of(sent_.back()) == test::cmd_encoder,
            "estimates end its report");
    require(count[test::cmd_heartbeat] == (beat_ % 10 == 0 ? 1 : 0), "a heartbeat every ten periods");
    require(count[test::cmd_torques] == (settings_.says_torque ? count[test::cmd_heartbeat] : 0),
            "torques with it");
    const bool starved = was_closed_ && silent_ > patience_ && !settings_.defects.watchdog_off;
    if (starved) {
      require(settings_.defects.torque_mode_limit || axis_->joint_torque() == 0.0,
              "a starved watchdog ends in no torque");
      told_ = 0.0F;
      dead_ = dead_ || (settings_.defects.latched_timeout && !settings_.defects.timeout_stays_enabled);
    }
    require(axis_->closed_loop() == (was_closed_ && (!starved || settings_.defects.timeout_stays_enabled)),
            "time disarms by the watchdog only");
    demanded();
  }
  void demanded() {
    if (dead_) require(!axis_->closed_loop() && axis_->error() != 0, "dead until it is restarted");
    if (axis_->closed_loop())
      require(asked_ && axis_->error() == 0, "closed loop was asked for, and there is no error");
    const bool torque_control = axis_->closed_loop() && control_ == 1 && input_ == 1;
    if (!torque_control) return require(axis_->joint_torque() == 0.0, "torque in torque control only");
    if (settings_.defects.torque_mode_limit) return;
    const double most = settings_.torque_max;
    const double told = std::isnan(told_) ? most : std::clamp(static_cast<double>(told_), -most, most);
    require(axis_->joint_torque() == told * per_shaft(), "the torque that it was told");
  }
  [[nodiscard]] double most() const override { return settings_.torque_max; }

  host::OdriveAxis::Settings settings_{};
  Buffer buffer_;
  unsigned node_ = 0, patience_ = 1, silent_ = 0, beat_ = 0;
  std::uint32_t control_ = 3, input_ = 1;
  float told_ = 0.0F;
  bool older_ = false, asked_ = false, dead_ = false;
};

class MitRun final : public DriveRun {
 public:
  explicit MitRun(Bytes& in) : DriveRun(in) {
    const unsigned how = in_.u8(), more = in_.u8();
    const bool damiao = how % 3 == 2, plain = how % 3 == 0;
    settings_.dialect = static_cast<host::MitAxis::Dialect>(how % 3);
    settings_.reply_size = plain ? static_cast<std::uint8_t>(5 + more % 3) : 8;
    settings_.realtime = (how & 64U) != 0;
    settings_.torque_range = (how & 128U) != 0 ? 0.5 : 18.0;
    settings_.defects.watchdog_off = (more & 4U) != 0;
    settings_.defects.short_frames_stale = (more & 8U) != 0;
    settings_.defects.latched_timeout = (more & 16U) != 0;
    takes_torn_ = settings_.defects.short_frames_stale;
    patience_ = 1 + (more >> 5U);
    settings_.timeout_cycles = static_cast<int>(patience_ * 40);
    node_ = 1 + in_.below(damiao ? 15 : 255);
    settings_.master_id = (how & 8U) != 0 ? static_cast<std::uint16_t>(node_) : 0x17;
    mount(static_cast<int>(node_));
    axis_ = std::make_unique<host::MitAxis>(mount_, settings_, sensor_, 0, 1);
  }

 private:
  CanFrame ours() override {
    switch (in_.below(4)) {
      case 0:
        return test::mit_command(node_, 0x8000, 0x800, 0, 0, in_.u16() % 4096);
      case 1:
        return test::mit_command(node_, in_.u16(), in_.u16() % 4096, in_.u16() % 4096, in_.u16() % 4096,
                                 in_.u16() % 4096);
      default:
        return test::mit_special(node_, 0xFB + in_.below(5));
    }
  }
  void arm(unsigned how) override {
    hear(test::mit_special(node_, 0xFC));
    hear(test::mit_command(node_, 0x8000, 0x800, 0, 0, how * 16));
  }
  [[nodiscard]] bool concerns(const CanFrame& f) const override {
    return !f.extended && !f.fd && !f.remote && f.id == node_ &&
           (f.size == 8 || settings_.defects.short_frames_stale);
  }
  void settled(double angle) override { shaft_at(angle); }

  void said(const CanFrame& f) override {
    require(f.id == settings_.master_id && f.size == settings_.reply_size,
            "a reply, where and as long as it is to be");
    const bool damiao = settings_.dialect == host::MitAxis::Dialect::damiao;
    require(damiao ? f.data[0] % 16 == node_ && f.data[0] / 16 == (axis_->closed_loop() ? 1 : 0)
                   : f.data[0] == node_,
            "of this drive");
    const double step = 2 * settings_.torque_range / 4095,
                 told = test::mit_t(f) * step - settings_.torque_range;
    if (f.size > 5)
      require(std::fabs(told * per_shaft() - axis_->joint_torque()) < 1.001 * step * mount_.gear_ratio,
              "the torque it applies");
  }
  void heard(const CanFrame& received) override {
    require(sent_.size() == (settings_.realtime ? 1 : 0),
            "a reply for each command, at once or with the tick");
    const CanFrame f = settings_.defects.short_frames_stale ? buffer_.fill(received) : received;
    silent_ = 0;
    if (test::is_special(f, 0xFC)) {
      entered_ = true;
      expired_ = false;
    } else if (test::is_special(f, 0xFD)) {
      entered_ = false;
    } else if (test::is_special(f, 0xFE)) {
      zero_ = angle_;
    } else if (!expired_ || !settings_.defects.latched_timeout) {
      expired_ = false;
      told_ = f;
      commanded_ = true;
    }
    demanded();
  }
  void passed() override {
    shaft_at(shaft_.angle);
    rate_ = shaft_.rate * per_shaft();
    require(sent_.size() == (settings_.realtime ? 0 : 1),
            "a reply for each command, at once or with the tick");
    if (++silent_ > patience_ && !settings_.defects.watchdog_off) {
      require(axis_->joint_torque() == 0.0, "a command that is too old is none");
      expired_ = true;
      commanded_ = false;
    }
    demanded();
  }
  void shaft_at(double joint) { angle_ = (joint - mount_.offset) * per_shaft(); }
  /// Torque by the fields of the last command.
  void demanded() {
    require(axis_->closed_loop() == entered_ && axis_->error() == 0, "motor mode as it was told last");
    if (!entered_ || !commanded_) return require(axis_->joint_torque() == 0.0, "no torque without a command");
    if (!sensor_.none()) return;
    const auto field = [&](std::size_t from, bool low, double least, double range) {
      const auto two = test::mit_number(told_, from, 2);
      return least + range * static_cast<double>(low ? two % 4096 : two / 16) / 4095;
    };
    const double p = static_cast<double>(test::mit_number(told_, 0, 2)) / 65535 * 25 - 12.5,
                 v = field(2, false, -50, 100);
    const double kp = field(3, true, 0, 500), kd = field(5, false, 0, 5), most = settings_.torque_range,
                 t = field(6, true, -most, 2 * most);
    const double torque = std::clamp(kp * (p - angle_ + zero_) + kd * (v - rate_) + t, -most, most);
    require(std::fabs(axis_->joint_torque() - torque * per_shaft()) < 1e-5, "the torque of the last command");
  }
  [[nodiscard]] double most() const override { return settings_.torque_range; }

  host::MitAxis::Settings settings_{};
  Buffer buffer_;
  CanFrame told_{};
  double angle_ = 0.0, rate_ = 0.0, zero_ = 0.0;  // of the shaft
  unsigned node_ = 1, patience_ = 1, silent_ = 0;
  bool entered_ = false, expired_ = false, commanded_ = false;
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  Bytes in(data, size);
  in.one_of(
      3, [&] { OdriveRun(in).go(); }, [&] { MitRun(in).go(); }, [&] { fuzz::Cia402Run(in).go(); });
  return 0;
}
