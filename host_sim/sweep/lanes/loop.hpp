#pragma once
/// One loop for several five-bars: what Controller::tick, Motion::advance, Recorder::tick and Statistics::add
/// do in a tick without effects, faults or joining, with the same templates underneath and in the same order.
/// Whatever else happens in a lane takes it out: its case is run alone.

#include <cstddef>

#include "firmware/control/law.hpp"
#include "firmware/cycle/estimate.hpp"
#include "host_sim/integrate/rk4.hpp"
#include "host_sim/plant/five_bar_plant.hpp"
#include "host_sim/plant/system.hpp"
#include "host_sim/sweep/lanes/kernel.hpp"
#include "host_sim/sweep/lanes/lanes.hpp"

template <int N, class Tag>
struct Eigen::NumTraits<esmc::host::Lanes<N, Tag>> : Eigen::GenericNumTraits<double> {
  using Real = esmc::host::Lanes<N, Tag>;
  using NonInteger = Real;
  using Nested = Real;
  using Literal = Real;
  enum {
    IsComplex = 0,
    IsInteger = 0,
    IsSigned = 1,
    RequireInitialization = 0,
    ReadCost = 1,
    AddCost = 1,
    MulCost = 1
  };
};

namespace esmc::host {

template <class L>
class LaneLoop {
 public:
  using M = FiveBar<L>;
  using Mask = typename L::Mask;
  using Plant = FiveBarPlantOf<BothLegs<L>, L>;
  using System = BareSystem<Plant>;
  static constexpr int n = L::count;

  LaneLoop(const LaneSettings& s, const LaneCase* cases)
      : settings_(s),
        cases_(cases),
        mode_{{{s.working_mode[0], s.working_mode[1]}}, s.assembly_mode},
        believed_(params(&LaneCase::believed)),
        true_(params(&LaneCase::plant)),
        plant_(params(&LaneCase::plant)),
        system_(plant_),
        stepper_(system_) {
    for (int i = 0; i < M::channels; ++i) {
      const auto u = static_cast<std::size_t>(i);
      gains_.lambda[i] = each([&](const LaneCase& c) { return c.lambda[u]; });
      gains_.k[i] = each([&](const LaneCase& c) { return c.k[u]; });
      gains_.layer[i] = each([&](const LaneCase& c) { return c.layer[u]; });
    }
    const auto own = [&](std::size_t i) { return each([&](const LaneCase& c) { return c.independent[i]; }); };
    gains_.independent = {own(0), own(1), own(2), own(3), own(4)};
    typename Plant::Angles angle, rate;
    for (std::size_t i = 0; i < angle.size(); ++i) {
      angle[i] = each([&](const LaneCase& c) { return c.angle[i]; });
      rate[i] = each([&](const LaneCase& c) { return c.rate[i]; });
    }
    y_.fill(L(0.0));
    System::put(y_, angle, rate);
    last_torque_ = last_angle_ = {L(0.0), L(0.0)};
    for (L* sum :
         {&square_, &settled_square_, &base_square_, &base_settled_square_, &largest_, &settled_largest_,
          &base_largest_, &base_settled_largest_, &torque_max_, &delta_sum_, &power_sum_, &saturated_}) {
      *sum = L(0.0);
    }
    Mask::stray = typename Mask::V{};
  }

  void run(const LaneReference& reference, LaneScore* out) {
    constexpr std::uint32_t block = 64;
    alignas(64) std::array<double, static_cast<std::size_t>(block * 6 * n)> track;
    for (std::uint32_t first = 0; first < settings_.ticks && !none(fine_); first += block) {
      const std::uint32_t count = settings_.ticks - first < block ? settings_.ticks - first : block;
      reference.fill(first, count, track.data());
      const std::size_t stride = settings_.one_reference ? 6 : 6 * n;
      for (std::uint32_t i = 0; i < count; ++i) tick(first + i, track.data() + i * stride);
      fine_ = fine_ && !Mask(Mask::stray);
    }
    require_in_range(System::angles(y_), System::rates(y_));
    put(out);
  }

 private:
  template <class F>
  [[nodiscard]] L each(const F& f) const {
    L out;
    for (int i = 0; i < n; ++i) out.v[i] = f(cases_[i]);
    return out;
  }
  [[nodiscard]] FiveBarParams<L> params(FiveBarParams<double> LaneCase::*of) const {
    FiveBarParams<L> p;
    p.l0 = each([&](const LaneCase& c) { return (c.*of).l0; });
    p.m0 = each([&](const LaneCase& c) { return (c.*of).m0; });
    p.g = each([&](const LaneCase& c) { return (c.*of).g; });
    using Leg = LegParams<double>;
    using Legs = LegParams<L>;
    constexpr double Leg::*from[] = {&Leg::l1, &Leg::l2, &Leg::lg1, &Leg::lg2, &Leg::m1,     &Leg::m2,
                                     &Leg::J1, &Leg::J2, &Leg::d1,  &Leg::d2,  &Leg::gamma1, &Leg::gamma2};
    constexpr L Legs::*to[] = {&Legs::l1, &Legs::l2, &Legs::lg1, &Legs::lg2, &Legs::m1,     &Legs::m2,
                               &Legs::J1, &Legs::J2, &Legs::d1,  &Legs::d2,  &Legs::gamma1, &Legs::gamma2};
    for (std::size_t j = 0; j < 2; ++j) {
      for (std::size_t i = 0; i < std::size(from); ++i)
        p.legs[j].*to[i] = each([&](const LaneCase& c) { return (c.*of).legs[j].*from[i]; });
    }
    return p;
  }
  [[nodiscard]] L limit(double LaneCase::*of) const {
    return each([&](const LaneCase& c) { return c.*of; });
  }
  [[nodiscard]] Mask within(L v, std::array<std::array<double, 2>, 2> LaneCase::*of, std::size_t i) const {
    return each([&](const LaneCase& c) { return (c.*of)[i][0]; }) <= v &&
           v <= each([&](const LaneCase& c) { return (c.*of)[i][1]; });
  }
  void require(Mask allowed) { fine_ = fine_ && allowed; }
  /// Finite, and no angle for which the plant's sine would take the C library's.
  void require_in_range(const typename Plant::Angles& angle, const typename Plant::Angles& rate) {
    for (std::size_t i = 0; i < angle.size(); ++i)
      require(magnitude(angle[i]) <= L(0.9 * ieee::Constants<double>::kLargestAngle) &&
              magnitude(rate[i]) <= L(1e100));
  }

  void tick(std::uint32_t number, const double* reference) {
    const typename Plant::State state{System::angles(y_), System::rates(y_)};
    require_in_range(state.angle, state.rate);
    const auto theta = Plant::joint_angles(state.angle), w = Plant::joint_rates(state.rate);
    Tracking<M> t;
    observe(number, {theta[0], theta[2]}, {w[0], w[2]}, t);
    const auto coordinate = [&](int i) {
      return settings_.one_reference ? L(reference[i]) : L::load(reference + i * n);
    };
    const auto pair = [&](int i) { return Vec2<L>(coordinate(i), coordinate(i + 1)); };
    const Vec2<L> position = pair(0);
    (void)desired_at_effector(believed_, mode_, position, pair(2), pair(4), t.desired_pose, t.desired_rates,
                              t.desired_acceleration);
    Vec2<L> torque;
    if (settings_.law == LawKind::pd) {
      torque = torque_pd<M>(gains_, t);
    } else {
      typename M::Channels acceleration, sliding;
      demand(settings_.law, believed_, gains_, settings_.reaching, t, acceleration, sliding);
      torque = believed_.base_torque(t.pose, believed_.force(acceleration, t.rates));
    }
    const Mask clamped = clamp(torque);
    record(number, plant_.output(state), position, t, torque, clamped);
    const typename Plant::Joints held{torque[0], L(0.0), torque[1], L(0.0)};
    system_.set_torques({held, nullptr});
    for (int i = 0; i < settings_.steps; ++i) stepper_.step(0.0, settings_.step, y_);
  }

  /// Controller::observe: sample -> estimate -> guards.
  void observe(std::uint32_t number, const std::array<L, 2>& measured, const std::array<L, 2>& rate,
               Tracking<M>& t) {
    Vec2<L> angle;
    const L jump = limit(&LaneCase::feedback_jump), lead = limit(&LaneCase::lead),
            speed = limit(&LaneCase::joint_speed);
    for (int i = 0; i < 2; ++i) {
      const auto u = static_cast<std::size_t>(i);
      if (number > 0) {
        const L off = measured[u] - last_angle_[u] - rate[u] * (settings_.tick * 1.0);
        require(!(jump > L(0.0)) || magnitude(off) <= jump * 1.0);
      }
      last_angle_[u] = measured[u];
      angle[i] = measured[u] + rate[u] * lead;
      require(magnitude(rate[u]) <= speed && within(angle[i], &LaneCase::joint_angle, u));
    }
    (void)estimate_from_base(believed_, mode_, angle, Vec2<L>(rate[0], rate[1]), t.pose, t.rates);
    for (int j = 0; j < 2; ++j) {
      const L sine = M::sin_type1(t.pose, j);
      require(magnitude(sine) >= limit(&LaneCase::type1) && sine * L(double(mode_.working[j])) > L(0.0));
      require(within(t.pose.effector[j], &LaneCase::workspace, static_cast<std::size_t>(j)));
    }
    require(M::sin_type2_in_mode(t.pose, mode_) >= limit(&LaneCase::type2));
  }

  /// Controller::limit.
  Mask clamp(Vec2<L>& torque) {
    Mask clamped(false);
    for (int i = 0; i < 2; ++i) {
      const L most = each([&](const LaneCase& c) { return c.torque_limit[static_cast<std::size_t>(i)]; });
      require(magnitude(torque[i]) <= L(1.7976931348623157e308));
      const Mask over = !(magnitude(torque[i]) <= most);
      torque[i] = choose(over, choose(torque[i] < L(0.0), -most, most), torque[i]);
      clamped = clamped || over;
    }
    return clamped;
  }

  /// Recorder::tick and Statistics::add.
  void record(std::uint32_t number, const typename Plant::Output& o, const Vec2<L>& position,
              const Tracking<M>& t, const Vec2<L>& torque, Mask clamped) {
    const bool settled = number >= settings_.settled_from;
    const Planar<L> miss = o.effector - Planar<L>{position.x(), position.y()};
    add(square_root(dot(miss, miss)), settled, square_, largest_, settled_square_, settled_largest_);
    typename M::Pose true_pose;
    if (!settings_.true_lengths) (void)true_.inverse(position, mode_, true_pose);
    if (settings_.base_errors) {
      const Vec2<L> base = M::base_angles(settings_.true_lengths ? t.desired_pose : true_pose);
      for (std::size_t i = 0; i < 2; ++i) {
        add(magnitude(wrap_to_pi(L(o.q[2 + 2 * i] - base[static_cast<int>(i)]))), settled, base_square_,
            base_largest_, base_settled_square_, base_settled_largest_);
      }
    }
    saturated_ += L(clamped);
    L power(0.0);
    for (int i = 0; i < 2; ++i) {
      const auto u = static_cast<std::size_t>(i);
      power += magnitude(torque[i] * o.qd[2 + 2 * u]);
      torque_max_ = larger_of(torque_max_, magnitude(torque[i]));
      if (number > 0) delta_sum_ += magnitude(torque[i] - last_torque_[u]);
      last_torque_[u] = torque[i];
    }
    power_sum_ += power;
  }
  static L larger_of(L a, L b) { return choose(b > a, b, a); }
  static void add(L e, bool settled, L& square, L& largest, L& settled_square, L& settled_largest) {
    square += e * e;
    largest = larger_of(largest, e);
    if (!settled) return;
    settled_square += e * e;
    settled_largest = larger_of(settled_largest, e);
  }

  void put(LaneScore* out) const {
    for (int i = 0; i < n; ++i) {
      out[i] = {fine_[i],
                square_[i],
                largest_[i],
                settled_square_[i],
                settled_largest_[i],
                base_square_[i],
                base_largest_[i],
                base_settled_square_[i],
                base_settled_largest_[i],
                torque_max_[i],
                delta_sum_[i],
                power_sum_[i],
                saturated_[i]};
    }
  }

  LaneSettings settings_;
  const LaneCase* cases_;
  typename M::Mode mode_;
  M believed_, true_;
  Plant plant_;
  System system_;
  Rk4<System> stepper_;
  Gains<M> gains_;
  typename System::State y_;
  std::array<L, 2> last_angle_, last_torque_;
  Mask fine_{true};
  L square_, largest_, settled_square_, settled_largest_, base_square_, base_largest_, base_settled_square_,
      base_settled_largest_, torque_max_, delta_sum_, power_sum_, saturated_;
};

template <class L>
void run_lanes(const LaneSettings& s, const LaneCase* cases, const LaneReference& reference, LaneScore* out) {
  LaneLoop<L>(s, cases).run(reference, out);
}

}  // namespace esmc::host
