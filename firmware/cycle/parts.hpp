#pragma once
/// Optional parts of the controller: functions of namespace esmc::part to which the configuration points, or
/// null. A part that the scene does not name is not in the image and costs no instructions. Here are their
/// memory and declarations, the definitions are in part_*.hpp. docs/reaching.md.

#include "firmware/control/law.hpp"
#include "firmware/control/super_twisting.hpp"
#include "firmware/cycle/sample.hpp"

namespace esmc {

template <class M>
struct ControllerConfig;

/// Memory of the optional parts between ticks. Not initialised by itself but for the members with a value.
template <class M>
struct PartMemory {
  using S = typename M::Scalar;
  static constexpr int depth = SuperTwisting<S>::most_delay + 1;

  Vec2<S> asked;  ///< torque that the law wanted in the last tick, N m, gathered on the base joints
  List<Vec<S, M::joints>, depth> sent;  ///< torques sent, N m, limited and ramped, the last tick's first
  bool whole = true;                    ///< the last torque sent is the wanted one
  int ticks = 0;                        ///< number of torques in `sent`
  SuperTwisting<S> twisting;
  Vec2<S> momentum;  ///< of the base joints, predicted for the next tick without torque, N m s
  Vec2<S> disturbance = Vec2<S>::Zero();  ///< observed on the base joints, N m

  /// The torque sent `ago` ticks before the last one, N m at the joints; zero where none was kept.
  [[nodiscard]] Vec<S, M::joints> torque(int ago) const {
    return ago < ticks ? sent[ago] : Vec<S, M::joints>::Zero().eval();
  }
  /// Records the torques sent, N m; call at the end of a tick under the law. `as_asked`: all as the law
  /// wanted.
  void keep(const Vec<S, M::joints>& torque, bool as_asked) {
    for (int k = depth - 1; k > 0; --k) sent[k] = sent[k - 1];
    sent[0] = torque;
    whole = as_asked;
    if (ticks < depth) ++ticks;
  }
  /// Calls f on each vector that a later tick reads, to linearise the controller.
  template <class F>
  void each_state(const F& f) {
    for (int k = 0; k < depth; ++k) f(sent[k]);
    for (Vec2<S>* v : {&asked, &momentum, &disturbance}) f(*v);
    twisting.each_state(f);
  }
  /// Returns to the state before the first tick.
  void reset() {
    ticks = 0;
    begin_halt();
  }
  /// Forgets what was learnt along the reference, not the torques that still act.
  void begin_halt() {
    twisting.reset();
    disturbance.setZero();
  }
};

/// Type of ControllerConfig::reach: sets v' and s of a law whose reaching law couples channels or has memory.
template <class M>
using ReachingPart = void (*)(const ControllerConfig<M>& config, const Tracking<M>& t, PartMemory<M>& memory,
                              typename M::Channels& acceleration, typename M::Channels& sliding);
/// Type of ControllerConfig::observer: updates memory.disturbance (N m) from the measured state.
template <class M>
using ObserverPart = void (*)(const ControllerConfig<M>& config, const Tracking<M>& t, PartMemory<M>& memory);
/// Torque of a motor: factor * commanded + amplitude * sin(per_turn * joint angle + phase); per joint.
template <class S, int Joints>
struct MotorMap {
  Vec<S, Joints> factor = Vec<S, Joints>::Ones();     ///< > 0
  Vec<S, Joints> amplitude = Vec<S, Joints>::Zero();  ///< of the cogging torque, N m at the joint
  Vec<S, Joints> per_turn = Vec<S, Joints>::Zero();   ///< its periods per turn of the joint
  Vec<S, Joints> phase = Vec<S, Joints>::Zero();      ///< rad
};
/// Direction of a MotorPart: from given to commanded (asked) torque, or back.
enum class MotorTorque : std::uint8_t { given_to_asked, asked_to_given };
/// Type of ControllerConfig::correct: converts torques, N m at the joints, in place.
template <class M>
using MotorPart = void (*)(const ControllerConfig<M>& config, const Sample<M>& measured, MotorTorque change,
                           Vec<typename M::Scalar, M::joints>& torque);
/// Type of ControllerConfig::predict: moves the state of `t` to the instant at which this tick's torque acts.
template <class M>
using PredictorPart = void (*)(const ControllerConfig<M>& config, const PartMemory<M>& memory,
                               Tracking<M>& t);

namespace part {

/// Sets v' and s with reaching = "super_twisting", for esmc, esmc_projected and smc; advances its memory.
template <class M>
void super_twisting(const ControllerConfig<M>& config, const Tracking<M>& t, PartMemory<M>& memory,
                    typename M::Channels& acceleration, typename M::Channels& sliding);
/// Sets v' and s with reaching = "implicit_coupled", for esmc and esmc_projected; uses no memory.
template <class M>
void implicit_coupled(const ControllerConfig<M>& config, const Tracking<M>& t, PartMemory<M>& memory,
                      typename M::Channels& acceleration, typename M::Channels& sliding);
/// Sets v' and s of `behind` or of the law itself, with the share of rotors at the elbows in v'.
template <class M>
void elbow_rotors(const ControllerConfig<M>& config, const Tracking<M>& t, PartMemory<M>& memory,
                  typename M::Channels& acceleration, typename M::Channels& sliding);
/// Updates memory.disturbance (N m) from the generalised momentum of the base joints; once per tick.
template <class M>
void momentum_observer(const ControllerConfig<M>& config, const Tracking<M>& t, PartMemory<M>& memory);
/// Moves pose and rates of t over the known delay: the model under sent torques and observed disturbance.
template <class M>
void predictor(const ControllerConfig<M>& config, const PartMemory<M>& memory, Tracking<M>& t);
/// Applies config.motor_map at the joint angles of the instant at which the torque acts. NaN where the phase
/// of the cogging torque is beyond the range of sin_cos.
template <class M>
void motor_map(const ControllerConfig<M>& config, const Sample<M>& measured, MotorTorque change,
               Vec<typename M::Scalar, M::joints>& torque);

}  // namespace part
}  // namespace esmc
