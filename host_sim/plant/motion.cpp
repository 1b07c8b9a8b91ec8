#include "host_sim/plant/motion.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "host_sim/plant/engine.hpp"

namespace esmc::host {

template <class Plant>
Motion<Plant>::Motion(const Setup& setup, const State& initial)
    : setup_(std::make_unique<Setup>(setup)), state_(initial), payload_(find_effect<Payload>(setup.effects)) {
  setup_->plant.project(state_.angle, state_.rate);
  engine_ = make_engine<Plant>(setup_->plant, setup_->effects, setup_->motor_joint, setup_->method,
                               setup_->resolution, state_, setup_->hand);
  breaks_ = engine_->breaks();
  if (payload_) breaks_.insert(breaks_.end(), {payload_->from, payload_->to});
  std::sort(breaks_.begin(), breaks_.end());
  energy_start_ = energy();
  potential_start_ = plant().potential_energy(state_);
  if (payload_ && payload_->from <= 0.0 && payload_->to > 0.0) set_payload(true);
}

/// The load comes and goes moving with the effector: rates stay, energy comes and goes with it.
template <class Plant>
void Motion<Plant>::set_payload(bool loaded) {
  if (loaded == loaded_) return;
  const double before = energy(), potential_before = plant().potential_energy(state_);
  loaded_ = loaded;
  engine_->set_plant(plant());
  energy_start_ += energy() - before;
  potential_start_ += plant().potential_energy(state_) - potential_before;
}

template <class Plant>
void Motion<Plant>::run(double t, double seconds, int steps, const MotorTorques<Joints>& torque) {
  engine_->run(t, seconds / steps, steps, torque);
  engine_->get(state_.angle, state_.rate);
}

template <class Plant>
void Motion<Plant>::advance(double t, double seconds, int steps, const MotorTorques<Joints>& torque) {
  if (breaks_.empty()) return run(t, seconds, steps, torque);
  const double end = t + seconds, longest = seconds / steps, nothing = 1e-9 * longest;
  while (t < end - nothing) {
    if (payload_) set_payload(t >= payload_->from - nothing && t < payload_->to - nothing);
    const auto next = std::upper_bound(breaks_.begin(), breaks_.end(), t + nothing);
    const double to = next == breaks_.end() ? end : std::min(end, *next);
    run(t, to - t, std::max(1, static_cast<int>(std::ceil((to - t) / longest - 1e-6))), torque);
    t = to;
  }
}

template <class Plant>
double Motion<Plant>::energy_error() {
  const double kinetic = plant().kinetic_energy(state_), potential = plant().potential_energy(state_);
  const double total = kinetic + potential, done = work();
  energy_scale_ = std::max({energy_scale_, kinetic, std::abs(potential - potential_start_), std::abs(done)});
  const double gap = std::abs(total - energy_start_ - done);
  // At rest nothing is exchanged: rounding is then measured against the weight's own energy.
  return gap / std::max({energy_scale_, 1e-9 * std::abs(total), 1e-12});
}

template class Motion<FiveBarPlant>;
template class Motion<RrPlant>;

}  // namespace esmc::host
