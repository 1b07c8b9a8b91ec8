#pragma once
/// How a fuzzed cycle is configured: twelve fixed shapes, each with something that the others have not, or
/// any combination of what a controller can be told, by dials that the input turns.

#include <array>
#include <compare>
#include <cstdint>
#include <limits>

#include "firmware/cycle/closure_projection.hpp"
#include "firmware/cycle/part_four_motors.hpp"
#include "firmware/cycle/part_implicit_coupled.hpp"
#include "firmware/cycle/part_momentum_observer.hpp"
#include "firmware/cycle/part_predictor.hpp"
#include "firmware/cycle/part_super_twisting.hpp"
#include "firmware/link/command_link.hpp"
#include "tests/fuzz/bytes.hpp"
#include "tests/support/cycle_setup.hpp"

namespace esmc::fuzz {

/// One byte as several small numbers.
class Dial {
 public:
  explicit Dial(unsigned v) : left_(v) {}
  /// 0 .. n - 1.
  unsigned turn(unsigned n) {
    const unsigned at = left_ % n;
    left_ /= n;
    return at;
  }

 private:
  unsigned left_;
};

struct Shape {
  static constexpr unsigned fixed = 12;
  unsigned choice = 0;                 ///< < fixed: one of the fixed ones
  std::array<std::uint8_t, 8> dial{};  ///< else

  /// From the input; fixed ones take no more of it.
  static Shape of(unsigned choice, Bytes& in) {
    Shape s;
    s.choice = choice % 16;
    if (s.choice < fixed) return s;
    s.choice = fixed;
    for (auto& d : s.dial) d = in.u8();
    return s;
  }
  [[nodiscard]] bool free() const { return choice >= fixed; }
  /// For the drives: the choice, or fixed and what the last dial says.
  [[nodiscard]] unsigned drive() const { return free() ? fixed + dial[7] : choice; }
  auto operator<=>(const Shape&) const = default;
};

template <class S>
PathSegment<S> segment(std::uint32_t start, const Vec2<S>& from, S far) {
  const Vec2<S> still = Vec2<S>::Zero();
  return {start, S(0),
          Quintic<S>::between({from, still, still}, {from + Vec2<S>(S(0), far), still, still}, S(0.04F))};
}
/// Up and down on a straight line, from where the machine's own reference has its centre.
template <class M, class S = typename M::Scalar>
std::span<const PathSegment<S>> up_and_down(std::uint32_t start) {
  static const Vec2<S> centre = test::setup<M>().controller.reference.centre;
  static const std::array<PathSegment<S>, 2> now{segment(0, centre, S(0.02F)),
                                                 segment(40, centre, S(-0.02F))},
      later{segment(20, centre, S(0.02F)), segment(50, centre, S(-0.02F))};
  return start == 0 ? now : later;
}

template <class M>
test::Setup<M> fixed_shape(unsigned choice, bool passive_encoders) {
  using S = typename M::Scalar;
  auto s = test::setup<M>();
  auto& c = s.controller;
  c.halt_ticks = choice % 2 != 0 ? 3 : 0;
  c.after_halt = choice % 3 == 0 ? AfterHalt::hold : choice % 3 == 1 ? AfterHalt::lower : AfterHalt::release;
  c.lower_ticks = 4;
  c.join_ticks = choice % 4 == 1 ? 500 : 0;
  c.ramp_ticks = choice % 4 == 2 ? 5 : 0;
  c.law = static_cast<LawKind>(choice % 5);
  c.reaching = static_cast<Reaching>(choice * 5 / 4 % 4);
  if (choice == 0) c.reference.kind = ReferenceKind::hold_start;
  if (choice == 3) {
    c.reference.kind = ReferenceKind::path;
    c.reference.path = up_and_down<M>(0);
  }
  c.torque_lead = choice % 4 == 3 ? S(1e-3F) : S(0);
  if (choice % 4 == 3) c.limits.feedback_jump = S(0.1F);
  if (choice % 4 == 1) c.limits.join_acceleration = S(1000);
  if (choice == 5 || choice == 11) c.sign_test_move = S(1e-3F);
  if (choice == 7) {  // no limit but the torque's: everything that can overflow does
    c.limits.joint_speed = std::numeric_limits<S>::max();
    c.limits.joint_angle = {};
    c.limits.workspace_x = c.limits.workspace_y = {};
    c.limits.min_abs_sin_type1 = S(0);
    c.reaching = Reaching::sign;
    c.gains.k.setConstant(S(1e30F));
  }
  if (choice >= 8 && M::joints == 4) {
    c.sensors = Sensors::all;
    if (choice >= 10 || !passive_encoders) c.motors = Motors::all;
    c.allocate = allocation_for<M>(c.motors);
  }
  return s;
}

// ---- by dials
// ------------------------------------------------------------------------------------------------------

template <class M>
void turn_law(ControllerConfig<M>& c, Dial d) {
  using S = typename M::Scalar;
  c.law = static_cast<LawKind>(d.turn(5));
  c.reaching = static_cast<Reaching>(d.turn(4));
  auto& g = c.gains;
  switch (d.turn(5)) {
    case 1:
      g.k.setConstant(std::numeric_limits<S>::max());
      g.independent.k = std::numeric_limits<S>::max();
      break;
    case 2:
      g.layer.setConstant(std::numeric_limits<S>::min());
      g.independent.layer = std::numeric_limits<S>::min();
      break;
    case 3:
      g.k.setZero();
      g.independent.k = S(0);
      break;
    case 4:
      for (int i = 0; i < M::channels; ++i) g.k[i] = S(i % 3) * S(100);
      break;
    default:
      break;
  }
}
template <class M>
void turn_parts(ControllerConfig<M>& c, Dial d) {
  using S = typename M::Scalar;
  static constexpr std::array<float, 4> delays{0.0F, 1.0F, 3.0F, 20.0F};
  const unsigned reach = d.turn(3);
  const bool channelwise = c.law == LawKind::esmc || c.law == LawKind::esmc_projected;
  if (reach == 1 && (channelwise || c.law == LawKind::smc)) c.reach = &part::super_twisting<M>;
  if (reach == 2 && channelwise) c.reach = &part::implicit_coupled<M>;
  if (d.turn(2) != 0) c.observer = &part::momentum_observer<M>;
  if (d.turn(2) != 0) c.predict = &part::predictor<M>;
  c.observer_bandwidth = S(200);
  c.delay_ticks = S(delays[d.turn(4)]);
  static constexpr std::array<float, 3> lags{0.0F, 0.5F, 20.0F};
  c.lag_ticks = S(lags[d.turn(3)]);
}
template <class M>
void turn_reference(ControllerConfig<M>& c,
                    const std::array<double, static_cast<std::size_t>(M::joints)>& angle, Dial d) {
  using S = typename M::Scalar;
  auto& r = c.reference;
  const unsigned kind = d.turn(8);
  if (kind == 1) r.kind = ReferenceKind::hold_start;
  if (kind >= 2 && kind <= 5) r.kind = ReferenceKind::path;
  if (kind >= 2 && kind <= 4) r.path = up_and_down<M>(kind == 4 ? 20 : 0);
  if (kind == 3) r.repeat_ticks = 30;
  if (kind == 6 && r.space == ReferenceSpace::base_joints) {
    r.kind = ReferenceKind::circle;
    r.space = ReferenceSpace::effector;
    r.centre = {S(0.1F), S(0.25F)};
    r.amplitude = {S(0.02F), S(0.02F)};
  } else if (kind == 6) {
    r.kind = ReferenceKind::sine;
    r.space = ReferenceSpace::base_joints;
    r.centre = {static_cast<S>(angle[0]), static_cast<S>(angle[M::joints / 2])};
    r.amplitude = {S(0.1F), S(0.05F)};
    r.phase[1] = r.phase[0];
    r.speed[1] = r.speed[0];
  }
  if (kind == 7) r.amplitude = r.amplitude * S(20);  // out of reach for most of the way
  constexpr std::array<std::uint32_t, 3> joins{0, 5, 500};
  c.join_ticks = joins[d.turn(3)];
  c.ramp_ticks = d.turn(2) != 0 ? 5 : 0;
  c.torque_lead = d.turn(2) != 0 ? S(1e-3F) : S(0);
}
template <class M>
void turn_stages(ControllerConfig<M>& c, Dial d, bool passive_encoders) {
  using S = typename M::Scalar;
  constexpr std::array<float, 4> moves{0.0F, 1e-3F, 1e-7F, 10.0F};
  c.halt_ticks = d.turn(2) != 0 ? 3 : 0;
  c.after_halt = static_cast<AfterHalt>(d.turn(3));
  c.lower_ticks = d.turn(2) != 0 ? 4 : 0;
  const unsigned places =
      d.turn(4);  // motors, encoders: base and base, all and base, all and all, base and all
  if (M::joints == 4 && places != 0) {
    if (places != 3 || !passive_encoders) c.motors = Motors::all;
    if (places != 1) c.sensors = Sensors::all;
  }
  c.allocate = allocation_for<M>(c.motors);
  c.sign_test_move = S(moves[d.turn(4)]);
}
template <class M>
void turn_limits(ControllerConfig<M>& c, Dial d, Dial more) {
  using S = typename M::Scalar;
  constexpr S most = std::numeric_limits<S>::max();
  switch (d.turn(6)) {
    case 1:
      c.torque_limit.setZero();
      break;
    case 2:
      c.torque_limit.setConstant(most);
      break;
    case 3:
      c.torque_limit.setConstant(S(1e-3F));
      break;
    case 4:
      c.torque_limit[0] = S(0);
      break;
    case 5:
      c.torque_limit *= S(20);
      break;
    default:
      break;
  }
  constexpr std::array<S, 3> speeds{S(0), most, S(0.5F)};
  if (const S speed = speeds[d.turn(3)]; speed > S(0)) {
    c.limits.joint_speed = speed;
    c.limits.join_acceleration =
        speed;  // the same number: a dial of its own would change what kept inputs say
  }
  if (d.turn(2) != 0) c.limits.joint_angle = {};
  if (d.turn(2) != 0) c.limits.workspace_x = c.limits.workspace_y = {};
  if (d.turn(2) != 0) c.limits.min_abs_sin_type1 = c.limits.min_abs_sin_type2 = S(0);
  if (more.turn(2) != 0) c.limits.feedback_jump = S(0.1F);
  if (more.turn(2) != 0) c.limits.max_age_ticks = 0;
  if (more.turn(2) != 0) c.limits.closure = most;
  if constexpr (M::joints == 4) {
    if (more.turn(2) != 0 && c.sensors == Sensors::all) c.fuse = &part::closure_projection<M>;
    c.encoder_variance = {S(1), S(4), S(0.5F), S(2)};
    const unsigned preload = more.turn(3);
    for (int i = 0; i < 4 && preload != 0; ++i) {
      const S size = preload == 1 ? c.torque_limit[i] * S(0.3F) : c.torque_limit[i];
      c.preload[i] = i % 2 == 0 ? size : -size;
    }
  }
}

template <class M>
test::Setup<M> setup_of(const Shape& shape, bool passive_encoders) {
  if (!shape.free()) return fixed_shape<M>(shape.choice, passive_encoders);
  auto s = test::setup<M>();
  auto& c = s.controller;
  turn_law(c, Dial(shape.dial[0]));
  turn_parts(c, Dial(shape.dial[1]));
  turn_reference<M>(c, s.angle, Dial(shape.dial[2]));
  turn_stages(c, Dial(shape.dial[3]), passive_encoders);
  turn_limits(c, Dial(shape.dial[4]), Dial(shape.dial[5]));
  return s;
}

// ---- the cycle around the controller
// ---------------------------------------------------------------------------------

inline constexpr unsigned link_base = 0x780;

inline link::LinkConfig link_config(unsigned choice, bool at_effector) {
  using link::Bounds;
  link::LinkConfig c;
  c.base_id = link_base;
  c.session = 77;
  c.counter_jump_max = 2;
  c.command_age_ticks_max = 50;
  c.status_ticks = 2;
  c.telemetry_ticks = 9;
  c.period_ns = 1'000'000;
  c.source = choice % 2 == 0 ? link::Source::stream : link::Source::reference;
  c.space = at_effector ? link::Space::effector : link::Space::base_joints;
  c.position = {Bounds{-3.0F, 3.0F}, Bounds{-3.0F, 3.0F}};
  c.parameters = link::Parameters(
      {20, 20, 8, 8, 1e-3F, 2, 2, 50, 1.0F, 10.0F, 3, choice == 4 ? 20.0F : 0.0F},
      {Bounds{1, 80}, Bounds{1, 80}, Bounds{0, 200}, choice >= Shape::fixed ? Bounds{8, 8} : Bounds{0, 200}});
  return c;
}

/// All but controller and axes.
template <class Config>
void turn_cycle(Config& c, const Shape& shape, bool at_effector) {
  using S = decltype(c.torque_mismatch);
  c.heartbeat_age_ticks_max = 6;
  c.torque_time = S(2e-3F);
  if (!shape.free()) {
    c.samples_timed = shape.choice % 2 == 0;
    c.zero_absolute = shape.choice != 6;
    c.torque_mismatch = shape.choice % 5 == 4 ? S(0.5F) : S(0);
    if (shape.choice % 3 != 2) c.link = link_config(shape.choice, at_effector);
    return;
  }
  if ((shape.dial[7] & 64U) != 0) c.heartbeat_age_ticks_max = 40;  // longer than drives are asked again after
  Dial d(shape.dial[6]);
  c.samples_timed = d.turn(2) == 0;
  c.zero_absolute = d.turn(2) == 0;
  c.torque_mismatch = d.turn(2) != 0 ? S(0.5F) : S(0);
  if (d.turn(4) == 0) return;
  const unsigned source = d.turn(2);
  c.link = link_config(d.turn(2) != 0 ? Shape::fixed + source : source, at_effector);
  if (d.turn(2) != 0) c.link.session = 255;
  if (shape.dial[7] >= 128) c.link.table_ticks = 7;  // the drives take the rest of this dial
}
/// Whether the board has a store of parameters.
inline bool has_store(const Shape& shape) { return shape.free() && shape.dial[6] % 2 != 0; }

}  // namespace esmc::fuzz
