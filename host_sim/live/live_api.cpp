#include "host_sim/live/live_api.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <iterator>
#include <nlohmann/json.hpp>
#include <utility>

#include "host_sim/error.hpp"
#include "host_sim/json_text.hpp"
#include "host_sim/live/session.hpp"
#include "host_sim/record/recording.hpp"
#include "host_sim/report/workspace.hpp"
#include "host_sim/version.hpp"

namespace esmc::host {

using Json = nlohmann::ordered_json;

namespace {

constexpr std::size_t samples_kept = 120'000, samples_shown = 20'000, events_kept = 200;
constexpr std::uint64_t samples_at_once = 2000;

double number(const Json& j) {
  if (!j.is_number()) throw Malformed();
  const double v = j.get<double>();
  if (!std::isfinite(v)) throw Malformed();
  return v;
}
V2 pair(const Json& j) {
  if (!j.is_array() || j.size() != 2) throw Malformed();
  return {number(j[0]), number(j[1])};
}
std::string text(const Json& j) {
  if (!j.is_string()) throw Malformed();
  return j.get<std::string>();
}
std::vector<std::string> texts(const Json& j) {
  if (!j.is_array()) throw Malformed();
  std::vector<std::string> out;
  for (const Json& item : j) out.push_back(text(item));
  return out;
}

/// The scene alone: files that it names are where they were.
std::string scene_text(const Scene& scene) {
  std::string out = scene.toml;
  for (const auto& [copy, text, original] : scene.companions) {
    const std::string name = "'" + std::string(copy) + "'";
    const std::string place = "'''" + std::filesystem::absolute(original).string() + "'''";
    if (const std::size_t at = out.find(name); at != std::string::npos) out.replace(at, name.size(), place);
  }
  return out;
}

/// Names of the columns of log.csv, the state last.
std::vector<std::string> sample_columns(const Scene& scene) {
  const auto joints = joint_names(scene.type);
  std::vector<std::string> out{"t", "x", "y"};
  out.insert(out.end(), joints.begin(), joints.end());
  for (const std::size_t joint : scene.motor_joints()) out.push_back("tau" + joints[joint].substr(5));
  for (const char* name : {"x_ref", "y_ref", "s_1", "s_2", "force_x", "force_y", "state"})
    out.emplace_back(name);
  return out;
}
/// Values of all columns but the state; NaN where there is none.
std::vector<double> sample_values(const LiveSample& s, const Scene& scene) {
  const std::size_t first = scene.type == MechanismType::five_bar ? 2 : 0, joints = first == 2 ? 4 : 2;
  std::vector<double> out{s.t, s.effector[0], s.effector[1]};
  for (std::size_t i = 0; i < joints; ++i) out.push_back(s.q[first + i]);
  for (std::size_t i = 0; i < static_cast<std::size_t>(scene.motors()); ++i) out.push_back(s.torque[i]);
  for (const auto& pair : {s.desired, s.sliding, s.force}) out.insert(out.end(), pair.begin(), pair.end());
  return out;
}

std::string per_kind(const PerKind& k) {
  return k.position == k.angle ? fmt::format("{}", k.position)
                               : fmt::format("{{ position = {}, angle = {} }}", k.position, k.angle);
}

}  // namespace

/// A connected page: how far it is up to date, and its hand.
class Page final : public Client {
 public:
  explicit Page(LiveApi& api)
      : api_(api),
        sample_(std::max(api.samples_.first,
                         api.samples_.end() - std::min(samples_shown, api.samples_.list.size()))),
        hand_(api.usual_hand_) {}
  ~Page() override {
    if (held_) api_.release_ = Hand{.most = hand_.most};
  }
  Page(const Page&) = delete;
  Page& operator=(const Page&) = delete;
  [[nodiscard]] std::string next() override {
    const auto& kept = api_.samples_;
    const bool scene = scene_ != api_.scene_number_, event = event_ < api_.events_.end();
    if (greeted_ && !scene && !event && answers_.empty() && sample_ >= kept.end()) return {};
    std::string out = "{";
    const auto part = [&](const char* name, const std::string& json) {
      out += fmt::format("{}\"{}\":{}", out.size() > 1 ? "," : "", name, json);
    };
    if (!std::exchange(greeted_, true)) part("hello", api_.hello_json());
    if (scene) part("scene", api_.scene_json());
    scene_ = api_.scene_number_;
    if (event) {
      Json list = Json::array();
      for (event_ = std::max(event_, api_.events_.first); event_ < api_.events_.end(); ++event_) {
        const LiveEvent& e = api_.events_.at(event_);
        list.push_back({{"t", e.t}, {"kind", e.kind}, {"text", e.text}});
      }
      part("events", json_text(list));
    }
    if (!answers_.empty()) part("answers", json_text(std::exchange(answers_, {})));
    if (sample_ < kept.end()) {
      part("samples", samples());
      const LiveSample& s = kept.list.back();
      const Json now{{"t", s.t},
                     {"state", s.state},
                     {"fault", s.fault},
                     {"q", s.q},
                     {"effector", s.effector},
                     {"desired", s.desired},
                     {"force", s.force},
                     {"anchor", s.holding ? Json(s.anchor) : Json(nullptr)},
                     {"brake", s.brake},
                     {"injecting", s.injecting},
                     {"saturated", s.saturated},
                     {"late", api_.loop_.late.load()},
                     {"dropped", api_.loop_.dropped.load()}};
      part("now", json_text(now));
    }
    return out + "}";
  }
  void on_message(std::string_view message) override {
    try {
      const Json j = parse_json(message, false);
      if (!j.is_object()) throw Malformed();
      apply(j);
    } catch (const Malformed&) {
      ++api_.malformed_;
    } catch (const std::exception& e) {  // of a scene that is refused: what is wrong and what is allowed
      answers_.emplace_back(printable(e.what()));
    }
  }

 private:
  void apply(const Json& j) {
    for (const auto& [key, value] : j.items()) {
      if (key == "do") {
        const auto command = from_name<LiveCommand>(text(value));
        if (!command) throw Malformed();
        api_.send(*command);
      } else if (key == "hand") {
        set_hand(value);
      } else if (key == "inject") {
        inject(value);
      } else if (key == "set") {
        api_.set(texts(value));
      } else if (key == "effects") {
        std::vector<std::string> tables = texts(value);
        for (std::string& e : tables) e = "{ " + e + " }";
        api_.set({fmt::format("effects=[{}]", fmt::join(tables, ", "))});
      } else {
        throw Malformed();
      }
    }
  }
  void inject(const Json& j) {
    if (j.is_null()) return api_.send(Injection{});
    if (!j.is_object() || !j.contains("fault")) throw Malformed();
    const std::string name = text(j["fault"]);
    const Scene& scene = *api_.scene_;
    const auto rows = injection_rows();
    const auto row = std::ranges::find(rows, name, &InjectionRow::name);
    if (row == rows.end() || !api_.injectable(*row))
      throw InputError("", printable(name) + ": no fault of these drives");
    const double drive = j.contains("drive") ? number(j["drive"]) : 1.0;
    if (!(drive >= 1.0 && drive <= static_cast<double>(scene.motors())) || drive != std::floor(drive)) {
      throw InputError("", fmt::format("drive: 1 to {}", scene.motors()));
    }
    Injection o = usual_injection(*row, static_cast<std::size_t>(drive) - 1);
    if (j.contains("ms") && j["ms"].is_null()) {
      o.length = for_ever;
    } else if (j.contains("ms")) {
      o.length = static_cast<int>(
          std::clamp(std::round(number(j["ms"]) * 1e-3 * scene.rate_hz), 1.0, double{for_ever}));
    }
    constexpr double largest = 1e6;  // frames in a tick, ticks of delay, N m, rad
    if (j.contains("amount")) o.amount = std::clamp(number(j["amount"]), -largest, largest);
    api_.send(o);
  }
  void set_hand(const Json& j) {
    if (!j.is_object()) throw Malformed();
    Hand h = hand_;
    constexpr double most_stiff = 1e4, most_damped = 1e3, strongest = 1e3, farthest = 1e3;
    const auto within = [](V2 v, double most) {
      return V2{std::clamp(v.x, -most, most), std::clamp(v.y, -most, most)};
    };
    const auto optional = [&](const char* key, double& into, double most) {
      if (j.contains(key)) into = std::clamp(number(j[key]), 0.0, most);
    };
    optional("stiffness", h.stiffness, most_stiff);
    optional("damping", h.damping, most_damped);
    optional("most", h.most, strongest);
    h.holding = j.contains("at") && !j["at"].is_null();
    if (h.holding) h.anchor = within(pair(j["at"]), farthest);
    h.push = j.contains("push") ? within(pair(j["push"]), strongest) : V2{};
    api_.send(h);
    api_.release_.reset();
    hand_ = h;
    held_ = h.holding || h.push.x != 0.0 || h.push.y != 0.0;
  }
  /// Samples as columns: shorter than rows with names, and what a plot wants.
  [[nodiscard]] std::string samples() {
    const auto& kept = api_.samples_;
    sample_ = std::clamp(sample_, kept.first, kept.end());
    const std::uint64_t to = std::min(kept.end(), sample_ + samples_at_once);
    fmt::memory_buffer out;
    const auto column = [&](std::string_view name, int digits, const auto& value) {
      fmt::format_to(std::back_inserter(out), "{}\"{}\":[", out.size() == 0 ? '{' : ',', name);
      for (std::uint64_t i = sample_; i < to; ++i) {
        const double v = value(kept.at(i));
        if (i > sample_) out.push_back(',');
        if (std::isfinite(v)) {
          fmt::format_to(std::back_inserter(out), "{:.{}g}", v, digits);
        } else {
          out.append(std::string_view("null"));
        }
      }
      out.push_back(']');
    };
    column("t", 9, [](const LiveSample& s) { return s.t; });
    column("x", 6, [](const LiveSample& s) { return s.effector[0]; });
    column("y", 6, [](const LiveSample& s) { return s.effector[1]; });
    column("xd", 6, [](const LiveSample& s) { return s.desired[0]; });
    column("yd", 6, [](const LiveSample& s) { return s.desired[1]; });
    column("error", 5, [](const LiveSample& s) {
      return std::hypot(s.effector[0] - s.desired[0], s.effector[1] - s.desired[1]);
    });
    for (std::size_t m = 0; m < static_cast<std::size_t>(api_.scene_->motors()); ++m)
      column(fmt::format("tau{}", m + 1), 4, [m](const LiveSample& s) { return s.torque[m]; });
    column("s1", 4, [](const LiveSample& s) { return s.sliding[0]; });
    column("s2", 4, [](const LiveSample& s) { return s.sliding[1]; });
    column("force", 4, [](const LiveSample& s) { return std::hypot(s.force[0], s.force[1]); });
    sample_ = to;
    return fmt::to_string(out) + "}";
  }

  LiveApi& api_;
  std::uint64_t sample_, event_ = 0, scene_ = 0;
  bool greeted_ = false, held_ = false;
  Hand hand_;
  std::vector<std::string> answers_;
};

LiveApi::LiveApi(const RunOptions& options, std::shared_ptr<const Scene> scene, Exchange& exchange)
    : options_(options),
      given_(options.sets),
      scene_(std::move(scene)),
      exchange_(exchange),
      usual_hand_(usual_hand(*scene_)) {}

std::unique_ptr<Client> LiveApi::on_connect() { return std::make_unique<Page>(*this); }

void LiveApi::on_timer() {
  if (release_ && exchange_.orders.push(*release_)) release_.reset();  // full: at the next call
  LiveSample s;
  while (exchange_.samples.pop(s)) {
    if (mcap_ != nullptr) mcap_->row(sample_values(s, *scene_), s.state);
    samples_.add(s, samples_kept);
  }
  LiveEvent e;
  while (exchange_.events.pop(e)) events_.add(std::move(e), events_kept);
}

void LiveApi::record_to(RunMcap* file) {
  mcap_ = file;
  if (mcap_ != nullptr) mcap_->columns(sample_columns(*scene_));
}

std::string LiveApi::log_csv() const {
  std::string out = fmt::format("{}\n", fmt::join(sample_columns(*scene_), ","));
  for (const LiveSample& s : samples_.list)
    fmt::format_to(std::back_inserter(out), "{},{}\n", fmt::join(sample_values(s, *scene_), ","), s.state);
  return out;
}

std::string LiveApi::log_mcap() const {
  namespace fs = std::filesystem;
  const std::string file = (fs::temp_directory_path() / ("esmc-live-" + make_token())).string();
  RunMcap mcap(file);
  mcap.columns(sample_columns(*scene_));
  for (const LiveSample& s : samples_.list) mcap.row(sample_values(s, *scene_), s.state);
  mcap.commit();
  std::string out = bytes_of(file);
  fs::remove(file);
  return out;
}

std::unique_ptr<Served> LiveApi::download(std::string_view path) {
  if (path == "/log.csv") return std::make_unique<Served>(Served{"text/csv; charset=utf-8", log_csv()});
  if (path == "/log.mcap") return std::make_unique<Served>(Served{"application/octet-stream", log_mcap()});
  if (path == "/scene.toml")
    return std::make_unique<Served>(Served{"application/toml; charset=utf-8", scene_text(*scene_)});
  return nullptr;
}

void LiveApi::send(LiveOrder o) {
  if (!exchange_.orders.push(std::move(o)))
    throw InputError("", "the loop is behind with its orders: once more, please");
}

void LiveApi::set(const std::vector<std::string>& sets) {
  RunOptions o = options_;
  auto what = fmt::format("{}", fmt::join(sets, ", "));
  for (const std::string& s : sets) o.sets = with_set(std::move(o.sets), s);
  if (sets.empty()) o.sets = given_, what = "the scene as given";
  const auto scene = read_live_scene(o);
  const RestartLevel takes = restart_level(*scene_, *scene);
  if (!controller_here() && takes != RestartLevel::nothing) {
    throw InputError(
        "", "the controller is on " + options_.bus +
                " and keeps its scene: only effects of plant and drives, and 'simulation', can change");
  }
  constexpr std::size_t line = 120;
  if (what.size() > line) what = what.substr(0, line) + " …";
  send(SceneOrder{scene, takes, printable(what)});
  scene_ = scene;
  options_.sets = o.sets;
  ++scene_number_;
}

bool LiveApi::injectable(const InjectionRow& row) const {
  return can_inject(row, scene_->drives.protocol) && (controller_here() || can_inject_from_outside(row));
}

std::string LiveApi::scene_json() const {
  const Scene& s = *scene_;
  Json effects = Json::array();
  for (const EffectText& e : effect_texts(s.toml))
    effects.push_back({{"type", e.type}, {"parameters", e.parameters}});
  Json j{{"name", printable(s.name)},
         {"mechanism", mechanism_json(s.mechanism, s.type == MechanismType::five_bar)},
         {"law", name(s.law)},
         {"reaching", name(s.reaching)},
         {"lambda", per_kind(s.lambda)},
         {"gain", s.robust_gain ? std::string("robust") : per_kind(s.gain)},
         {"layer", per_kind(s.layer)},
         {"kp", s.kp ? fmt::format("{}", *s.kp) : ""},
         {"kd", s.kd ? fmt::format("{}", *s.kd) : ""},
         {"rate_hz", s.rate_hz},
         {"torque_limit", s.torque_limit},
         {"effects", std::move(effects)},
         {"sets", options_.sets}};
  return json_text(j);
}

std::string LiveApi::hello_json() const {
  Json faults = Json::array();
  for (const InjectionRow& r : injection_rows()) {
    if (!injectable(r)) continue;
    const Injection usual = usual_injection(r, 0);
    Json ms = r.longest == 0 ? Json(nullptr) : Json(1e3 * usual.length * scene_->tick());
    faults.push_back({{"name", r.name}, {"ms", std::move(ms)}});
  }
  const auto& laws = names_of<LawChoice>;  // those before open_loop close a loop
  const Json hello{
      {"version", version},
      {"bus", options_.bus},
      {"controller", controller_here()},
      {"motors", scene_->motors()},
      {"laws", std::vector(laws.begin(), laws.begin() + static_cast<int>(LawChoice::open_loop))},
      {"reaching_laws", names_of<ReachingChoice>},
      {"channels", scene_->type == MechanismType::five_bar ? Json{"x", "y"} : Json{"theta1", "theta2"}},
      {"faults", std::move(faults)},
      {"hand",
       {{"stiffness", usual_hand_.stiffness}, {"damping", usual_hand_.damping}, {"most", usual_hand_.most}}}};
  return json_text(hello);
}

}  // namespace esmc::host
