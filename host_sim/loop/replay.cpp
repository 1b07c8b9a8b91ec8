#include <fmt/format.h>

#include <cmath>

#include "host_sim/bus/frame_log.hpp"
#include "host_sim/error.hpp"
#include "host_sim/loop/run.hpp"
#include "host_sim/record/comparison.hpp"
#include "host_sim/record/output.hpp"
#include "host_sim/record/recording.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {
namespace {

using Json = nlohmann::ordered_json;

std::string frame_text(const std::optional<hal::CanFrame>& f) {
  if (!f) return "nothing";
  const std::string line = candump_line(0, "x", *f);
  return line.substr(line.rfind(' ') + 1);
}

Difference difference_of(const RecordedBus::Deviation& d, double tick) {
  const hal::CanFrame& f = d.recorded ? *d.recorded : *d.computed;
  const std::string text = frame_text(f);
  return {"frames.log",
          d.line,
          static_cast<std::uint64_t>(std::floor(static_cast<double>(d.time_us) * 1e-6 / tick + 1e-9)),
          "frame " + text.substr(0, text.find('#')),
          frame_text(d.recorded),
          frame_text(d.computed)};
}

std::string text_of(const Difference& d) {
  std::string out = d.file;
  if (d.line > 0) out += fmt::format(":{}", d.line);
  if (d.tick) out += fmt::format(": tick {}", *d.tick);
  return fmt::format("{}: {}: recorded {}, computed {}", out, d.what, d.recorded, d.computed);
}

Json json_of(const Difference& d) {
  return {{"file", d.file},
          {"line", d.line > 0 ? Json(d.line) : Json(nullptr)},
          {"tick", d.tick ? Json(*d.tick) : Json(nullptr)},
          {"what", d.what},
          {"recorded", d.recorded},
          {"computed", d.computed}};
}

int run_again(const Recording& r, const RunOptions& o) {
  if (r.command == "sim") return run_sim(o);
  if (r.command == "controller") return run_controller(o);
  return r.command == "plant" || r.realtime ? run_plant(o) : run_hil(o);
}

/// What was compared, in words.
std::string coverage(const Recording& r, const Comparison& c, std::uint64_t frames) {
  std::string out = fmt::format("{} ticks", r.ticks);
  if (r.command != "sim") out += fmt::format(", {} frames", frames);
  if (c.same_digest() && r.summary["digest"].is_string())
    out += ", digest " + r.summary["digest"].get<std::string>();
  return out;
}

}  // namespace

int run_replay(const ReplayOptions& o) {
  const Recording r = read_recording(o.directory, o.any_version);
  const Scene scene = read_scene(r.file("scene.toml"), {});
  if (r.interrupted && scene.accuracy)
    throw InputError(
        "", o.directory + ": was interrupted while the step was being chosen, there is nothing to run again");
  Comparison comparison(r.directory, scene.tick(), r.realtime, !r.one_end());
  RunOptions run;
  run.scene = r.file("scene.toml");
  run.seed = r.seed;
  run.realtime = r.realtime;
  run.single_precision = r.single_precision;
  run.again = {&comparison, &r.summary,        std::nullopt, r.interface.empty() ? "virtual" : r.interface,
               nullptr,     r.command == "hil"};
  if (r.interrupted || r.realtime) run.again.ticks = r.ticks;
  std::optional<RecordedBus> bus;
  if (r.one_end()) {
    bus.emplace(r.interface, passed_frames(r));
    run.again.bus = &*bus;
  }
  std::string failure;
  try {
    (void)run_again(r, run);
  } catch (const RunError& e) {
    failure = e.what();
  }
  if (stop_requested()) throw Interrupted(o.directory + ": interrupted, not compared to the end");
  if (bus) {
    // A plant in real time goes on talking until the controller has heard that it is idle.
    if (failure.empty() && (!r.realtime || r.command == "controller")) bus->end();
    if (bus->deviation()) comparison.add(difference_of(*bus->deviation(), scene.tick()));
  }
  if (!failure.empty())
    comparison.add({"summary.json", 0, std::nullopt, "the run", "came to its end", "failed: " + failure});
  const auto differences = comparison.differences();
  const std::uint64_t frames = bus ? bus->passed() : comparison.lines("frames.log");
  if (o.json) {
    Json j{{"directory", o.directory},
           {"command", r.command},
           {"realtime", r.realtime},
           {"equal", differences.empty()},
           {"ticks", r.ticks},
           {"frames", r.command == "sim" ? Json(nullptr) : Json(frames)},
           {"digest", r.summary["digest"]},
           {"digest_equal", r.summary["digest"].is_string() ? Json(comparison.same_digest()) : Json(nullptr)},
           {"differences", Json::array()}};
    for (const Difference& d : differences) j["differences"].push_back(json_of(d));
    fmt::print("{}", document_text(j));
  } else if (differences.empty()) {
    fmt::print("equal to the last bit: {}, {}\n", r.command, coverage(r, comparison, frames));
  } else {
    fmt::print("not equal: {}\n", printable(text_of(differences.front())));
    if (differences.size() > 1) fmt::print("and in {} other places (--json)\n", differences.size() - 1);
  }
  return differences.empty() ? 0 : 1;
}

}  // namespace esmc::host
