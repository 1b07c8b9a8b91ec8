#include "host_sim/check/margins.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <span>

#include "firmware/cycle/instances.hpp"
#include "host_sim/controller/robust.hpp"
#include "host_sim/design/efforts.hpp"
#include "host_sim/drives/actuators.hpp"
#include "host_sim/error.hpp"
#include "host_sim/record/recorder.hpp"
#include "host_sim/record/run_options.hpp"
#include "host_sim/record/verdict.hpp"
#include "host_sim/turns.hpp"

namespace esmc::host {
namespace {

/// Joint of base joint or motor i of `of`.
template <class M>
std::size_t joint_of(std::size_t i, int of) {
  return static_cast<std::size_t>(ControllerConfig<M>::joint_of(static_cast<int>(i), of));
}

template <class M>
typename M::Pose start_pose(const Scene& scene, const M& m) {
  return m.pose(Vec<double, M::joints>(scene.start_angle.data()));
}

/// With the friction of the plant, and `payload`, kg, at the effector. Dry friction that is regularised is
/// that at the joint rates `rate`, rad/s; empty: of fast joints.
FiveBarParams<double> true_mechanism(const Scene& scene, double payload, std::span<const double> rate = {}) {
  FiveBarParams<double> truth = scene.mechanism;
  JointFriction friction = friction_of(scene.effects).value_or(JointFriction{});
  for (std::size_t i = 0; i < rate.size(); ++i) {
    const double full =
        std::tanh(std::abs(rate[i]) / find_effect<CoulombFriction>(scene.effects)->regularised);
    friction.dry[i] *= full;
    friction.asymmetry[i] *= full * full;
  }
  set_friction(truth, friction);
  return with_payload(truth, scene.type == MechanismType::rr, payload);
}

/// A controller that allocates torques as the scene's does; without a closed loop, of motors without limits.
template <class M>
ControllerConfig<M> allocating_controller(const Scene& scene, const ReferenceBundle<double>& reference) {
  ControllerConfig<M> c;
  if (scene.closed_loop()) {
    c = make_controller<M>(scene, Pacing::lockstep, reference);
    c.torque_limit = c.torque_given();
    return c;
  }
  c.torque_limit.setConstant(std::numeric_limits<double>::infinity());
  c.allocate = allocation_for<M>(scene.all_motors ? Motors::all : Motors::base);
  return c;
}

/// Widens the margins by a pose, its base angles, which count turns, and their rates.
template <class M>
void add_motion(const typename M::Pose& pose, const Vec2<double>& base, const Vec2<double>& rates,
                Margins& to) {
  to.sin_type1 = std::min(to.sin_type1, M::min_abs_sin_type1(pose));
  to.sin_type2 = std::min(to.sin_type2, M::abs_sin_type2(pose));
  to.x.widen(pose.effector.x());
  to.y.widen(pose.effector.y());
  for (std::size_t i = 0; i < 2; ++i) {
    const auto k = static_cast<int>(i);
    to.angle[i].widen(base[k]);
    to.joint_speed[i] = std::max(to.joint_speed[i], std::abs(rates[k]));
  }
}

/// The state at a motion of the reference; empty: out of reach.
template <class M>
std::optional<Desired<M>> desired(const M& m, const typename M::Mode& mode, ReferenceSpace space,
                                  const Motion2<double>& r) {
  return space == ReferenceSpace::effector
             ? desired_at_effector(m, mode, r.position, r.velocity, r.acceleration)
             : desired_at_base(m, mode, r.position, r.velocity, r.acceleration);
}

template <class M>
Vec2<double> start_base(const Scene& scene) {
  return {scene.start_angle[joint_of<M>(0, 2)], scene.start_angle[joint_of<M>(1, 2)]};
}

template <class World>
class Follower {
 public:
  using M = typename World::Mechanism;
  Follower(const Scene& scene, Log& log)
      : scene_(scene),
        log_(log),
        bundle_(make_reference(scene, Pacing::lockstep)),
        controller_(allocating_controller<M>(scene, bundle_)),
        reference_(bundle_.get()) {
    controller_.mechanism = M(params_of<M>(true_mechanism(scene, 0.0)));
    if (payload_) loaded_ = M(params_of<M>(true_mechanism(scene, payload_->mass)));
    if (reference_.kind == ReferenceKind::hold_start)
      reference_.centre = start_pose(scene, controller_.mechanism).effector;
    out_.together = controller_.allocate != nullptr;
    out_.torque.assign(static_cast<std::size_t>(scene.motors()), 0.0);
    out_.drive_short = out_.torque;
    for (std::size_t i = 0; i < out_.torque.size(); ++i)
      out_.torque_limit.push_back(controller_.torque_limit[static_cast<int>(joint_of<M>(i, scene.motors()))]);
    drive_.assign(out_.torque.size(), TorqueStage(scene.effects));
    if (const auto gear = find_effect<JointFlexibility>(scene.effects)) {
      rotor_.assign(gear->rotor_inertia.begin(), gear->rotor_inertia.begin() + scene.motors());
    } else if (const auto play = find_effect<Backlash>(scene.effects)) {
      rotor_.assign(out_.torque.size(), play->rotor_inertia);
    }
    for (const double asked : scene.preload) out_.preload.push_back(std::abs(asked));
    out_.preload_t.assign(out_.preload.size(), 0.0);
  }

  Margins run() {
    const M& m = controller_.mechanism;
    const typename M::Mode mode = mode_of<M>(scene_);
    const std::uint32_t ticks = std::min<std::uint32_t>(tick_count(scene_), 2'000'000U);
    for (std::uint32_t n = 0; n < ticks; ++n) {
      if (stop_requested()) throw Interrupted("interrupted");
      const double t = n * scene_.tick();
      const Motion2<double> r = reference_.at(n, scene_.tick());
      const auto d = desired<M>(m, mode, reference_.space, r);
      if (!d) {
        out_.unreachable = fmt::format("the reference leaves the reach of the mechanism at t = {:.3f} s", t);
        break;
      }
      if (n == 0) add_start(mode, r, *d);
      for (int i = 0; i < 2; ++i) base_[i] = nearest_turn(M::base_angles(d->pose)[i], base_[i]);
      add_motion<M>(d->pose, base_, M::base(d->rates), out_);
      row_ = {t, d->pose.effector.x(), d->pose.effector.y(), base_[0], base_[1]};
      add_jump(n, r);
      add_torques(n, d->pose, forces(t, d->pose, d->rates, d->acceleration));
      row_.push_back(M::min_abs_sin_type1(d->pose));
      if (scene_.type == MechanismType::five_bar) row_.push_back(M::abs_sin_type2(d->pose));
      if (log_.wanted()) log_.row(row_, "");
    }
    judge_way();
    return out_;
  }

 private:
  /// Forces on every channel, of all that acts on the mechanism or has to be moved.
  typename M::Channels forces(double t, const typename M::Pose& pose, const typename M::Rates& rates,
                              const typename M::Rates& acceleration) const {
    const bool carries = payload_ && t >= payload_->from && t < payload_->to;
    M m = carries ? loaded_ : controller_.mechanism;
    if (rounded_) {
      const Vec<double, M::joints> rate = joints_of<M>(rates);
      m = M(params_of<M>(true_mechanism(scene_, carries ? payload_->mass : 0.0, {rate.data(), M::joints})));
    }
    typename M::Channels a = m.channel_accelerations(pose, rates, acceleration);
    m.add_rotors(a);
    typename M::Channels w = m.force(a, rates);
    if constexpr (!M::has_type2) {
      // The payload moves the mass centre of the arm's bar, where the forces of its rows act.
      const Vec2<double> torque = m.base_torque(pose, w);
      if (carries) w << torque, Vec<double, M::channels - 2>::Zero();
    }
    constexpr int first = M::has_type2 ? 2 : 0, legs = M::joints / 2, rows = (M::channels - first) / legs;
    const Vec<double, M::joints> joint = joints_of<M>(acceleration);
    for (std::size_t i = 0; i < rotor_.size(); ++i) {
      const auto j = static_cast<int>(scene_.motor_joints()[i]);
      w[first + j / 2 * rows + j % 2] += rotor_[i] * joint[j];
    }
    for (const Effect& e : scene_.effects) {
      const auto* f = std::get_if<ExternalForce>(&e);
      if (f == nullptr || t < f->from || t >= f->to) continue;
      const Vec2<double> v = m.tip_rate(pose, rates);
      Vec2<double> force(f->force[0], f->force[1]);
      if (f->human)
        force = (Vec2<double>(f->anchor[0], f->anchor[1]) - pose.effector) * f->stiffness - v * f->damping;
      if constexpr (M::has_type2) {
        w.template head<2>() -= force;
      } else {  // J^T of the force, column by column
        for (int i = 0; i < 2; ++i) w[i] -= m.tip_rate(pose, Vec2<double>::Unit(i)).dot(force);
      }
    }
    return w;
  }

  /// Where the scene starts from, and how much of the torque it takes to accelerate there.
  void add_start(const typename M::Mode& mode, const Motion2<double>& r, const Desired<M>& d) {
    const M& m = controller_.mechanism;
    out_.start_off = (start_pose(scene_, m).effector - d.pose.effector).norm();
    out_.start_speed = m.tip_rate(d.pose, d.rates).norm();
    const auto force = [&](double acceleration) {
      const Vec2<double> still = Vec2<double>::Zero(),
                         a = Vec2<double>::Constant(acceleration / std::sqrt(2.0));
      const auto at = desired<M>(m, mode, reference_.space, {r.position, still, a});
      return forces(0.0, d.pose, at ? at->rates : d.rates, at ? at->acceleration : d.acceleration);
    };
    const typename M::Channels w = force(1.0) - force(0.0);
    unit_share_ = design::share_of_limits(controller_, d.pose, w, design::effort(controller_, d.pose, w));
  }

  /// What the torque that the reference leaves does to speeds, and whether the start is too far off for it.
  void judge_way() {
    if (!(unit_share_ > 0.0)) return;
    constexpr double quick = 0.1;  // s: a law is on the reference again before it counts
    const LegParams<double>& leg = scene_.mechanism.legs[0];
    const double reach = leg.l1 + leg.l2, acceleration = std::max(0.0, 1.0 - out_.share) / unit_share_;
    const bool at_effector = reference_.space == ReferenceSpace::effector;
    out_.tick_speed = std::min(acceleration * scene_.tick(),
                               0.1 * scene_.limits.joint_speed * (at_effector ? leg.l1 : 1.0));
    // From rest to rest in the shortest time: half of it each way.
    const double jump = 2.0 * std::sqrt(out_.start_off / (acceleration * (at_effector ? 1.0 : reach)));
    out_.off_reference = scene_.reference.join.value_or(0.0) == 0.0 && jump > quick &&
                         out_.start_off > std::max(error_share * out_.path(), 0.01 * reach);
  }

  /// A jump of position or speed between two ticks is what their mean speed and mean acceleration leave over.
  void add_jump(std::uint32_t n, const Motion2<double>& now) {
    const double tick = scene_.tick();
    out_.speed_max = std::max(out_.speed_max, now.velocity.norm());
    acceleration_max_ = std::max(acceleration_max_, now.acceleration.norm());
    if (n > 0) {
      const double v =
          (now.velocity - last_.velocity - (now.acceleration + last_.acceleration) * (0.5 * tick)).norm();
      const double x =
          (now.position - last_.position - (now.velocity + last_.velocity) * (0.5 * tick)).norm();
      if (v > 2.0 * tick * acceleration_max_ && v > out_.speed_jump) {
        out_.speed_jump = v;
        out_.jump_t = n * tick;
      }
      out_.position_jump = std::max(out_.position_jump, x > 2.0 * tick * out_.speed_max ? x : 0.0);
    }
    last_ = now;
  }

  /// `w`: force on every channel.
  void add_torques(std::uint32_t n, const typename M::Pose& pose, const typename M::Channels& w) {
    const double t = n * scene_.tick();
    const auto effort = design::effort(controller_, pose, w);
    const double share = design::share_of_limits(controller_, pose, w, effort);
    const bool most = !(share <= out_.share);
    if (most) {
      out_.share = share;
      out_.share_t = t;
      out_.share_torque.clear();
    }
    bool short_of = !(share <= 1.0);
    for (std::size_t i = 0; i < out_.torque.size(); ++i) {
      const double torque = effort.torque[static_cast<int>(joint_of<M>(i, scene_.motors()))];
      out_.torque[i] = std::max(out_.torque[i], std::abs(torque));
      row_.push_back(torque);
      if (most) out_.share_torque.push_back(torque);
      bool clipped = false;
      const auto joint = static_cast<int>(joint_of<M>(i, scene_.motors()));
      const auto& map = controller_.motor_map;
      const double asked = (torque + std::copysign(map.amplitude[joint], torque)) / map.factor[joint];
      (void)drive_[i](asked, scene_.tick(), clipped);
      if (clipped) out_.drive_short[i] = std::max(out_.drive_short[i], std::abs(torque));
      short_of = short_of || clipped;
      if (i >= out_.preload.size() || scene_.preload[i] == 0.0) continue;
      const double towards = std::copysign(1.0, scene_.preload[i]) * torque;
      if (!(towards < out_.preload[i])) continue;
      out_.preload[i] = towards;
      out_.preload_t[i] = t;
    }
    out_.short_ticks += short_of ? 1 : 0;
    ++out_.ticks;
    if (scene_.law != LawChoice::pd) return;
    Vec2<double> sag;  // of the base joints: what makes kp give the torque
    for (int i = 0; i < 2; ++i) {
      const auto joint = ControllerConfig<M>::joint_of(i, 2);
      sag[i] = effort.torque[joint] / controller_.gains.independent.kp;
    }
    const M& m = controller_.mechanism;
    out_.sag = std::max(out_.sag, m.tip_rate(pose, m.base_rates(pose, sag)).norm());
  }

  const Scene& scene_;
  Log& log_;
  Vec2<double> base_ = start_base<M>(scene_);
  ReferenceBundle<double> bundle_;
  ControllerConfig<M> controller_;
  Reference<double> reference_;
  std::optional<Payload> payload_ = find_effect<Payload>(scene_.effects);
  bool rounded_ = find_effect<CoulombFriction>(scene_.effects).value_or(CoulombFriction{}).regularised > 0.0;
  M loaded_;                        // with the payload
  std::vector<double> rotor_;       // inertia per motor, kg m2 at the joint
  std::vector<TorqueStage> drive_;  // per motor
  Motion2<double> last_;
  double acceleration_max_ = 0.0;
  double unit_share_ = 0.0;  // of the torque limits, for an acceleration of 1 where the scene starts
  Margins out_;
  std::vector<double> row_;
};

}  // namespace

std::optional<Moment> moment_at(const Scene& scene, std::uint32_t tick, double least) {
  return with_world(scene, [&]<class World>(World) -> std::optional<Moment> {
    using M = typename World::Mechanism;
    const M m(params_of<M>(scene.mechanism));
    const auto bundle = make_reference(scene, Pacing::lockstep);
    Reference<double> reference = bundle.get();
    if (reference.kind == ReferenceKind::hold_start) reference.centre = start_pose(scene, m).effector;
    Motion2<double> r = reference.at(tick, scene.tick());
    if (r.velocity.norm() < least) r.velocity.setConstant(least / std::sqrt(2.0));
    const auto d = desired(m, mode_of<M>(scene), reference.space, r);
    if (!d) return std::nullopt;
    const Vec<double, M::joints> angle = M::angles(d->pose), rate = joints_of<M>(d->rates);
    return Moment{tick, {angle.begin(), angle.end()}, {rate.begin(), rate.end()}};
  });
}

Margins start_margins(const Scene& scene) {
  return with_world(scene, [&]<class World>(World) {
    using M = typename World::Mechanism;
    const Vec2<double> rates(scene.start_rate[joint_of<M>(0, 2)], scene.start_rate[joint_of<M>(1, 2)]);
    Margins out;
    add_motion<M>(start_pose(scene, M(params_of<M>(scene.mechanism))), start_base<M>(scene), rates, out);
    return out;
  });
}

std::vector<std::string> check_columns(const Scene& scene) {
  return with_world(scene, [&]<class World>(World) {
    using M = typename World::Mechanism;
    std::vector<std::string> c{"t", "x_ref", "y_ref"};
    for (std::size_t i = 0; i < 2; ++i)
      c.push_back(World::joint_names[joint_of<M>(i, 2)] + std::string("_ref"));
    for (std::size_t i = 0; i < static_cast<std::size_t>(scene.motors()); ++i)
      c.emplace_back(World::torque_names[joint_of<M>(i, scene.motors())]);
    c.emplace_back("min_abs_sin_type1");
    if (scene.type == MechanismType::five_bar) c.emplace_back("abs_D2");
    return c;
  });
}

Margins margins(const Scene& scene, Log& log) {
  if (scene.reference.type != ReferenceType::none)
    return with_world(scene, [&]<class World>(World) { return Follower<World>(scene, log).run(); });
  Margins none;
  none.torque.assign(static_cast<std::size_t>(scene.motors()), 0.0);
  return none;
}

}  // namespace esmc::host
