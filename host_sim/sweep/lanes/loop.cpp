/// One loop for several five-bars: the firmware's controller, and what Motion::advance and Recorder::tick do
/// in a tick without effects and faults, with the same templates underneath and in the same order. A lane in
/// which anything else happens is taken out: its case is run alone. Compiled once per instruction set, for
/// ESMC_LANES mechanisms.

#include <array>
#include <bit>
#include <cstddef>

#include "host_sim/integrate/fixed_step.hpp"
#include "host_sim/plant/five_bar_plant.hpp"
#include "host_sim/plant/system.hpp"
#include "host_sim/sweep/lanes/controller.hpp"
#include "host_sim/sweep/lanes/kernel.hpp"

namespace esmc::host {

/// The mechanism under torques at its base joints, without its work.
template <class Plant>
class LaneSystem : public MechanismState<Plant, 0> {
 public:
  using Base = MechanismState<Plant, 0>;
  using State = typename Base::State;
  using Base::Base;
  typename Plant::Joints torque{};  ///< N m
  static constexpr std::size_t size() { return Base::work; }
  void slope(double, const State& y, State& dy) const {
    const auto rate = Base::rates(y);
    Base::put(dy, rate, this->plant().acceleration(Base::angles(y), rate, torque));
  }
};

template <class L>
class LaneLoop {
 public:
  using M = FiveBar<L>;
  using Mask = typename L::Mask;
  using Plant = FiveBarPlantOf<BothLegs<L>, L>;
  using System = LaneSystem<Plant>;
  static constexpr int n = L::count;

  LaneLoop(const LaneSettings& s, const LaneCase* cases)
      : settings_(s),
        cases_(cases),
        true_(params([](const LaneCase& c) { return c.plant; })),
        plant_(params([](const LaneCase& c) { return c.plant; })),
        system_(plant_),
        stepper_(system_),
        controller_(configuration()) {
    supervisor_.begin_tick(Command::enable, {});
    supervisor_.begin_tick(Command::none, {.all_ready = true});
    typename Plant::Angles angle, rate;
    gather(angle, [](const LaneCase& c) { return c.angle; });
    gather(rate, [](const LaneCase& c) { return c.rate; });
    y_.fill(L(0.0));
    System::put(y_, angle, rate);
    Mask::stray = typename Mask::V{};
  }

  void run(LaneScore* out) {
    if (settings_.driven) {
      for (std::uint32_t i = 0; i < settings_.ticks && (i % block != 0 || going_on()); ++i) drive(i);
      keep_state();
    } else {
      follow();
    }
    fine_ = fine_ && !Mask(Mask::stray);
    const typename Plant::Angles angle = System::angles(y_), rate = System::rates(y_);
    for (std::size_t i = 0; i < angle.size(); ++i) fine_ = fine_ && finite(angle[i]) && finite(rate[i]);
    put(out);
  }

 private:
  static constexpr std::uint32_t block = 64;  // ticks between two looks at what ends a run
  [[nodiscard]] bool going_on() {
    if (settings_.stopped != nullptr && settings_.stopped()) fine_ = Mask(false);
    return !none(fine_);
  }
  /// All ticks under the controller.
  void follow() {
    alignas(64) std::array<double, static_cast<std::size_t>(block * 6 * n)> track;
    for (std::uint32_t first = 0; first < settings_.ticks && going_on(); first += block) {
      const std::uint32_t count = settings_.ticks - first < block ? settings_.ticks - first : block;
      if (settings_.track != nullptr) {
        track_ = {settings_.track, 0, true};
      } else {
        fill_references(settings_, cases_, n, first, count, track.data());
        track_ = {track.data(), first, settings_.one_reference};
      }
      for (std::uint32_t i = 0; i < count; ++i) tick(first + i);
      fine_ = fine_ && !Mask(Mask::stray);
    }
  }
  /// `to` becomes of(case) of all lanes: a struct of numbers, or a vector.
  template <class To, class F>
  void gather(To& to, const F& of) const {
    constexpr std::size_t numbers = sizeof(to) / sizeof(L);  // NOLINT(bugprone-sizeof-expression)
    std::array<L, numbers> out;
    for (int lane = 0; lane < n; ++lane) {
      const auto from = std::bit_cast<std::array<double, numbers>>(of(cases_[lane]));
      for (std::size_t i = 0; i < numbers; ++i) out[i].v[lane] = from[i];
    }
    to = std::bit_cast<To>(out);
  }
  template <int Size, class F>
  void gather(Vec<L, Size>& to, const F& of) const {
    for (int i = 0; i < Size; ++i) gather(to[i], [&](const LaneCase& c) { return of(c)[i]; });
  }
  template <class F>
  [[nodiscard]] FiveBarParams<L> params(const F& of) const {
    FiveBarParams<L> out;
    gather(out, of);
    return out;
  }
  /// What LaneSettings says to be equal is taken from the first lane.
  [[nodiscard]] typename Controller<M>::Config configuration() const {
    typename Controller<M>::Config out;
    const auto set = [&](auto& to, const auto& of) {
      gather(to, [&](const LaneCase& c) { return of(c.controller); });
    };
    using Of = ControllerConfig<FiveBar<double>>;
    const Of& common = cases_->controller;
    out.mechanism = M(params([](const LaneCase& c) { return c.believed; }));
    out.mode = {common.mode.working, common.mode.assembly};
    out.law = common.law;
    out.reaching = common.reaching;
    out.reference.track = &track_;
    out.sample_time = common.sample_time;
    set(out.torque_lead, [](const Of& c) { return c.torque_lead; });
    set(out.torque_limit, [](const Of& c) { return c.torque_limit; });
    set(out.gains.lambda, [](const Of& c) { return c.gains.lambda; });
    set(out.gains.k, [](const Of& c) { return c.gains.k; });
    set(out.gains.layer, [](const Of& c) { return c.gains.layer; });
    set(out.gains.independent, [](const Of& c) { return c.gains.independent; });
    set(out.limits.min_abs_sin_type1, [](const Of& c) { return c.limits.min_abs_sin_type1; });
    set(out.limits.min_abs_sin_type2, [](const Of& c) { return c.limits.min_abs_sin_type2; });
    set(out.limits.joint_speed, [](const Of& c) { return c.limits.joint_speed; });
    set(out.limits.closure, [](const Of& c) { return c.limits.closure; });
    set(out.limits.workspace_x, [](const Of& c) { return c.limits.workspace_x; });
    set(out.limits.workspace_y, [](const Of& c) { return c.limits.workspace_y; });
    set(out.limits.joint_angle, [](const Of& c) { return c.limits.joint_angle; });
    set(out.limits.feedback_jump, [](const Of& c) {  // 0: any, which lanes do not tell from a number
      return c.limits.feedback_jump > 0.0 ? c.limits.feedback_jump : std::numeric_limits<double>::max();
    });
    return out;
  }

  void tick(std::uint32_t number) {
    const typename Plant::State state{System::angles(y_), System::rates(y_)};
    const auto theta = Plant::joint_angles(state.angle), w = Plant::joint_rates(state.rate);
    for (const std::size_t j : {0U, 2U}) {
      sample_.angle[static_cast<int>(j)] = theta[j];
      sample_.rate[static_cast<int>(j)] = w[j];
    }
    const TickResult<M> done = controller_.tick(sample_, supervisor_);
    record(number, plant_.output(state), done);
    advance(done.torque[0], done.torque[2]);
  }

  /// A tick of a driven case.
  void drive(std::uint32_t number) {
    if (settings_.every > 0 && number % settings_.every == 0) keep_state();
    std::array<L, 2> torque;
    for (int lane = 0; lane < n; ++lane) {
      for (std::size_t i = 0; i < 2; ++i) torque[i].v[lane] = cases_[lane].torque[2 * number + i];
    }
    advance(torque[0], torque[1]);
  }
  void keep_state() {
    const auto o = plant_.output({System::angles(y_), System::rates(y_)});
    for (int lane = 0; lane < n; ++lane) {
      double* to = cases_[lane].states + kept_;
      for (std::size_t i = 0; i < o.q.size(); ++i) {
        to[i] = o.q[i][lane];
        to[o.q.size() + i] = o.qd[i][lane];
      }
    }
    kept_ += 2 * static_cast<std::ptrdiff_t>(o.q.size());
  }

  /// The mechanism by one tick.
  void advance(L torque1, L torque2) {
    system_.torque = {torque1, L(0.0), torque2, L(0.0)};
    for (int i = 0; i < settings_.steps; ++i) stepper_.step(0.0, settings_.step, y_);
  }

  /// As Recorder::tick.
  void record(std::uint32_t number, const typename Plant::Output& o, const TickResult<M>& done) {
    const bool settled = number * settings_.tick >= settling_time;
    const Vec2<L>& x = done.desired_effector;
    const Planar<L> miss = o.effector - Planar<L>{x[0], x[1]};
    sums_.effector.add(settled, square_root(dot(miss, miss)));
    typename M::Pose desired;  // out of the true mechanism's reach: a stray lane
    if (!settings_.true_lengths) (void)true_.inverse(x, controller_.config().mode, desired);
    if (settings_.base_errors) {
      const Vec2<L> base = settings_.true_lengths ? done.desired_base() : M::base_angles(desired);
      for (std::size_t i = 0; i < 2; ++i)
        sums_.base.add(settled, magnitude(wrap_to_pi(L(o.q[2 + 2 * i] - base[static_cast<int>(i)]))));
    }
    const std::array<L, 2> torque{done.torque[0], done.torque[2]};
    L power = 0.0;
    for (std::size_t i = 0; i < 2; ++i) power += magnitude(torque[i] * o.qd[2 + 2 * i]);
    sums_.add(torque, power, done.saturated);
  }

  void put(LaneScore* out) const {
    const auto lane = [](const ErrorSums<L>& sums, int i) {
      const auto one = [i](const typename ErrorSums<L>::Moments& m) {
        return ErrorStatistics::Moments{m.square[i], m.largest[i], m.count};
      };
      return ErrorStatistics(one(sums.all()), one(sums.settled()));
    };
    for (int i = 0; i < n; ++i) {
      out[i].ok = fine_[i];
      RunSums<double>& s = out[i].sums;
      s.effector = lane(sums_.effector, i);
      s.base = lane(sums_.base, i);
      s.torque_max = sums_.torque_max[i];
      s.delta_sum = sums_.delta_sum[i];
      s.power_sum = sums_.power_sum[i];
      s.saturated_ticks = sums_.saturated_ticks[i];
      s.deltas = sums_.deltas;
    }
  }

  LaneSettings settings_;
  const LaneCase* cases_;
  M true_;
  Plant plant_;
  System system_;
  Rk4<System> stepper_;
  LaneTrack track_;
  Controller<M> controller_;
  Supervisor supervisor_;
  Sample<M> sample_;
  typename System::State y_;
  RunSums<L> sums_;
  Mask fine_{true};
  std::ptrdiff_t kept_ = 0;  // numbers
};

namespace {
struct Isa {};
}  // namespace

void ESMC_KERNEL(const LaneSettings& settings, const LaneCase* cases, LaneScore* out) {
  LaneLoop<Lanes<ESMC_LANES, Isa>>(settings, cases).run(out);
}

}  // namespace esmc::host
