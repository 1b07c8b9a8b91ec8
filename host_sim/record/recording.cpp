#include "host_sim/record/recording.hpp"

#include <fmt/format.h>

#include <charconv>
#include <filesystem>
#include <fstream>
#include <memory>
#include <type_traits>

#include "host_sim/error.hpp"
#include "host_sim/json_text.hpp"
#include "host_sim/record/digest.hpp"
#include "host_sim/version.hpp"

namespace esmc::host {
namespace {

using Json = nlohmann::ordered_json;

template <class T>
bool number(std::string_view text, T& out, int base = 10) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), out, base);
  return error == std::errc() && end == text.data() + text.size();
}

/// Number of lines. Throws InputError for an incomplete one and, with `interface`, which becomes that of the
/// first frame, for one not of candump -L.
std::uint64_t count_lines(const Recording& r, const char* name, std::string* interface = nullptr) {
  const std::string path = r.file(name);
  require_regular_file(path);
  std::ifstream in(path, std::ios::binary);
  if (!in) refuse("{}: cannot be read", path);
  std::uint64_t n = 0;
  for (std::string line; std::getline(in, line);) {
    ++n;
    if (in.eof()) refuse_at(fmt::format("{}:{}", path, n), "the file ends within a line: it is torn");
    if (interface == nullptr) continue;
    const auto frame = parse_candump(line);
    if (!frame)
      refuse_at(fmt::format("{}:{}", path, n),
                "is no line of candump -L, as (0000000001.001135) vcan0 022#00000000");
    if (n == 1) *interface = frame->interface;
  }
  return n;
}

std::optional<hal::CanFrame> parse_frame(std::string_view text) {
  hal::CanFrame f;
  const std::size_t mark = text.find('#');
  if (mark != 3 && mark != 8) return std::nullopt;
  f.extended = mark == 8;
  if (!number(text.substr(0, mark), f.id, 16)) return std::nullopt;
  std::string_view data = text.substr(mark + 1);
  if (data.starts_with("R")) {
    f.remote = true;
    unsigned size = 0;
    if (data.size() != 2 || !number(data.substr(1), size) || size > 8) return std::nullopt;
    f.size = static_cast<std::uint8_t>(size);
    return hal::well_formed(f) ? std::optional(f) : std::nullopt;
  }
  if (data.starts_with("#")) {
    f.fd = true;
    if (data.size() < 2 || (data[1] != '0' && data[1] != '1')) return std::nullopt;
    f.bit_rate_switch = data[1] == '1';
    data = data.substr(2);
  }
  if (data.size() % 2 != 0 || data.size() / 2 > f.data.size()) return std::nullopt;
  for (std::size_t i = 0; i < data.size(); i += 2) {
    if (!number(data.substr(i, 2), f.data[i / 2], 16)) return std::nullopt;
  }
  f.size = static_cast<std::uint8_t>(data.size() / 2);
  return hal::well_formed(f) ? std::optional(f) : std::nullopt;
}

/// A value of summary.json. Throws InputError where it is missing or of another type.
template <class T>
T at(const Recording& r, const char* pointer) {
  try {
    const Json& value = r.summary.at(Json::json_pointer(pointer));
    if (!std::is_same_v<T, std::uint64_t> || value.is_number_unsigned()) return value.get<T>();
  } catch (const nlohmann::json::exception&) {
  }
  refuse_at(
      r.file("summary.json"),
      "{} is missing or of another kind: allowed is what sim, hil, plant and controller leave with --out",
      pointer);
}

std::uint64_t with_companion(std::uint64_t hash, const std::string& name, const std::string& text) {
  return fnv(fnv(hash, fmt::format("{} {}\n", name, text.size())), text);
}

/// Command, version, seed and the like from the summary. Throws InputError.
Recording read_summary(const std::string& directory, bool any_version) {
  Recording r;
  r.directory = directory;
  try {
    r.summary = parse_json(bytes_of(r.file("summary.json")), true);
  } catch (const nlohmann::json::exception& e) {
    refuse_at(r.file("summary.json"), "no JSON document: {}", e.what());
  }
  r.command = at<std::string>(r, "/run/command");
  if (r.command != "sim" && r.command != "hil" && r.command != "plant" && r.command != "controller")
    refuse_at(r.file("summary.json"), "/run/command is '{}', allowed are sim, hil, plant, controller",
              printable(r.command));
  const auto by = at<std::string>(r, "/run/version");
  if (by != version && !any_version)
    refuse_at(r.file("summary.json"), "recorded by esmc {}, this is {}: take that one, or --any-version",
              printable(by), version);
  r.realtime = at<bool>(r, "/run/realtime");
  r.single_precision = at<std::string>(r, "/run/scalar") == "float";
  r.seed = at<std::uint64_t>(r, "/seed");
  r.ticks = at<std::uint64_t>(r, "/ticks");
  r.interrupted = r.summary.contains("interrupted");
  return r;
}

void require_same_digest(const Recording& r) {
  std::error_code error;
  std::uint64_t hash = fnv(fnv_start, bytes_of(r.file("scene.toml")));
  for (const char* name : companion_names) {
    if (std::filesystem::exists(r.file(name), error))
      hash = with_companion(hash, name, bytes_of(r.file(name)));
  }
  const std::string was = at<std::string>(r, "/run/scene_digest"), is = digest_text(hash);
  if (was != is)
    refuse_at(r.file("scene.toml"), "is not the scene that was run: its digest is {}, summary.json says {}",
              is, printable(was));
}

/// Checks frames.log and, of one end, frames.csv. Returns the interface.
std::string read_frames(const Recording& r) {
  std::string interface;
  const std::uint64_t lines = count_lines(r, "frames.log", &interface);
  const auto frames = at<std::uint64_t>(r, "/bus/frames");
  if (lines == 0) refuse_at(r.file("frames.log"), "has no frames");
  if (lines < frames)
    refuse_at(r.file("frames.log"), "has {} lines, {} frames were counted: torn or of another run", lines,
              frames);
  if (!r.one_end()) return interface;
  const std::uint64_t passages = count_lines(r, "frames.csv");
  if (passages != lines + 1)
    refuse_at(r.file("frames.csv"), "has {} lines, {} frames and a header are {}: torn or of another run",
              passages, lines, lines + 1);
  if (at<std::uint64_t>(r, "/bus/lost") > 0)
    refuse_at(r.file("summary.json"), "/bus/lost is not 0: which frames could not be sent then is not known");
  return interface;
}

}  // namespace

std::optional<CandumpLine> parse_candump(std::string_view line) {
  CandumpLine out;
  const std::size_t point = line.find('.'), close = line.find(')');
  if (!line.starts_with("(") || point == std::string_view::npos || close == std::string_view::npos ||
      close != point + 7)
    return std::nullopt;
  std::uint64_t seconds = 0, micro = 0;
  if (!number(line.substr(1, point - 1), seconds) || !number(line.substr(point + 1, 6), micro))
    return std::nullopt;
  if (seconds > 1'000'000'000'000) return std::nullopt;
  out.time_us = static_cast<std::int64_t>(seconds * 1'000'000 + micro);
  const std::size_t space = line.find(' ', close + 2);
  if (space == std::string_view::npos || line[close + 1] != ' ') return std::nullopt;
  out.interface = line.substr(close + 2, space - close - 2);
  out.text = space + 1;
  const auto frame = parse_frame(line.substr(out.text));
  if (!frame || out.interface.empty()) return std::nullopt;
  out.frame = *frame;
  return out;
}

void require_csv(const std::string& directory) {
  std::error_code error;
  if (std::filesystem::exists(directory + "/log.csv", error) ||
      !std::filesystem::exists(directory + "/log.npy", error))
    return;
  refuse("{}: has log.npy, of a run with --log npy; log.csv is needed: run it with --log csv", directory);
}

std::string scene_digest(const Scene& scene) {
  std::uint64_t hash = fnv(fnv_start, scene.toml);
  for (const Companion& c : scene.companions) hash = with_companion(hash, c.name, c.text);
  return digest_text(hash);
}

Recording read_recording(const std::string& directory, bool any_version) {
  std::error_code error;
  if (!std::filesystem::is_directory(directory, error))
    refuse("{}: no such directory; allowed is what sim, hil, plant or controller left with --out", directory);
  require_csv(directory);
  Recording r = read_summary(directory, any_version);
  if (r.summary["run"].contains("log"))
    refuse_at(r.file("log.csv"),
              "has not every tick: it was recorded with --log-every, and a replay needs --log-every 1");
  require_same_digest(r);
  const std::uint64_t rows = count_lines(r, "log.csv");
  // Not rows != ticks + 1: a number that is not of a run may be 2^64 - 1.
  if (rows == 0 || rows - 1 != r.ticks)
    refuse_at(r.file("log.csv"),
              "has {} lines, and should have a header and one for each of {} ticks: torn or of another run",
              rows, r.ticks);
  if (r.interrupted && r.ticks == 0)
    refuse("{}: was interrupted before t = 0, there is nothing to run again", directory);
  if (r.command != "sim") r.interface = read_frames(r);
  return r;
}

RecordedBus::Source passed_frames(const Recording& r) {
  struct Files {
    std::ifstream frames, passage;
    std::string path, frame, row;
    std::uint64_t n = 0;
  };
  auto files = std::make_shared<Files>(Files{std::ifstream(r.file("frames.log"), std::ios::binary),
                                             std::ifstream(r.file("frames.csv"), std::ios::binary),
                                             r.file("frames.csv"), "", "", 0});
  if (!std::getline(files->passage, files->row) || files->row != "look,sent,age_us")
    refuse_at(files->path + ":1", "the header is look,sent,age_us");
  return [files]() -> std::optional<PassedFrame> {
    if (!std::getline(files->frames, files->frame) || !std::getline(files->passage, files->row))
      return std::nullopt;
    ++files->n;
    const auto line = parse_candump(files->frame);
    PassedFrame p;
    const auto field = fields_of(files->row);
    unsigned sent = 2;
    const bool good = line && field.size() == 3 && number(field[0], p.look) && number(field[1], sent) &&
                      sent < 2 && number(field[2], p.age_us) && (sent == 0 || p.age_us == 0);
    if (!good)
      refuse_at(fmt::format("{}:{}", files->path, files->n + 1),
                "allowed is LOOK,0,AGE for a frame that was received, LOOK,1,0 for one that was sent");
    p.time_us = line->time_us;
    p.sent = sent == 1;
    p.frame = line->frame;
    return p;
  };
}

std::vector<std::string> joint_names(MechanismType type) {
  if (type == MechanismType::rr) return {"theta1", "theta2"};
  return {"theta11", "theta12", "theta21", "theta22"};
}

}  // namespace esmc::host
