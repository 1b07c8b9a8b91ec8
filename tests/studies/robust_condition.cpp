// The promise of robust designs against plants from outside, at length: random trials and climbs to worse
// ones, per law and mechanism. Prints rows of a table; docs/robust-design.md has them. usage:
// robust_condition TRIALS

#include <fmt/format.h>

#include <cstdlib>
#include <vector>

#include "tests/support/robust_problem.hpp"

namespace esmc::test {
namespace {

template <class M>
void study(const char* mechanism, const char* name, LawKind law, int trials) {
  constexpr int designs = 40, climbs = 5, rounds = 6;
  int made = 0, broken = 0;
  long random = 0, climbed = 0;
  std::vector<Real> need;
  for (std::uint64_t seed = 1000; seed < 1000 + designs; ++seed) {
    const auto p = random_problem(seed, law, static_cast<M*>(nullptr));
    const auto d = host::design::design(p);
    if (!d.refused.empty()) continue;
    ++made;
    const Trials<M> judge(p, d);
    Random r(seed ^ 0xabcdU);
    Real worst = -1;
    Trial from;
    const auto take = [&](const Trial& t, long& count) {
      const Verdict v = judge.judge(t);
      if (!v.valid) return;
      ++count;
      if (v.slack > 0) ++broken;
      if (v.slack > worst) {
        worst = v.slack;
        from = t;
      }
    };
    for (int i = 0; i < trials / designs; ++i) take(random_trial(r, p.points.size()), random);
    for (int i = 0; i < climbs; ++i)
      take(judge.worst_near(i == 0 ? from : random_trial(r, p.points.size()), rounds), climbed);
    need.push_back(1 + worst);
  }
  std::sort(need.begin(), need.end());
  const auto at = [&](double share) {
    return need.empty() ? 0.0
                        : static_cast<double>(
                              need[static_cast<std::size_t>(share * static_cast<double>(need.size() - 1))]);
  };
  fmt::print("| {} | `{}` | {} | {} | {} | {} | {:.2f} | {:.2f} | {:.3f} |\n", mechanism, name, made, random,
             climbed, broken, at(0), at(0.5), at(1));
  std::fflush(stdout);
}

}  // namespace
}  // namespace esmc::test

int main(int argc, char** argv) {
  using namespace esmc;
  const int trials = argc > 1 ? std::atoi(argv[1]) : 30000;
  test::study<Rr<double>>("rr", "smc", LawKind::smc, trials);
  test::study<Rr<double>>("rr", "esmc_projected", LawKind::esmc_projected, trials);
  test::study<FiveBar<double>>("five_bar", "smc", LawKind::smc, trials);
  test::study<FiveBar<double>>("five_bar", "esmc_projected", LawKind::esmc_projected, trials);
  test::study<Rr<double>>("rr", "esmc", LawKind::esmc, trials / 5);
  test::study<FiveBar<double>>("five_bar", "esmc", LawKind::esmc, trials / 5);
  return 0;
}
