#pragma once
/// A plant whose non-smooth parts are in a mode: smooth between two events, which guards announce.
///
///   joint with dry friction   slips one way, or is held (rate exactly zero)
///   stop                      open, or in contact; a rigid one then holds its joint, one way
///   gear with play            which flank presses
///
/// What holds a joint: reactions.hpp. Friction allows +-T, a rigid stop one side without bound, both at once
/// both. A soft stop that returns restitution^2 of its energy is a spring of the mean stiffness and friction
/// that grows with the depth.

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "host_sim/plant/reactions.hpp"
#include "host_sim/plant/system.hpp"

namespace esmc::host {

template <class Plant>
class EventSystem : public LoadedSystem<Plant> {
 public:
  using Base = LoadedSystem<Plant>;
  using MechanismBase = typename Base::Base;
  using typename Base::Angles, typename Base::Joints, typename Base::State;
  static constexpr auto joints = static_cast<std::size_t>(Plant::joints);

  /// `attached` without the end stops' loads; its flanks are set here. Impacts below `rebound_min`, m or rad
  /// of bounce, are taken for the last.
  EventSystem(const Plant& plant, Attachments& attached, const std::vector<Effect>& effects,
              double rebound_min)
      : Base(plant, attached), flank_(attached.flank), rebound_min_(rebound_min) {
    const auto friction = find_effect<CoulombFriction>(effects);
    if (friction && !(friction->regularised > 0.0))
      for (std::size_t j = 0; j < joints; ++j) mode_[j].dry = mode_[j].dry_here = friction->torque[j];
    const auto stops = find_effect<EndStops>(effects);
    for (std::size_t i = 0; stops && i < 2; ++i)
      mode_[i * joints / 2].stop = Stop{stops->lower[i], stops->upper[i]};
    if (stops) restitution_ = stops->restitution;
    if (stops && stops->stiffness) stiffness_ = *stops->stiffness;
  }

  /// Whether there is anything that can switch.
  [[nodiscard]] bool smooth() const {
    return std::ranges::none_of(mode_, [](const Mode& m) { return m.dry > 0.0 || m.stop; }) &&
           std::ranges::none_of(this->attached().drivetrain, &Drivetrain::has_play);
  }
  /// Whether nothing moves while torques and loads stay.
  [[nodiscard]] bool frozen() const { return held_ > 1 && this->size() == Base::work + 1; }
  [[nodiscard]] const Events& events() const { return events_; }
  [[nodiscard]] long evaluations() const { return evaluations_; }

  void slope(double t, const State& y, State& dy) const {
    ++evaluations_;
    const Angles angle = Base::angles(y), rate = Base::rates(y);
    const Joints theta = Plant::joint_angles(angle), w = Plant::joint_rates(rate);
    Joints torque = this->joint_torque(t, y, dy, angle, rate, theta, w);
    if (held_ > 1) {  // two independent joints hold a mechanism of two degrees of freedom
      Base::put(dy, Angles{}, Angles{});
      dy[Base::work] = 0.0;
      return;
    }
    for (std::size_t j = 0; j < joints; ++j) torque[j] += contact_torque(j, theta[j]);
    this->mechanism_slope(angle, rate, torque, dy);
    if (held_ == 1) {
      const Angles by = response(angle, first_held());
      const double r =
          -Plant::joint_rates(Base::rates(dy))[first_held()] / Plant::joint_rates(by)[first_held()];
      for (std::size_t i = 0; i < by.size(); ++i) dy[Base::positions + i] += r * by[i];
    }
  }

  /// Onto the closure, held joints exactly at rest.
  void project(State& y) const {
    if (held_ < 2) Base::project(y);
    if (held_ == 0) return;
    if (held_ > 1) return put_rates(y, Angles{});
    bring_to_rest(first_held(), y);
  }

  using Guards = GuardValues<6 * joints>;
  [[nodiscard]] Guards guards(double t, const State& y) const {
    Guards g;
    for_each_guard(t, y, [&](double value, auto, auto, auto) { g.value[g.count++] = value; });
    return g;
  }

  /// Most that a guard, in the middle of a step over which the slope changed by `bend`, is off the mean of
  /// the ends, over 1/8 of the step: joints are differences of two bars.
  [[nodiscard]] double guard_change(const State& bend) const {
    if (held_ > 0 || std::ranges::any_of(this->attached().drivetrain, &Drivetrain::has_play)) return inf;
    double most = 0.0;
    for (std::size_t i = 0; i < Base::work; ++i) most = std::max(most, std::abs(bend[i]));
    return 2.0 * most;
  }

  /// Modes at the start of a stretch in which torques or loads may have jumped; `last`: the guards at y
  /// before.
  Guards begin(double t, State& y, const Guards& last) {
    if (!begun_) {
      begun_ = true;
      first_modes(y);
      settle(t, y);
    } else if (held_ == 0 && last.least() >= 0.0) {
      return last;  // of the state alone
    } else {
      const Guards now = guards(t, y);
      if (now.least() >= 0.0) return now;
      switch_modes(t, y);
    }
    return guards(t, y);
  }

  /// The modes after an event at (t, y), where a guard is negative; impacts change y.
  void switch_modes(double t, State& y) {
    bool struck = false;
    std::array<bool, joints> stops{};
    for_each_guard(t, y, [&](double value, Kind kind, std::size_t j, int side) {
      if (value >= 0.0) return;
      if (kind == Kind::slip) stops[j] = true;
      if (kind == Kind::flank) {
        flank_[j] = flank_[j] == 0 ? side : 0;
        ++events_.contact;
      }
      if (kind != Kind::stop) return;
      Mode& m = mode_[j];
      if (stiffness_ > 0.0 || m.touches != 0) {
        m.touches = m.touches == 0 ? side : 0;
        ++events_.contact;
        if (!m.held) m.moves = Plant::joint_rates(Base::rates(y))[j] > 0.0 ? 1 : -1;
      } else {
        struck = true;
      }
    });
    if (struck) collide(t, y);
    for (std::size_t j = 0; j < joints; ++j) {
      if (!stops[j] || struck || mode_[j].held) continue;
      if (!can_hold(y)) {
        mode_[j].moves = -mode_[j].moves;
        continue;
      }
      hold(j, y);
      ++events_.stick;
    }
    settle(t, y);
  }

  // Frees held joints and removes this system's dry friction, for steps by moreau_jean, which has its own;
  // restart() undoes it.
  void release() {
    held_ = 0;
    for (Mode& m : mode_) m.held = false, m.dry_here = 0.0;
  }
  /// Contacts and directions as the state has them.
  void follow(const State& y) {
    const Joints theta = Plant::joint_angles(Base::angles(y)), w = Plant::joint_rates(Base::rates(y));
    for (std::size_t j = 0; j < joints; ++j) {
      mode_[j].moves = w[j] > 0.0 ? 1 : (w[j] < 0.0 ? -1 : 0);
      mode_[j].touches = 0;
      for (const int side : {-1, 1})
        if (mode_[j].stop && stiffness_ > 0.0 && gap(j, side, theta[j]) < 0.0) mode_[j].touches = side;
    }
    follow_flanks(y);
  }
  void restart() {
    ++events_.crowded;
    for (Mode& m : mode_) m.dry_here = m.dry;
    begun_ = false;
  }

 private:
  static constexpr double inf = std::numeric_limits<double>::infinity();
  /// Beyond this a guard counts as negative: rad, rad/s. Above rounding, below every tolerance.
  static constexpr double rounding = 1e-13;
  enum class Kind { slip, held, stop, flank };
  struct Stop {
    double lower, upper;
  };
  struct Mode {
    double dry = 0.0, dry_here = 0.0;  ///< N m: of the joint; as this system accounts for it
    std::optional<Stop> stop;
    int moves = 0;    ///< direction that its friction acts against
    int touches = 0;  ///< its stop: -1 the lower, 1 the upper
    bool held = false;
    void include(double angle) { stop = Stop{std::min(stop->lower, angle), std::max(stop->upper, angle)}; }
  };

  [[nodiscard]] Angles response(const Angles& angle, std::size_t j) const {
    Joints unit{};
    unit[j] = 1.0;
    return this->plant().response(angle, unit);
  }
  static void put_rates(State& y, const Angles& rate) { Base::put(y, Base::angles(y), rate); }
  /// Lowest joint that is held. Call only while held_ > 0: without one the result is 0, as for joint 0.
  [[nodiscard]] std::size_t first_held() const {
    for (std::size_t j = 0; j < joints; ++j)
      if (mode_[j].held) return j;
    return 0;
  }
  [[nodiscard]] double gap(std::size_t j, int side, double angle) const {
    return side > 0 ? mode_[j].stop->upper - angle : angle - mode_[j].stop->lower;
  }
  [[nodiscard]] double depth(std::size_t j, double angle) const {
    const int side = mode_[j].touches;
    return stiffness_ > 0.0 && side != 0 ? std::max(0.0, -gap(j, side, angle)) : 0.0;
  }
  /// Friction torque that a joint can hold; that of a soft stop is half of what it does not give back.
  [[nodiscard]] double grip(std::size_t j, double angle) const {
    return mode_[j].dry_here + 0.5 * stiffness_ * (1.0 - restitution_ * restitution_) * depth(j, angle);
  }
  /// Of the stop's spring, and of friction where the joint moves.
  [[nodiscard]] double contact_torque(std::size_t j, double angle) const {
    const Mode& m = mode_[j];
    double torque = -0.5 * stiffness_ * (1.0 + restitution_ * restitution_) * m.touches * depth(j, angle);
    if (!m.held) torque -= m.moves * grip(j, angle);
    return torque;
  }
  [[nodiscard]] double lower(std::size_t j, double angle) const {
    return stiffness_ == 0.0 && mode_[j].touches > 0 ? -inf : -grip(j, angle);
  }
  [[nodiscard]] double upper(std::size_t j, double angle) const {
    return stiffness_ == 0.0 && mode_[j].touches < 0 ? inf : grip(j, angle);
  }

  /// Calls f(value, kind, joint or motor, side). A joint that rubs is judged by its rate, and so on.
  template <class F>
  void for_each_guard(double t, const State& y, const F& f) const {
    const Angles angle = Base::angles(y);
    const Joints theta = Plant::joint_angles(angle), w = Plant::joint_rates(Base::rates(y));
    for (std::size_t j = 0; j < joints; ++j) {
      const Mode& m = mode_[j];
      const bool soft = stiffness_ > 0.0 && m.touches != 0 && restitution_ < 1.0;
      if (!m.held && (m.dry > 0.0 || soft)) f(m.moves * w[j] + rounding, Kind::slip, j, m.moves);
      if (!m.stop) continue;
      for (const int side : {-1, 1}) {
        const double g = gap(j, side, theta[j]);
        if (m.touches == 0) f(g + rounding, Kind::stop, j, side);
        if (m.touches == side && stiffness_ > 0.0) f(rounding - g, Kind::stop, j, side);
      }
    }
    if (held_ > 0) f(held_joints(t, y).reserve(rounding), Kind::held, first_held(), 0);
    for_each_play(y, [&](std::size_t k, auto contact) {
      for (const int side : {-1, 1}) {
        if (flank_[k] == 0) f(rounding - contact(side), Kind::flank, k, side);
        if (flank_[k] == side) f(rounding + contact(side), Kind::flank, k, side);
      }
    });
  }
  /// Calls f(motor, contact) for each gear with play: contact(side) > 0 where that flank presses.
  template <class F>
  void for_each_play(const State& y, const F& f) const {
    std::size_t at = Base::work + 1;
    for (std::size_t k = 0; k < this->attached().drivetrain.size(); ++k) {
      const Drivetrain& d = this->attached().drivetrain[k];
      const auto own = std::span(y).subspan(at, d.states());
      at += d.states();
      if (!d.has_play()) continue;
      const Shaft joint = this->MechanismBase::shaft(this->attached().motor_joint[k], y);
      f(k, [&](int side) { return d.contact(side, joint, own); });
    }
  }

  /// The held joints at (t, y), with no reaction in `free`.
  [[nodiscard]] HeldJoints<Joints> held_joints(double t, const State& y) const {
    ++evaluations_;
    State dy{};
    const Angles angle = Base::angles(y), rate = Base::rates(y);
    const Joints theta = Plant::joint_angles(angle);
    Joints torque = this->joint_torque(t, y, dy, angle, rate, theta, Plant::joint_rates(rate));
    HeldJoints<Joints> h;
    for (std::size_t j = 0; j < joints; ++j) {
      torque[j] += contact_torque(j, theta[j]);
      if (!mode_[j].held) continue;
      h.add(j);
      h.by[j] = Plant::joint_rates(response(angle, j));
      h.lower[j] = lower(j, theta[j]);
      h.upper[j] = upper(j, theta[j]);
    }
    h.free = Plant::joint_rates(this->plant().acceleration(angle, rate, torque));
    return h;
  }

  /// Whether a joint without rate may be held. Beside a held one, the others share one degree of freedom: if
  /// any of them moves, this one is at a dead point and turns.
  [[nodiscard]] bool can_hold(const State& y) const {
    if (held_ == 0) return true;
    double moving = 0.0;
    for (const double w : Plant::joint_rates(Base::rates(y))) moving = std::max(moving, std::abs(w));
    return moving <= 1e4 * rounding;
  }
  void hold(std::size_t j, State& y) {
    mode_[j].held = true;
    bring_to_rest(j, y);
    ++held_;
    if (held_ > 1) put_rates(y, Angles{});
  }
  /// Rate of joint j to exactly zero by an impulse there.
  void bring_to_rest(std::size_t j, State& y) const {
    Angles rate = Base::rates(y);
    const Angles by = response(Base::angles(y), j);
    const double r = -Plant::joint_rates(rate)[j] / Plant::joint_rates(by)[j];
    for (std::size_t i = 0; i < by.size(); ++i) rate[i] += r * by[i];
    rate[j] = j % 2 == 0 ? 0.0 : rate[j - 1];
    put_rates(y, rate);
  }

  void first_modes(State& y) {
    const Joints theta = Plant::joint_angles(Base::angles(y)), w = Plant::joint_rates(Base::rates(y));
    bool struck = false;
    held_ = 0;
    for (std::size_t j = 0; j < joints; ++j) {
      Mode& m = mode_[j];
      m.held = false;
      m.touches = 0;
      m.moves = w[j] > 0.0 ? 1 : -1;
      if (m.stop) {  // a start beyond a rigid stop is one in contact
        if (stiffness_ == 0.0) m.include(theta[j]);
        for (const int side : {-1, 1})
          if (gap(j, side, theta[j]) <= 0.0) m.touches = side;
        if (stiffness_ == 0.0 && m.touches * w[j] < 0.0) m.touches = 0;  // it leaves
        struck = struck || (stiffness_ == 0.0 && m.touches * w[j] > 0.0);
      }
    }
    follow_flanks(y);
    if (struck) collide(0.0, y);
    hold_what_rests(y);
  }
  void follow_flanks(const State& y) {
    for_each_play(y, [&](std::size_t k, auto contact) {
      flank_[k] = contact(-1) > 0.0 ? -1 : (contact(1) > 0.0 ? 1 : 0);
    });
  }
  /// Joints at rest that friction or a stop may hold.
  void hold_what_rests(State& y) {
    const Joints theta = Plant::joint_angles(Base::angles(y)), w = Plant::joint_rates(Base::rates(y));
    for (std::size_t j = 0; j < joints; ++j) {
      const bool may = upper(j, theta[j]) - lower(j, theta[j]) > 0.0;
      if (!mode_[j].held && may && std::abs(w[j]) <= 10.0 * rounding && can_hold(y)) hold(j, y);
    }
  }

  /// Impact on every rigid stop that is touched: Newton's restitution, no impulse of friction, which is
  /// bounded. Frees what was held and moves now.
  void collide(double t, State& y) {
    const Angles angle = Base::angles(y);
    const Joints theta = Plant::joint_angles(angle), before = Plant::joint_rates(Base::rates(y));
    std::vector<StopImpact<Angles>> rows;
    for (std::size_t j = 0; j < joints; ++j) {
      mode_[j].held = false;
      if (!mode_[j].stop) continue;
      for (const int side : {-1, 1}) {
        if (gap(j, side, theta[j]) > rounding && mode_[j].touches != side) continue;
        double back = restitution_ * std::max(0.0, side * before[j]);
        rows.push_back({j, side, back, response(angle, j)});
        mode_[j].touches = 0;
      }
    }
    held_ = 0;
    const Joints free = held_joints(t, y).free;
    for (auto& r : rows) {  // the last bounce
      const double push = r.side * free[r.joint];
      if (r.rebound > 0.0 && r.rebound * r.rebound < rebound_min_ * std::max(push, 0.0)) {
        r.rebound = 0.0;
        ++events_.accumulated;
      }
    }
    ++events_.impact;
    Angles after = Base::rates(y);
    y[Base::work] += push_back<Plant>(rows, before, after);
    put_rates(y, after);
    const Joints w = Plant::joint_rates(after);
    for (const auto& r : rows)
      if (std::abs(w[r.joint]) <= 10.0 * rounding) mode_[r.joint].touches = r.side;
    for (std::size_t j = 0; j < joints; ++j) mode_[j].moves = w[j] > 0.0 ? 1 : -1;
    hold_what_rests(y);
  }

  /// Which of the held joints stay, and which way the others go. The load is raised by 1e-9 so that a joint
  /// exactly at its limit gives way.
  void settle(double t, State& y) {
    hold_what_rests(y);
    if (held_ == 0) return;
    constexpr double raised = 1.0 + 1e-9;
    HeldJoints<Joints> h = held_joints(t, y);
    for (double& a : h.free) a *= raised;
    const std::array<int, joints> way = h.directions(rounding);
    for (const std::size_t j : h.held()) {
      if (way[j] == 0) continue;
      mode_[j].held = false;
      mode_[j].moves = way[j];
      if (stiffness_ == 0.0 && mode_[j].touches == -way[j]) {
        mode_[j].touches = 0;
        mode_[j].include(Plant::joint_angles(Base::angles(y))[j]);  // where it has rested, to the last bit
        ++events_.contact;
      }
      --held_;
      ++events_.slip;
    }
  }

  std::array<Mode, joints> mode_{};
  std::array<int, 4>& flank_;
  double stiffness_ = 0.0;  ///< of the stops, N m/rad; 0: rigid, or none
  double restitution_ = 0.0;
  double rebound_min_;
  std::size_t held_ = 0;
  bool begun_ = false;
  Events events_;
  mutable long evaluations_ = 0;
};

}  // namespace esmc::host
