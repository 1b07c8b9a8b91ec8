#pragma once
/// Scenes that are nearly right, from a few bytes each: a good one, of which keys of the table are set to
/// good, bad and odd values, variants exchanged as a whole, keys taken away. A fuzzer that writes text does
/// not get past the first required key.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "host_sim/scene/key.hpp"
#include "tests/fuzz/bytes.hpp"
#include "tests/support/cycle_setup.hpp"

namespace esmc::fuzz {

class SceneBuilder {
 public:
  SceneBuilder(Bytes& in, bool five_bar, std::string file) : in_(in), file_(std::move(file)) {
    for (const host::Key& k : host::scene_keys()) {
      keys_.push_back(&k);
      const std::string variant(k.path.substr(0, k.path.find("].") + 1));
      if (k.path.find('[') != std::string_view::npos &&
          std::ranges::find(variants_, variant) == variants_.end())
        variants_.push_back(variant);
    }
    if (five_bar) {
      sections_["mechanism"] = {{"type", "\"five_bar\""},           {"half_base", "0.05"},
                                {"effector_mass", "0.05"},          {"gravity", "9.8"},
                                {"working_mode", "[\"+\", \"+\"]"}, {"assembly_mode", "\"-\""}};
      sections_["mechanism.leg"] = {{"l1", "0.12"}, {"l2", "0.16"}, {"lg1", "0.06"}, {"lg2", "0.068"},
                                    {"m1", "0.1"},  {"m2", "0.1"},  {"J1", "2e-4"},  {"J2", "7e-4"}};
      sections_["reference"] = {
          {"type", "\"circle\""}, {"center", "[0.0, 0.17]"}, {"radius", "0.02"}, {"speed", "10.0"}};
    } else {
      sections_["mechanism"] = {{"type", "\"rr\""}, {"gravity", "9.8"}, {"working_mode", "[\"+\"]"}};
      sections_["mechanism.leg"] = {{"l1", "0.3"}, {"l2", "0.25"}, {"lg1", "0.15"}, {"lg2", "0.11"},
                                    {"m1", "1.2"}, {"m2", "0.8"},  {"J1", "1e-2"},  {"J2", "4.5e-3"}};
      sections_["reference"] = {
          {"type", "\"line\""}, {"from", "[0.4, -0.1]"}, {"to", "[0.2, 0.25]"}, {"duration", "0.8"}};
    }
    sections_["control"] = {
        {"law", "\"esmc\""}, {"lambda", "40.0"}, {"gain", "150.0"}, {"torque_limit", "2.0"}};
    sections_["simulation"] = {{"duration", "0.1"}, {"step", "1e-4"}};
  }

  /// A few changes: every wrong one hides what comes after it.
  void change() {
    for (unsigned n = in_.below(16); n > 0 && !in_.empty(); --n) {
      const unsigned what = in_.below(10);
      switch (what) {
        case 0:
        case 1:
          whole(variants_[in_.u8() % variants_.size()]);
          break;
        case 2:
          take_away(*keys_[in_.u8() % keys_.size()]);
          break;
        case 3:
        case 4:
          preset();
          break;
        default: {
          const host::Key& k = *keys_[in_.u8() % keys_.size()];
          set(k, what < 8 ? plausible(k) : value(k));
          break;
        }
      }
    }
  }
  /// `key=value`, as for --set.
  std::vector<std::string> overrides(int most) {
    std::vector<std::string> out;
    for (; most > 0 && !in_.empty(); --most) {
      const host::Key& k = *keys_[in_.u8() % keys_.size()];
      std::string path(k.path);
      if (const auto from = path.find('['); from != std::string::npos)
        path.erase(from, path.find(']') - from + 1);
      out.push_back(path + "=" + value(k));
    }
    return out;
  }
  [[nodiscard]] std::string text() const {
    std::string out;
    for (const auto& [name, keys] : sections_) {
      if (name == "mechanism.leg" && legs_ != 1) continue;
      if (!name.empty()) out += "[" + name + "]\n";
      out += lines(keys);
    }
    for (int leg = 0; leg < legs_ && legs_ != 1; ++leg)
      out += "[[mechanism.legs]]\n" + lines(sections_.at("mechanism.leg"));
    for (const auto& [type, keys] : effects_) out += "[[effects]]\ntype = \"" + type + "\"\n" + lines(keys);
    return out;
  }

 private:
  using Keys = std::map<std::string, std::string>;

  static std::string lines(const Keys& keys) {
    std::string out;
    for (const auto& [k, v] : keys) out += k + " = " + v + "\n";
    return out;
  }
  static std::string number(double v) {
    if (std::isnan(v)) return "nan";
    if (std::isinf(v)) return v < 0 ? "-inf" : "inf";
    char text[40];
    std::snprintf(text, sizeof text, "%.9g", v);
    return std::string_view(text).find_first_of(".e") == std::string_view::npos ? std::string(text) + ".0"
                                                                                : text;
  }
  static std::string integer(double v) {
    return std::to_string(static_cast<long long>(std::clamp(v, -9e18, 9e18)));
  }
  static std::string list(const std::string& v, unsigned n) {
    std::string out = "[";
    for (unsigned i = 0; i < n; ++i) out += (i > 0 ? ", " : "") + v;
    return out + "]";
  }
  static std::vector<std::string> words(const host::Key& k) {
    std::vector<std::string> out;
    for (std::size_t at = 0; at < k.choices.size();) {
      const std::size_t end = std::min(k.choices.find(" | ", at), k.choices.size());
      out.push_back("\"" + std::string(k.choices.substr(at, end - at)) + "\"");
      at = end + 3;
    }
    return out;
  }
  static bool is(const host::Key& k, std::string_view what) {
    return k.kind.find(what) != std::string_view::npos;
  }

  /// A number that the key may have, and that scenes are likely to work with.
  static double fair(const host::Key& k) {
    const double low = std::isfinite(k.low) ? k.low : -1e3;
    if (is(k, "integer")) return std::max(1.0, low);
    return std::clamp(0.1, low, k.high) + (k.low_open && k.low >= 0.1 ? 0.1 : 0.0);
  }
  [[nodiscard]] std::string good(const host::Key& k) const {
    if (!k.choices.empty()) return is(k, "strings") ? list(words(k)[0], 2) : words(k)[0];
    if (k.kind == "boolean") return "true";
    if (k.kind == "string") return "\"" + file_ + "\"";
    if (k.kind == "number pairs") return "[[-0.02, 0.16], [0.02, 0.17]]";
    if (k.path == "control.torque") return "[{ offset = 0.1 }, { terms = [{ amp = 0.1, omega = 3.0 }] }]";
    if (k.path == "control.torque.terms") return "[{ amp = 0.1, omega = 3.0 }]";
    if (k.path == "limits.workspace") return "{ x = [-1.0, 1.0], y = [-1.0, 1.0] }";
    if (k.kind == "table" || k.kind == "tables") return "{}";
    const std::string one = k.kind == "integer" || k.kind == "integers" ? integer(fair(k)) : number(fair(k));
    if (k.kind == "integers") return "[1, 2]";
    return k.kind == "numbers" ? (is(k, "lower") ? "[-0.1, 0.1]" : list(one, 2)) : one;
  }
  /// A word or a number that the key may have.
  std::string plausible(const host::Key& k) {
    const auto w = words(k);
    if (!w.empty()) {
      const std::string& one = w[in_.u8() % w.size()];
      return is(k, "strings") ? list(one, 1 + in_.below(2)) : one;
    }
    if (k.kind == "boolean") return in_.yes() ? "true" : "false";
    if (!is(k, "number") && !is(k, "integer")) return good(k);
    const auto one = [&] {
      const int b = static_cast<std::int8_t>(in_.u8());
      const double size = fair(k) * std::exp2((b / 2) / 4.0),
                   v = std::clamp(b % 2 != 0 ? -size : size, std::max(k.low, -1e9), std::min(k.high, 1e9));
      return is(k, "integer") ? integer(v) : number(v);
    };
    if (k.kind == "number pairs") {
      const std::string a = one(), b = one();
      return "[[" + a + ", " + b + "], [" + a + ", " + b + "]]";
    }
    if (k.kind != "numbers" && k.kind != "integers" && in_.below(4) != 0) return one();
    std::string out = "[" + one();
    for (unsigned n = in_.yes() ? 3 : 1; n > 0; --n) out += ", " + one();
    return out + "]";
  }
  /// Of this key, or of none.
  std::string value(const host::Key& k) {
    static const std::vector<std::string> odd{"true",
                                              "false",
                                              "\"x\"",
                                              "\"\"",
                                              "{}",
                                              "[]",
                                              "[[]]",
                                              "[{}]",
                                              "{ position = 1.0, angle = 2.0 }",
                                              "{ position = 1.0 }",
                                              "{ position = 1.0, angle = \"x\" }",
                                              "{ a = 1.0, b = 2.0 }",
                                              "\"robust\"",
                                              "1979-05-27",
                                              "nan",
                                              "inf",
                                              "-inf",
                                              "1e308",
                                              "1e-320",
                                              "-0.0",
                                              "0x10",
                                              "[true]",
                                              "[1, 2.0]",
                                              "[\"a\", 1]",
                                              "[0.1, 0.2, 0.3]",
                                              "[-0.1, 0.1]",
                                              "[0.1, -0.1]",
                                              "[[0.1, -0.1], [0.0, 0.1]]",
                                              "[[0.0, 1.0], [1.0]]",
                                              "[[0.0, 0.1]]",
                                              "[[0.0, 0.1], [\"a\", 0.1]]",
                                              "9223372036854775807",
                                              "2.5",
                                              "127",
                                              "\"\\u0000\"",
                                              "\"/nowhere\"",
                                              "\"/\"",
                                              "'''a'''",
                                              "\"\"\"a\\\n b\"\"\"",
                                              "[{ offset = 1.0, terms = [] }, { offset = 1.0 }]",
                                              "[{ offset = \"x\" }]",
                                              "[{ terms = [{ amp = 1.0, omega = 2.0, phase = 0.5 }] }, {}]",
                                              "[{ terms = [{ amp = 1.0 }] }, {}]",
                                              "{ x = [0.0, 1.0] }",
                                              "{ x = [1.0, 0.0], y = [0.0, 1.0] }"};
    const auto small = [&] { return number(static_cast<std::int8_t>(in_.u8()) * 0.02); };
    switch (in_.below(12)) {
      case 0:
        return good(k);
      case 1:
        return k.fallback.empty() || k.fallback == "-" ? good(k) : std::string(k.fallback);
      case 2: {
        const auto w = words(k);
        if (w.empty()) return odd[in_.u8() % odd.size()];
        const std::string& one = w[in_.u8() % w.size()];
        return is(k, "strings") ? list(one, 1 + in_.below(3)) : one;
      }
      case 3:
        return odd[in_.u8() % odd.size()];
      case 4:
        return is(k, "integer") ? integer(in_.yes() ? k.low : k.high) : number(in_.yes() ? k.low : k.high);
      case 5:
        return number(in_.yes() ? k.low - 1e-9 - std::fabs(k.low) * 1e-9 : k.high * (1 + 1e-9) + 1e-9);
      case 6:
        return list(is(k, "integer") ? integer(fair(k)) : number(fair(k)), in_.below(6));
      case 7:
        return integer(static_cast<std::int8_t>(in_.u8()));
      case 8:
        return small();
      case 9: {
        const std::string a = small();
        return "[" + a + ", " + small() + "]";
      }
      case 10: {
        const std::string a = small(), b = small();
        return "[" + a + ", " + b + ", " + small() + ", " + b + "]";
      }
      default: {
        const std::string a = small(), b = small();
        return "[[" + a + ", " + b + "], [" + small() + ", " + a + "]]";
      }
    }
  }

  /// Of a pose that closes, near the reference of the five-bar; without the passive joints, or with them.
  std::string joints() {
    const double x = static_cast<std::int8_t>(in_.u8()) * 1e-3, y = 0.12 + in_.u8() * 5e-4;
    const unsigned modes = in_.u8();
    const auto q = test::five_bar_angles(x, y, (modes & 1U) != 0 ? -1 : 1, (modes & 2U) != 0 ? -1 : 1);
    char text[120];
    if ((modes & 4U) != 0) {
      std::snprintf(text, sizeof text, "[%.12e, %.12e]", q[0], q[2]);
    } else {
      std::snprintf(text, sizeof text, "[%.12e, %.12e, %.12e, %.12e]", q[0], q[1], q[2], q[3]);
    }
    return text;
  }

  void set(const host::Key& k, const std::string& v) {
    const std::string path(k.path);
    if (path.starts_with("effects[")) {
      const std::string type = path.substr(8, path.find(']') - 8), key = path.substr(path.rfind('.') + 1);
      for (auto& [name, keys] : effects_) {
        if (name == type) keys[key] = v;
      }
      return;
    }
    if (path == "mechanism.legs") {
      legs_ = static_cast<int>(in_.below(4));
      return;
    }
    if (path.starts_with("control.torque.") || path == "effects.type" || path == "mechanism.leg") return;
    const std::size_t dot = path.rfind('.');
    std::string section = dot == std::string::npos ? "" : path.substr(0, dot);
    section = section.substr(0, section.find('['));
    if (dot == std::string::npos && k.kind == "table") return;
    sections_[section][path.substr(dot == std::string::npos ? 0 : dot + 1)] = v;
  }
  void take_away(const host::Key& k) {
    const std::string path(k.path);
    const std::size_t dot = path.rfind('.');
    if (dot == std::string::npos) return;
    const std::string section = path.substr(0, std::min(dot, path.find('[')));
    if (const auto at = sections_.find(section); at != sections_.end())
      at->second.erase(path.substr(dot + 1));
    if (section == "effects" && !effects_.empty()) effects_.pop_back();
  }
  /// A reference or an effect with all that it needs.
  void whole(const std::string& variant) {
    const std::string section = variant.substr(0, variant.find('[')),
                      type = variant.substr(section.size() + 1, variant.size() - section.size() - 2);
    Keys keys;
    for (const host::Key* k : keys_) {
      if (k->path.starts_with(variant + ".") && k->fallback.empty())
        keys[std::string(k->path.substr(variant.size() + 1))] = good(*k);
    }
    if (section == "effects") {
      effects_.emplace_back(type, keys);
    } else {
      keys["type"] = "\"" + type + "\"";
      sections_[section] = keys;
    }
  }
  /// What only works together.
  void preset() {
    auto& control = sections_["control"];
    auto& drives = sections_["drives"];
    in_.one_of(
        16, [&] { control["motors"] = control["sensors"] = "\"all\""; },
        [&] {
          control["sensors"] = "\"all\"";
          sections_["sensors"]["nodes"] = "[3, 4]";
        },
        [&] {
          control["law"] = "\"none\"";
          for (const auto* gone : {"lambda", "gain", "torque_limit"}) control.erase(gone);
        },
        [&] {
          control["law"] = "\"open_loop\"";
          for (const auto* gone : {"lambda", "gain", "torque_limit"}) control.erase(gone);
          control["torque"] = "[{ offset = 0.1 }, { terms = [{ amp = 0.1, omega = 3.0 }] }]";
        },
        [&] {
          control["law"] = "\"pd\"";
          for (const auto* gone : {"lambda", "gain"}) control.erase(gone);
          control["kp"] = control["kd"] = "10.0";
        },
        [&] {
          control["gain"] = "\"robust\"";
          sections_["uncertainty"]["m1"] = "0.1";
        },
        [&] { drives["protocol"] = "\"cia402\""; }, [&] { drives["protocol"] = "\"mit\""; },
        [&] {
          sections_["command"] = {{"speed", "0.5"}, {"acceleration", "5.0"}};
        },
        [&] {
          sections_["simulation"].erase("step");
          sections_["simulation"]["accuracy"] = "1e-6";
        },
        [&] { control["law"] = "\"esmc_projected\""; }, [&] { control["law"] = "\"smc\""; },
        [&] {
          control["law"] = "\"ctc\"";
          control.erase("gain");
        },
        [&] { control["reaching"] = in_.yes() ? "\"super_twisting\"" : "\"implicit_coupled\""; },
        [&] {
          control["predictor"] = "true";
          control["delay_ticks"] = number(in_.below(20) * 0.5);
        },
        [&] {
          sections_["initial"] = {{"joints", joints()}};
        });
  }

  Bytes& in_;
  std::string file_;
  std::vector<const host::Key*> keys_;
  std::vector<std::string> variants_;
  std::map<std::string, Keys> sections_;
  std::vector<std::pair<std::string, Keys>> effects_;
  int legs_ = 1;
};

}  // namespace esmc::fuzz
