/// A plant is integrated between control ticks: no method touches the heap in a step.

#include <gtest/gtest.h>

#include <memory>

#include "host_sim/integrate/dopri5.hpp"
#include "host_sim/integrate/dopri8.hpp"
#include "host_sim/integrate/fixed_step.hpp"
#include "host_sim/integrate/radau5.hpp"
#include "tests/support/heap_guard.hpp"
#include "tests/support/systems.hpp"

namespace esmc::test {
namespace {

template <class M>
void adaptive(const Kepler& kepler) {
  const auto method = std::make_unique<M>(kepler);
  auto y = kepler.start();
  host::Advance a;
  {
    const HeapGuard guard;
    method->step(0.0, 0.01, y);
    a = method->advance(0.01, 1.0, y, {1e-8, 1e-8});
  }
  EXPECT_TRUE(a.ok);
}

TEST(NoHeap, Integrators) {
  const Kepler kepler;
  host::SemiImplicitEuler<Kepler> euler(kepler);
  host::Rk4<Kepler> rk4(kepler);
  auto y = kepler.start();
  {
    const HeapGuard guard;
    euler.step(0.0, 0.01, y);
    rk4.step(0.01, 0.01, y);
  }
  EXPECT_LT(kepler.error(0.02, y), 1e-2);
  adaptive<host::Dopri5<Kepler>>(kepler);
  adaptive<host::Dopri8<Kepler>>(kepler);
  adaptive<host::Radau5<Kepler>>(kepler);
}

}  // namespace
}  // namespace esmc::test
