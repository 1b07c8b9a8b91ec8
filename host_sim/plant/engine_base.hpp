#pragma once
/// System and method of a motion behind one virtual call per tick.

#include <memory>
#include <utility>
#include <vector>

#include "host_sim/effects/drivetrain.hpp"
#include "host_sim/plant/inputs.hpp"
#include "host_sim/plant/system.hpp"

namespace esmc::host {

template <class Plant>
class Engine {
 public:
  using Angles = typename Plant::Angles;
  using Joints = typename Plant::Joints;

  virtual ~Engine() = default;
  /// Integrates from t, s, in `steps` steps of `step`, s, each; no load may jump within.
  virtual void run(double t, double step, int steps, const MotorTorques<Joints>& torque) = 0;
  virtual void set_plant(const Plant& plant) = 0;  ///< must outlive this
  virtual void get(Angles& angle, Angles& rate) const = 0;
  [[nodiscard]] virtual double work() const = 0;  ///< of motors and loads since the start, J
  [[nodiscard]] virtual Shaft shaft(std::size_t joint) const = 0;
  [[nodiscard]] virtual std::size_t effect_states() const = 0;   ///< number of them
  [[nodiscard]] virtual std::vector<double> breaks() const = 0;  ///< instants that no step may cross, s
  [[nodiscard]] virtual Method method() const = 0;
  [[nodiscard]] virtual Effort effort() const { return {}; }
};

/// An engine with its system, a `Sys` of what is attached, and their state.
template <class Plant, class Sys>
class SystemEngine : public Engine<Plant> {
 public:
  using Angles = typename Plant::Angles;

  /// `plant` must outlive this. `more`: arguments of the system.
  template <class... More>
  SystemEngine(const Plant& plant, std::unique_ptr<Attachments> attached,
               const typename Plant::State& initial, const More&... more)
      : attached_(std::move(attached)), system_(plant, *attached_, more...) {
    Sys::put(y_, initial.angle, initial.rate);
    system_.start(y_);
  }
  SystemEngine(const SystemEngine&) = delete;
  SystemEngine& operator=(const SystemEngine&) = delete;

  void set_plant(const Plant& plant) override { system_.set_plant(plant); }
  void get(Angles& angle, Angles& rate) const override {
    angle = Sys::angles(y_);
    rate = Sys::rates(y_);
  }
  [[nodiscard]] double work() const override { return y_[Sys::work]; }
  [[nodiscard]] Shaft shaft(std::size_t joint) const override { return system_.shaft(joint, y_); }
  [[nodiscard]] std::size_t effect_states() const override { return system_.size() - Sys::work - 1; }
  [[nodiscard]] std::vector<double> breaks() const override { return attached_->loads.breaks; }

 protected:
  std::unique_ptr<Attachments> attached_;
  Sys system_;
  typename Sys::State y_{};
};

}  // namespace esmc::host
