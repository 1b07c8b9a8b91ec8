#include <fmt/format.h>

#include <map>
#include <nlohmann/json.hpp>
#include <thread>

#include "host_sim/operate/console.hpp"
#include "host_sim/operate/page_api.hpp"
#include "host_sim/operate/status_text.hpp"
#include "host_sim/record/fault_record.hpp"
#include "host_sim/record/recorder.hpp"
#include "host_sim/report/workspace.hpp"
#include "host_sim/version.hpp"

namespace esmc::host {

extern const std::string_view operate_html, operate_css, operate_js;

namespace {

using Json = nlohmann::ordered_json;
using Clock = Connection::Clock;
using std::chrono::milliseconds;

constexpr milliseconds picture(20), row_period(5), stop_period(20);

Json hello_of(const Connection& link, const Scene& scene) {
  const bool five_bar = scene.type == MechanismType::five_bar,
             joints = scene.reference.type == ReferenceType::joint_sine;
  const auto& box = joints ? scene.limits.joint_angle : scene.limits.workspace;
  const Json base = five_bar ? Json{"theta11", "theta21"} : Json{"theta1", "theta2"};
  return {{"version", version},
          {"name", printable(scene.name)},
          {"scene", printable(scene.file)},
          {"mechanism", mechanism_json(scene.mechanism, five_bar)},
          {"joints", base},
          {"axes", joints ? base : Json{"x", "y"}},
          {"unit", joints ? "rad" : "m"},
          {"box", box ? Json(*box) : Json(nullptr)},
          {"speed", link.parameter(link::Index::speed)},
          {"homes", !scene.drives.homing_speed.empty()},
          {"rate_hz", scene.rate_hz}};
}

Clock::duration seconds(double s) {
  return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(s));
}

/// What telemetry says of a fault, for the command interface carries its name and its axis alone. Of one that
/// the pose in the last telemetry shows (joint angle, workspace, singularities, closure): `where`,
/// `measured`, `limit`, `unit`; otherwise an empty object.
Json fault_values(Fault fault, const ControllerNews& news, const Scene& scene) {
  Json values = Json::object();
  const std::size_t second = news.joint[3] ? 2 : 1;  // with four motors the third is the other base joint
  if (!news.joint[0] || !news.joint[second]) return values;
  Scene of_base_joints = scene;  // the angles of passive joints are not sent
  of_base_joints.all_sensors = false;
  with_world(scene, [&]<class Traits>(Traits) {
    using M = typename Traits::Mechanism;
    Sample<M> sample;
    sample.angle[0] = static_cast<double>((*news.joint[0])[0]);
    sample.angle[M::joints / 2] = static_cast<double>((*news.joint[second])[0]);
    TickResult<M> result;
    result.fault = fault;
    FaultFinder<Traits> finder(of_base_joints);
    finder.see(result, sample);
    if (const auto& found = finder.found(); found && found->measured && found->limit)
      values = {{"where", found->where},
                {"measured", *found->measured},
                {"limit", *found->limit},
                {"unit", found->unit}};
  });
  return values;
}

class PageLoop {
 public:
  PageLoop(Connection& link, Console& console, const Scene& scene, PageApi& api)
      : link_(link), console_(console), scene_(scene), api_(api) {
    link_.attend({[this] { meanwhile(); }, [this] { return api_.take_life(); },
                  [this] { return api_.stop() != PageApi::Stop::none; }});
    console_.tell([this](const std::string& text) { api_.tell(time(), "told", text); });
  }
  ~PageLoop() {
    link_.attend({});
    console_.tell({});
  }
  PageLoop(const PageLoop&) = delete;
  PageLoop& operator=(const PageLoop&) = delete;

  void run() {
    while (!stop_requested()) {
      try {
        link_.pump(milliseconds(5));
      } catch (const ControllerSilent&) {  // the page says so; a stop goes on until it is heard
        continue;
      }
      if (const auto stop = api_.stop(); stop != PageApi::Stop::none) {
        carry_out(stop);
      } else if (auto order = api_.next_order()) {
        if (const std::uint64_t jog = order->hold_to)
          console_.hold_to_run([this, jog] { return api_.held(jog); });
        carry_out(order->words);
      }
    }
  }

 private:
  void carry_out(PageApi::Stop stop) {
    if (stop == PageApi::Stop::left) {
      guarded([&] { console_.leave(); });
    } else {
      carry_out(Console::Words{stop == PageApi::Stop::off ? "off" : "halt"});
    }
    if (link_.silent_s() * 1e3 <= silence_ms) api_.stop_done(stop);
  }
  void carry_out(const Console::Words& words) {
    api_.tell(time(), "order", fmt::format("{}", fmt::join(words, " ")));
    busy_ = words.front();
    guarded([&] { console_.run(words); });
    busy_.clear();
  }
  /// What is refused is told; a bus that is gone shows in the next pump.
  template <class Do>
  void guarded(const Do& action) {
    try {
      action();
    } catch (const Interrupted&) {  // by a stop, whose end is told
    } catch (const std::runtime_error& e) {
      api_.tell(time(), "refused", e.what());
    }
  }

  [[nodiscard]] double time() const { return link_.seconds(link_.news().ticks); }
  /// In every wait of the console: what is shown, and stops without waiting for the command that runs.
  void meanwhile() {
    const auto now = Clock::now();
    const auto stop = api_.stop();
    if (stop > PageApi::Stop::left && now - stopped_ >= stop_period &&
        link_.status().state != State::disabled) {
      stopped_ = now;
      link_.send(link_.client().order(stop == PageApi::Stop::off ? link::Order::off : link::Order::disarm));
    }
    if (link_.news().statuses != statuses_) row(now);
    if (now - shown_ < picture) return;
    shown_ = now;
    Json j = status_json(link_);
    j["t"] = time();
    j["busy"] = busy_;
    const double silent = link_.silent_s(), usual = scene_.command->status_ticks * scene_.tick();
    j["silent_s"] = silent > std::max(1.0, 3.0 * usual) ? Json(silent) : Json(nullptr);
    for (Json& record : j["faults"]) {
      if (const auto found = found_.find(record["name"].get<std::string>()); found != found_.end())
        record.update(found->second);
    }
    if (const Points* points = console_.known_points()) j["points"] = points->all();
    api_.publish(j.dump());
  }
  void row(Clock::time_point now) {
    const ControllerNews& n = link_.news();
    statuses_ = n.statuses;
    const State state = n.status->state;
    const Fault fault = n.status->fault;
    if (state != state_) api_.tell(time(), "state", name(state));
    constexpr int looks = 4;  // the telemetry of the faulty tick comes after its Status
    if (fault != fault_ && fault != Fault::none) {
      api_.tell(time(), "fault", name(fault));
      found_[name(fault)] = Json::object();
      looks_ = looks;
    }
    if (fault != Fault::none && looks_ > 0 && found_[name(fault)].empty()) {
      --looks_;
      found_[name(fault)] = fault_values(fault, n, scene_);
    }
    state_ = state;
    fault_ = fault;
    if (now - row_at_ < row_period) return;
    row_at_ = now;
    Json row = Json::array({time()});
    for (const float v : n.values()) row.push_back(v);  // NaN is written as null
    api_.add_row(row.dump());
  }

  Connection& link_;
  Console& console_;
  const Scene& scene_;
  PageApi& api_;
  std::uint32_t statuses_ = 0;
  State state_ = State::disabled;
  Fault fault_ = Fault::none;
  std::map<std::string, Json> found_;  ///< by fault: its values when it was last found
  int looks_ = 0;                      ///< at them, still to be taken
  std::string busy_;                   ///< the command that runs
  Clock::time_point shown_{}, row_at_{}, stopped_{};
};

}  // namespace

int run_page(Connection& link, Console& console, const Scene& scene, int port) {
  const double silence = link.seconds(link.parameter(link::Index::silence));
  PageApi api(hello_of(link, scene),
              {"arm", "run", "hold", "resume", "override", "goto", "reset", "zero", "home", "set", "store",
               "teach", "capture"},
              // A jog ends as a stream does, though not before what a browser on a busy machine needs.
              seconds(std::max(link.seconds(link.parameter(link::Index::stream_age)), 0.1)),
              seconds(silence > 0.0 ? 0.5 * silence : 1.0));
  const ServerOptions options = page_options(port, "operate", operate_html, operate_css, operate_js);
  const auto server = open_server(options, api);
  link.read_faults();
  fmt::print("http://127.0.0.1:{}/?token={}\n", server->port(), options.token);
  std::fflush(stdout);
  {
    const std::jthread serving([&](const std::stop_token& stop) { server->run(stop); });
    PageLoop(link, console, scene, api).run();
  }
  const ServerCounts& served = server->counts();
  fmt::print("{} pages, {} requests refused, {} messages, {} of them malformed or too many\n", served.pages,
             served.refused, served.messages, api.malformed());
  return 0;
}

}  // namespace esmc::host
