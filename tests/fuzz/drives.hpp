#pragma once
/// An emulated drive on the desk, whatever its protocol: its shaft, what it is told and what it says. Which
/// frames concern it, which form its own have and what follows for torque is for each protocol to say.

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "host_sim/drives/emulated_axis.hpp"
#include "host_sim/effects/shaft_sensor.hpp"
#include "tests/fuzz/bytes.hpp"

namespace esmc::fuzz {

constexpr double period = 1e-3;  // s

class DriveRun {
 public:
  explicit DriveRun(Bytes& in) : in_(in) {}
  DriveRun(const DriveRun&) = delete;
  DriveRun& operator=(const DriveRun&) = delete;
  virtual ~DriveRun() = default;

  void go() {
    axis_->settle(shaft_.angle);
    settled(shaft_.angle);
    while (!in_.empty() && periods_ < periods_max) {
      in_.one_of(
          8, [&] { pass(); }, [&] { hear(in_.frame()); }, [&] { hear(ours()); },
          [&] { hear(changed(ours())); },
          [&] {
            for (unsigned n = in_.below(64); n > 0; --n) pass();
          },
          [&] { arm(in_.u8()); }, [&] { move(); }, [&] { hear(in_.yes() ? last_ : changed(last_)); });
    }
  }

 protected:
  // ---- what a protocol says
  // ------------------------------------------------------------------------------------------

  /// A frame as a controller sends it to this drive.
  virtual hal::CanFrame ours() = 0;
  /// What brings it to torque, `how` it is done.
  virtual void arm(unsigned how) = 0;
  /// False: to this drive it is nothing.
  [[nodiscard]] virtual bool concerns(const hal::CanFrame& f) const = 0;
  /// Each frame of its own, before what it was told has been looked at.
  virtual void said(const hal::CanFrame& f) = 0;
  virtual void settled(double) {}
  virtual void heard(const hal::CanFrame& f) = 0;
  virtual void passed() = 0;
  /// N m at the shaft that it cannot exceed.
  [[nodiscard]] virtual double most() const = 0;

  // ---- the desk
  // ------------------------------------------------------------------------------------------------------

  /// How it is mounted, and what its sensor does wrong.
  void mount(int node) {
    const unsigned how = in_.u8();
    mount_ = {.node = node,
              .direction = (how & 1U) != 0 ? -1.0 : 1.0,
              .gear_ratio = (how & 2U) != 0 ? 2.0 : 1.0,
              .offset = (how & 4U) != 0 ? 0.25 : 0.0};
    if ((how & 8U) != 0) sensor_.encoder = host::Encoder{.bits = 12};
    if ((how & 16U) != 0) sensor_.delay = host::SensorDelay{.ticks = 2};
    if ((how & 32U) != 0) shaft_.friction = 0.0;
  }
  [[nodiscard]] double per_shaft() const { return mount_.direction * mount_.gear_ratio; }

  void hear(hal::CanFrame f) {
    if (f.remote) f.data = {};  // as it comes from a bus
    if (!hal::well_formed(f)) return;
    last_ = f;
    const double before = axis_->joint_torque();
    was_closed_ = axis_->closed_loop();
    const bool commanded = axis_->commanded_by(f), mine = concerns(f);
    const bool completes = axis_->receive(f, sink());
    if (!mine) {
      require(sent_.empty() && !completes && !commanded, "what is not for it has no answer");
      require(axis_->joint_torque() == before && axis_->closed_loop() == was_closed_, "and no effect");
    } else {
      heard(f);
    }
    // A torn frame is nothing that a controller sends: where it acts, that is the defect.
    if (axis_->joint_torque() != before && axis_->joint_torque() != 0.0)
      require(commanded || takes_torn_, "torque comes of commands");
    hold();
  }
  void pass() {
    if (periods_ == periods_max) return;
    ++periods_;
    shaft_.advance(std::clamp(axis_->joint_torque(), -1.0, 1.0), period);
    if (!(std::fabs(shaft_.angle) < 1e5 && std::fabs(shaft_.rate) < 1e4)) shaft_.angle = shaft_.rate = 0.0;
    was_closed_ = axis_->closed_loop();
    axis_->publish(shaft_.angle, shaft_.rate, sink());
    passed();
    hold();
  }

  Bytes& in_;
  host::AxisMount mount_{};
  host::SensorEffects sensor_{{}};
  host::LoneShaft shaft_{};
  std::unique_ptr<host::EmulatedAxis> axis_;
  std::vector<hal::CanFrame> sent_;  ///< of this frame or period
  bool was_closed_ = false, takes_torn_ = false;

 private:
  static constexpr int periods_max = 600;

  host::EmulatedAxis::Send sink() {
    sent_.clear();
    return [this](const hal::CanFrame& f) {
      require(hal::well_formed(f) && !f.extended && !f.remote && !f.fd && !f.bit_rate_switch,
              "classic frames with 11 bits");
      said(f);
      sent_.push_back(f);
    };
  }
  void hold() {
    const double torque = axis_->joint_torque();
    require(std::isfinite(torque), "torque is a number");
    require(std::fabs(torque) <= most() * mount_.gear_ratio * (1 + 1e-12), "and within the limit");
    if (!axis_->closed_loop()) require(torque == 0.0, "a drive that is not enabled applies none");
    if (torque != 0.0) require(axis_->error() == 0, "nor one with an error");
  }
  void move() {
    if (in_.yes()) {
      shaft_.rate = static_cast<std::int8_t>(in_.u8());
      return;
    }
    const auto angle = static_cast<double>(in_.f32());
    if (std::fabs(angle) < 1e5) shaft_.angle = angle;
  }
  hal::CanFrame changed(hal::CanFrame f) {
    in_.one_of(
        6, [&] { f.size = static_cast<std::uint8_t>(in_.below(9)); }, [&] { f.id ^= 1U << in_.below(11); },
        [&] { f.extended = true; }, [&] { f.remote = true; }, [&] { f.fd = true; },
        [&] { f.data[in_.below(8)] = in_.u8(); });
    return f;
  }

  hal::CanFrame last_{};
  int periods_ = 0;
};

}  // namespace esmc::fuzz
