#pragma once
/// A second reader of what is recorded, of the tests' own: tables of numbers, lines of candump -L, the files
/// that a run has left. It says what is good, what that means, and where the rest is not.

#include <array>
#include <bit>
#include <cctype>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "host_sim/bus/recorded_bus.hpp"
#include "host_sim/record/recording.hpp"
#include "host_sim/scene/scene.hpp"
#include "host_sim/version.hpp"

namespace esmc::fuzz {

inline const std::array<std::string, 8> file_names{
    "summary.json", "scene.toml",         "log.csv",        "frames.log",
    "frames.csv",   host::endpoints_copy, host::model_copy, host::reference_copy};

inline std::vector<std::string> split(const std::string& text, char at) {
  std::vector<std::string> out(1);
  for (const char c : text) {
    if (c == at) {
      out.emplace_back();
    } else {
      out.back() += c;
    }
  }
  return out;
}

inline bool digits(std::string_view text) {
  for (const char c : text) {
    if (c < '0' || c > '9') return false;
  }
  return !text.empty();
}
/// A whole number that is not larger than `most`, leading zeros or not.
inline std::optional<std::uint64_t> whole(std::string_view text, std::uint64_t most) {
  if (!digits(text)) return {};
  std::uint64_t v = 0;
  for (const char c : text) {
    const auto digit = static_cast<std::uint64_t>(c - '0');
    if (v > (most - digit) / 10 || digit > most) return {};
    v = 10 * v + digit;
  }
  return v;
}

// Tables.

/// What one column says in one row: none, or too small to be told from zero, where both answers are right.
struct Cell {
  bool good = false, vanishing = false;
  double value = 0.0;
};
inline Cell cell(const std::string& text) {
  std::string_view rest = text;
  const auto run = [&rest] {
    std::size_t n = 0;
    while (n < rest.size() && rest[n] >= '0' && rest[n] <= '9') ++n;
    rest.remove_prefix(n);
    return n;
  };
  if (rest.starts_with('-')) rest.remove_prefix(1);
  std::size_t mantissa = run();
  if (rest.starts_with('.')) {
    rest.remove_prefix(1);
    mantissa += run();
  }
  if (mantissa == 0) return {};
  if (rest.starts_with('e') || rest.starts_with('E')) {
    rest.remove_prefix(1);
    if (rest.starts_with('-') || rest.starts_with('+')) rest.remove_prefix(1);
    if (run() == 0) return {};
  }
  const double v = std::strtod(text.c_str(), nullptr);
  if (!rest.empty() || !std::isfinite(v)) return {};
  return {true, v == 0.0 && text.find_first_of("123456789") < text.find_first_of("eE"), v};
}

inline const std::vector<std::string> asked{"t", "a", "b"};

struct OwnTable {
  std::size_t refused = 0;  ///< line, 0: none
  std::size_t perhaps = 0;  ///< line of a number that vanishes, likewise
  std::vector<std::string> header, words;
  std::vector<std::vector<double>> columns{3};
};
inline OwnTable own_table(const std::string& text) {
  OwnTable out;
  std::vector<std::string> lines = split(text, '\n');
  const bool torn = !lines.back().empty();
  const std::size_t whole_lines = lines.size() - 1;
  const auto fields = [&](std::size_t i) {
    std::string line = lines[i];
    if (!line.empty() && line.back() == '\r') line.pop_back();
    return split(line, ',');
  };
  out.refused = 1;
  if (whole_lines == 0) return out;
  out.header = fields(0);
  std::map<std::string, std::vector<std::size_t>> places;
  for (std::size_t i = 0; i < out.header.size(); ++i) places[out.header[i]].push_back(i);
  for (const std::string& name : asked) {
    if (places[name].size() != 1) return out;
  }
  for (std::size_t i = 1; i < whole_lines; ++i) {
    out.refused = i + 1;
    const auto row = fields(i);
    if (row.size() != out.header.size()) return out;
    for (std::size_t c = 0; c < asked.size(); ++c) {
      const Cell of = cell(row[places[asked[c]].front()]);
      if (!of.good) return out;
      if (of.vanishing && out.perhaps == 0) out.perhaps = i + 1;
      out.columns[c].push_back(of.value);
    }
    if (!places["state"].empty()) out.words.push_back(row[places["state"].front()]);
  }
  out.refused = torn ? whole_lines + 1 : 0;
  return out;
}

// Lines of frames.

inline std::optional<unsigned> hex(std::string_view text) {
  unsigned v = 0;
  for (const char c : text) {
    if (std::isxdigit(static_cast<unsigned char>(c)) == 0) return {};
    v = 16 * v + static_cast<unsigned>(c <= '9' ? c - '0' : (c | 0x20) - 'a' + 10);
  }
  return v;
}

inline std::optional<host::CandumpLine> own_line(const std::string& line) {
  host::CandumpLine out;
  const std::size_t close = line.find(") "),
                    second = close == std::string::npos ? close : line.find(' ', close + 2);
  if (second == std::string::npos || close < 9 || line[0] != '(' || line[close - 7] != '.') return {};
  const auto s = whole(std::string_view(line).substr(1, close - 8), 1'000'000'000'000);
  const auto us = whole(std::string_view(line).substr(close - 6, 6), 999'999);
  if (!s || !us) return {};
  out.time_us = static_cast<std::int64_t>(*s * 1'000'000 + *us);
  out.interface = line.substr(close + 2, second - close - 2);
  out.text = second + 1;
  const std::string frame = line.substr(out.text);
  const std::size_t mark = frame.find('#');
  if (out.interface.empty() || (mark != 3 && mark != 8)) return {};
  hal::CanFrame& f = out.frame;
  f.extended = mark == 8;
  const auto id = hex(std::string_view(frame).substr(0, mark));
  if (!id || *id > (f.extended ? 0x1FFF'FFFFU : 0x7FFU)) return {};
  f.id = *id;
  std::string data = frame.substr(mark + 1);
  if (data.size() == 2 && data[0] == 'R') {
    f.remote = true;
    f.size = static_cast<std::uint8_t>(data[1] - '0');
    return data[1] >= '0' && data[1] <= '8' ? std::optional(out) : std::nullopt;
  }
  if (data.starts_with("#0") || data.starts_with("#1")) {
    f.fd = true;
    f.bit_rate_switch = data[1] == '1';
    data.erase(0, 2);
  }
  if (data.size() % 2 != 0 || data.size() > (f.fd ? 128U : 16U)) return {};
  for (; f.size < data.size() / 2; ++f.size) {
    const auto byte = hex(std::string_view(data).substr(2 * std::size_t{f.size}, 2));
    if (!byte) return {};
    f.data[f.size] = static_cast<std::uint8_t>(*byte);
  }
  return out;
}

// Directories.

using Files = std::array<std::optional<std::string>, file_names.size()>;

inline std::uint64_t own_hash(std::uint64_t h, const std::string& text) {
  for (const char c : text) {
    h ^= static_cast<unsigned char>(c);
    h *= 1099511628211U;
  }
  return h;
}
inline std::string own_digest(const Files& files) {
  std::uint64_t h = own_hash(14695981039346656037U, files[1].value_or(""));
  for (std::size_t i = 5; i < files.size(); ++i) {
    if (files[i])
      h = own_hash(own_hash(h, file_names[i] + " " + std::to_string(files[i]->size()) + "\n"), *files[i]);
  }
  std::array<char, 17> text{};
  (void)std::snprintf(text.data(), text.size(), "%016llx", static_cast<unsigned long long>(h));
  return text.data();
}

/// Lines of a file; none where it is torn or is not there.
inline std::optional<std::vector<std::string>> whole_lines(const std::optional<std::string>& text) {
  if (!text) return {};
  std::vector<std::string> lines = split(*text, '\n');
  if (!lines.back().empty()) return {};
  lines.pop_back();
  return lines;
}

/// summary.json: what stands under each name, as JSON has it.
struct Summary {
  std::map<std::string, std::string> run, rest, bus;
  std::optional<std::string> instead_of_run;

  [[nodiscard]] std::string text() const {
    const auto object = [](const std::map<std::string, std::string>& of) {
      std::string out;
      for (const auto& [name, value] : of) out += (out.empty() ? "{\"" : ", \"") + name + "\": " + value;
      return out.empty() ? "{}" : out + "}";
    };
    std::map<std::string, std::string> all = rest;
    all["run"] = instead_of_run.value_or(object(run));
    all["bus"] = object(bus);
    return object(all);
  }
};
/// The string, without escapes: those that have some mean nothing here.
inline std::optional<std::string> string_of(const std::map<std::string, std::string>& of,
                                            const std::string& name) {
  const auto at = of.find(name);
  if (at == of.end() || at->second[0] != '"') return {};
  return at->second.substr(1, at->second.size() - 2);
}
inline std::optional<std::uint64_t> number_of(const std::map<std::string, std::string>& of,
                                              const std::string& name) {
  const auto at = of.find(name);
  return at == of.end() ? std::nullopt : whole(at->second, std::numeric_limits<std::uint64_t>::max());
}
inline bool bool_in(const std::map<std::string, std::string>& of, const std::string& name) {
  const auto at = of.find(name);
  return at != of.end() && (at->second == "true" || at->second == "false");
}

/// The files at fault, "" for the directory as a whole; none: it is a recording.
inline std::set<std::string> faults(const Files& files, const Summary& s, bool any_version) {
  std::set<std::string> out;
  for (std::size_t i = 0; i < 3; ++i) {
    if (!files[i]) out.insert(file_names[i]);
  }
  const std::map<std::string, std::string> run =
      s.instead_of_run ? std::map<std::string, std::string>{} : s.run;
  const auto command = string_of(run, "command"), by = string_of(run, "version"),
             digest = string_of(run, "scene_digest");
  const auto ticks = number_of(s.rest, "ticks");
  const bool known =
      command && (*command == "sim" || *command == "hil" || *command == "plant" || *command == "controller");
  const bool of_this_program = by && (*by == host::version || any_version);
  if (!known || !of_this_program || !digest || !ticks || !number_of(s.rest, "seed") ||
      !string_of(run, "scalar") || !bool_in(run, "realtime"))
    out.insert("summary.json");
  if (digest && *digest != own_digest(files)) out.insert("scene.toml");
  const auto rows = whole_lines(files[2]);
  if (!rows || rows->empty() || (ticks && rows->size() - 1 != *ticks)) out.insert("log.csv");
  if (s.rest.contains("interrupted") && ticks == 0U) out.insert("");
  if (!known || *command == "sim") return out;
  const auto frames = whole_lines(files[3]), passage = whole_lines(files[4]);
  const auto counted = number_of(s.bus, "frames");
  if (!counted) out.insert("summary.json");
  if (!frames || frames->empty() || (counted && frames->size() < *counted)) out.insert("frames.log");
  for (std::size_t i = 0; frames && i < frames->size(); ++i) {
    if (!own_line((*frames)[i])) out.insert("frames.log");
  }
  if (*command == "hil" && (!run.contains("realtime") || run.at("realtime") != "true")) return out;
  if (!passage || (frames && passage->size() != frames->size() + 1)) out.insert("frames.csv");
  if (number_of(s.bus, "lost") != 0U) out.insert("summary.json");
  return out;
}

/// What passed, as frames.log and frames.csv have it; line of frames.csv that is no row of it, 0: none.
inline std::vector<host::PassedFrame> own_passage(const Files& files, std::size_t& refused) {
  std::vector<host::PassedFrame> out;
  const auto frames = *whole_lines(files[3]), rows = *whole_lines(files[4]);
  refused = 1;
  if (rows[0] != "look,sent,age_us") return out;
  for (std::size_t i = 1; i < rows.size(); ++i) {
    refused = i + 1;
    const auto row = split(rows[i], ',');
    if (row.size() != 3) return out;
    const auto look = whole(row[0], std::numeric_limits<std::uint64_t>::max()), sent = whole(row[1], 1),
               age = whole(row[2], 0xFFFF'FFFFU);
    if (!look || !sent || !age || (*sent == 1 && *age != 0)) return out;
    const auto of = *own_line(frames[i - 1]);
    out.push_back({of.time_us, *look, *sent == 1, static_cast<std::uint32_t>(*age), of.frame});
  }
  refused = 0;
  return out;
}

}  // namespace esmc::fuzz
