#include "host_sim/record/recording.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "host_sim/error.hpp"

namespace esmc::host {

std::vector<std::string_view> fields_of(std::string_view line) {
  std::vector<std::string_view> out;
  for (std::size_t at = 0;; ++at) {
    const std::size_t end = std::min(line.find(',', at), line.size());
    out.push_back(line.substr(at, end - at));
    if (end == line.size()) return out;
    at = end;
  }
}

void require_regular_file(const std::string& file) {
  std::error_code error;
  if (std::filesystem::is_regular_file(file, error)) return;
  const bool there = std::filesystem::exists(file, error);
  refuse("{}: {}", file, there ? "is not a regular file" : "there is no such file");
}

std::string bytes_of(const std::string& file) {
  constexpr std::uintmax_t bytes_max = std::uintmax_t{4} << 30U;
  require_regular_file(file);
  std::error_code error;
  if (std::filesystem::file_size(file, error) > bytes_max || error) refuse("{}: is larger than 4 GiB", file);
  std::ifstream in(file, std::ios::binary);
  std::ostringstream text;
  if (in && in.peek() != std::ifstream::traits_type::eof()) text << in.rdbuf();
  if (!in.is_open() || in.bad()) refuse("{}: cannot be read", file);
  return std::move(text).str();
}

RecordedTable read_table(const std::string& file, const std::vector<std::string>& names,
                         const std::string& hint, const std::string& word) {
  const std::string bytes = bytes_of(file);
  std::string_view rest = bytes;
  if (rest.starts_with("\xEF\xBB\xBF")) rest.remove_prefix(3);  // byte order mark
  RecordedTable out;
  out.file = file;
  std::size_t number = 0;
  const auto where = [&] { return file + ":" + std::to_string(number); };
  const auto line = [&] {
    ++number;
    const std::size_t end = rest.find('\n');
    if (end == std::string_view::npos)
      refuse_at(where(), "{}",
                rest.empty() ? "is empty: a header and rows are needed"
                             : "the last line has no end: the file was torn off");
    std::string_view text = rest.substr(0, end);
    rest.remove_prefix(end + 1);
    if (text.ends_with('\r')) text.remove_suffix(1);
    return text;
  };
  for (const std::string_view name : fields_of(line())) out.header.emplace_back(name);
  std::vector<std::size_t> wanted;
  for (const std::string& name : names) {
    const auto at = std::find(out.header.begin(), out.header.end(), name);
    if (at == out.header.end()) refuse_at(where(), "there is no column {}{}", name, hint);
    if (std::count(out.header.begin(), out.header.end(), name) > 1)
      refuse_at(where(), "there are two columns {}", name);
    wanted.push_back(static_cast<std::size_t>(at - out.header.begin()));
  }
  const auto word_at =
      word.empty() ? out.header.end() : std::find(out.header.begin(), out.header.end(), word);
  out.columns.resize(names.size());
  while (!rest.empty()) {
    const auto fields = fields_of(line());
    if (fields.size() != out.header.size())
      refuse_at(where(), "{} fields where the header has {}", fields.size(), out.header.size());
    if (word_at != out.header.end())
      out.words.emplace_back(fields[static_cast<std::size_t>(word_at - out.header.begin())]);
    for (std::size_t i = 0; i < wanted.size(); ++i) {
      const std::string_view f = fields[wanted[i]];
      double v = 0.0;
      const auto [end, error] = std::from_chars(f.data(), f.data() + f.size(), v);
      if (error != std::errc() || end != f.data() + f.size() || !std::isfinite(v))
        refuse_at(where(), "{} must be a finite number, not '{}'", names[i], f.substr(0, 40));
      out.columns[i].push_back(v);
    }
  }
  return out;
}

void require_ascending(const RecordedTable& table, std::size_t column) {
  const std::vector<double>& t = table.columns[column];
  for (std::size_t i = 1; i < t.size(); ++i) {
    if (!(t[i] > t[i - 1])) refuse_at(table.where(i), "the time must ascend from row to row");
  }
}

void require_even(const RecordedTable& table, std::size_t column, const std::string& hint) {
  const std::vector<double>& t = table.columns[column];
  if (t.size() < 2) return;
  const double mean = (t.back() - t.front()) / static_cast<double>(t.size() - 1);
  for (std::size_t i = 1; i < t.size(); ++i) {
    if (std::isfinite(mean) && std::abs(t[i] - t[i - 1] - mean) <= 0.4 * mean) continue;  // t may be rounded
    refuse_at(
        table.where(i),
        "t = {:.10g} s is {:.3g} s after the row before, and rows are {:.3g} s apart: they must stand at "
        "equal distances{}",
        t[i], t[i] - t[i - 1], mean, hint);
  }
}

void require_every_tick(const RecordedTable& table, std::size_t column, double tick) {
  const std::vector<double>& t = table.columns[column];
  for (std::size_t i = 0; i < t.size(); ++i) {
    if (std::abs(t[i] - t[0] - static_cast<double>(i) * tick) <= 0.01 * tick) continue;
    refuse_at(table.where(i),
              "t = {:.10g} s is not {} ticks of {:g} s after the first row: every tick is needed, at the "
              "scene's control.rate_hz",
              t[i], i, tick);
  }
}

}  // namespace esmc::host
