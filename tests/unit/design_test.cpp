// Robust design: what it promises, judged by plants that it has never seen the equations of.

#include <gtest/gtest.h>

#include "tests/support/robust_problem.hpp"

namespace esmc::test {
namespace {

using host::design::design;
using host::design::Design;
using host::design::Problem;

struct Outcome {
  int designs = 0, trials = 0;
  Real worst = -1e9L;  ///< slack
  std::uint64_t seed = 0;
};

template <class M>
Outcome try_designs(LawKind law, std::uint64_t first, int designs, int random, int climbs) {
  Outcome out;
  for (std::uint64_t seed = first; seed < first + static_cast<std::uint64_t>(designs); ++seed) {
    const auto p = random_problem(seed, law, static_cast<M*>(nullptr));
    const Design<M> d = design(p);
    if (!d.refused.empty()) continue;
    ++out.designs;
    const Trials<M> trials(p, d);
    Random r(seed ^ 0x7a1U);
    const auto take = [&](const Trial& t) {
      const Verdict v = trials.judge(t);
      if (!v.valid) return;
      ++out.trials;
      if (v.slack > out.worst) {
        out.worst = v.slack;
        out.seed = seed;
      }
    };
    for (int i = 0; i < random; ++i) take(random_trial(r, p.points.size()));
    for (int i = 0; i < climbs; ++i) take(trials.worst_near(random_trial(r, p.points.size()), 5));
  }
  return out;
}

template <class M>
void expect_kept(LawKind law, int random, int climbs) {
  const Outcome o =
      try_designs<M>(law, 1, 12, random, climbs);  // all modes of the five-bar, every cause alone
  EXPECT_GE(o.designs, 8);
  EXPECT_GE(o.trials, 6 * random);
  EXPECT_LE(o.worst, 0) << "seed " << o.seed;
  ::testing::Test::RecordProperty("needed_over_used", std::to_string(1 + o.worst));
  EXPECT_GE(o.worst, -0.95L) << "gains twenty times too large would pass every trial";
}

TEST(Design, PromiseOfTheProjectedLawIsKeptByTruePlantsFiveBar) {
  expect_kept<FiveBar<double>>(LawKind::esmc_projected, 40, 1);
}
TEST(Design, PromiseOfTheProjectedLawIsKeptByTruePlantsRr) {
  expect_kept<Rr<double>>(LawKind::esmc_projected, 100, 2);
}
TEST(Design, PromiseOfSmcIsKeptByTruePlantsFiveBar) { expect_kept<FiveBar<double>>(LawKind::smc, 40, 1); }
TEST(Design, PromiseOfSmcIsKeptByTruePlantsRr) { expect_kept<Rr<double>>(LawKind::smc, 100, 2); }

}  // namespace
}  // namespace esmc::test
