#include "host_sim/record/comparison.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

#include "host_sim/error.hpp"
#include "host_sim/record/recording.hpp"

namespace esmc::host {
namespace {

using Json = nlohmann::ordered_json;

/// Appends the values in which two documents differ.
void compare(const Json& recorded, const Json& computed, const std::string& path,
             const std::vector<std::string>& ignored, std::vector<Difference>& out) {
  if (std::find(ignored.begin(), ignored.end(), path) != ignored.end()) return;
  if (recorded.is_object() && computed.is_object()) {
    const auto inner = [&](const std::string& key) { return path.empty() ? key : path + "." + key; };
    for (const auto& [key, value] : recorded.items())
      compare(value, computed.contains(key) ? computed[key] : Json("absent"), inner(key), ignored, out);
    for (const auto& [key, value] : computed.items()) {
      if (!recorded.contains(key)) compare("absent", value, inner(key), ignored, out);
    }
  } else if (recorded != computed) {
    out.push_back({"summary.json", 0, std::nullopt, path, recorded.dump(), computed.dump()});
  }
}

}  // namespace

LineComparison::LineComparison(const std::string& directory, std::string name,
                               std::vector<std::string> ignored_columns, double tick)
    : name_(std::move(name)),
      ignored_(std::move(ignored_columns)),
      tick_(tick),
      file_(directory + "/" + name_, std::ios::binary) {
  if (!file_) throw InputError("", directory + "/" + name_ + ": cannot be read");
}

void LineComparison::take(std::string_view text) {
  pending_ += text;
  std::size_t at = 0;
  for (std::size_t end = 0; (end = pending_.find('\n', at)) != std::string::npos; at = end + 1)
    line(std::string_view(pending_).substr(at, end - at));
  pending_.erase(0, at);
}

void LineComparison::line(std::string_view computed) {
  if (difference_) return;
  ++lines_;
  const bool there = static_cast<bool>(std::getline(file_, recorded_));
  if (lines_ == 1) header_ = computed;
  if (!there) {
    difference_ =
        Difference{name_, lines_, std::nullopt, "the recording ends", "nothing", std::string(computed)};
  } else if (recorded_ != computed) {
    if (name_ == "frames.log") {
      difference_ = frame_difference(recorded_, std::string(computed));
    } else {
      difference_ = row_difference(recorded_, computed);
    }
  }
}

void LineComparison::end() {
  if (!difference_ && std::getline(file_, recorded_))
    difference_ = Difference{name_, lines_ + 1, std::nullopt, "the repeated run ends", recorded_, "nothing"};
}

std::optional<Difference> LineComparison::row_difference(std::string_view recorded,
                                                         std::string_view computed) const {
  const auto columns = fields_of(header_), a = fields_of(recorded), b = fields_of(computed);
  const auto cell = [](const auto& of, std::size_t i) { return i < of.size() ? of[i] : std::string_view(); };
  for (std::size_t i = 0; i < std::max({columns.size(), a.size(), b.size()}); ++i) {
    const std::string_view column = cell(columns, i), was = cell(a, i), is = cell(b, i);
    if (was == is || std::ranges::find(ignored_, column) != ignored_.end()) continue;
    return Difference{name_,
                      lines_,
                      lines_ > 1 ? std::optional(lines_ - 2) : std::nullopt,
                      std::string(lines_ == 1 ? "header" : column),
                      std::string(was),
                      std::string(is)};
  }
  return std::nullopt;
}

Difference LineComparison::frame_difference(const std::string& recorded, const std::string& computed) const {
  const auto was = parse_candump(recorded), is = parse_candump(computed);
  Difference d{name_, lines_, std::nullopt, "line", recorded, computed};
  if (!was || !is) return d;
  d.tick = static_cast<std::uint64_t>(std::floor(static_cast<double>(was->time_us) * 1e-6 / tick_ + 1e-9));
  d.what = "frame " + recorded.substr(was->text, recorded.find('#') - was->text);
  if (was->frame == is->frame) {
    d.what += ", its time";
  } else {
    d.recorded = recorded.substr(was->text);
    d.computed = computed.substr(is->text);
  }
  return d;
}

std::FILE* Comparison::open(const std::string& name) {
  if (name != "log.csv" && (name != "frames.log" || !frames_)) return nullptr;
  // In real time the delay of a tick depends on the wall clock.
  auto& lines = files_[name];
  lines = std::make_unique<LineComparison>(
      directory_, name, realtime_ ? std::vector<std::string>{"delay"} : std::vector<std::string>{}, tick_);
  const auto write = [](void* cookie, const char* text, std::size_t size) {
    static_cast<LineComparison*>(cookie)->take({text, size});
    return static_cast<ssize_t>(size);
  };
  std::FILE* const stream = ::fopencookie(lines.get(), "w", {nullptr, write, nullptr, nullptr});
  if (stream == nullptr) throw RunError("no memory for a stream");
  return stream;
}

void Comparison::summary(Json computed, const Json& recorded) {
  if (!recorded.contains("verdict")) {  // of 0.2.0 or before, which named faults and gave no verdict
    computed.erase("verdict");
    if (computed.contains("supervisor"))
      for (Json& f : computed["supervisor"]["faults"]) f = Json(f["name"]);
  }
  std::vector<std::string> ignored{"schema", "wall_s", "real_time_factor", "run", "accuracy.cpu_s"};
  // These depend on the wall clock.
  if (realtime_)
    ignored.insert(ignored.end(), {"late_ticks", "bus", "supervisor", "tracking", "verdict", "interrupted"});
  if (!frames_) ignored.emplace_back("bus.load");
  complete_ = true;
  const std::size_t before = others_.size();
  compare(recorded, computed, "", ignored, others_);
  same_digest_ = recorded.value("digest", Json()) == computed.value("digest", Json());
  const auto digest = std::find_if(others_.begin() + static_cast<std::ptrdiff_t>(before), others_.end(),
                                   [](const Difference& d) { return d.what == "digest"; });
  if (digest != others_.end())
    std::rotate(others_.begin() + static_cast<std::ptrdiff_t>(before), digest, digest + 1);
}

std::vector<Difference> Comparison::differences() {
  std::vector<Difference> out;
  for (auto& [name, lines] : files_) {
    if (complete_) lines->end();
    if (lines->difference()) out.push_back(*lines->difference());
  }
  out.insert(out.end(), others_.begin(), others_.end());
  std::stable_partition(out.begin(), out.end(), [](const Difference& d) { return d.file == "frames.log"; });
  return out;
}

std::uint64_t Comparison::lines(const std::string& name) const {
  const auto found = files_.find(name);
  return found == files_.end() ? 0 : found->second->lines();
}

}  // namespace esmc::host
