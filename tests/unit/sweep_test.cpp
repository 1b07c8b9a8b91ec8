/// Sweeps: which cases there are, what is kept of them, and that several at once have the bits of each alone.

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <set>

#include "host_sim/error.hpp"
#include "host_sim/record/run_options.hpp"
#include "host_sim/sweep/journal.hpp"
#include "host_sim/sweep/lanes/controller.hpp"
#include "host_sim/sweep/lanes/kernel.hpp"
#include "host_sim/sweep/lanes/lanes.hpp"
#include "host_sim/sweep/output.hpp"
#include "host_sim/sweep/runner.hpp"
#include "host_sim/sweep/sample.hpp"

namespace esmc::host {
namespace {

namespace fs = std::filesystem;

/// A folder that goes with the test.
class Scratch {
 public:
  Scratch() : path_(fs::temp_directory_path() / ("esmc_sweep_test_" + std::to_string(::getpid()))) {
    fs::create_directories(path_);
  }
  Scratch(const Scratch&) = delete;
  Scratch& operator=(const Scratch&) = delete;
  ~Scratch() { fs::remove_all(path_); }
  [[nodiscard]] std::string file(const std::string& name) const { return (path_ / name).string(); }
  std::string write(const std::string& name, const std::string& text) const {
    std::ofstream(file(name), std::ios::binary) << text;
    return file(name);
  }

 private:
  fs::path path_;
};

Axis range(double from, double to, std::uint64_t steps = 0) { return {0, from, to, false, steps, steps > 0}; }

TEST(SweepDesign, AGridHasEveryCombinationOnce) {
  const Design d(Sampling::grid, 1, 1, {{3, 0, 0, false, 0, true}, range(1.0, 2.0, 5)});
  ASSERT_EQ(d.cases(), 15U);
  std::set<std::pair<std::uint64_t, double>> seen;
  for (std::uint64_t i = 0; i < d.cases(); ++i) seen.emplace(d.chosen(i, 0), d.value(i, 1));
  EXPECT_EQ(seen.size(), 15U);
  EXPECT_EQ(d.value(0, 1), 1.0);
  EXPECT_EQ(d.value(4, 1), 2.0);
  EXPECT_EQ(d.value(2, 1), 1.5);
}

TEST(SweepDesign, ALogarithmicRangeHasEqualRatiosAndItsEnds) {
  Axis a = range(0.1, 1000.0, 5);
  a.logarithmic = true;
  const Design d(Sampling::grid, 1, 1, {a});
  EXPECT_EQ(d.value(0, 0), 0.1);
  EXPECT_EQ(d.value(4, 0), 1000.0);
  EXPECT_NEAR(d.value(2, 0), 10.0, 1e-12);
}

TEST(SweepDesign, LatinHypercubePutsOneSampleIntoEveryStratumOfEveryAxis) {
  for (const std::uint64_t n : {1U, 2U, 7U, 64U, 1000U}) {
    const Design d(Sampling::latin_hypercube, n, 42,
                   {range(0.0, 1.0), range(-1.0, 1.0), {4, 0, 0, false, 0, false}});
    ASSERT_EQ(d.cases(), n);
    std::vector<int> count(n, 0), second(n, 0);
    std::vector<std::uint64_t> listed(4, 0);
    for (std::uint64_t i = 0; i < n; ++i) {
      ++count[static_cast<std::size_t>(d.value(i, 0) * static_cast<double>(n))];
      ++second[static_cast<std::size_t>((d.value(i, 1) + 1.0) / 2.0 * static_cast<double>(n))];
      ++listed[d.chosen(i, 2)];
    }
    EXPECT_EQ(*std::min_element(count.begin(), count.end()), 1) << n;
    EXPECT_EQ(*std::min_element(second.begin(), second.end()), 1) << n;
    if (n % 4 == 0) {
      EXPECT_EQ(listed, std::vector<std::uint64_t>(4, n / 4)) << n;
    }
  }
}

TEST(SweepDesign, SamplesAreUniformIndependentAndDependOnTheSeed) {
  constexpr std::uint64_t n = 20000;
  const Design d(Sampling::random, n, 1, {range(0.0, 1.0), range(0.0, 1.0)});
  const Design other(Sampling::random, n, 2, {range(0.0, 1.0)});
  double x = 0.0, y = 0.0, xy = 0.0, z = 0.0;
  for (std::uint64_t i = 0; i < n; ++i) {
    const double a = d.value(i, 0) - 0.5, b = d.value(i, 1) - 0.5;
    x += a;
    y += b;
    xy += a * b;
    z += a * (other.value(i, 0) - 0.5);
  }
  // Standard deviations: sqrt(n / 12) = 41 of the sums, sqrt(n) / 12 = 12 of the products.
  EXPECT_LT(std::abs(x), 200.0);
  EXPECT_LT(std::abs(y), 200.0);
  EXPECT_LT(std::abs(xy), 60.0);
  EXPECT_LT(std::abs(z), 60.0);
}

TEST(SweepDesign, CrossedAxesMeetTheSameSamplesAtEachOfTheirPoints) {
  const Design d(Sampling::latin_hypercube, 10, 5, {range(0.0, 1.0), {3, 0, 0, false, 0, true}});
  ASSERT_EQ(d.cases(), 30U);
  for (std::uint64_t i = 0; i < 10; ++i) {
    EXPECT_EQ(d.value(i, 0), d.value(i + 10, 0));
    EXPECT_EQ(d.chosen(i + 20, 1), 2U);
  }
}

TEST(SweepDesign, MoreCasesThanAllowedAreNone) {
  const std::vector<Axis> grid(4, range(0.0, 1.0, 1000));
  EXPECT_EQ(Design(Sampling::grid, 1, 1, grid).cases(), 0U);
  EXPECT_EQ(Design(Sampling::random, Design::most_cases + 1, 1, {range(0, 1)}).cases(), 0U);
}

TEST(SweepPermutation, IsOne) {
  for (std::uint64_t size = 1; size < 70; ++size) {
    std::set<std::uint64_t> seen;
    for (std::uint64_t i = 0; i < size; ++i) seen.insert(permuted(3, 9, i, size));
    EXPECT_EQ(seen.size(), size);
    EXPECT_LT(*seen.rbegin(), size);
  }
}

TEST(SweepPareto, IsWhatNothingDominates) {
  for (std::uint64_t trial = 0; trial < 60; ++trial) {
    std::vector<std::vector<double>> points;
    for (std::uint64_t i = 0; i < 40; ++i) {
      std::vector<double> p;
      for (std::uint64_t c = 0; c < 2 + trial % 2; ++c)  // few values: with equal ones
        p.push_back(static_cast<double>(random_bits(trial, c, i) % 12));
      points.push_back(p);
    }
    points[7][0] = std::nan("");
    const auto dominated = [&](std::size_t i) {
      return std::any_of(points.begin(), points.end(), [&](const std::vector<double>& p) {
        bool better = false;
        for (std::size_t c = 0; c < p.size(); ++c) {
          if (!(p[c] <= points[i][c])) return false;
          better = better || p[c] < points[i][c];
        }
        return better;
      });
    };
    const auto front = pareto_front(points);
    std::set<std::vector<double>> expected, found;
    for (std::size_t i = 0; i < points.size(); ++i) {
      if (i != 7 && !dominated(i)) expected.insert(points[i]);
    }
    for (const std::size_t i : front) found.insert(points[i]);
    EXPECT_EQ(found, expected);
    EXPECT_EQ(front.size(), found.size());  // of equal points one
  }
}

std::vector<Finished> some_cases(std::uint64_t first, std::uint64_t count) {
  std::vector<Finished> out;
  for (std::uint64_t i = first; i < first + count; ++i)
    out.push_back({i, static_cast<std::uint32_t>(i % 3), {0.1 * double(i), -1.0}});
  return out;
}

TEST(SweepJournal, KeepsWholeRecordsWhereverAKillHasCutIt) {
  const Scratch scratch;
  const std::string file = scratch.file("journal");
  { Journal(file, 1, 100, 2).append(some_cases(0, 5)); }
  const auto whole = fs::file_size(file);
  constexpr std::uintmax_t record = 32, head = 32;
  ASSERT_EQ(whole, head + 5 * record);
  for (std::uintmax_t size = whole; size >= head; --size) {
    fs::resize_file(file, size);
    const Journal j(file, 1, 100, 2);
    ASSERT_EQ(j.found().size(), (size - head) / record) << size;
    EXPECT_EQ(fs::file_size(file), head + j.found().size() * record);
  }
}

TEST(SweepJournal, GoesOnBehindATornRecordAndAHeadCutShort) {
  const Scratch scratch;
  const std::string file = scratch.file("journal");
  { Journal(file, 1, 100, 2).append(some_cases(0, 5)); }
  std::ofstream(file, std::ios::app) << "torn";
  { Journal(file, 1, 100, 2).append(some_cases(5, 2)); }
  {
    const Journal j(file, 1, 100, 2);
    ASSERT_EQ(j.found().size(), 7U);
    EXPECT_EQ(j.found()[6].index, 6U);
    EXPECT_EQ(j.found()[6].values, (std::vector<double>{0.1 * 6.0, -1.0}));
    EXPECT_EQ(j.found()[5].outcome, 2U);
  }
  fs::resize_file(file, 9);
  EXPECT_TRUE(Journal(file, 1, 100, 2).found().empty());
}

TEST(SweepJournal, DropsWhatADiskHasChangedAndAllBehindIt) {
  const Scratch scratch;
  const std::string file = scratch.file("journal");
  { Journal(file, 1, 100, 2).append(some_cases(0, 5)); }
  std::fstream f(file, std::ios::in | std::ios::out | std::ios::binary);
  f.seekp(32 + 2 * 32 + 17);
  f.put('x');
  f.close();
  EXPECT_EQ(Journal(file, 1, 100, 2).found().size(), 2U);
}

TEST(SweepJournal, IsRefusedToAnotherSweepAndToASecondProcess) {
  const Scratch scratch;
  const std::string file = scratch.file("journal");
  {
    const Journal held(file, 1, 100, 2);
    EXPECT_THROW(Journal(file, 1, 100, 2), InputError);
  }
  { Journal(file, 1, 100, 2).append(some_cases(0, 5)); }
  EXPECT_THROW(Journal(file, 2, 100, 2), InputError);
  EXPECT_THROW(Journal(file, 1, 101, 2), InputError);
  EXPECT_THROW(Journal(file, 1, 100, 3), InputError);
  EXPECT_TRUE(Journal(file, 2, 100, 2, true).found().empty());
  EXPECT_TRUE(Journal(file, 2, 100, 2).found().empty());
  EXPECT_THROW(Journal(scratch.file("no/such/folder"), 1, 100, 2), InputError);
}

struct Here {};
using Pair = Lanes<2, Here>;  // what every processor has; the wider ones show in whole runs, below

TEST(SweepLanes, ElementaryFunctionsHaveTheBitsOfOneNumber) {
  std::vector<double> numbers{0.0,      -0.0,      1.0,          -1.0, 1e-310, -1e-310, 1e300, 1e-300,
                              HUGE_VAL, -HUGE_VAL, std::nan(""), 3.2,  -3.2,   1e4,     0.5,   2.0};
  for (std::uint64_t i = 0; i < 400; ++i)
    numbers.push_back((static_cast<double>(random_bits(1, 2, i) >> 11U) * 0x1p-52 - 1.0) *
                      (i % 2 == 0 ? 1.0 : 20.0));
  const auto same = [](double a, double b) {
    return std::bit_cast<std::uint64_t>(a) == std::bit_cast<std::uint64_t>(b) ||
           (std::isnan(a) && std::isnan(b));
  };
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    const std::array<double, 2> y{numbers[i], numbers[(i * 7 + 3) % numbers.size()]};
    const std::array<double, 2> x{numbers[(i * 5 + 1) % numbers.size()], -numbers[i]};
    const Pair a = arc_tangent2(Pair::load(y.data()), Pair::load(x.data())),
               w = wrap_to_pi(Pair::load(y.data())), t = hyperbolic_tangent(Pair::load(y.data())),
               u = angle_of_unit(Pair::load(y.data()), Pair::load(x.data())),
               s = sign_of(Pair::load(y.data())),
               c = saturated(Pair::load(y.data()), magnitude(Pair::load(x.data()))),
               m = -Pair::load(y.data());
    for (int k = 0; k < 2; ++k) {
      const double yk = y[static_cast<std::size_t>(k)], xk = x[static_cast<std::size_t>(k)];
      EXPECT_TRUE(same(a[k], arc_tangent2(yk, xk))) << yk << " " << xk;
      EXPECT_TRUE(same(u[k], angle_of_unit(yk, xk))) << yk << " " << xk;
      EXPECT_TRUE(same(w[k], wrap_to_pi(yk))) << yk;
      EXPECT_TRUE(same(t[k], hyperbolic_tangent(yk))) << yk;
      EXPECT_TRUE(same(s[k], sign_of(yk))) << yk;
      EXPECT_TRUE(same(c[k], saturated(yk, std::abs(xk)))) << yk << " " << xk;
      EXPECT_TRUE(same(m[k], -yk)) << yk;
      if (!(std::abs(yk) <= 1e4)) continue;
      const SinCos<Pair> sc = sin_cos(Pair::load(y.data()));
      EXPECT_TRUE(same(sc.sin[k], sin_cos(yk).sin) && same(sc.cos[k], sin_cos(yk).cos)) << yk;
    }
  }
}

TEST(SweepLanes, TorqueLimitIsThatOfOneNumber) {
  const std::array<double, 8> torques{0.0, -0.0, 3.0, -3.0, 5.0, -7.0, HUGE_VAL, std::nan("")};
  for (const double limit : {3.0, 0.0, -1.0, std::nan("")}) {
    for (std::size_t i = 0; i < torques.size(); i += 2) {
      Pair together = Pair::load(&torques[i]);
      const auto checks = limit_torque(together, Pair(limit));
      for (const std::size_t k : {0U, 1U}) {
        double alone = torques[i + k];
        const TorqueCheck check = esmc::limit_torque(alone, limit);
        for (const TorqueCheck c : {TorqueCheck::passed, TorqueCheck::limited, TorqueCheck::not_finite}) {
          EXPECT_EQ((checks == c)[static_cast<int>(k)], check == c) << torques[i + k] << " " << limit;
        }
        if (check != TorqueCheck::not_finite) {
          EXPECT_EQ(together[static_cast<int>(k)], alone);
        }
      }
    }
  }
}

TEST(SweepLanes, ABranchThatIsNotTakenIsNoted) {
  using Mask = Pair::Mask;
  Mask::stray = Mask::V{};
  const std::array<double, 2> v{1.0, -1.0};
  bool taken = false;
  if (!(Pair::load(v.data()) > Pair(0.0))) taken = true;
  EXPECT_FALSE(taken);
  const Mask noted(Mask::stray);
  EXPECT_FALSE(noted[0]);
  EXPECT_TRUE(noted[1]);
}

/// Every law and reaching law, a plant that is not what the controller believes, and settings bad enough for
/// some cases to fault.
std::string specification(const std::string& more) {
  return "scene = '" ESMC_SCENE
         "'\nset = ['simulation.duration=0.4', 'simulation.step=1e-3', 'control.layer=0.5']\n"
         "objectives = ['rms_m', 'max_m', 'settled_rms_m', 'settled_max_m', 'rms_rad', 'max_rad', "
         "'settled_rms_rad', "
         "'settled_max_rad', 'torque_max_nm', 'torque_activity_nm', 'saturated_ticks', 'energy_j', "
         "'faulted']\n" +
         more;
}
std::string vary(const std::string& key, const std::string& how) {
  return "[[vary]]\nkey = '" + key + "'\n" + how + "\n";
}

std::vector<Finished> run_all(const SweepSpec& spec, const CaseScenes& scenes, const LaneKernel* kernel) {
  CaseRunner runner(spec, scenes, kernel);
  Package all;
  for (std::uint64_t i = 0; i < spec.design.cases(); ++i) all.push_back(i);
  std::vector<Finished> out;
  EXPECT_TRUE(runner.run(all, out));
  std::sort(out.begin(), out.end(), [](const Finished& a, const Finished& b) { return a.index < b.index; });
  return out;
}

void expect_same(const std::vector<Finished>& a, const std::vector<Finished>& b) {
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a[i].outcome, b[i].outcome) << i;
    for (std::size_t c = 0; c < a[i].values.size(); ++c)
      EXPECT_EQ(std::bit_cast<std::uint64_t>(a[i].values[c]), std::bit_cast<std::uint64_t>(b[i].values[c]))
          << i << " " << c;
  }
}

const char* const uncertain = "[sample]\nmethod = 'latin_hypercube'\ncount = 3\nseed = 4\n";
std::string plant() {
  return vary("plant.legs.1.m1", "factor = [0.5, 1.5]") + vary("plant.legs.2.l2", "factor = [0.97, 1.03]") +
         vary("plant.effector_mass", "from = 0.0\nto = 0.3") +
         vary("control.gain", "from = 1\nto = 2000\nlog = true") +
         vary("control.lambda", "from = 5\nto = 200");
}

TEST(SweepLanes, EveryKernelGivesTheBitsOfEachCaseAlone) {
  const Scratch scratch;
  const std::string laws =
      vary("control.law", "values = ['esmc', 'esmc_projected', 'smc', 'ctc']\ncross = true");
  const std::string kinds =
      vary("control.reaching", "values = ['sign', 'saturation', 'tanh', 'implicit']\ncross = true");
  const std::string joint_springs = vary("control.law", "values = ['pd']\ncross = true") +
                                    vary("control.kp", "from = 1\nto = 60") +
                                    vary("control.kd", "from = 0.05\nto = 2");
  const std::string circles = vary("reference.radius", "from = 0.03\nto = 0.09") +
                              vary("reference.speed", "from = -9\nto = 9") +
                              vary("mechanism.leg.l1", "from = 0.11\nto = 0.13");
  for (const std::string& axes : {laws + kinds + plant(), joint_springs + plant(), circles + plant()}) {
    std::string text = specification(uncertain + axes);
    if (axes.starts_with(joint_springs))
      text.insert(text.find("'simulation.step"), "'control.kp=20', 'control.kd=0.5', ");
    const SweepSpec spec = read_sweep(scratch.write("spec.toml", text));
    const CaseScenes scenes(spec);
    const auto alone = run_all(spec, scenes, nullptr);
    EXPECT_GT(
        std::count_if(alone.begin(), alone.end(), [](const Finished& f) { return f.outcome == outcome_ok; }),
        0);
    for (const LaneKernel& kernel : lane_kernels()) {
      SCOPED_TRACE(kernel.name);
      expect_same(alone, run_all(spec, scenes, &kernel));
    }
  }
}

/// A program is timed with the model, the limits and the law: its reference is another one in each case,
/// however the cases are shared out.
TEST(SweepLanes, AProgramIsTimedForEachCase) {
  const Scratch scratch;
  std::string text = specification(uncertain + vary("control.torque_limit", "from = 0.8\nto = 1.6") +
                                   vary("limits.joint_speed", "values = [20.0, 60.0]\ncross = true"));
  text.insert(
      text.find("'simulation.step"),
      "'initial={at=\"reference\"}', 'reference={type=\"program\", from=[0.03, 0.17], moves=[{move=\"line\", "
      "to=[-0.03, 0.19]}, {move=\"line\", to=[0.03, 0.17]}]}', ");
  const SweepSpec spec = read_sweep(scratch.write("spec.toml", text));
  const CaseScenes scenes(spec);
  const auto alone = run_all(spec, scenes, nullptr);
  EXPECT_NE(alone[0].values[0], alone[1].values[0]);
  for (const LaneKernel& kernel : lane_kernels()) {
    SCOPED_TRACE(kernel.name);
    expect_same(alone, run_all(spec, scenes, &kernel));
    CaseRunner runner(spec, scenes, &kernel);  // one case after the other
    std::vector<Finished> out;
    for (std::uint64_t i = 0; i < alone.size(); ++i) EXPECT_TRUE(runner.run({i}, out));
    expect_same(alone, out);
  }
}

TEST(SweepLanes, AStoppedGroupIsNotDone) {
  const Scratch scratch;
  const SweepSpec spec = read_sweep(scratch.write("spec.toml", specification(uncertain + plant())));
  const CaseScenes scenes(spec);
  std::vector<double> torque(20, 0.0), state(12);
  std::vector<LaneJob> follows(1), driven(1);
  ASSERT_TRUE(make_lane_job(scenes.nominal(), spec.wanted, follows[0]));
  ASSERT_TRUE(make_driven_job(scenes.nominal(), 10, 0, driven[0]));
  driven[0].numbers.torque = torque.data();
  driven[0].numbers.states = state.data();
  for (const LaneKernel& kernel : lane_kernels()) {
    for (const auto& jobs : {follows, driven}) {
      for (const bool stop : {false, true}) {
        std::vector<LaneScore> scores;
        stop_requested() = stop;
        run_lane_jobs(kernel, jobs, scores);
        stop_requested() = false;
        EXPECT_EQ(scores[0].ok, !stop) << kernel.name;
      }
    }
  }
}

/// Also where more of the scene depends on a number than its field: belief, rotors, parts of the controller.
TEST(SweepScenes, SettingANumberIsReadingTheSceneAgain) {
  const Scratch scratch;
  std::string axes =
      plant() + vary("mechanism.half_base", "from = 0.04\nto = 0.06") +
      vary("plant.legs.2.J1", "factor = [0.5, 2]") + vary("mechanism.leg.lg1", "from = 0.05\nto = 0.07") +
      vary("control.model.m2", "from = 0.5\nto = 2") + vary("control.model.gravity", "from = 0.5\nto = 1.2") +
      vary("control.delay_ticks", "values = [1, 2, 3]") + vary("control.layer", "from = 0.01\nto = 1") +
      vary("reference.phase", "from = 0\nto = 6");
  const std::string leg = "l1=0.12, l2=0.16, lg1=0.06, lg2=0.068, m1=0.11, m2=0.1, J1=2e-4, J2=7e-4";
  for (const std::string& more :
       {std::string(), std::string("'control.predictor=true', 'control.delay_ticks=1', "),
        "'control.model.mechanism={type=\"five_bar\", half_base=0.05, gravity=9.8, working_mode=[\"+\", "
        "\"+\"], leg={" +
            leg + "}}', ",
        std::string("'mechanism.rotor_inertia=[1e-4, 2e-4]', "),
        std::string("'mechanism.rotor_inertia=[1e-4, 2e-4, 2e-4, 1e-4]', "),
        std::string("'effects=[{type=\"end_stops\", lower=[-1.0, -1.0], upper=[1.1, 1.6]}]', ")}) {
    SCOPED_TRACE(more);
    std::string text = specification("[sample]\nmethod = 'random'\ncount = 12\n" + axes +
                                     vary("plant.rotor_inertia.1", "values = [0.0, 3e-4]\ncross = true"));
    if (more.find("rotor") == std::string::npos) text.erase(text.rfind("[[vary]]"));
    text.insert(text.find("'simulation.step"), more);
    const SweepSpec spec = read_sweep(scratch.write("spec.toml", text));
    const CaseScenes set(spec);
    CaseScenes read(spec);
    read.read_always();
    expect_same(run_all(spec, set, nullptr), run_all(spec, read, nullptr));
  }
}

TEST(SweepScenes, ThePlantVariesAndTheControllerBelievesTheScene) {
  const Scratch scratch;
  const SweepSpec spec = read_sweep(
      scratch.write("spec.toml", specification(uncertain + vary("plant.legs.1.m1", "factor = [0.5, 0.6]") +
                                               vary("mechanism.leg.m2", "from = 0.2\nto = 0.3"))));
  CaseScenes scenes(spec);
  const Scene& s = scenes.at(1);
  const FiveBarParams<double> believed = believed_mechanism(s);
  EXPECT_EQ(believed.legs[0].m1, scenes.nominal().mechanism.legs[0].m1);
  EXPECT_LT(s.mechanism.legs[0].m1, 0.61 * believed.legs[0].m1);
  EXPECT_EQ(s.mechanism.legs[1].m1, believed.legs[1].m1);
  EXPECT_EQ(s.mechanism.legs[0].m2, believed.legs[0].m2);
  EXPECT_GT(believed.legs[1].m2, 0.19);
}

}  // namespace
}  // namespace esmc::host
