#include "host_sim/live/live_api.hpp"

#include <fmt/format.h>

#include <cmath>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <thread>

#include "host_sim/bus/host_bus.hpp"
#include "host_sim/error.hpp"
#include "host_sim/live/session.hpp"
#include "host_sim/loop/waiting.hpp"
#include "host_sim/record/output.hpp"
#include "host_sim/scene/edit.hpp"
#include "host_sim/web/server.hpp"

namespace esmc::host {

extern const std::string_view live_html, live_css, live_js;

namespace {

using Json = nlohmann::ordered_json;

/// The loop: orders, tick, samples, then sleep until the next tick. It never waits for the server.
class Runner {
 public:
  Runner(LiveSession& session, Exchange& exchange, LiveApi::LoopCounts& counts)
      : session_(session), exchange_(exchange), counts_(counts) {}

  /// Until Ctrl-C or `seconds` of ticks have passed; then the drives are idle.
  void run(std::optional<double> seconds) {
    std::uint64_t late = 0;
    const auto over = [&] { return stop_requested() || (seconds && session_.sample().t >= *seconds); };
    while (!over()) {
      // Another scene may have another tick.
      const double period = session_.period();
      Pace pace(period);
      while (!over() && session_.period() == period) {
        LiveOrder o;
        while (exchange_.orders.pop(o)) session_.order(o);
        step();
        pace.wait();
        counts_.late = late + pace.late();
      }
      late += pace.late();
    }
    session_.order(LiveCommand::stop);
    constexpr int ticks_to_rest = 5000;
    for (int n = 0; n < ticks_to_rest && (n == 0 || !session_.at_rest()); ++n) step();
  }
  [[nodiscard]] const std::vector<LiveEvent>& faults() const { return faults_; }

 private:
  void step() {
    try {
      session_.tick();
    } catch (const Interrupted&) {
      throw;
    } catch (const BusGone&) {
      throw;
    } catch (const std::runtime_error& e) {
      session_.fail(e.what());
    }
    // A page plots no more than 1000 points a second. An odd stride shows a torque that alternates from tick
    // to tick as it is.
    const auto stride = static_cast<std::uint64_t>(std::ceil(session_.scene().rate_hz / 1000.0)) | 1U;
    if (const std::uint64_t n = session_.ticks(); n != shown_ && n % stride == 0) {
      shown_ = n;
      if (!exchange_.samples.push(LiveSample(session_.sample()))) ++counts_.dropped;
    }
    for (LiveEvent& e : session_.take_events()) {
      if (e.kind == "fault" && faults_.size() < faults_kept) faults_.push_back(e);
      (void)exchange_.events.push(std::move(e));  // full: the server has ended
    }
  }
  static constexpr std::size_t faults_kept = 1000;

  LiveSession& session_;
  Exchange& exchange_;
  LiveApi::LoopCounts& counts_;
  std::vector<LiveEvent> faults_;
  std::uint64_t shown_ = 0;
};

Json summary(const LiveSession& session, const Runner& runner, const LiveApi::LoopCounts& loop,
             const ServerCounts& served, std::uint64_t malformed) {
  Json faults = Json::array();
  for (const LiveEvent& e : runner.faults())
    faults.push_back({{"t", e.t}, {"fault", e.text.substr(0, e.text.find(':'))}});
  return {{"scene", printable(session.scene().name)},
          {"duration_s", session.now()},
          {"ticks", session.ticks()},
          {"late_ticks", loop.late.load()},
          {"final_state", session.sample().state},
          {"faults", std::move(faults)},
          {"samples_dropped", loop.dropped.load()},
          {"server",
           {{"pages", served.pages},
            {"refused", served.refused},
            {"messages", served.messages},
            {"malformed", malformed},
            {"too_long", served.too_long}}},
          {"run_ticks", session.run_ticks()},
          {"digest", session.digest()}};
}

}  // namespace

int run_live(const LiveOptions& o) {
  const bool here = o.run.bus == "virtual";  // the controller
  const auto scene = read_live_scene(o.run);
  std::optional<HostBus> bus;
  if (!here) bus.emplace(open_bus(o.run.bus, scene->bitrate, scene->data_bitrate > 0));
  auto exchange = std::make_unique<Exchange>();
  LiveApi api(o.run, scene, *exchange);
  const ServerOptions options = page_options(o.port, "live", live_html, live_css, live_js);
  const auto server = open_server(options, api);
  std::optional<RunMcap> mcap;
  refuse_overwrite("--mcap", o.run.mcap, files_of(*scene));
  if (!o.run.mcap.empty()) api.record_to(&mcap.emplace(o.run.mcap));
  const auto session = here ? make_live_session(scene) : make_live_plant(scene, *bus);

  std::FILE* told = o.run.json ? stderr : stdout;
  fmt::print(told, "http://127.0.0.1:{}/?token={}\n", server->port(), options.token);
  (void)std::fflush(told);

  Runner runner(*session, *exchange, api.loop());
  {
    const std::jthread serving([&](const std::stop_token& stop) { server->run(stop); });
    runner.run(o.duration);
  }
  if (mcap) {
    api.on_timer();  // what the server's thread has left
    mcap->commit();
  }
  const Json s = summary(*session, runner, api.loop(), server->counts(), api.malformed());
  if (o.run.json) {
    fmt::print("{}", document_text(s));
    return 0;
  }
  fmt::print("{}: {:.3f} s, {} ticks, {} late; {}, {} faults; {} pages, {} requests refused\n",
             s["scene"].get<std::string>(), s["duration_s"].get<double>(), session->ticks(),
             api.loop().late.load(), session->sample().state, runner.faults().size(), server->counts().pages,
             server->counts().refused);
  return 0;
}

}  // namespace esmc::host
