#include "host_sim/check/check.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "firmware/cycle/instances.hpp"
#include "host_sim/controller/robust.hpp"
#include "host_sim/design/efforts.hpp"
#include "host_sim/error.hpp"
#include "host_sim/record/recorder.hpp"
#include "host_sim/record/run_options.hpp"

namespace esmc::host {
namespace {

/// Joint of base joint or motor i of `of`.
template <class M>
std::size_t joint_of(std::size_t i, int of) {
  return static_cast<std::size_t>(ControllerConfig<M>::joint_of(static_cast<int>(i), of));
}

template <class M>
typename M::Pose start_pose(const Scene& scene, const M& m) {
  Vec<double, M::joints> q;
  for (int i = 0; i < M::joints; ++i) q[i] = scene.start_angle[static_cast<std::size_t>(i)];
  return m.pose(q);
}

/// With the viscous friction of the plant.
FiveBarParams<double> true_mechanism(const Scene& scene) {
  FiveBarParams<double> truth = scene.mechanism;
  if (const auto f = find_effect<ViscousFriction>(scene.effects)) {
    for (std::size_t j = 0; j < 2; ++j) {
      truth.legs[j].d1 = f->coefficient[2 * j];
      truth.legs[j].d2 = f->coefficient[2 * j + 1];
    }
  }
  return truth;
}

/// A controller that allocates torques as the scene's does; without a closed loop, of motors without limits.
template <class M>
ControllerConfig<M> allocating_controller(const Scene& scene, const ReferenceBundle<double>& reference) {
  if (scene.closed_loop()) return make_controller<M>(scene, Pacing::lockstep, reference);
  ControllerConfig<M> c;
  c.torque_limit.setConstant(std::numeric_limits<double>::infinity());
  c.allocate = allocation_for<M>(scene.all_motors ? Motors::all : Motors::base);
  return c;
}

/// Widens the margins by a pose and the rates of the base joints.
template <class M>
void add_motion(const typename M::Pose& pose, const Vec2<double>& rates, Margins& to) {
  to.sin_type1 = std::min(to.sin_type1, M::min_abs_sin_type1(pose));
  to.sin_type2 = std::min(to.sin_type2, M::abs_sin_type2(pose));
  to.x.widen(pose.effector.x());
  to.y.widen(pose.effector.y());
  for (std::size_t i = 0; i < 2; ++i) {
    const auto k = static_cast<int>(i);
    to.angle[i].widen(M::base_angles(pose)[k]);
    to.joint_speed[i] = std::max(to.joint_speed[i], std::abs(rates[k]));
  }
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
    controller_.mechanism = make_mechanism(true_mechanism(scene), static_cast<M*>(nullptr));
    if (reference_.kind == ReferenceKind::hold_start)
      reference_.centre = start_pose(scene, controller_.mechanism).effector;
    out_.together = controller_.allocate != nullptr;
    out_.torque.assign(static_cast<std::size_t>(scene.motors()), 0.0);
    for (const double asked : scene.preload) out_.preload.push_back(std::abs(asked));
    out_.preload_t.assign(out_.preload.size(), 0.0);
  }

  Margins run() {
    const M& m = controller_.mechanism;
    const typename M::Mode mode = mode_of(scene_, static_cast<M*>(nullptr));
    const std::uint32_t ticks = std::min<std::uint32_t>(tick_count(scene_), 2'000'000U);
    for (std::uint32_t n = 0; n < ticks; ++n) {
      if (stop_requested()) throw RunError("interrupted");
      const double t = n * scene_.tick();
      const Motion2<double> r = reference_.at(n, scene_.tick());
      const auto d = reference_.space == ReferenceSpace::effector
                         ? desired_at_effector(m, mode, r.position, r.velocity, r.acceleration)
                         : desired_at_base(m, mode, r.position, r.velocity, r.acceleration);
      if (!d) {
        out_.unreachable = fmt::format("the reference leaves the reach of the mechanism at t = {:.3f} s", t);
        break;
      }
      add_motion<M>(d->pose, M::base(d->rates), out_);
      row_ = {t, d->pose.effector.x(), d->pose.effector.y()};
      for (int i = 0; i < 2; ++i) row_.push_back(M::base_angles(d->pose)[i]);
      add_torques(t, d->pose, m.force(m.channel_accelerations(d->pose, d->rates, d->acceleration), d->rates));
      row_.push_back(M::min_abs_sin_type1(d->pose));
      if (scene_.type == MechanismType::five_bar) row_.push_back(M::abs_sin_type2(d->pose));
      if (log_.wanted()) log_.row(row_, "");
    }
    return out_;
  }

 private:
  /// `w`: force on every channel.
  void add_torques(double t, const typename M::Pose& pose, const typename M::Channels& w) {
    const auto effort = design::effort(controller_, pose, w);
    const double share = design::share_of_limits(controller_, pose, w, effort);
    const bool most = !(share <= out_.share);
    if (most) {
      out_.share = share;
      out_.share_t = t;
      out_.share_torque.clear();
    }
    for (std::size_t i = 0; i < out_.torque.size(); ++i) {
      const double torque = effort.torque[static_cast<int>(joint_of<M>(i, scene_.motors()))];
      out_.torque[i] = std::max(out_.torque[i], std::abs(torque));
      row_.push_back(torque);
      if (most) out_.share_torque.push_back(torque);
      if (i >= out_.preload.size() || scene_.preload[i] == 0.0) continue;
      const double towards = std::copysign(1.0, scene_.preload[i]) * torque;
      if (!(towards < out_.preload[i])) continue;
      out_.preload[i] = towards;
      out_.preload_t[i] = t;
    }
  }

  const Scene& scene_;
  Log& log_;
  ReferenceBundle<double> bundle_;
  ControllerConfig<M> controller_;
  Reference<double> reference_;
  Margins out_;
  std::vector<double> row_;
};

}  // namespace

Margins start_margins(const Scene& scene) {
  return with_world(scene, [&]<class World>(World) {
    using M = typename World::Mechanism;
    const Vec2<double> rates(scene.start_rate[joint_of<M>(0, 2)], scene.start_rate[joint_of<M>(1, 2)]);
    Margins out;
    add_motion<M>(start_pose(scene, make_mechanism(scene.mechanism, static_cast<M*>(nullptr))), rates, out);
    for (std::size_t i = 0; i < 2; ++i) {  // not wrapped, as they are measured
      const double angle = scene.start_angle[joint_of<M>(i, 2)];
      out.angle[i] = {angle, angle};
    }
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
