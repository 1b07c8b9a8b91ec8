#pragma once
/// The emulated plant with the faults of drives and sensors, and what the judge has to know of its motors.

#include <cmath>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "host_sim/campaign/faulty_bus.hpp"
#include "host_sim/campaign/judge.hpp"
#include "host_sim/drives/emulated_plant.hpp"

namespace esmc::host {

template <class Plant>
class FaultyPlant : public EmulatedPlant<Plant> {
 public:
  using Base = EmulatedPlant<Plant>;
  using Reading = typename Base::Reading;

  /// Drive `injection.drive`, which exists, is made from `defective`, the others from `scene`; `traits`: of
  /// the protocol of `scene`. All arguments but `motion` outlive this.
  FaultyPlant(Motion<Plant> motion, const Scene& scene, const Scene& defective, const Injection& injection,
              const ProtocolTraits& traits, bool lockstep = true)
      : Base(std::move(motion), scene, make_faulty_axes(scene, defective, injection, lockstep)),
        scene_(&scene),
        injection_(&injection),
        traits_(&traits),
        lockstep_(lockstep) {
    for (std::size_t i = 0; i < this->axes().size(); ++i) {
      const PlacedAxis& placed = this->axes()[i].placed;
      nodes_.push_back(placed.mount.node);
      records_.push_back({});
      records_[i].last_angle = this->motion().shaft(static_cast<std::size_t>(placed.joint)).angle;
      if (!placed.motor) continue;
      MotorState& m = records_[i].state;
      m.limit = scene.torque_limit[i];
      m.step = traits.torque_step(scene, i);
      m.none = traits.zero_is_a_step ? 0.0 : 0.5 * m.step * (1.0 + 1e-6);
    }
  }

  [[nodiscard]] const std::vector<int>& nodes() const { return nodes_; }
  [[nodiscard]] std::size_t motors() const { return static_cast<std::size_t>(scene_->motors()); }
  [[nodiscard]] const MotorState& motor(std::size_t i) const { return records_[i].state; }
  /// Distance that a motor's joint has turned since the last tick, rad.
  [[nodiscard]] double turned(std::size_t i) const { return records_[i].turned; }
  /// As EmulatedPlant::set_motion(): replaces motion and scene, not the drives. `scene` must outlive this.
  void set_motion(Motion<Plant> motion, const Scene& scene) {
    Base::set_motion(std::move(motion), scene);
    scene_ = &scene;
  }

  /// Begins a tick: every drive sends its reports. `active`: the fault acts; `first`: it begins now.
  void publish(FaultyBus& bus, bool active, bool first) {
    this->begin_tick();
    if (first) strike(bus);
    active_ = active;
    const auto send = [&](std::size_t axis, const hal::CanFrame& f) { bus.from_drive(axis, f); };
    Base::publish(send, [&](std::size_t i, Reading now) -> std::optional<Reading> {
      Record& r = records_[i];
      r.turned = std::abs(now.angle - r.last_angle);
      r.last_angle = now.angle;
      if (without_power(i)) return std::nullopt;
      return i == injection_->drive ? sensed(r, now, first) : now;
    });
  }

  /// Hands the frames of the tick that began at `now_ms` to the drives.
  void deliver(FaultyBus& bus, double now_ms) {
    for (std::size_t i = 0; i < records_.size(); ++i) {
      MotorState& m = records_[i].state;
      m.heard_now = m.heard_stranger = m.armed_now = false;
      note_torque(i, now_ms);  // a watchdog may have acted when the tick began
    }
    const auto send = [&](std::size_t axis, const hal::CanFrame& f) { bus.from_drive(axis, f); };
    for (const FaultyBus::Delivery& d : bus.to_drives()) {
      for (std::size_t i = 0; i < records_.size(); ++i) {
        if (!bus.hears(i) || without_power(i)) continue;
        const EmulatedAxis& drive = *this->axes()[i].drive;
        MotorState& m = records_[i].state;
        const bool armed_before = drive.closed_loop(), command = drive.commanded_by(d.frame);
        this->hand_over(i, d.frame, send);
        if (command && !d.ours) m.heard_stranger = m.strangers = true;
        if (command && d.ours) {
          m.heard_now = true;
          m.heard_ms = now_ms + d.ms;
        }
        const bool feeds =
            traits_->is_sign_of_life != nullptr ? traits_->is_sign_of_life(*scene_, d.frame) : command;
        if (feeds && d.ours) m.fed_ms = now_ms + d.ms;
        m.armed_now = m.armed_now || (!armed_before && drive.closed_loop());
        note_torque(i, now_ms + d.ms);
      }
    }
  }

  /// Moves over `seconds` from t on, s; no effect before the brake is released.
  void advance(double t, double seconds) {
    if (!this->released()) return;
    bool clipped = false;
    Base::advance(t, seconds, scene_->step, Base::deliver(this->asked(), seconds, clipped));
  }

 private:
  struct Record {
    MotorState state;
    Reading kept{};  ///< what a frozen sensor shows
    double last_angle = 0.0, turned = 0.0;
  };

  static std::vector<SeatedAxis> make_faulty_axes(const Scene& scene, const Scene& defective,
                                                  const Injection& injection, bool lockstep) {
    std::vector<SeatedAxis> axes = make_axes(scene, lockstep);
    SeatedAxis& afflicted = axes[injection.drive];
    if (&defective != &scene) afflicted.drive = make_axis(defective, afflicted.placed, lockstep);
    if (injection.kind() == Injected::swapped_nodes) std::swap(axes[0].placed.joint, axes[1].placed.joint);
    return axes;
  }

  /// One drive, or all, are switched on late.
  [[nodiscard]] bool without_power(std::size_t i) const {
    return active_ && injection_->kind() == Injected::late_power &&
           (i == injection_->drive || injection_->choice % 2 == 0);
  }

  /// Faults that happen to a drive once.
  void strike(FaultyBus& bus) {
    const std::size_t i = injection_->drive;
    const int node = nodes_[i];
    const auto receive = [&](const std::vector<hal::CanFrame>& frames) {
      for (const hal::CanFrame& f : frames)
        this->hand_over(i, f, [&](std::size_t axis, const hal::CanFrame& g) { bus.from_drive(axis, g); });
    };
    const Injected kind = injection_->kind();
    if (kind == Injected::drive_error) receive(traits_->fail(node));
    if (kind == Injected::drive_disarm) receive(traits_->disarm(node));
    if (kind == Injected::drive_reset) this->restart_drive(i, *scene_, lockstep_);
  }

  /// Reading of the afflicted drive's encoder.
  [[nodiscard]] Reading sensed(Record& r, Reading now, bool first) const {
    if (first) r.kept = now;
    if (!active_) return now;
    const Injected kind = injection_->kind();
    if (kind == Injected::frozen_sensor) {
      // The angle alone, or both; a stuck counter may also show the speed as zero.
      if (injection_->choice % 3 == 0) return {r.kept.angle, now.rate};
      return {r.kept.angle, injection_->choice % 3 == 1 ? r.kept.rate : 0.0};
    }
    if (kind == Injected::sensor_jump || kind == Injected::sensor_step)
      return {now.angle + injection_->amount, now.rate};
    return kind == Injected::sensor_flipped ? Reading{-now.angle, -now.rate} : now;
  }

  void note_torque(std::size_t i, double now_ms) {
    MotorState& m = records_[i].state;
    const double torque = this->axes()[i].drive->joint_torque();
    const auto none = [&](double t) { return std::abs(t) <= m.none; };
    if (none(torque) && !none(m.torque)) m.zero_ms = now_ms;
    m.torque = torque;
  }

  const Scene* scene_;
  const Injection* injection_;
  const ProtocolTraits* traits_;
  bool lockstep_;
  std::vector<Record> records_;
  std::vector<int> nodes_;
  bool active_ = false;
};

}  // namespace esmc::host
