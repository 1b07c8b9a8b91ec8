#include "host_sim/studies/studies.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <mutex>
#include <nlohmann/json.hpp>

#include "host_sim/check/check.hpp"
#include "host_sim/controller/robust.hpp"
#include "host_sim/loop/progress.hpp"
#include "host_sim/loop/run.hpp"
#include "host_sim/parallel.hpp"
#include "host_sim/record/output.hpp"
#include "host_sim/record/recorder.hpp"
#include "host_sim/report/study_page.hpp"

namespace esmc::host {
namespace {

using Json = nlohmann::ordered_json;

/// Outcome of simulated plants.
struct Plants {
  std::uint64_t wanted = 0, count = 0, outside_band = 0, stopped = 0;  ///< fewer than wanted after Ctrl-C
  double largest = 0.0;                                                ///< settled error, m or rad
  std::uint64_t worst = 0;
  std::string fault;  ///< of the first one that stopped
};

Plants simulate(const Scene& scene, std::uint64_t seed, std::uint64_t count, bool lengths, double band) {
  std::vector<double> error(count, 0.0);
  std::vector<std::string> fault(count, "not run");
  std::mutex mutex;
  std::uint64_t done = 0;
  Progress progress(count);
  run_each(std::min(processors(), 64), count, [&](std::uint64_t i) {
    if (stop_requested()) return false;
    std::string ended;
    try {
      const Trace t = trace(sampled_plant(scene, seed, i, lengths));
      if (stop_requested()) return false;
      const bool rr = scene.type == MechanismType::rr;
      error[i] = (rr ? t.statistics.sums().base : t.statistics.sums().effector).settled().largest;
      if (!t.end.faults.empty()) ended = t.end.faults.front().name;
      if (!std::isfinite(error[i])) ended = "diverged";
    } catch (const InputError&) {  // other lengths: the reference may be out of reach
      ended = "impossible";
    }
    fault[i] = std::move(ended);
    const std::lock_guard lock(mutex);
    progress.show(++done);
    return true;
  });
  Plants out;
  out.wanted = count;
  out.count = done;
  for (std::uint64_t i = 0; i < count; ++i) {
    if (fault[i] == "not run") continue;
    if (!fault[i].empty()) {
      if (out.stopped++ == 0) out.fault = fault[i];
      continue;
    }
    if (error[i] > out.largest) {
      out.largest = error[i];
      out.worst = i;
    }
    if (error[i] > band) ++out.outside_band;
  }
  return out;
}

template <class Traits>
class Report {
 public:
  using M = typename Traits::Mechanism;
  Report(const Scene& scene, const DesignOptions& o)
      : scene_(scene),
        o_(o),
        problem_(design_problem<M>(scene, Pacing::lockstep)),
        d_(design::design(problem_)) {
    sampled_layer();
    findings();
    if (o.simulate > 0 && d_.refused.empty()) plants();
  }

  int print(OutputDirectory& out) const {
    const Json j = json();
    const bool good = d_.refused.empty() && held();
    const auto page = [&] {
      using enum StudyVerdict::Level;
      return study_page("Gains for " + scene_.name, o_.run.command_line, document_html(j),
                        {!good               ? bad
                         : warnings_.empty() ? ok
                                             : warn,
                         !d_.refused.empty() ? "refused: " + d_.refused
                         : held()            ? "every plant within the stated intervals is held"
                                             : "a simulated plant left the promise",
                         fmt::format("{} warnings", warnings_.size()),
                         {}});
    };
    publish({"design", j, text(), page}, o_.run.json, out);
    return stop_requested() ? exit_interrupted : good ? 0 : 1;
  }

 private:
  [[nodiscard]] static const char* unit() { return M::has_type2 ? "m" : "rad"; }
  [[nodiscard]] bool uncertain_lengths() const {
    const UncertaintyScene& u = *scene_.uncertainty;
    return u.l1 > 0.0 || u.l2 > 0.0 || u.half_base > 0.0;
  }
  [[nodiscard]] bool smc() const { return scene_.law == LawChoice::smc; }
  [[nodiscard]] bool held() const { return !exact_ || (exact_->outside_band == 0 && exact_->stopped == 0); }

  /// Refused where `esmc check` refuses the layer, with the delays of the scene.
  void sampled_layer() {
    if (!d_.refused.empty() ||
        (scene_.reaching != ReachingChoice::saturation && scene_.reaching != ReachingChoice::tanh))
      return;
    Findings f;
    judge_layer(scene_, d_.stiffness, f);
    for (const Finding& found : f.list()) {
      if (found.level == Level::error || found.code == Code::gain_margin)
        d_.refused = "with these gains " + found.text;
      else
        d_.warnings.push_back(found.text);
    }
  }

  void findings() {
    warnings_ = d_.warnings;
    for (const std::string& s : outside(scene_))
      warnings_.push_back("the scene's own mechanism is outside: " + s);
    if (uncertain_lengths()) {
      warnings_.emplace_back(
          "lengths: no gain answers for l1, l2, half_base; --simulate shows what their tolerances do");
    }
    if (const auto rest = not_covered(scene_); !rest.empty())
      warnings_.push_back("the promise knows nothing of: " + fmt::format("{}", fmt::join(rest, ", ")));
    if (scene_.law == LawChoice::esmc && d_.beyond_range > 0.0) {
      warnings_.push_back(
          fmt::format("law esmc: the condition is that of s in the range of C; at the edge of the tube "
                      "{:.0f} % of s is not (r of [F32]); esmc_projected has none",
                      100.0 * d_.beyond_range));
    }
  }

  void plants() {
    Scene s = scene_;
    s.robust_gain = true;
    const double band = promised();
    exact_ = simulate(s, o_.run.seed, o_.simulate, false, band);
    if (uncertain_lengths()) lengths_ = simulate(s, o_.run.seed, o_.simulate, true, band);
  }
  /// Bound on the error of a simulated plant, m or rad, and its name.
  [[nodiscard]] const char* judge() const {
    return d_.sampled ? "the band" : (d_.layer ? "the band of the layer in continuous time" : "the tube");
  }
  [[nodiscard]] double promised() const {
    return d_.sampled ? d_.sampled->error : (d_.layer ? d_.layer->error : d_.tube);
  }

  /// The condition that the gain of a row follows from.
  [[nodiscard]] std::string dictates(const design::Row<M>& r) const {
    if (r.linear > r.need + r.eta) return "layer";
    return r.eta > r.need ? "reaching_time" : design::name(r.cause);
  }
  [[nodiscard]] Json at(const design::Place& place) const {
    const design::Point& p = problem_.points[place.point];
    return {{"t", problem_.along_time ? Json(p.time) : Json(nullptr)},
            {"position", {p.now.position.x(), p.now.position.y()}}};
  }
  [[nodiscard]] std::string where(const design::Place& place) const {
    const design::Point& p = problem_.points[place.point];
    return problem_.along_time ? fmt::format("t = {:.3f} s", p.time)
                               : fmt::format("({:.3f}, {:.3f})", p.now.position.x(), p.now.position.y());
  }

  static Json band_json(const std::optional<design::Band>& b) {
    return b ? Json{{"error", b->error}, {"sliding", b->sliding}} : Json(nullptr);
  }
  static Json plants_json(const std::optional<Plants>& p) {
    if (!p) return nullptr;
    return {{"plants", p->count},
            {"wanted", p->wanted},
            {"largest_error", p->largest},
            {"worst", p->worst},
            {"outside_band", p->outside_band},
            {"stopped", p->stopped},
            {"fault", p->fault.empty() ? Json(nullptr) : Json(p->fault)}};
  }
  [[nodiscard]] Json json() const {
    Json j;
    j["scene"] = scene_.name;
    j["law"] = name(scene_.law);
    j["reaching"] = name(scene_.reaching);
    j["over"] = scene_.uncertainty->workspace ? "workspace" : "reference";
    j["refused"] = d_.refused.empty() ? Json(nullptr) : Json(d_.refused);
    j["tube"] = {{"error", d_.tube},
                 {"unit", unit()},
                 {"given", d_.tube_given},
                 {"inside", d_.tube * d_.inside},
                 {"start", d_.start}};
    j["gains"] = Json::array();
    for (int i = 0; i < M::channels && !smc(); ++i) {
      const auto& r = d_.row[static_cast<std::size_t>(i)];
      if (r.k == 0.0) continue;
      j["gains"].push_back({{"channel", Traits::channel_names[i]},
                            {"unit", M::is_angle(i) ? "rad/s2" : "m/s2"},
                            {"k", r.k},
                            {"need", r.need},
                            {"eta", r.eta},
                            {"layer", r.linear},
                            {"dictated_by", dictates(r)},
                            {"at", at(r.place)}});
    }
    j["gain_independent"] = smc() ? Json(d_.k_independent) : Json(nullptr);
    j["reaching_time_s"] = d_.reaching_time;
    j["band"] = {{"layer", band_json(d_.layer)}, {"sampled", band_json(d_.sampled)}};
    j["ahead"] = d_.ahead;
    j["mismatch"] = d_.mismatch;
    j["disturbance"] = d_.disturbance;
    j["beyond_range"] = d_.beyond_range;
    j["torque"] = Json::array();
    for (int m = 0; m < scene_.motors(); ++m) {
      const auto joint = static_cast<std::size_t>(ControllerConfig<M>::joint_of(m, scene_.motors()));
      j["torque"].push_back(
          {{"motor", m + 1},
           {"hold_nm", d_.hold[joint]},
           {"peak_nm", d_.peak[joint]},
           {"limit_nm",
            problem_.controller.torque_limit[ControllerConfig<M>::joint_of(m, scene_.motors())]}});
    }
    const auto shares = [](const design::Shares& s) {
      return Json{{"force", s.force}, {"preload", s.preload}};
    };
    j["four_motors"] = scene_.all_motors
                           ? Json{{"hold", shares(d_.hold_shares)}, {"peak", shares(d_.peak_shares)}}
                           : Json(nullptr);
    j["states"] = d_.states;
    j["simulated"] = {{"judged_by", d_.sampled ? "sampled" : (d_.layer ? "layer" : "tube")},
                      {"exact_lengths", plants_json(exact_)},
                      {"lengths", plants_json(lengths_)}};
    j["warnings"] = warnings_;
    return j;
  }

  [[nodiscard]] std::string quantity(double v) const {
    return M::has_type2 ? fmt::format("{:.3g} mm", 1e3 * v) : fmt::format("{:.3g} mrad", 1e3 * v);
  }
  [[nodiscard]] std::string plants_text(const Plants& p, const char* what) const {
    std::string out = fmt::format("{} plants{}: largest error {} (plant {}), {} outside {}", p.count, what,
                                  quantity(p.largest), p.worst, p.outside_band, judge());
    if (p.stopped > 0) out += fmt::format(", {} stopped ({})", p.stopped, p.fault);
    if (p.count < p.wanted) out += fmt::format("; interrupted, {} were asked for", p.wanted);
    return out + "\n";
  }
  [[nodiscard]] std::string text() const {
    std::string out =
        fmt::format("{}: {} law, {} reaching, over {}\n", printable(scene_.name), name(scene_.law),
                    name(scene_.reaching), scene_.uncertainty->workspace ? "the workspace" : "the reference");
    if (d_.tube > 0.0)
      out +=
          fmt::format("tube: error up to {} ({})", quantity(d_.tube), d_.tube_given ? "given" : "computed");
    if (d_.inside > 0.0)
      out += fmt::format("; what begins within {} never leaves it", quantity(d_.tube * d_.inside));
    if (d_.tube > 0.0) out += "\n";
    if (!d_.refused.empty()) return out + "refused: " + d_.refused + "\n";
    out += gains_text() + bands_text() + torque_text();
    if (exact_) out += plants_text(*exact_, "");
    if (lengths_) out += plants_text(*lengths_, " with other lengths");
    for (const std::string& w : warnings_) out += "warning: " + w + "\n";
    return out;
  }
  [[nodiscard]] std::string gains_text() const {
    if (smc()) {
      return fmt::format("gain {:.4g} {}/s2; mass matrix wrong by {:.2f} in the maximum norm [F37], {}\n",
                         d_.k_independent, unit(), d_.mismatch, where(d_.row[0].place));
    }
    std::string out = fmt::format("{:<6} {:>10} {:>10} {:>10} {:>10}  dictated by\n", "", "gain", "condition",
                                  "reaching", "layer");
    for (int i = 0; i < M::channels; ++i) {
      const auto& r = d_.row[static_cast<std::size_t>(i)];
      if (r.k == 0.0) continue;
      const std::string cause = dictates(r);
      out += fmt::format("{:<6} {:>10.4g} {:>10.4g} {:>10.4g} {:>10.4g}  {}, {}\n", Traits::channel_names[i],
                         r.k, r.need, r.eta, r.linear, cause == "reaching_time" ? "reaching time" : cause,
                         where(r.place));
    }
    return out + "(positions m/s2, angles rad/s2; gain = 1.05 max(condition + reaching, layer))\n";
  }
  [[nodiscard]] std::string bands_text() const {
    std::string out = fmt::format(
        "reaching, in continuous time: what begins within {} {} on the surface after {:.3g} s{}\n",
        quantity(d_.tube * d_.inside), d_.layer ? "would be" : "is", d_.reaching_time,
        d_.layer ? " without its layer, and comes into the band of [F38] with it" : "");
    if (d_.layer) {
      out +=
          fmt::format("cost of the layer [F38]: in continuous time the error stays within {} instead of 0\n",
                      quantity(d_.layer->error));
    }
    if (!d_.sampled) {
      return out +
             fmt::format("sampled: no band is promised{}; --simulate judges by {}\n",
                         scene_.reaching == ReachingChoice::implicit ? "" : " but for implicit reaching",
                         judge());
    }
    out += fmt::format(
        "sampled every {:.3g} ms, up to {:g} tick{} late: the promise is a band, |e| <= {}, |e' + lambda e| "
        "<= {}/s\n",
        1e3 * scene_.tick(), problem_.told_ticks, problem_.told_ticks == 1.0 ? "" : "s",
        quantity(d_.sampled->error), quantity(d_.sampled->sliding));
    if (d_.ahead > 0.0) {
      out += fmt::format(
          "of that {} are what the motion goes on while what is measured is {:g} tick{} late: no gain makes "
          "that less\n",
          quantity(d_.ahead), scene_.sensor_lag_ticks, scene_.sensor_lag_ticks == 1.0 ? "" : "s");
    }
    return out;
  }
  [[nodiscard]] std::string torque_text() const {
    std::string out;
    for (int m = 0; m < scene_.motors(); ++m) {
      const auto joint = static_cast<std::size_t>(ControllerConfig<M>::joint_of(m, scene_.motors()));
      out += fmt::format(
          "motor {}: {:.3g} N m hold the worst plant on the motion, the law asks for up to {:.3g} in the "
          "tube, limit {:.3g}\n",
          m + 1, d_.hold[joint], d_.peak[joint],
          problem_.controller.torque_limit[ControllerConfig<M>::joint_of(m, scene_.motors())]);
    }
    return out;
  }

  const Scene& scene_;
  const DesignOptions& o_;
  design::Problem<M> problem_;
  design::Design<M> d_;
  std::vector<std::string> warnings_;
  std::optional<Plants> exact_, lengths_;
};

}  // namespace

int run_design(const DesignOptions& o) {
  std::vector<std::string> sets = o.run.sets;
  if (o.workspace) sets.emplace_back("uncertainty.over=\"workspace\"");
  Scene scene = read_scene(o.run.scene, sets);
  if (!scene.uncertainty)
    throw InputError("", o.run.scene + ": a design needs the table [uncertainty], which says what against");
  if (!scene.sliding()) {
    throw InputError(
        scene.control_where,
        "this law has no switching gain to design: control.law must be esmc, esmc_projected or smc");
  }
  if (scene.reaching == ReachingChoice::super_twisting ||
      scene.reaching == ReachingChoice::implicit_coupled || scene.disturbance_observer > 0.0 ||
      scene.predictor) {
    throw InputError(scene.control_where,
                     "esmc design promises for the plain laws: control.reaching must be sign, saturation, "
                     "tanh or implicit, without disturbance_observer and predictor");
  }
  if (o.simulate > 0) refuse_bus_effects(scene, "esmc design simulates without a bus");
  scene.seed = o.run.seed;
  OutputDirectory out(o.run.out);
  out.spare(o.run.scene);
  return with_world(scene, [&]<class World>(World) { return Report<World>(scene, o).print(out); });
}

}  // namespace esmc::host
