#include "host_sim/sweep/sweep.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <optional>

#include "host_sim/error.hpp"
#include "host_sim/parallel.hpp"
#include "host_sim/record/digest.hpp"
#include "host_sim/record/finish.hpp"
#include "host_sim/record/output.hpp"
#include "host_sim/record/recording.hpp"
#include "host_sim/record/run_options.hpp"
#include "host_sim/sweep/output.hpp"
#include "host_sim/sweep/ranks.hpp"
#include "host_sim/sweep/work.hpp"
#include "host_sim/version.hpp"

namespace esmc::host {
namespace {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

constexpr const char* journal_name = "sweep.journal";

/// Of all threads of this process, s.
double cpu_time() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

/// Files that cases read besides the scene's own.
std::vector<std::string> varied_files(const SweepSpec& spec) {
  std::vector<std::string> out;
  for (const Vary& v : spec.vary) {
    if (v.key != "reference.path" && v.key != "control.model.mechanism" && v.key != "drives.endpoints")
      continue;
    for (const SweepValue& value : v.values) {
      if (const auto* name = std::get_if<std::string>(&value))
        out.push_back((fs::path(spec.scene).parent_path() / *name).string());
    }
  }
  return out;
}

std::uint64_t identity_of(const SweepSpec& spec, const Scene& scene) {
  std::uint64_t text = fnv(fnv(fnv_start, spec.text), scene_digest(scene));
  for (const std::string& file : varied_files(spec)) {  // other values are in the text already
    std::error_code error;
    if (!fs::is_regular_file(file, error)) continue;
    std::ifstream in(file, std::ios::binary);
    text = fnv(text, std::string(std::istreambuf_iterator<char>(in), {}));
  }
  return fnv(text, fmt::format("{} {}", version, program_hash));
}

/// Wall-clock figures, apart from everything that is repeatable.
Json timing(const SweepOptions& o, const WorkerConfig& config, const Ranks* ranks, std::size_t cases,
            double duration, double wall_s, double cpu_s) {
  const int processes = ranks != nullptr ? ranks->size() : 1, workers = processes * config.jobs;
  const double simulated = static_cast<double>(cases) * duration;
  return {
      {"command", o.command_line},
      {"cases", cases},
      {"wall_s", wall_s},
      {"processes", processes},
      {"threads_each", config.jobs},
      {"lanes",
       config.kernel != nullptr ? fmt::format("{} x {}", config.kernel->lanes, config.kernel->name) : "none"},
      {"cases_per_s", static_cast<double>(cases) / wall_s},
      {"simulated_s_per_core_s", simulated / wall_s / workers},
      {"cpu_s", ranks == nullptr ? Json(cpu_s) : Json(nullptr)},
      {"simulated_s_per_cpu_s", ranks == nullptr ? Json(simulated / cpu_s) : Json(nullptr)}};
}

class Sweep {
 public:
  Sweep(const SweepOptions& o, const SweepSpec& spec, const CaseScenes& scenes, std::uint64_t identity)
      : o_(o), spec_(spec), scenes_(scenes), out_(o.out) {
    table_.columns = spec.wanted.size();
    const auto cases = static_cast<std::size_t>(spec.design.cases());
    table_.values.resize(cases * table_.columns);
    table_.outcome.resize(cases, outcome_not_run);
    done_.assign(cases, false);
    if (!out_.wanted()) return;
    out_.spare(o.spec);
    out_.spare(spec.scene);
    for (const std::string& file : varied_files(spec)) out_.spare(file);
    const std::string file = (fs::path(o.out) / journal_name).string();
    journal_.emplace(file, identity, cases, table_.columns, o.restart);
    keep(journal_->found());
    found_ = journal_->found().size();
  }

  int run(const WorkerConfig& config, Ranks* ranks) {
    if (found_ > 0 && !o_.json) fmt::print("{} of {} cases were done before\n", found_, done_.size());
    std::fflush(stdout);
    const auto begin = std::chrono::steady_clock::now();
    const double cpu_before = cpu_time();
    const auto workers = static_cast<std::size_t>(config.jobs * (ranks != nullptr ? ranks->size() : 1));
    std::size_t now = found_;
    {
      WorkList list(done_, workers, [&](const std::vector<Finished>& cases) {
        if (journal_) journal_->append(cases);
        keep(cases);
        now += cases.size();
      });
      work_off(list, config, ranks);
    }
    const double wall_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    if (now < done_.size()) {
      const Json summary = sweep_summary(spec_, scenes_, table_);
      print(summary);
      throw Interrupted(fmt::format("interrupted after {} of {} cases, which the summary is of{}", now,
                                    done_.size(), journal_ ? "; the same command goes on from there" : ""));
    }
    finish(timing(o_, config, ranks, now - found_, scenes_.mean_duration(), wall_s, cpu_time() - cpu_before));
    return 0;
  }

 private:
  void print(const Json& summary) const {
    if (o_.capture != nullptr) {
      o_.capture->document = document_text(summary);
    } else {
      fmt::print("{}", o_.json ? document_text(summary) : sweep_text(summary));
    }
  }
  void keep(const std::vector<Finished>& cases) {
    for (const Finished& f : cases) {
      std::copy(f.values.begin(), f.values.end(),
                table_.values.begin() + static_cast<std::ptrdiff_t>(f.index * table_.columns));
      table_.outcome[f.index] = f.outcome;
      done_[f.index] = true;
    }
  }

  void finish(const Json& timing) {
    const Json summary = sweep_summary(spec_, scenes_, table_);
    if (out_.wanted()) {
      out_.write("sweep.toml", spec_.text_of_run);
      write_scene(scenes_.nominal(), out_);
      write_cases(out_.path("cases.csv"), spec_, scenes_, table_);
      out_.write("summary.json", document_text(summary));
      out_.write("report.html", sweep_page(spec_, scenes_, table_, summary));
      out_.write("timing.json", document_text(timing));
      if (std::ranges::count(spec_.wanted, Objective::tick_ns) > 0)
        write_timing(out_.path("timing.csv"), spec_, table_);
      out_.commit();
      journal_->remove();
    }
    print(summary);
    if (o_.json) return;
    const Json& rate = timing[timing["cpu_s"].is_null() ? "simulated_s_per_core_s" : "simulated_s_per_cpu_s"];
    fmt::print(
        "{:.3g} s: {:.0f} cases/s, {:.0f} simulated seconds per core-second ({} x {} threads, lanes: {})\n",
        timing["wall_s"].get<double>(), timing["cases_per_s"].get<double>(), rate.get<double>(),
        timing["processes"].get<int>(), timing["threads_each"].get<int>(),
        timing["lanes"].get<std::string>());
    if (out_.wanted()) fmt::print("report: {}\n", (fs::path(out_.directory()) / "report.html").string());
  }

  const SweepOptions& o_;
  const SweepSpec& spec_;
  const CaseScenes& scenes_;
  OutputDirectory out_;
  std::optional<Journal> journal_;
  SweepTable table_;
  std::vector<bool> done_;
  std::size_t found_ = 0;
};

/// `broadcast`: set once the other processes have the job; they will then be told when to end.
int run_with(const SweepOptions& o, Ranks* ranks, bool& broadcast) {
  const SweepSpec spec = read_sweep(o.spec);
  const CaseScenes scenes(spec);
  const WorkerConfig config{&spec, &scenes, o.jobs > 0 ? o.jobs : (ranks != nullptr ? 1 : processors()),
                            o.scalar ? nullptr : &lane_kernels().front()};
  const std::uint64_t identity = identity_of(spec, scenes.nominal());
  if (ranks != nullptr && ranks->rank() > 0) {
    serve(config, *ranks, identity);
    return 0;
  }
  Sweep sweep(o, spec, scenes, identity);
  if (ranks != nullptr) broadcast_job(*ranks, identity);
  broadcast = true;
  return sweep.run(config, ranks);
}

}  // namespace

int run_sweep(const SweepOptions& o) {
  const auto ranks = join_ranks();
  bool broadcast = false;
  try {
    return run_with(o, ranks.get(), broadcast);
  } catch (const std::exception&) {
    if (ranks != nullptr && ranks->rank() == 0 && !broadcast) finish_workers(*ranks);
    if (ranks == nullptr || ranks->rank() == 0) throw;
  }
  std::string message;
  (void)ranks->receive(message, true);
  // 'x': the first process has found the same error and reports it; a failing status here would let mpirun
  // end it before.
  if (message[0] == 'x') return 0;
  ranks->send(0, "eprocess " + std::to_string(ranks->rank()) + " cannot read what the first one has read");
  return 2;
}

}  // namespace esmc::host
