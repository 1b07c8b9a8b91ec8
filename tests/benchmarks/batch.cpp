// Simulated seconds per second of processor time, of one thread, for the cases of a sweep's specification: by
// the lanes of host_sim/sweep/lanes and by the yardstick beside them, in turns. Prints JSON.
// usage: batch SPEC CASES ROUNDS
//        batch SPEC trace lanes|yardstick    instructions of a tick of eight mechanisms, by address in this
//        file
#include <fmt/format.h>
#include <sys/ptrace.h>
#include <sys/user.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstdlib>
#include <ctime>
#include <exception>
#include <fstream>
#include <limits>
#include <map>
#include <string>

#include "host_sim/sweep/cases.hpp"
#include "host_sim/sweep/lanes/cases.hpp"
#include "tests/benchmarks/batch_yardstick.hpp"

namespace esmc::bench {
namespace {

using Jobs = std::vector<host::LaneJob>;

/// `track` must live as long as the jobs run.
std::vector<Jobs> jobs_of(const host::SweepSpec& spec, std::size_t cases, host::SharedTrack& track) {
  host::CaseScenes scenes(spec);
  std::vector<Jobs> out;
  for (std::size_t i = 0; i < cases; ++i) {
    if (i % batch_lanes == 0) out.emplace_back();
    host::LaneJob job;
    if (i > 0) job.bundle = out.front().front().bundle;
    if (!host::make_lane_job(scenes.at(i), spec.wanted, job))
      throw std::runtime_error("a case does not fit the lanes");
    out.back().push_back(job);
  }
  for (Jobs& jobs : out) host::share_reference(jobs, track);
  return out;
}

template <class F>
double seconds(const F& f) {
  const std::clock_t begin = std::clock();
  f();
  return static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC;
}

/// Cycles per second, by additions that wait for each other, a cycle each.
double clock_rate() {
  constexpr long additions = 200'000'000;
  double best = 0.0;
  for (int round = 0; round < 3; ++round) {
    const double took = seconds([] {
      long left = additions / 10;
      asm volatile(
          "1: add $1, %%rax\n add $1, %%rax\n add $1, %%rax\n add $1, %%rax\n add $1, %%rax\n"
          "add $1, %%rax\n add $1, %%rax\n add $1, %%rax\n add $1, %%rax\n add $1, %%rax\n"
          "dec %0\n jnz 1b"
          : "+r"(left)
          :
          : "rax", "cc");
    });
    best = std::max(best, static_cast<double>(additions) / took);
  }
  return best;
}

/// Where this program's file begins in the memory of a process.
std::uint64_t base_of(pid_t process) {
  std::ifstream maps(fmt::format("/proc/{}/maps", process));
  std::uint64_t base = 0;
  maps >> std::hex >> base;
  return base;
}

/// Runs `work` with a short and a long run in another process, instruction by instruction, and prints how
/// often each was executed per tick.
template <class F>
int trace(const F& work) {
  constexpr std::uint32_t few = 64, more = 64;  // a block of references
  const pid_t child = ::fork();
  if (child == 0) {
    ::ptrace(PTRACE_TRACEME, 0, nullptr, nullptr);
    for (const std::uint32_t ticks : {few, few + more}) {
      ::raise(SIGUSR1);
      work(ticks);
    }
    ::raise(SIGUSR1);
    ::_exit(0);
  }
  int status = 0, part = 0;
  std::map<std::uint64_t, long> count[2];
  ::waitpid(child, &status, 0);
  const std::uint64_t base = base_of(child);
  while (WIFSTOPPED(status)) {
    if (WSTOPSIG(status) == SIGUSR1 && ++part == 3) break;
    user_regs_struct registers{};
    ::ptrace(PTRACE_GETREGS, child, nullptr, &registers);
    ++count[part - 1][registers.rip - base];
    ::ptrace(PTRACE_SINGLESTEP, child, nullptr, nullptr);
    ::waitpid(child, &status, 0);
  }
  ::kill(child, SIGKILL);
  ::waitpid(child, &status, 0);
  std::string out;
  for (const auto& [address, n] : count[1]) {
    const double per_tick = static_cast<double>(n - count[0][address]) / more;
    if (per_tick != 0.0) out += fmt::format("{}\"{:x}\": {:.6g}", out.empty() ? "" : ", ", address, per_tick);
  }
  fmt::print("{{{}}}\n", out);
  return out.empty() ? 1 : 0;
}

int trace_one(const char* file, bool yardstick) {
  const host::SweepSpec spec = host::read_sweep(file);
  host::SharedTrack track;
  const Jobs jobs = jobs_of(spec, batch_lanes, track).front();
  std::array<host::LaneCase, batch_lanes> cases;
  for (std::size_t i = 0; i < cases.size(); ++i) cases[i] = jobs[i].numbers;
  return trace([&](std::uint32_t ticks) {
    host::LaneSettings s = jobs.front().settings;
    s.ticks = ticks;
    std::array<host::LaneScore, batch_lanes> scores;
    BatchScore sum{};
    if (yardstick) {
      batch_yardstick(s, cases.data(), sum);
    } else {
      host::lane_kernels().front().run(s, cases.data(), scores.data());
    }
  });
}

/// All cases by a yardstick. `apart`: becomes the largest relative difference of an error from `scores`.
void run_all(decltype(batch_yardstick) yardstick, const std::vector<Jobs>& all,
             const std::vector<host::LaneScore>& scores, double& apart) {
  for (std::size_t g = 0; g < all.size(); ++g) {
    std::array<host::LaneCase, batch_lanes> cases;
    for (std::size_t i = 0; i < cases.size(); ++i) cases[i] = all[g][std::min(i, all[g].size() - 1)].numbers;
    BatchScore sum{};
    const host::LaneSettings& s = all[g].front().settings;
    yardstick(s, cases.data(), sum);
    for (std::size_t i = 0; i < all[g].size(); ++i) {
      const double rms = scores[g * batch_lanes + i].sums.effector.all().rms();
      apart = std::max(apart, std::abs(std::sqrt(sum[i] / s.ticks) / rms - 1.0));
    }
  }
}

int run(const char* file, std::size_t cases, int rounds) {
  const host::LaneKernel& kernel = host::lane_kernels().front();
  if (kernel.lanes != batch_lanes) {
    fmt::print("{{\"lanes\": {}}}\n", kernel.lanes);
    return 0;
  }
  const host::SweepSpec spec = host::read_sweep(file);
  host::SharedTrack track;
  const std::vector<Jobs> all = jobs_of(spec, cases, track);
  const host::LaneSettings& s = all.front().front().settings;
  double lanes = std::numeric_limits<double>::max(), yardstick = lanes, rounded = lanes;
  std::array<double, 2> apart{};
  std::vector<host::LaneScore> scores(cases);
  for (int round = 0; round < rounds; ++round) {
    lanes = std::min(lanes, seconds([&] {
                       std::vector<host::LaneScore> some;
                       for (std::size_t g = 0; g < all.size(); ++g) {
                         host::run_lane_jobs(kernel, all[g], some);
                         std::copy(some.begin(), some.end(),
                                   scores.begin() + static_cast<std::ptrdiff_t>(g * batch_lanes));
                       }
                     }));
    yardstick = std::min(yardstick, seconds([&] { run_all(batch_yardstick, all, scores, apart[0]); }));
    rounded = std::min(rounded, seconds([&] { run_all(batch_rounded, all, scores, apart[1]); }));
  }
  const double simulated = static_cast<double>(cases) * s.ticks * s.tick;
  fmt::print(
      R"({{"lanes": {}, "sweep_lanes": {:.6g}, "yardstick": {:.6g}, "rounded": {:.6g}, "apart": {:.3g}, )"
      R"("rounded_apart": {:.3g}, "clock": {:.5g}}})"
      "\n",
      kernel.lanes, simulated / lanes, simulated / yardstick, simulated / rounded, apart[0], apart[1],
      clock_rate());
  return 0;
}

}  // namespace
}  // namespace esmc::bench

int main(int argc, char** argv) try {
  if (argc != 4) return 2;
  if (argv[2] == std::string("trace")) return esmc::bench::trace_one(argv[1], argv[3][0] == 'y');
  return esmc::bench::run(argv[1], static_cast<std::size_t>(std::atoi(argv[2])), std::atoi(argv[3]));
} catch (const std::exception& e) {
  fmt::print(stderr, "{}\n", e.what());
  return 1;
}
