#pragma once
/// Optional parts of the controller. Each is a function of namespace esmc::part that the configuration points
/// to, or null: what a scene does not name is not in the image and costs no instructions. What parts remember
/// from tick to tick is here; their code is in part_*.hpp of this folder. docs/reaching.md.

#include "firmware/control/law.hpp"
#include "firmware/control/super_twisting.hpp"

namespace esmc {

template <class M>
struct ControllerConfig;

/// What optional parts remember.
template <class M>
struct PartMemory {
  using S = typename M::Scalar;
  static constexpr int depth = SuperTwisting<S>::most_delay + 1;

  Vec2<S> asked;  ///< torque of the last tick, N m, gathered on the base joints: by the law
  List<Vec<S, M::joints>, depth> sent;  ///< and as it went out, limited and ramped; the last tick's first
  bool whole = true;                    ///< the last one is what was asked
  int ticks = 0;                        ///< so many are remembered
  SuperTwisting<S> twisting;
  Vec2<S> momentum;  ///< of the base joints, with what is known to change it until the next tick, N m s
  Vec2<S> disturbance = Vec2<S>::Zero();  ///< on the base joints, as observed, N m

  /// The torque sent `ago` ticks before the last one.
  [[nodiscard]] Vec<S, M::joints> torque(int ago) const {
    return ago < ticks ? sent[ago] : Vec<S, M::joints>::Zero().eval();
  }
  /// At the end of a tick in which the law acted.
  void keep(const Vec<S, M::joints>& torque, bool as_asked) {
    for (int k = depth - 1; k > 0; --k) sent[k] = sent[k - 1];
    sent[0] = torque;
    whole = as_asked;
    if (ticks < depth) ++ticks;
  }
  /// As before the first tick of a law.
  void reset() {
    ticks = 0;
    twisting.reset();
    disturbance.setZero();
  }
};

/// A law's v' and sliding variables with a reaching law that is not a function of one channel alone.
template <class M>
using ReachingPart = void (*)(const ControllerConfig<M>& config, const Tracking<M>& t, PartMemory<M>& memory,
                              typename M::Channels& acceleration, typename M::Channels& sliding);
/// From the measured state, what torques of unknown origin there are on the base joints: memory.disturbance.
template <class M>
using ObserverPart = void (*)(const ControllerConfig<M>& config, const Tracking<M>& t, PartMemory<M>& memory);
/// The state of `t` moved on to the instant at which this tick's torque acts.
template <class M>
using PredictorPart = void (*)(const ControllerConfig<M>& config, const PartMemory<M>& memory,
                               Tracking<M>& t);

namespace part {

/// reaching = "super_twisting", for esmc, esmc_projected and smc.
template <class M>
void super_twisting(const ControllerConfig<M>& config, const Tracking<M>& t, PartMemory<M>& memory,
                    typename M::Channels& acceleration, typename M::Channels& sliding);
/// reaching = "implicit_coupled", for esmc and esmc_projected.
template <class M>
void implicit_coupled(const ControllerConfig<M>& config, const Tracking<M>& t, PartMemory<M>& memory,
                      typename M::Channels& acceleration, typename M::Channels& sliding);
/// disturbance_observer: generalised momentum of the base joints, its bandwidth in the configuration.
template <class M>
void momentum_observer(const ControllerConfig<M>& config, const Tracking<M>& t, PartMemory<M>& memory);
/// predictor = true: the believed mechanism under the torques sent and the disturbance observed, over the
/// told delay.
template <class M>
void predictor(const ControllerConfig<M>& config, const PartMemory<M>& memory, Tracking<M>& t);

}  // namespace part
}  // namespace esmc
