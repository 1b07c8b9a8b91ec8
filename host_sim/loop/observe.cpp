#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <optional>
#include <thread>

#include "host_sim/controller/axes_config.hpp"
#include "host_sim/loop/run.hpp"
#include "host_sim/loop/waiting.hpp"
#include "host_sim/record/output.hpp"
#include "host_sim/record/recorder.hpp"

namespace esmc::host {
namespace {

using Json = nlohmann::ordered_json;

/// Receives everything, sends nothing.
class ListenOnly {
 public:
  ListenOnly(HostBus& bus, const Scene& scene) : bus_(&bus), scene_(&scene) {}
  hal::SendStatus try_send(const hal::CanFrame&) { return hal::SendStatus::ok; }
  [[nodiscard]] bool try_receive(hal::CanFrame& f) {
    if (!bus_->try_receive(f)) return false;
    require_same_scene(*scene_, f);
    return true;
  }
  [[nodiscard]] std::uint32_t frame_age_us() const { return bus_->frame_age_us(); }

 private:
  HostBus* bus_;
  const Scene* scene_;
};
static_assert(hal::TimesFrames<ListenOnly>);

/// The pose of measured angles; empty where they close no loop.
template <class M>
std::optional<Estimate<M>> located(const ControllerConfig<M>& c, const Sample<M>& s) {
  if constexpr (M::joints == 4) {
    if (c.sensors == Sensors::all) return estimate_from_all(c.mechanism, s.angle, s.rate);
  }
  using Config = ControllerConfig<M>;
  const int a = Config::joint_of(0, 2), b = Config::joint_of(1, 2);
  return estimate_from_base(c.mechanism, c.mode, Vec2<double>(s.angle[a], s.angle[b]),
                            Vec2<double>(s.rate[a], s.rate[b]));
}

const char* sign_text(double v) { return v > 0.0 ? "+" : "-"; }

template <class World>
class Observer {
 public:
  using M = typename World::Mechanism;
  using Config = ControllerConfig<M>;

  Observer(const Scene& scene, HostBus& bus)
      : scene_(scene),
        bus_(bus, scene),
        reference_(make_reference(scene, Pacing::realtime)),
        cycle_(make_cycle<M>(scene, Pacing::realtime, reference_)) {}

  void tick() {
    std::visit(
        [&](auto& c) {
          c.receive(bus_);
          c.tick(bus_, false);
        },
        cycle_);
  }
  /// "1, 2": the silent nodes.
  [[nodiscard]] std::string silent() const {
    std::string out;
    for (const Json& j : joints()) {
      if (j["age_ticks"].is_null()) out += fmt::format("{}{}", out.empty() ? "" : ", ", j["node"].get<int>());
    }
    return out;
  }
  [[nodiscard]] Json look() const {
    Json j = {{"joints", joints()},
              {"zero", scene_.drives.zero == Zero::absolute ? "absolute" : "not confirmed"},
              {"effector", nullptr},
              {"working_mode", nullptr},
              {"min_abs_sin_type1", nullptr}};
    if constexpr (M::has_type2)
      j.update({{"assembly_mode", nullptr}, {"assumed_assembly_mode", nullptr}, {"sin_type2", nullptr}});
    if (!silent().empty() || scene_.drives.zero != Zero::absolute) return j;
    const auto at =
        std::visit([](const auto& c) { return located<M>(c.controller().config(), c.sample()); }, cycle_);
    if (!at) return j;
    j["effector"] = Json::array({at->pose.effector.x(), at->pose.effector.y()});
    j["min_abs_sin_type1"] = M::min_abs_sin_type1(at->pose);
    if constexpr (M::has_type2) {
      j["working_mode"] =
          Json::array({sign_text(M::sin_type1(at->pose, 0)), sign_text(M::sin_type1(at->pose, 1))});
      // Base joints alone allow both assembly modes: then that of the scene is assumed.
      j[scene_.all_sensors ? "assembly_mode" : "assumed_assembly_mode"] = sign_text(at->pose.sin_type2);
      j["sin_type2"] = at->pose.sin_type2;
    } else {
      j["working_mode"] = Json::array({sign_text(at->pose.arm.turn[1].y())});
    }
    return j;
  }

 private:
  [[nodiscard]] Json joints() const {
    const auto list = [&](const auto& c) {
      Json out = Json::array();
      const auto& config = c.controller().config();
      for (int i = 0, n = config.sensor_count(); i < n; ++i) {
        const int joint = Config::joint_of(i, n);
        const int place = n == M::joints ? i : joint / (M::joints / 2);
        const auto& axis = c.axis(place);
        const std::uint32_t age = c.sample().age_ticks[static_cast<std::size_t>(joint)];
        const bool heard = age != drive::age_max && age < scene_.rate_hz;  // within a second
        out.push_back({{"name", World::joint_names[joint]},
                       {"node", node_at(static_cast<std::size_t>(place))},
                       {"angle", heard ? Json(c.sample().angle[joint]) : Json(nullptr)},
                       {"rate", heard ? Json(c.sample().rate[joint]) : Json(nullptr)},
                       {"age_ticks", heard ? Json(age) : Json(nullptr)},
                       {"error", axis.error() ? Json(axis.error_code()) : Json(nullptr)}});
      }
      return out;
    };
    return std::visit(list, cycle_);
  }
  /// Node of the axis at a place in the cycle.
  [[nodiscard]] int node_at(std::size_t place) const {
    std::size_t i = 0;
    while (axis_of(scene_, i) != place) ++i;
    return scene_.drives.nodes[i];
  }
  const Scene& scene_;
  ListenOnly bus_;
  ReferenceBundle<double> reference_;
  AnyCycle<M> cycle_;
};

std::string line_of(const Json& j, double t) {
  const auto number = [](const Json& v, const char* digits) {
    return v.is_null() ? std::string("?") : fmt::format(fmt::runtime(digits), v.get<double>());
  };
  std::string out = fmt::format("{:8.1f} s ", t);
  for (const Json& q : j["joints"]) {
    out += fmt::format(
        " {} {} rad, age {};", q["name"].get<std::string>(), number(q["angle"], "{:.4f}"),
        q["age_ticks"].is_null() ? "not heard" : fmt::format("{} ticks", q["age_ticks"].get<int>()));
    if (!q["error"].is_null()) out += fmt::format(" error 0x{:x};", q["error"].get<std::uint32_t>());
  }
  if (j["zero"] != "absolute") return out + " zero not confirmed: angles are the encoders' own, no pose";
  if (j["effector"].is_null()) return out + " no pose";
  out += fmt::format(" effector {:.4f} {:.4f} m; working mode", j["effector"][0].get<double>(),
                     j["effector"][1].get<double>());
  for (const Json& w : j["working_mode"]) out += fmt::format(" {}", w.get<std::string>());
  out += fmt::format(", |sin theta_j2| >= {:.3f}", j["min_abs_sin_type1"].get<double>());
  if (j.contains("assembly_mode")) {
    const bool seen = !j["assembly_mode"].is_null();
    out += fmt::format("; assembly mode {}{}, D2 {:.3f}",
                       j[seen ? "assembly_mode" : "assumed_assembly_mode"].get<std::string>(),
                       seen ? "" : " (assumed)", j["sin_type2"].get<double>());
  }
  return out;
}

template <class World>
int observe(const Scene& scene, const RunOptions& o, HostBus& bus) {
  Observer<World> observer(scene, bus);
  const std::uint32_t ticks = tick_count(scene),
                      often = std::max<std::uint32_t>(
                          1, static_cast<std::uint32_t>(std::llround(0.2 * scene.rate_hz)));
  const auto begin = std::chrono::steady_clock::now();
  std::uint32_t n = 0;
  while (n < ticks && !stop_requested()) {
    observer.tick();
    if (is_gone(bus)) throw BusGone();
    ++n;
    if (!o.json && n % often == 0) {
      fmt::print("{}\n", line_of(observer.look(), n * scene.tick()));
      std::fflush(stdout);
    }
    std::this_thread::sleep_until(begin + std::chrono::duration<double>(n * scene.tick()));
  }
  if (o.json) {
    Json j = {{"scene", scene.name}, {"ticks", n}};
    j.update(observer.look());
    fmt::print("{}", document_text(j));
  }
  const std::string silent = observer.silent();
  if (silent.empty()) return 0;
  throw RunError("not heard on " + bus.name() + ": node " + silent);
}

}  // namespace

int run_observe(const Scene& scene, const RunOptions& o, HostBus& bus) {
  return with_world(scene, [&]<class World>(World) { return observe<World>(scene, o, bus); });
}

}  // namespace esmc::host
