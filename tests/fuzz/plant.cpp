#include "tests/fuzz/plant.hpp"

#include <cmath>

#include "firmware/control/reduced.hpp"
#include "firmware/cycle/estimate.hpp"
#include "tests/support/cycle_setup.hpp"

namespace esmc {
namespace {

/// Base joints 1 ms on, semi-implicit. False where that does not close.
template <class M>
bool step(const M& m, const typename M::Mode& mode, Vec2<typename M::Scalar>& angle,
          Vec2<typename M::Scalar>& rate, const Vec2<typename M::Scalar>& torque, typename M::Pose& pose,
          typename M::Rates& rates) {
  using S = typename M::Scalar;
  constexpr S h = static_cast<S>(1e-3L);
  if (!estimate_from_base(m, mode, angle, rate, pose, rates)) return false;
  const auto bias = m.channel_accelerations(pose, rates, m.base_accelerations(pose, rates, Vec2<S>::Zero()));
  const Vec2<S> acceleration = Reduced<M>(m, pose).solve(torque - m.base_torque(pose, m.force(bias, rates)));
  const Vec2<S> turning = rate + acceleration * h, turned = angle + turning * h;
  if (!(std::fabs(turning[0]) < S(1000) && std::fabs(turning[1]) < S(1000))) return false;
  if (!estimate_from_base(m, mode, turned, turning, pose, rates)) return false;
  angle = turned;
  rate = turning;
  return true;
}

}  // namespace

extern "C" void move_five_bar(std::array<double, 4>& angle, std::array<double, 4>& rate,
                              const std::array<double, 4>& torque) {
  using M = FiveBar<float>;
  static const M m = [] {
    FiveBarParams<float> p{.l0 = static_cast<float>(test::half_base), .m0 = 0.05F, .g = 9.8F, .legs = {}};
    const auto l1 = static_cast<float>(test::bar1), l2 = static_cast<float>(test::bar2);
    p.legs[0] = {l1, l2, 0.06F, 0.068F, 0.1F, 0.11F, 2e-4F, 7e-4F, 0.01F, 0.012F, 0.0F, 0.0F};
    p.legs[1] = {l1, l2, 0.058F, 0.07F, 0.12F, 0.1F, 2.2e-4F, 6.5e-4F, 0.011F, 0.01F, 0.0F, 0.0F};
    return M(p);
  }();
  const auto f = [](double v) { return static_cast<float>(v); };
  Vec2<float> base(f(angle[0]), f(angle[2])), turning(f(rate[0]), f(rate[2]));
  M::Pose pose;
  M::Rates rates;
  const M::Mode mode{{{1, 1}}, -1};
  if (!estimate_from_base(m, mode, base, turning, pose, rates)) return;
  const Vec2<float> gathered =
      m.gather_on_base(pose, Vec2<float>::Zero(),
                       {{Vec2<float>(f(torque[0]), f(torque[1])), Vec2<float>(f(torque[2]), f(torque[3]))}});
  if (!step(m, mode, base, turning, gathered, pose, rates)) return;
  const auto all = M::angles(pose);
  for (std::size_t i = 0; i < 4; ++i) {
    angle[i] = static_cast<double>(all[static_cast<int>(i)]);
    rate[i] = static_cast<double>(rates.leg[static_cast<int>(i / 2)][static_cast<int>(i % 2)]);
  }
}

extern "C" void move_rr(std::array<double, 2>& angle, std::array<double, 2>& rate,
                        const std::array<double, 2>& torque) {
  using M = Rr<double>;
  static const M m(
      RrParams<double>{{0.2, 0.15, 0.09, 0.07, 0.4, 0.3, 2e-3, 1e-3, 0.01, 0.01, 0.0, 0.0}, 9.8});
  Vec2<double> base(angle[0], angle[1]), turning(rate[0], rate[1]);
  M::Pose pose;
  M::Rates rates;
  if (!step(m, M::Mode{1}, base, turning, Vec2<double>(torque[0], torque[1]), pose, rates)) return;
  angle = {base[0], base[1]};
  rate = {turning[0], turning[1]};
}

}  // namespace esmc
