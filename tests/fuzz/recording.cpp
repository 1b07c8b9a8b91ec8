/// What is read of motions that were recorded: tables of numbers (CSV), lines of candump -L, and what a run
/// has left in a directory, for `esmc replay`. A second reader (recording_reader.hpp) says of each what is
/// good, and where it is not.

#include <array>
#include <cctype>
#include <cfloat>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "host_sim/bus/frame_log.hpp"
#include "host_sim/bus/recorded_bus.hpp"
#include "host_sim/error.hpp"
#include "host_sim/record/derivatives.hpp"
#include "host_sim/record/recording.hpp"
#include "host_sim/scene/scene.hpp"
#include "host_sim/version.hpp"
#include "tests/fuzz/bytes.hpp"
#include "tests/fuzz/memory_folder.hpp"
#include "tests/fuzz/recording_reader.hpp"

namespace {

using namespace esmc;
using namespace esmc::fuzz;
using hal::CanFrame;
using host::InputError;

/// Ends with what is refused: its message, or none where nothing was. Another exception ends the process.
template <class Act>
std::optional<std::string> refusal(Act&& act) {
  try {
    act();
  } catch (const InputError& e) {
    const std::string message = e.what();
    require(message.find('\n') == std::string::npos, "a refusal is one line");
    return message;
  }
  return {};
}

// Tables.

bool same_bits(double a, double b) {
  return std::bit_cast<std::uint64_t>(a) == std::bit_cast<std::uint64_t>(b);
}

/// A check of a time against its own statement: `distance(i)` of row i from where it may be, at most
/// `slack(i)` but for rounding.
template <class Check, class Distance, class Slack>
void judge_times(const host::RecordedTable& table, Check&& check, bool certain, Distance&& distance,
                 Slack&& slack) {
  const auto message = refusal(check);
  const std::vector<double>& t = table.columns[0];
  constexpr auto eps = static_cast<long double>(DBL_EPSILON), least = static_cast<long double>(DBL_TRUE_MIN);
  long double largest = 0.0L;
  for (const double v : t) largest = std::max(largest, std::abs(static_cast<long double>(v)));
  for (std::size_t i = 0; i < t.size(); ++i) {
    const long double rounding = 8 * eps * largest + 1e-9L * slack(i) + least;
    const bool named = message && message->starts_with(table.where(i) + ": ");
    if (named)
      return require(!certain || distance(i) >= slack(i) - rounding, "a row that is refused is out of place");
    require(distance(i) <= slack(i) + rounding, "a row that is let pass is in its place");
  }
  require(!message, "what is refused is a row");
}

/// What is asked of the times of a table, where there are some.
void times(const host::RecordedTable& table, double tick) {
  const std::vector<double>& t = table.columns[0];
  const auto ascending = refusal([&] { host::require_ascending(table, 0); });
  std::size_t ordered = 1;
  while (ordered < t.size() && t[ordered - 1] < t[ordered]) ++ordered;
  require(ascending.has_value() == (ordered < t.size()), "times increase");
  require(!ascending || ascending->starts_with(table.where(ordered) + ": "),
          "the first that does not is named");
  if (ascending || t.empty()) return;
  const auto at = [&](std::size_t i) { return static_cast<long double>(t[i]); };
  judge_times(
      table, [&] { host::require_every_tick(table, 0, tick); }, true,
      [&](std::size_t i) {
        return std::abs(at(i) - at(0) - static_cast<long double>(i) * static_cast<long double>(tick));
      },
      [&](std::size_t) { return 0.01L * static_cast<long double>(tick); });
  if (t.size() < 2) return require(!refusal([&] { host::require_even(table, 0, ""); }), "one row is even");
  const long double mean = (at(t.size() - 1) - at(0)) / static_cast<long double>(t.size() - 1);
  // Of a span that no double holds nothing can be said: it may be refused as a whole.
  judge_times(
      table, [&] { host::require_even(table, 0, "; a hint"); },
      at(t.size() - 1) - at(0) <= static_cast<long double>(DBL_MAX),
      [&](std::size_t i) { return i == 0 ? 0.0L : std::abs(at(i) - at(i - 1) - mean); },
      [&](std::size_t) { return 0.4L * mean; });
}

/// A file with this text, read twice; none where it is refused.
std::optional<host::RecordedTable> table(const std::string& text, double tick) {
  folder().write(2, text);
  const std::string file = folder().file(file_names[2]);
  const OwnTable own = own_table(text);
  std::optional<host::RecordedTable> out;
  const auto message = refusal([&] { out = host::read_table(file, asked, ": a hint", "state"); });
  const auto named = [&](std::size_t n) {
    return message && message->starts_with(file + ":" + std::to_string(n) + ": ");
  };
  const std::size_t refused = own.perhaps != 0 && named(own.perhaps) ? own.perhaps : own.refused;
  require(message.has_value() == (refused != 0), "refused where it is bad, and only there");
  if (message) {
    require(named(refused), "file and line of what is bad");
    return {};
  }
  require(out->file == file && out->header == own.header && out->words == own.words,
          "header and words are those of the file");
  require(out->columns.size() == asked.size() && out->rows() == own.columns[0].size(), "a value per row");
  for (std::size_t c = 0; c < asked.size(); ++c) {
    require(out->columns[c].size() == out->rows(), "columns are of one length");
    for (std::size_t i = 0; i < out->rows(); ++i) {
      const double is = out->columns[c][i], was = own.columns[c][i];
      require(std::isfinite(is), "numbers are finite");
      require(same_bits(is, was), "numbers are what strtod makes of them");
    }
  }
  times(*out, tick);
  const auto without = host::read_table(file, asked, "");
  require(without.words.empty() && without.columns == out->columns, "unrequested text columns are empty");
  return out;
}

/// Numbers as someone writes them; wide enough that they come back.
std::string written(double v, unsigned how) {
  std::array<char, 512> text{};
  const auto end = text.data() + text.size();
  switch (how) {
    case 0:
      return {text.data(), std::to_chars(text.data(), end, v).ptr};
    case 1:
      return {text.data(), std::to_chars(text.data(), end, v, std::chars_format::fixed).ptr};
    default:
      (void)std::snprintf(text.data(), text.size(), how == 2 ? "%.17g" : "%.18E", v);
      return text.data();
  }
}

double plausible(fuzz::Bytes& in) {
  switch (in.below(6)) {
    case 0:
      return in.f64();
    case 1:
      return static_cast<double>(in.f32());
    case 2:
      return DBL_MAX * (in.yes() ? 1 : -1);
    default:
      return (in.u8() - 128) / 64.0;
  }
}

/// A table from numbers, and perhaps one thing wrong with it.
void built_table(fuzz::Bytes& in) {
  std::vector<std::string> header = asked;
  const unsigned shape = in.u8();
  if ((shape & 1U) != 0) header.insert(header.begin() + static_cast<std::ptrdiff_t>(in.below(4)), "state");
  if ((shape & 2U) != 0) header.insert(header.begin() + static_cast<std::ptrdiff_t>(in.below(4)), "more");
  if ((shape & 4U) != 0) std::swap(header.front(), header.back());
  const std::string end = (shape & 8U) != 0 ? "\r\n" : "\n";
  const double tick = (1 + in.below(100)) * 1e-3;
  double now = plausible(in);
  const std::size_t rows = in.below(24);
  std::vector<std::vector<double>> wanted(3);
  std::vector<std::vector<std::string>> fields{header};
  bool good = true;
  for (std::size_t i = 0; i < rows; ++i) {
    const unsigned what = in.u8();
    std::vector<std::string>& row = fields.emplace_back();
    for (const std::string& name : header) {
      const auto c = static_cast<std::size_t>(std::ranges::find(asked, name) - asked.begin());
      if (c == asked.size()) {
        row.push_back(name == "state" ? ((what & 1U) != 0 ? "running" : "") : "nan");
        continue;
      }
      const double v = c == 0 ? now : plausible(in);
      good = good && std::isfinite(v);
      wanted[c].push_back(v);
      row.push_back(written(v, (what >> 1U) & 3U));
    }
    // Most tables that are recorded: a row per tick, a little off, or a gap.
    now += what < 200 ? tick : (what < 240 ? tick * (1 + plausible(in) / 100) : plausible(in));
  }
  const unsigned flaw = in.below(16);
  std::vector<std::string>& victim = fields[in.u8() % fields.size()];
  std::string& field = victim[in.u8() % victim.size()];
  static const std::array<const char*, 12> odd{"",    " 1",   "1 ", "+1", "0x1", "1e999",
                                               "inf", "-nan", "1e", ".",  "--1", "1;"};
  if (flaw == 1) victim.emplace_back("1");
  if (flaw == 2) victim.pop_back();
  if (flaw == 3) field = odd[in.u8() % odd.size()];
  if (flaw == 4) {
    const std::size_t length = 1U + in.u8();
    field = std::string(length, static_cast<char>(in.u8()));
  }
  std::string text;
  for (const auto& row : fields) {
    for (std::size_t i = 0; i < row.size(); ++i) text += (i == 0 ? "" : ",") + row[i];
    text += end;
  }
  if (flaw == 5) text.pop_back();
  if (flaw == 6) text.clear();
  const auto read = table(text, tick);
  if (flaw == 5 || flaw == 6 || (rows > 0 && (flaw == 1 || flaw == 2)))
    require(!read, "what is torn or has rows of two widths is refused");
  if ((flaw < 1 || flaw > 6) && good) {
    require(read.has_value(), "numbers are accepted");
    for (std::size_t c = 0; c < asked.size(); ++c) {
      require(std::ranges::equal(read->columns[c], wanted[c], same_bits), "numbers come back as they were");
    }
  }
}

/// Derivatives of a cubic, which they are to give exactly; no row is asked for that is not there.
void derivatives(fuzz::Bytes& in) {
  const std::size_t rows = in.below(24), row = in.below(32);
  std::array<double, 4> p{};
  for (double& v : p) v = (in.u8() - 128) / 64.0;
  const bool inside = row >= host::derivative_half && row + host::derivative_half < rows;
  const auto at = [&](std::size_t i) {
    require(i < rows, "a row of the table");
    const double x = static_cast<double>(i) - static_cast<double>(row);
    return p[0] + x * (p[1] + x * (p[2] + x * p[3]));
  };
  const double is = host::curvature(host::curvature_weights(), rows, row, at);
  require(inside ? std::abs(is - 2 * p[2]) < 1e-10 : is == 0.0, "the curvature of a cubic");
  if (!inside) return;
  const std::vector<double> weights = host::slope_weights();
  double slope = 0.0;
  for (std::size_t k = 0; k < weights.size(); ++k) slope += weights[k] * at(row + k - host::derivative_half);
  require(std::abs(slope - p[1]) < 1e-10, "the slope of a cubic");
}

// Lines of frames.

std::string upper(std::string text) {
  for (char& c : text) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  return text;
}

void line(const std::string& text) {
  const auto is = host::parse_candump(text), wanted = own_line(text);
  require(is.has_value() == wanted.has_value(), "a frame where there is one");
  if (!is) return;
  require(is->time_us == wanted->time_us && is->interface == wanted->interface && is->text == wanted->text,
          "its time and interface");
  require(is->frame == wanted->frame && hal::well_formed(is->frame), "that frame and no other");
  const std::string again = host::candump_line(is->time_us, is->interface, is->frame);
  const auto twice = host::parse_candump(again);
  require(twice && twice->frame == is->frame && twice->time_us == is->time_us &&
              twice->interface == is->interface,
          "it can be said again");
  require(again.substr(twice->text) == upper(text.substr(is->text)), "as it was heard");
}

/// A frame that a log can hold.
std::optional<CanFrame> loggable(fuzz::Bytes& in) {
  CanFrame f = in.frame();
  f.bit_rate_switch = f.bit_rate_switch && f.fd;
  if (f.remote) f.data = {};
  return hal::well_formed(f) ? std::optional(f) : std::nullopt;
}

void frame(fuzz::Bytes& in) {
  const auto f = loggable(in);
  if (!f) return;
  const std::uint64_t high = in.u32();
  const auto time = static_cast<std::int64_t>((high << 24U | in.u16()) % 1'000'000'000'000'000'000U);
  const std::string text = host::candump_line(time, "vcan" + std::to_string(in.u8()), *f);
  line(text);
  const auto back = host::parse_candump(text);
  require(back && back->frame == *f && back->time_us == time, "there and back");
  // Nearly that line.
  std::string other = text;
  for (unsigned n = in.below(3); n > 0; --n) {
    static constexpr std::string_view odd = "-+ 0189aFR#.()x";
    const std::size_t at = in.u8() % other.size();
    if (in.yes()) {
      other[at] = odd[in.u8() % odd.size()];
    } else {
      other.insert(at, 1, odd[in.u8() % odd.size()]);
    }
  }
  line(other);
}

// Directories.

/// A frame that is another one.
CanFrame changed(CanFrame f, unsigned how) {
  const bool plain = !f.fd && !f.remote;
  if (how == 1 && f.id < 0x800U) {
    f.extended = !f.extended;
  } else if (how == 2 && plain) {
    f.remote = true;
  } else if (how == 3 && plain) {
    f.fd = true;
  } else if (how == 4 && f.fd) {
    f.bit_rate_switch = !f.bit_rate_switch;
  } else if (how == 5 && f.size > 0) {
    --f.size;
  } else if (how == 6 && f.size > 0 && !f.remote) {
    f.data[f.size - 1U] ^= 1U;
  } else {
    f.id ^= 1U;
  }
  return f;
}

/// A node that does what it did then, and at `other` something else: that is found, and nothing besides.
void again(const host::Recording& r, const std::vector<host::PassedFrame>& wanted, std::size_t other,
           unsigned how) {
  host::RecordedBus bus(r.interface, host::passed_frames(r));
  bool told = false;
  for (std::size_t i = 0; i < wanted.size(); ++i) {
    const host::PassedFrame& w = wanted[i];
    CanFrame f = w.frame;
    require(!bus.over() && bus.has_input() == !w.sent && bus.passed() == i,
            "what comes next is what came then");
    if (w.sent) {
      if (i == other) f = changed(f, how);
      require(bus.try_send(f) == hal::SendStatus::ok, "a frame is sent");
      told = told || i == other;
    } else {
      for (int looks = 0; looks < 300 && !bus.try_receive(f); ++looks) bus.look();
      if (bus.passed() == i) return require(w.look > 0, "what came before the first look is there");
      require(f == w.frame && bus.frame_age_us() == w.age_us, "what was received is received again");
    }
    require(bus.deviation().has_value() == told, "a deviation is found, and nothing else is one");
    if (told)
      require(bus.deviation()->line == other + 1 && bus.deviation()->recorded == wanted[other].frame,
              "the first one, and where");
  }
  bus.end();
  require(bus.over() && bus.deviation().has_value() == told, "nothing is left");
}

void judge(const Files& files, const Summary& s, bool any_version, std::size_t other, unsigned how) {
  for (std::size_t i = 0; i < files.size(); ++i) {
    if (files[i]) {
      folder().write(i, *files[i]);
    } else {
      folder().remove(i);
    }
  }
  const std::string& path = folder().path();
  std::optional<host::Recording> r;
  const auto message = refusal([&] { r = host::read_recording(path, any_version); });
  const auto at_fault = faults(files, s, any_version);
  require(message.has_value() == !at_fault.empty(), "refused where something is wrong, and only there");
  if (message) {
    const bool named = std::ranges::any_of(at_fault, [&](const std::string& name) {
      return message->starts_with(name.empty() ? path + ": " : path + "/" + name + ":");
    });
    return require(named, "what is named is at fault");
  }
  require(r->directory == path && r->command == *string_of(s.run, "command") &&
              r->seed == *number_of(s.rest, "seed") && r->ticks == *number_of(s.rest, "ticks") &&
              r->realtime == (s.run.at("realtime") == "true") &&
              r->single_precision == (s.run.at("scalar") == "\"float\"") &&
              r->interrupted == s.rest.contains("interrupted"),
          "what is read is what stands there");
  host::Scene scene;
  scene.toml = *files[1];
  for (std::size_t i = 5; i < files.size(); ++i) {
    if (files[i]) scene.companions.push_back({file_names[i], *files[i], ""});
  }
  require(host::scene_digest(scene) == own_digest(files), "the digest is that of a run");
  if (r->command == "sim") return;
  require(r->interface == own_line(whole_lines(files[3])->front())->interface,
          "the interface is that of the first frame");
  if (!r->one_end()) return;
  std::size_t refused = 0;
  const auto wanted = own_passage(files, refused);
  std::size_t n = 0;
  const auto passage = refusal([&] {
    const auto next = host::passed_frames(*r);
    for (auto p = next(); p; p = next()) {
      require(n < wanted.size() && p->time_us == wanted[n].time_us && p->look == wanted[n].look &&
                  p->sent == wanted[n].sent && p->age_us == wanted[n].age_us && p->frame == wanted[n].frame,
              "what passed is what is written");
      ++n;
    }
  });
  require(n == wanted.size() && passage.has_value() == (refused != 0), "all of it, up to what is refused");
  if (!passage) return again(*r, wanted, other, how);
  require(passage->starts_with(path + "/frames.csv:" + std::to_string(refused) + ": "),
          "file and line of what is bad");
}

/// A file under a hand that is not careful.
void spoil(fuzz::Bytes& in, std::optional<std::string>& text) {
  const unsigned how = in.below(6);
  if (how == 0) return text.reset();
  if (!text) text = "";
  const std::size_t at = text->empty() ? 0 : in.u8() % text->size();
  switch (how) {
    case 1:
      text->resize(at);
      break;
    case 2:
      text->insert(at, 1, static_cast<char>(in.u8()));
      break;
    case 3:
      *text += "\n";
      break;
    case 4:
      *text += *text;
      break;
    default:
      if (!text->empty()) (*text)[at] = static_cast<char>(in.u8());
      break;
  }
}

/// A recording that is nearly right.
void directory(fuzz::Bytes& in) {
  static const std::array<const char*, 4> commands{"\"sim\"", "\"hil\"", "\"plant\"", "\"controller\""};
  const unsigned shape = in.u8(), beside = in.u8();
  Files files;
  Summary s;
  const std::size_t length = in.below(4);
  files[1] = std::string(length, static_cast<char>(in.u8()));
  for (std::size_t i = 5; i < files.size(); ++i) {
    if ((beside >> i & 1U) != 0) files[i] = std::string(in.below(4), 'x');
  }
  const std::size_t ticks = in.below(5), frames = in.below(7);
  files[2] = "t\n";
  for (std::size_t i = 0; i < ticks; ++i) *files[2] += std::to_string(i) + "\n";
  files[3] = "";
  files[4] = "look,sent,age_us\n";
  std::size_t written = 0;
  for (std::uint64_t i = 0, time = 0, look = 0; i < frames; ++i) {
    const auto f = loggable(in);
    if (!f) continue;
    ++written;
    time += in.u16();
    look += in.below(3);
    const unsigned how = in.u8();
    *files[3] += host::candump_line(static_cast<std::int64_t>(time), "can0", *f) + "\n";
    *files[4] += std::to_string(look) + ((how & 1U) != 0 ? ",1,0\n" : ",0," + std::to_string(how) + "\n");
  }
  s.run = {{"command", commands[shape & 3U]},
           {"version", std::string("\"") + host::version + "\""},
           {"realtime", (shape & 4U) != 0 ? "true" : "false"},
           {"scalar", (shape & 8U) != 0 ? "\"float\"" : "\"double\""},
           {"scene_digest", "\"" + own_digest(files) + "\""}};
  s.rest = {{"seed", std::to_string(in.u32())}, {"ticks", std::to_string(ticks)}};
  if ((shape & 16U) != 0) s.rest["interrupted"] = "true";
  s.bus = {{"frames", std::to_string(written)}, {"lost", "0"}};
  // Every wrong one hides what comes after it.
  static const std::array<const char*, 16> odd{"null",
                                               "true",
                                               "false",
                                               "0",
                                               "1",
                                               "-1",
                                               "1.5",
                                               "1e3",
                                               "18446744073709551615",
                                               "18446744073709551616",
                                               "\"\"",
                                               "\"sim\"",
                                               "\"a\\nb\"",
                                               "[]",
                                               "{}",
                                               "[{\"a\": null}]"};
  for (unsigned n = in.below(8) < 4 ? 0 : 1 + in.below(3); n > 0; --n) {
    const unsigned what = in.below(8);
    if (what == 0) {
      std::map<std::string, std::string>& of = in.yes() ? s.run : (in.yes() ? s.rest : s.bus);
      if (!of.empty()) of.erase(std::next(of.begin(), static_cast<std::ptrdiff_t>(in.u8() % of.size())));
    } else if (what < 4) {
      std::map<std::string, std::string>& of = what == 1 ? s.run : (what == 2 ? s.rest : s.bus);
      if (!of.empty())
        std::next(of.begin(), static_cast<std::ptrdiff_t>(in.u8() % of.size()))->second =
            odd[in.u8() % odd.size()];
    } else if (what == 4) {
      s.instead_of_run = odd[in.u8() % odd.size()];
    } else {
      spoil(in, files[1 + in.u8() % (files.size() - 1)]);
    }
  }
  if (in.below(32) != 31) files[0] = s.text();
  const std::size_t other = in.below(8);
  judge(files, s, (shape & 32U) != 0, other, in.below(8));
}

/// A summary as text, beside a run of no ticks: whatever is accepted says that.
void summary(const std::string& text) {
  const Files files{text, "", "t\n"};
  for (std::size_t i = 0; i < files.size(); ++i) {
    if (files[i]) {
      folder().write(i, *files[i]);
    } else {
      folder().remove(i);
    }
  }
  std::optional<host::Recording> r;
  const auto message = refusal([&] { r = host::read_recording(folder().path(), true); });
  const bool digest = text.find(own_digest(files)) != std::string::npos;
  if (!message)
    return require(r->command == "sim" && r->ticks == 0 && !r->interrupted && digest,
                   "a run of no ticks, of that scene");
  for (std::size_t i = 0; i < 4; ++i) {
    if (message->starts_with(folder().file(file_names[i]) + ":")) return;
  }
  require(message->starts_with(folder().path() + ": "), "a refusal says of what");
}

/// What is not there, or is no file.
void nowhere(fuzz::Bytes& in) {
  const bool there = in.yes();
  const std::string& path = folder().path();
  folder().remove(0);
  if (there) folder().occupy(0);
  const std::string file = folder().file(file_names[0]);
  const std::string why = there ? ": is not a regular file" : ": there is no such file";
  require(refusal([&] { (void)host::read_table(file, asked, ""); }) == file + why, "no table");
  require(refusal([&] { (void)host::read_recording(path, true); }) == file + why, "no summary");
  const auto message = refusal([&] { (void)host::read_recording(path + "/none", true); });
  require(message && message->starts_with(path + "/none: no such directory"), "no directory");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const std::string rest(reinterpret_cast<const char*>(data) + 1, size - 1);
  fuzz::Bytes in(data, size);
  const auto build = [&] { built_table(in); };
  in.one_of(
      8, [&] { (void)table(rest, 1e-3); }, build, build, [&] { line(rest); }, [&] { frame(in); },
      [&] { summary(rest); }, [&] { in.below(4) == 0 ? nowhere(in) : derivatives(in); },
      [&] { directory(in); });
  return 0;
}
