/// No control tick touches the heap: not in any law, state or fault.

#include <gtest/gtest.h>

#include <cstdlib>
#include <memory>
#include <new>
#include <string>
#include <vector>

#include "tests/support/cycle_rig.hpp"
#include "tests/support/heap_guard.hpp"

namespace {

using namespace esmc;
using test::HeapGuard;
using test::Rig;
using test::Setup;
using test::setup;

/// A full life under guard: enabling, 1000 running ticks, a fault, reset, enabling again, stop.
template <class M>
void live(const Setup<M>& s) {
  const auto rig = std::make_unique<Rig<M>>(s);
  int running = 0;
  bool failed = false, disabled = false;
  {
    const HeapGuard guard;
    (void)rig->start();
    for (int i = 0; i < 1000; ++i) {
      rig->sends_encoder[0] = i % 3 != 0;
      running += rig->tick().state == State::running ? 1 : 0;
    }
    rig->sends_encoder.fill(true);
    rig->error[0] = 1;
    failed = rig->tick().state == State::fault;
    rig->error[0] = 0;
    for (int i = 0; i < 3; ++i) rig->tick();
    rig->tick(Command::reset);
    (void)rig->start();
    rig->tick(Command::stop);
    disabled = rig->until(State::disabled);
  }
  EXPECT_EQ(running, 1000) << name(rig->cycle.supervisor().fault());
  EXPECT_TRUE(failed && disabled);
}

template <class M>
class NoHeap : public testing::Test {};
using Machines = testing::Types<FiveBar<double>, Rr<float>>;
TYPED_TEST_SUITE(NoHeap, Machines);

TYPED_TEST(NoHeap, InEveryLawReachingAndArrangement) {
  using S = typename TypeParam::Scalar;
  for (const LawKind law :
       {LawKind::esmc, LawKind::esmc_projected, LawKind::smc, LawKind::ctc, LawKind::pd}) {
    for (const Reaching reaching :
         {Reaching::sign, Reaching::saturation, Reaching::tanh, Reaching::implicit}) {
      for (const Motors motors : {Motors::base, Motors::all}) {
        for (const Sensors sensors : {Sensors::base, Sensors::all}) {
          auto s = setup<TypeParam>();
          s.controller.law = law;
          s.controller.reaching = reaching;
          s.controller.motors = motors;
          s.controller.allocate = allocation_for<TypeParam>(motors);
          s.controller.sensors = sensors;
          s.controller.join_ticks = 300;
          s.controller.torque_limit.setConstant(S(5));
          live(s);
        }
      }
    }
  }
}

TYPED_TEST(NoHeap, WithEveryOptionalPart) {
  using S = typename TypeParam::Scalar;
  for (const ReachingPart<TypeParam> reach :
       {&part::super_twisting<TypeParam>, &part::implicit_coupled<TypeParam>,
        &part::elbow_rotors<TypeParam>}) {
    auto s = setup<TypeParam>();
    s.controller.reach = reach;
    s.controller.observer = &part::momentum_observer<TypeParam>;
    s.controller.observer_bandwidth = S(50);
    s.controller.delay_ticks = S(2);
    s.controller.predict = &part::predictor<TypeParam>;
    s.controller.correct = &part::motor_map<TypeParam>;
    s.controller.motor_map.amplitude.setConstant(S(0.01));
    s.controller.motor_map.per_turn.setConstant(S(14));
    s.controller.torque_limit.setConstant(S(5));
    live(s);
  }
}

TYPED_TEST(NoHeap, OnEveryKindOfReference) {
  using S = typename TypeParam::Scalar;
  std::vector<PathSegment<S>> path(3);
  const Vec2<S> p = TypeParam::joints == 4 ? Vec2<S>(S(0), S(0.17)) : Vec2<S>(S(0.2), S(0.2));
  for (unsigned i = 0; i < 3; ++i) {
    path[i].start_tick = 100 * i;
    Motion2<S> here;
    here.position = p;
    path[i].curve = Quintic<S>::between(here, here, S(0.1));
  }
  for (const ReferenceKind kind :
       {ReferenceKind::hold_start, ReferenceKind::circle, ReferenceKind::sine, ReferenceKind::path}) {
    auto s = setup<TypeParam>();
    s.controller.reference.kind = kind;
    s.controller.reference.space = ReferenceSpace::effector;
    s.controller.reference.centre = p;
    s.controller.reference.amplitude = {S(0.01), S(0.01)};
    s.controller.reference.path = path;
    s.controller.reference.repeat_ticks = 300;
    live(s);
  }
}

/// The guard bites, at every door. `delete new int` and the like are optimised away: keep the pointer.
void* volatile kept = nullptr;

TEST(HeapGuardDeathTest, CatchesEveryWayToAllocate) {
  testing::FLAGS_gtest_death_test_style = "threadsafe";
  struct alignas(128) Wide {
    char c[128];
  };
  const std::vector<std::pair<const char*, void (*)()>> doors{
      {"malloc", [] { kept = std::malloc(1); }},
      {"calloc", [] { kept = std::calloc(1, 1); }},
      {"realloc", [] { kept = std::realloc(nullptr, 1); }},
      {"aligned_alloc", [] { kept = std::aligned_alloc(64, 64); }},
      {"posix_memalign",
       [] {
         void* p = nullptr;
         if (posix_memalign(&p, 64, 64) == 0) kept = p;
       }},
      {"new", [] { kept = new int(1); }},
      {"new[]", [] { kept = new int[3]; }},
      {"new, nothrow", [] { kept = new (std::nothrow) int(1); }},
      {"aligned new", [] { kept = new Wide; }},
      {"operator new", [] { kept = ::operator new(1); }},
      {"std::vector", [] { kept = std::vector<int>(100).data(); }},
      {"dynamic Eigen",
       [] {
         Eigen::MatrixXd m = Eigen::MatrixXd::Zero(5, 5);
         kept = m.data();
       }},
  };
  for (const auto& [door, open] : doors) {
    EXPECT_DEATH(
        {
          const HeapGuard guard;
          open();
        },
        "heap allocation under HeapGuard")
        << door;
    open();  // and lets through without a guard
  }
}

}  // namespace
