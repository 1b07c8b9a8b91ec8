#include "host_sim/scene/reader.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <optional>
#include <sstream>
#include <string>
#include <string_view>
#include <vector>

#include "host_sim/scene/scene.hpp"

namespace esmc::host {
namespace {

/// Longest reference in s: beyond it ticks and digits of the time run out.
constexpr double reference_time_max = 1e6;
constexpr double reference_ticks_max = 4e9;

/// The bytes of a file that a scene names.
std::string read_bytes(const Section& s, const std::filesystem::path& path) {
  std::error_code error;
  if (path.native().find('\0') != std::string::npos) s.fail("path", "must be a file name, without NUL");
  if (!std::filesystem::is_regular_file(path, error)) {
    const bool there = std::filesystem::exists(path, error);
    s.fail("path", "names {}: {}",
           there ? "something that is not a regular file" : "a file that does not exist", path.string());
  }
  std::ifstream file(path, std::ios::binary);
  std::ostringstream bytes;
  if (file && file.peek() != std::ifstream::traits_type::eof()) bytes << file.rdbuf();
  if (!file.is_open() || file.bad()) s.fail("path", "names a file that cannot be read: {}", path.string());
  return bytes.str();
}

/// "1, 2, 3": exactly three finite numbers.
std::optional<PathPoint> parse_point(std::string_view line) {
  std::array<double, 3> v{};
  for (std::size_t i = 0; i < v.size(); ++i) {
    const std::size_t comma = line.find(',');
    if ((comma == std::string_view::npos) != (i + 1 == v.size())) return std::nullopt;
    std::string_view field = line.substr(0, comma);
    line.remove_prefix(comma == std::string_view::npos ? line.size() : comma + 1);
    constexpr const char* blank = " \t\r";
    const std::size_t first = field.find_first_not_of(blank);
    if (first == std::string_view::npos) return std::nullopt;
    field = field.substr(first, field.find_last_not_of(blank) - first + 1);
    if (field.size() > 1 && field.front() == '+' && field[1] != '-') field.remove_prefix(1);
    const auto [end, error] = std::from_chars(field.data(), field.data() + field.size(), v[i]);
    if (error != std::errc() || end != field.data() + field.size() || !std::isfinite(v[i]))
      return std::nullopt;
  }
  return PathPoint{v[0], v[1], v[2]};
}

/// The points of a CSV, whose path is relative to the scene file; its text becomes a companion of the scene.
void read_path(Section& s, Scene& scene, double longest) {
  const std::filesystem::path path = std::filesystem::path(scene.file).parent_path() / s.text("path");
  scene.companions.push_back({reference_copy, read_bytes(s, path), path.string()});
  std::istringstream in(scene.companions.back().text);
  std::string line;
  std::getline(in, line);
  if (line.starts_with("\xEF\xBB\xBF")) line.erase(0, 3);  // byte order mark
  while (!line.empty() && (line.back() == '\r' || line.back() == ' ')) line.pop_back();
  if (line != "t,x,y") throw InputError(path.string() + ":1", "the header must be t,x,y and nothing else");
  std::vector<PathPoint>& out = scene.reference.table;
  for (int number = 2; std::getline(in, line); ++number) {
    if (line.empty() || line == "\r") continue;
    const auto p = parse_point(line);
    const std::string where = fmt::format("{}:{}", path.string(), number);
    if (!p || !(out.empty() ? p->t == 0.0 : p->t > out.back().t)) {
      throw InputError(where,
                       "three finite numbers t,x,y and nothing else are needed, t from 0 and ascending");
    }
    if (p->t > longest) refuse_at(where, "t must be at most {:g} s", longest);
    out.push_back(*p);
  }
  if (out.size() < 3)
    throw InputError(path.string() + ":2", "three or more points are needed (two are a line)");
}

}  // namespace

void read_reference(Section s, Scene& scene) {
  ReferenceScene& r = scene.reference;
  const double longest = std::min(reference_time_max, reference_ticks_max / scene.rate_hz);
  s.read_fields(scene);
  s.use_schema(fmt::format("reference[{}]", name(r.type)));
  s.read_fields(scene);
  if (r.type == ReferenceType::line) r.points = {s.pair("from"), s.pair("to")};
  if (r.type == ReferenceType::file) read_path(s, scene, longest);
  if (r.type == ReferenceType::program) read_program(s, scene);
  if (r.type == ReferenceType::polyline && !r.points.empty()) {  // without them an error is noted
    double length = 0.0;                                         // m; with the way back where it repeats
    for (std::size_t i = 0; i < r.points.size() - (r.repeat ? 0U : 1U); ++i) {
      const auto &a = r.points[i], &b = r.points[(i + 1) % r.points.size()];
      length += std::hypot(b[0] - a[0], b[1] - a[1]);
    }
    if (const double seconds = length / r.speed; !(seconds <= longest)) {
      s.fail("speed", "is too slow: the polyline would take {:.3g} s, at most {:g} s are allowed", seconds,
             longest);
    }
  }
  s.finish();
}

}  // namespace esmc::host
