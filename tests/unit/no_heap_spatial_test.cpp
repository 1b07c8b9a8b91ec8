/// Nor does a control tick in space touch the heap.

#include <gtest/gtest.h>

#include <memory>

#include "host_sim/spatial/controller.hpp"
#include "tests/support/heap_guard.hpp"

namespace {

using namespace esmc::host;
using esmc::Reaching;
using esmc::test::HeapGuard;

HexapodParams<double> platform() {
  HexapodParams<double> p;
  p.platform = {2, {0.03, 0.03, 0.05}};
  for (int j = 0; j < 6; ++j) {
    const double pair = 2.0943951 * (j / 2), side = j % 2 == 0 ? -1 : 1, low = pair + side * 0.85,
                 high = pair + side * 0.2;
    p.base[j] = {0.4 * std::cos(low), 0.4 * std::sin(low), 0};
    p.joint[j] = {0.2 * std::cos(high), 0.2 * std::sin(high), -0.03};
  }
  p.home = {0, 0, 0.5};
  p.cylinder = {0.1, 0.5, 0.002, 0.0002, 0};
  p.rod = {0.1, 0.3, 0.001, 0.0001, 1};
  p.gravity = 9.8;
  return p;
}

template <class M>
void live(const M& mechanism, const Vec3<double>& home) {
  for (const SpatialLaw law : {SpatialLaw::esmc, SpatialLaw::esmc_projected, SpatialLaw::smc_euler}) {
    for (const Reaching reaching :
         {Reaching::sign, Reaching::saturation, Reaching::tanh, Reaching::implicit}) {
      SpatialConfig<M> c;
      c.mechanism = mechanism;
      c.law = law;
      c.reaching = reaching;
      c.gains.point = c.gains.turn = {20, 40, 0.04};
      c.force_limit = c.moment_limit = 1e3;
      c.length = 0.2;
      const auto controller = std::make_unique<SpatialController<M>>(c);
      SpatialReference<double> reference;
      reference.kind = SpatialReferenceKind::sway;
      reference.position = home;
      reference.angle = 0.2;
      reference.rate = 6;
      reference.phase.per_tick = 1ULL << 54U;
      SpatialSample<double> sample{home, Vec3<double>::Zero(), {}, Vec3<double>::Zero()};
      int alive = 0;
      SpatialFault end{};
      {
        const HeapGuard guard;
        for (std::uint32_t n = 0; n < 20; ++n)
          alive += controller->tick(sample, reference.at(n, 1e-3)).fault == SpatialFault::none ? 1 : 0;
        sample.position[0] = std::numeric_limits<double>::quiet_NaN();
        end = controller->tick(sample, reference.at(20, 1e-3)).fault;
      }
      EXPECT_EQ(alive, 20);
      EXPECT_EQ(end, SpatialFault::not_finite);
    }
  }
}

TEST(NoHeapInSpace, InEveryLawAndReaching) {
  live(make_free_body<double>({2, {0.02, 0.03, 0.045}}, 9.8), Vec3<double>::Zero());
  live(make_hexapod(platform()), platform().home);
}

}  // namespace
