#pragma once
/// Turns ticks into log rows and statistics: motion, reference, and the tick of a controller in this process.

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "host_sim/controller/controller_config.hpp"
#include "host_sim/error.hpp"
#include "host_sim/plant/motion.hpp"
#include "host_sim/record/log.hpp"
#include "host_sim/record/summary.hpp"
#include "host_sim/turns.hpp"

namespace esmc::host {

/// Plant and controller model of the same mechanism.
struct FiveBarTraits {
  using Plant = FiveBarPlant;
  using Mechanism = FiveBar<double>;
  using SinglePrecision = FiveBar<float>;
  static Plant plant(const Scene& s, double payload = 0.0) { return Plant(s.mechanism, payload); }
  static constexpr const char* joint_names[] = {"theta11", "theta12", "theta21", "theta22"};
  static constexpr const char* torque_names[] = {"tau11", "tau12", "tau21", "tau22"};
  static constexpr const char* channel_names[] = {
      "x",    "y",       "theta11", "theta12", "phi11", "phi12", "Xg11", "Yg11", "Xg12",
      "Yg12", "theta21", "theta22", "phi21",   "phi22", "Xg21",  "Yg21", "Xg22", "Yg22"};
  static double angle(const Plant::Output& o, int joint) { return o.q[static_cast<std::size_t>(joint) + 2]; }
  static double rate(const Plant::Output& o, int joint) { return o.qd[static_cast<std::size_t>(joint) + 2]; }
};
struct RrTraits {
  using Plant = RrPlant;
  using Mechanism = Rr<double>;
  using SinglePrecision = Rr<float>;
  static Plant plant(const Scene& s, double payload = 0.0) { return Plant(s.arm(), payload); }
  static constexpr const char* joint_names[] = {"theta1", "theta2"};
  static constexpr const char* torque_names[] = {"tau1", "tau2"};
  static constexpr const char* channel_names[] = {"theta1", "theta2", "phi1", "phi2",
                                                  "Xg1",    "Yg1",    "Xg2",  "Yg2"};
  static double angle(const Plant::Output& o, int joint) { return o.q[static_cast<std::size_t>(joint)]; }
  static double rate(const Plant::Output& o, int joint) { return o.qd[static_cast<std::size_t>(joint)]; }
};

/// Calls f with FiveBarTraits or RrTraits, by the mechanism of a scene.
template <class F>
auto with_world(const Scene& s, const F& f) {
  return s.type == MechanismType::five_bar ? f(FiveBarTraits()) : f(RrTraits());
}

/// The plant of a scene in a state, with its effects as at t = 0. `hand`, which outlives the motion,
/// may pull at the effector; null: none.
template <class World>
Motion<typename World::Plant> make_motion(const Scene& s, const typename World::Plant::State& state,
                                          const Hand* hand = nullptr) {
  const auto payload = find_effect<Payload>(s.effects);
  return Motion<typename World::Plant>({World::plant(s), World::plant(s, payload ? payload->mass : 0.0),
                                        s.effects, s.motor_joints(), s.method, s.resolution, hand},
                                       state);
}
/// State of the plant of a scene at t = 0.
template <class World>
typename World::Plant::State initial_state(const Scene& s) {
  typename World::Plant::Joints angle{}, rate{};
  std::copy_n(s.start_angle.begin(), angle.size(), angle.begin());
  std::copy_n(s.start_rate.begin(), rate.size(), rate.begin());
  return World::Plant::from_joints(angle, rate);
}
/// The plant of a scene at t = 0, with its effects.
template <class World>
Motion<typename World::Plant> make_motion(const Scene& s) {
  return make_motion<World>(s, initial_state<World>(s));
}

/// Sets the supervisor's part of the end of a run: state and faults.
/// `seen`: the fault as the loop saw it.
inline void set_outcome(RunEnd& e, const Supervisor& supervisor, const std::optional<FaultRecord>& seen) {
  e.final_state = name(supervisor.state());
  e.faults.clear();
  if (supervisor.fault() == Fault::none) return;
  const FaultRecord plain{.name = name(supervisor.fault())};
  e.faults.push_back(seen && seen->name == plain.name ? *seen : plain);
}
/// The sliding variables of a configuration; none where its law has none.
template <class World, class C>
std::vector<Surface> surfaces_of(const Scene& scene, const ControllerConfig<C>& c) {
  std::vector<Surface> out;
  const bool independent = scene.law == LawChoice::smc,
             layered =
                 scene.reaching != ReachingChoice::sign && scene.reaching != ReachingChoice::super_twisting;
  for (int i = 0; i < (independent ? 2 : C::channels) && scene.sliding(); ++i) {
    const auto& own = c.gains.independent;
    out.push_back({World::channel_names[i],
                   static_cast<double>(scene.law == LawChoice::esmc ? c.gains.lambda[i] : own.lambda),
                   layered ? static_cast<double>(independent ? own.layer : c.gains.layer[i]) : 0.0});
  }
  return out;
}
/// Sets coordinates, rates and method of the end of a run; the energy error goes to `statistics`.
template <class Plant>
void set_final_state(RunEnd& e, Motion<Plant>& motion, Statistics& statistics) {
  const typename Plant::Output o = motion.output();
  e.q.assign(o.q.begin(), o.q.end());
  e.qd.assign(o.qd.begin(), o.qd.end());
  e.method = motion.method();
  e.effort = motion.effort();
  statistics.energy_error = larger(statistics.energy_error, motion.energy_error());
}

/// The reference as the true mechanism would have to follow it, tick by tick.
template <class World>
class ReferenceTrack {
 public:
  using M = typename World::Mechanism;
  struct Point {
    V2 effector;
    std::array<double, 2> base;
  };

  /// `begins`: its beginning is known; not for a plant whose controller, elsewhere, tests signs first.
  ReferenceTrack(const Scene& scene, Pacing pacing, bool begins = true)
      : bundle_(std::make_unique<ReferenceBundle<double>>(make_reference(scene, pacing))),
        present_(begins && scene.reference.type != ReferenceType::none),
        mechanism_(params_of<M>(scene.mechanism)),
        mode_(mode_of<M>(scene)),
        joined_(bundle_->get(), bundle_->join_ticks, scene.tick()),
        same_(bundle_->join_ticks == 0 && bundle_->get().kind != ReferenceKind::hold_start &&
              !scene.predictor),
        true_lengths_(same_lengths(believed_mechanism(scene), scene.mechanism)) {}

  [[nodiscard]] bool at_effector() const { return joined_.reference().space == ReferenceSpace::effector; }
  [[nodiscard]] bool present() const { return present_; }  ///< there is one, and its beginning is known
  [[nodiscard]] const ReferenceBundle<double>& bundle() const { return *bundle_; }
  /// Makes Point::base 0 from now on, for good.
  void without_base() { with_base_ = false; }
  /// Whether a missing point at this tick is an error of the scene, not of the join.
  [[nodiscard]] bool must_reach(std::uint32_t tick) const {
    return tick >= bundle_->join_ticks && joined_.reference().kind != ReferenceKind::hold_start;
  }

  /// Sets the state of the mechanism at t = 0: m and m/s, rad and rad/s. Call before at().
  void start(V2 effector, V2 velocity, const std::array<double, 2>& base, const std::array<double, 2>& rate) {
    joined_.start(at_effector() ? Vec2<double>(effector.x, effector.y) : Vec2<double>(base[0], base[1]),
                  at_effector() ? Vec2<double>(velocity.x, velocity.y) : Vec2<double>(rate[0], rate[1]));
  }
  /// Returns the reference at a tick. Empty: out of reach. `solved`: a controller's tick, whose inverse
  /// kinematics of the same point with the true lengths is reused.
  [[nodiscard]] std::optional<Point> at(std::uint32_t tick, const TickResult<M>* solved = nullptr) const {
    const bool followed =
        solved != nullptr && true_lengths_ && at_effector() && solved->state == State::running;
    if (same_ && followed && solved->running_tick == tick) {
      const Vec2<double> base = with_base_ ? solved->desired_base() : Vec2<double>(0, 0);
      return Point{{solved->desired_effector.x(), solved->desired_effector.y()}, {base[0], base[1]}};
    }
    const Motion2<double> m = joined_.at(tick);
    if (at_effector()) {
      if (followed && solved->desired_effector == m.position) {
        const Vec2<double> base = with_base_ ? solved->desired_base() : Vec2<double>(0, 0);
        return Point{{m.position.x(), m.position.y()}, {base[0], base[1]}};
      }
      const auto pose = mechanism_.inverse(m.position, mode_);
      if (!pose) return std::nullopt;
      const Vec2<double> base = with_base_ ? M::base_angles(*pose) : Vec2<double>(0, 0);
      return Point{{m.position.x(), m.position.y()}, {base[0], base[1]}};
    }
    const auto e = estimate_from_base(mechanism_, mode_, m.position, m.velocity);
    if (!e) return std::nullopt;
    return Point{{e->pose.effector.x(), e->pose.effector.y()}, {m.position[0], m.position[1]}};
  }

 private:
  std::unique_ptr<ReferenceBundle<double>> bundle_;  // its path must not move
  bool present_;
  M mechanism_;
  typename M::Mode mode_;
  JoinedReference<double> joined_;
  bool same_;          // the controller's reference does not depend on its measured start
  bool true_lengths_;  // the controller believes the true lengths
  bool with_base_ = true;
};

/// The controller's tick; null pointers where it runs elsewhere.
template <class M>
struct ControllerView {
  const TickResult<M>* result = nullptr;
  const Sample<M>* sample = nullptr;
  bool exact = true;  ///< false: rounded to single precision, the reference included
};

template <class World>
class Recorder {
 public:
  using Plant = typename World::Plant;
  using M = typename World::Mechanism;

  /// `scene` must outlive this. `log`: closed by this, null: none. `with_controller`: tick() gets its view.
  Recorder(const Scene& scene, Pacing pacing, const LogSink& log, bool with_controller)
      : scene_(scene),
        track_(scene, pacing, with_controller || !scene.drives.sign_test.value_or(false)),
        with_controller_(with_controller),
        log_(log, columns(), tick_count(scene)),
        torque_(static_cast<std::size_t>(scene.motors())) {}

  [[nodiscard]] ReferenceTrack<World>& track() { return track_; }
  [[nodiscard]] Statistics& statistics() { return statistics_; }
  [[nodiscard]] Log& log() { return log_; }
  void without_digest() { digest_ = false; }  ///< for the rest of the run
  /// Leaves out the errors of the base joints from now on, for good.
  void without_base_errors() {
    base_errors_ = false;
    track_.without_base();
  }
  /// Whether the reference, once joined, has left the reach of the true mechanism in any tick so far.
  [[nodiscard]] bool reference_left() const { return reference_left_; }

  /// Records a tick that begins in the plant's present state, under `torque` (N m per joint) until the next.
  /// `disarmed`: a drive has left closed loop; counts where the supervisor is not seen. Throws Diverged where
  /// the state is not finite.
  void tick(std::uint32_t n, Motion<Plant>& motion, const typename Plant::Joints& torque, bool saturated,
            const ControllerView<M>& seen, bool disarmed = false) {
    const typename Plant::Output o = motion.output();
    const std::span<const double> q(o.q), qd(o.qd);
    constexpr std::size_t half = Plant::outputs / 2;
    const auto add_to_digest = [&](std::span<const double> values) {
      if (digest_) statistics_.digest.add(values);
    };
    add_to_digest(q.first(half));
    require_finite(q, n * scene_.tick());
    require_finite(qd, n * scene_.tick());
    const V2 x = o.effector;
    if (seen.result != nullptr && seen.result->state == State::testing) begin_ = n + 1;
    if (n == begin_) {
      track_.start(x, o.effector_rate, {World::angle(o, 0), World::angle(o, M::joints / 2)},
                   {World::rate(o, 0), World::rate(o, M::joints / 2)});
    }
    TickRecord r;
    r.t = n * scene_.tick();
    for (std::size_t i = 0; i < torque_.size(); ++i) {
      const std::size_t j = joint(static_cast<int>(i));
      torque_[i] = torque[j];
      r.power += std::abs(torque[j] * World::rate(o, static_cast<int>(j)));
    }
    r.torque = torque_;
    r.saturated = saturated || (seen.result != nullptr && seen.result->saturated);
    r.faulted = seen.result != nullptr ? seen.result->fault != Fault::none : disarmed;
    add_to_digest(q.subspan(half));
    const bool led = track_.present() && n >= begin_;
    const auto reference = led ? track_.at(n - begin_, seen.exact ? seen.result : nullptr) : std::nullopt;
    r.has_reference = reference.has_value();
    if (reference) r.reference = {reference->effector.x, reference->effector.y};
    reference_left_ = reference_left_ || (led && !reference && track_.must_reach(n - begin_));
    add_to_digest(qd.first(half));
    if (reference) {
      const V2 miss = x - reference->effector;
      r.effector_error = std::sqrt(dot(miss, miss));
      for (int i = 0; i < 2 && base_errors_; ++i) {
        const auto u = static_cast<std::size_t>(i);
        r.base_error[u] = wrap_to_pi(World::angle(o, i * M::joints / 2) - reference->base[u]);
      }
    }
    add_to_digest(qd.subspan(half));
    statistics_.add(r);
    statistics_.closure_max = larger(statistics_.closure_max, o.closure);
    if (n % energy_stride == 0)
      statistics_.energy_error = larger(statistics_.energy_error, motion.energy_error());
    if (log_.wanted()) write(r, o, x, reference, seen);
  }

 private:
  static constexpr std::uint32_t energy_stride = 16;  // the balance drifts slowly; every tick would cost 5 %
  static constexpr double none = std::numeric_limits<double>::quiet_NaN();

  [[nodiscard]] std::size_t joint(int motor) const {
    return static_cast<std::size_t>(ControllerConfig<M>::joint_of(motor, scene_.motors()));
  }
  [[nodiscard]] int sensor_joint(int i) const {
    return ControllerConfig<M>::joint_of(i, scene_.all_sensors ? M::joints : 2);
  }

  [[nodiscard]] std::vector<std::string> columns() const {
    std::vector<std::string> c{"t", "x", "y"};
    const auto joints = static_cast<std::size_t>(M::joints);
    for (std::size_t i = 0; i < joints; ++i) c.emplace_back(World::joint_names[i]);
    for (int i = 0; i < scene_.motors(); ++i) c.emplace_back(World::torque_names[joint(i)]);
    c.insert(c.end(), {"x_ref", "y_ref"});
    for (int i = 0; i < 2; ++i) c.push_back(base_name(i) + "_ref");
    if (Plant::outputs == 6) c.insert(c.end(), {"xd", "yd"});
    for (std::size_t i = 0; i < joints; ++i) c.push_back(std::string(World::joint_names[i]) + "_rate");
    if (!with_controller_) return c;
    for (const char* name : World::channel_names) c.push_back(std::string("s_") + name);
    for (int i = 0; i < sensors(); ++i) {
      const std::string name = World::joint_names[static_cast<std::size_t>(sensor_joint(i))];
      c.push_back(name + "_meas");
      c.push_back(name + "_rate_meas");
    }
    for (int i = 0; i < scene_.motors(); ++i)
      c.push_back(std::string(World::torque_names[joint(i)]) + "_cmd");
    c.emplace_back("state");
    return c;
  }
  [[nodiscard]] int sensors() const { return scene_.all_sensors ? M::joints : 2; }
  static std::string base_name(int i) {
    return World::joint_names[static_cast<std::size_t>(i * M::joints / 2)];
  }

  void write(const TickRecord& r, const typename Plant::Output& o, V2 x,
             const std::optional<typename ReferenceTrack<World>::Point>& reference,
             const ControllerView<M>& seen) {
    row_.assign({r.t, x.x, x.y});
    for (int i = 0; i < M::joints; ++i) row_.push_back(World::angle(o, i));
    row_.insert(row_.end(), r.torque.begin(), r.torque.end());
    row_.push_back(reference ? reference->effector.x : none);
    row_.push_back(reference ? reference->effector.y : none);
    for (std::size_t i = 0; i < 2; ++i) {  // on the turn on which the joint is
      const double base = reference ? reference->base[i] : none;
      const double joint = World::angle(o, static_cast<int>(i) * M::joints / 2);
      row_.push_back(std::isfinite(joint) ? nearest_turn(base, joint) : base);
    }
    if (Plant::outputs == 6) row_.insert(row_.end(), {o.qd[0], o.qd[1]});
    for (int i = 0; i < M::joints; ++i) row_.push_back(World::rate(o, i));
    const char* state = "";
    if (with_controller_) {
      for (int i = 0; i < M::channels; ++i) row_.push_back(seen.result->sliding[i]);
      for (int i = 0; i < sensors(); ++i) {
        row_.push_back(seen.sample->angle[sensor_joint(i)]);
        row_.push_back(seen.sample->rate[sensor_joint(i)]);
      }
      for (int i = 0; i < scene_.motors(); ++i)
        row_.push_back(seen.result->torque[static_cast<int>(joint(i))]);
      state = name(seen.result->state);
    }
    log_.row(row_, state);
  }

  const Scene& scene_;
  ReferenceTrack<World> track_;
  std::uint32_t begin_ = 0;  // of the reference: after the sign test
  bool with_controller_, digest_ = true, base_errors_ = true, reference_left_ = false;
  Log log_;
  Statistics statistics_;
  std::vector<double> torque_, row_;
};

/// Throws InputError where the reference leaves the true mechanism's reach in the first 2e6 ticks of the run.
template <class World>
void require_reachable(const Scene& scene, Pacing pacing) {
  if (scene.reference.type == ReferenceType::none) return;
  ReferenceTrack<World> track(scene, pacing);
  const auto q = scene.start_angle;
  const std::size_t half = q.size() / 2;
  constexpr std::uint32_t checked =
      2'000'000;  // longer runs repeat themselves or are caught by the supervisor
  track.start({}, {}, {q[0], q[half == 2 ? 2 : 1]}, {0.0, 0.0});
  if (scene.reference.type == ReferenceType::hold && !scene.reference.position) return;
  for (std::uint32_t n = track.bundle().join_ticks; n < std::min(tick_count(scene), checked); ++n) {
    if (!track.at(n)) {
      throw InputError(scene.reference_where, "the reference leaves the reach of the mechanism at t = " +
                                                  fmt::format("{:.3f} s", n * scene.tick()));
    }
  }
}

}  // namespace esmc::host
