#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "host_sim/controller/program.hpp"
#include "host_sim/error.hpp"
#include "host_sim/plan/limits.hpp"
#include "host_sim/record/finish.hpp"
#include "host_sim/record/recording.hpp"
#include "host_sim/report/study_page.hpp"
#include "host_sim/studies/studies.hpp"
#include "host_sim/turns.hpp"

namespace esmc::host {
namespace {

using Json = nlohmann::ordered_json;
using plan::LimitKind;

constexpr double noticeable = 1e-3;  ///< share of the time of motion from which a limit is named

/// Name of a limit as it stands in limits_active.
std::string name_of(LimitKind kind, std::size_t i) {
  switch (kind) {
    case LimitKind::torque:
      return fmt::format("torque_{}", i + 1);
    case LimitKind::joint_speed:
      return fmt::format("joint_speed_{}", i + 1);
    case LimitKind::speed:
      return "speed";
    case LimitKind::jerk:
      return "jerk";
    default:
      return "acceleration";
  }
}

template <class M>
class PlanReport {
 public:
  explicit PlanReport(const Scene& scene) : scene_(scene), problem_(program_problem<M>(scene)) {
    problem_.bound = true;
    plan_ = planned(problem_);
  }

  [[nodiscard]] Json json() const {
    Json j = {{"scene", scene_.name}, {"duration_s", plan_.duration}, {"bound_s", plan_.bound}};
    j["limits_active"] = Json::array();
    Json limits = Json::array();
    for (std::size_t k = 0; k < plan_.use.size(); ++k) {
      for (std::size_t i = 0; i < plan_.use[k].size(); ++i) {
        const plan::Use& use = plan_.use[k][i];
        if (use.share == 0.0) continue;
        const std::string name = name_of(static_cast<LimitKind>(k), i);
        const bool active =
            use.active > noticeable || (static_cast<LimitKind>(k) == LimitKind::jerk && use.share > 0.9);
        if (active) j["limits_active"].push_back(name);
        limits.push_back({{"limit", name}, {"share", use.share}, {"active", use.active}});
      }
    }
    j["margin"] = {{"torque", 1.0 - largest(LimitKind::torque)},
                   {"speed", 1.0 - plan::speed_reserve * largest(LimitKind::joint_speed)}};
    j["deviation_m"] = plan_.deviation;
    j["pieces"] = plan_.path.size();
    j["limits"] = limits;
    j["moves"] = moves();
    j["point_to_point"] = point_to_point();
    return j;
  }

  [[nodiscard]] std::size_t rows() const { return plan_.ticks / stride() + 1; }  ///< of path.csv
  /// Columns of path.csv.
  [[nodiscard]] static std::vector<std::string> columns(const Scene& scene) {
    const std::vector<std::string> joint = joint_names(scene.type);
    std::vector<std::string> out{"t"};
    for (const auto& [dots, suffix] :
         {std::pair{"", ""}, std::pair{"d", "_rate"}, std::pair{"dd", "_acceleration"}}) {
      for (const char* axis : {"x", "y"}) out.push_back(std::string(axis) + dots);
      for (const std::string& base : {joint[0], joint[joint.size() / 2]}) out.push_back(base + suffix);
    }
    for (const std::size_t m : scene.motor_joints()) out.push_back("tau" + joint[m].substr(5));
    return out;
  }

  /// Ticks from row to row: one, more where there would be more than two million rows.
  [[nodiscard]] std::uint32_t stride() const { return plan_.ticks / 2'000'000 + 1; }
  /// Rows: the table as the controller reads it, and the torques of the motors.
  void write(Log& log) const {
    Reference<double> reference;
    reference.kind = ReferenceKind::path;
    reference.path = plan_.path;
    const plan::MotorLimits<M> motors(problem_);
    const auto payload = find_effect<Payload>(scene_.effects);
    const auto joints = scene_.motor_joints();
    Vec2<double> base = problem_.start_base;
    for (std::uint32_t n = 0; n <= plan_.ticks && log.wanted(); n += stride()) {
      const double t = n * scene_.tick();
      const Motion2<double> m = reference.at(n, scene_.tick());
      const auto d = desired_at_effector(problem_.controller.mechanism, problem_.controller.mode, m.position,
                                         m.velocity, m.acceleration);
      if (!d) break;
      const Vec2<double> wrapped = M::base_angles(d->pose), rate = M::base(d->rates),
                         acc = M::base(d->acceleration);
      for (int i = 0; i < 2; ++i) base[i] = nearest_turn(wrapped[i], base[i]);
      std::vector<double> row{
          t,       m.position[0], m.position[1],     base[0],           base[1], m.velocity[0], m.velocity[1],
          rate[0], rate[1],       m.acceleration[0], m.acceleration[1], acc[0],  acc[1]};
      const auto torque = motors.torques(*d, payload && t >= payload->from && t < payload->to);
      for (const std::size_t joint : joints) row.push_back(torque[static_cast<int>(joint)]);
      log.row(row, "");
    }
  }

  [[nodiscard]] std::string text(const Json& j) const {
    std::string out =
        fmt::format("{}: {:.4g} s, {:.4g} s if only the motors' torque limited it on this path\n",
                    printable(scene_.name), plan_.duration, plan_.bound);
    out += fmt::format(
        "limits reached: {}\n",
        j["limits_active"].empty()
            ? "none"
            : fmt::format("{}", fmt::join(j["limits_active"].get<std::vector<std::string>>(), ", ")));
    out +=
        fmt::format("margin: torque {:.3g} %, speed of the base joints {:.3g} %\n",
                    100.0 * j["margin"]["torque"].get<double>(), 100.0 * j["margin"]["speed"].get<double>());
    out += fmt::format("corners: at most {:.3g} mm off; {} quintics\n", 1e3 * plan_.deviation,
                       plan_.path.size());
    for (const Json& m : j["moves"]) {
      out += fmt::format("move {} ({}): {:.4g} s\n", m["move"].get<int>(), m["kind"].get<std::string>(),
                         m["duration_s"].get<double>());
    }
    for (const Json& m : j["point_to_point"]) {
      const auto time = [&](const char* key) {
        return m[key].is_number() ? fmt::format("{:.4g} s", m[key].get<double>()) : "impossible";
      };
      out += fmt::format("move {}, rest to rest: line {}, joint {}\n", m["move"].get<int>(), time("line_s"),
                         time("joint_s"));
    }
    return out;
  }

  [[nodiscard]] std::string page(const RunOptions& o, const Json& j, const std::string& words,
                                 const Log& log) const {
    const auto column = [&](const std::string& name) {
      return static_cast<std::size_t>(std::ranges::find(log.columns(), name) - log.columns().begin());
    };
    Series path{"effector", {}}, speed{"effector", {}}, limit{"its limit curve", {}};
    constexpr double shown = 4.0;  // times the largest speed: beyond that the limit is of no interest
    std::vector<Series> torques;
    for (const std::string& name : log.columns()) {
      if (name.starts_with("tau")) torques.push_back({name, {}});
    }
    for (const SeriesRow& row : log.thinned()) {
      const auto& v = row.values;
      path.points.emplace_back(v[column("x")], v[column("y")]);
      speed.points.emplace_back(v[0], std::hypot(v[column("xd")], v[column("yd")]));
      for (Series& s : torques) s.points.emplace_back(v[0], v[column(s.name)]);
    }
    double fastest = 0.0;
    for (const auto& [t, v] : speed.points) fastest = std::max(fastest, v);
    for (const auto& [t, v] : plan_.limit_curve)
      limit.points.emplace_back(t, v < shown * fastest ? v : std::nan(""));
    double last = 0.0;
    for (const std::size_t joint : scene_.motor_joints()) {
      const double most = problem_.controller.torque_limit[static_cast<int>(joint)], T = plan_.duration;
      if (scene_.closed_loop() && most != last)
        torques.push_back({fmt::format("limit {:g}", most),
                           {{0.0, most}, {T, most}, {T, -most}, {0.0, -most}, {0.0, most}}});
      last = most;
    }
    const auto chart = [](const char* title, const char* x, const char* y, const std::vector<Series>& of) {
      return chart_svg(title, x, y, of, Scale::linear, Scale::linear);
    };
    return study_page(
        "Plan of " + scene_.name, o.command_line,
        figures_html({chart("Path", "x, m", "y, m", {path}), chart("Speed", "t, s", "m/s", {speed, limit}),
                      chart("Torque", "t, s", "N m", torques)}) +
            document_html(j),
        {StudyVerdict::Level::ok, words.substr(0, words.find('\n')), "", {}});
  }

 private:
  [[nodiscard]] double largest(LimitKind kind) const {
    double out = 0.0;
    for (const plan::Use& use : plan_.use[static_cast<std::size_t>(kind)]) out = std::max(out, use.share);
    return out;
  }
  [[nodiscard]] Json moves() const {
    Json out = Json::array();
    double begin = 0.0;
    for (std::size_t i = 0; i < plan_.end.size(); ++i) {
      out.push_back({{"move", i + 1},
                     {"kind", name(problem_.moves[i].kind)},
                     {"begin_s", begin},
                     {"end_s", plan_.end[i]},
                     {"duration_s", plan_.end[i] - begin}});
      begin = plan_.end[i];
    }
    return out;
  }
  /// Each line, from rest to rest, beside the fastest joint move between its ends; limits of motors and
  /// joints.
  [[nodiscard]] Json point_to_point() const {
    Json out = Json::array();
    for (std::size_t i = 0; i < problem_.moves.size(); ++i) {
      if (problem_.moves[i].kind != MoveKind::line) continue;
      const auto alone = [&](MoveKind kind, const std::array<double, 2>& to) -> Json {
        plan::Problem<M> p = problem_;
        MoveScene m;
        m.kind = kind;
        m.to = to;
        m.where = problem_.moves[i].where;
        p.moves = {m};
        p.repeat = p.bound = false;
        p.start = plan_.from[i];
        p.start_base = plan_.from_base[i];
        try {
          return plan::plan(p).duration;
        } catch (const plan::Refused&) {
          return nullptr;
        }
      };
      const Vec2<double>& end = plan_.from_base[i + 1];
      out.push_back({{"move", i + 1},
                     {"line_s", alone(MoveKind::line, problem_.moves[i].to)},
                     {"joint_s", alone(MoveKind::joint, {end[0], end[1]})}});
      if (!out.back()["line_s"].is_number() || !out.back()["joint_s"].is_number()) continue;
      out.back()["gained_s"] = out.back()["line_s"].get<double>() - out.back()["joint_s"].get<double>();
    }
    return out;
  }

  const Scene& scene_;
  plan::Problem<M> problem_;
  plan::Plan plan_;
};

}  // namespace

int run_plan(const RunOptions& o) {
  const Scene scene = read_scene(o.scene, o.sets);
  if (scene.reference.type != ReferenceType::program)
    throw InputError(scene.reference_where,
                     "'reference.type' must be \"program\": only a program is planned");
  OutputDirectory out(o.out);
  with_mechanism<double>(scene, [&]<class M>(const M*) {
    const PlanReport<M> report(scene);
    Log log(out.open("path.csv"), PlanReport<M>::columns(scene), report.rows());
    if (o.capture != nullptr) log.keep(&o.capture->log);
    report.write(log);
    log.close();
    if (out.wanted()) write_scene(scene, out);
    const Json j = report.json();
    if (o.capture != nullptr) {
      o.capture->document = document_text(j);
      return;
    }
    const std::string text = report.text(j);
    publish({"plan", j, text, [&] { return report.page(o, j, text, log); }}, o.json, out);
  });
  return 0;
}

}  // namespace esmc::host
