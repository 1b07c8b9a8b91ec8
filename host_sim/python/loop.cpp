#include "host_sim/python/loop.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "firmware/cycle/estimate.hpp"
#include "host_sim/controller/robust.hpp"
#include "host_sim/drives/actuators.hpp"
#include "host_sim/error.hpp"
#include "host_sim/record/recorder.hpp"

namespace esmc::host {
namespace {

using Json = nlohmann::ordered_json;

Command command_of(const std::string& name) {
  if (name == "none") return Command::none;
  if (name == "stop") return Command::stop;
  if (name == "halt") return Command::halt;
  if (name == "reset") return Command::reset;
  if (name == "enable") return Command::enable;
  refuse("command = {:?}: none, stop, halt, reset or enable", name);
}

void require_size(std::span<const double> values, std::size_t size, const char* what) {
  if (values.size() != size) refuse("{}: {} values, {} are needed", what, values.size(), size);
}

template <class World>
class ControllerOf final : public PythonController {
 public:
  using M = typename World::Mechanism;

  explicit ControllerOf(const Scene& s)
      : scene_(s),
        reference_(make_reference<double>(scene_, Pacing::lockstep)),
        controller_(make_controller<M>(scene_, Pacing::lockstep, reference_)),
        supervisor_(controller_.supervision()) {
    supervisor_.begin_tick(Command::enable, {});
  }

  PythonTick tick(std::span<const double> angle, std::span<const double> rate,
                  const std::string& command) override {
    require_size(angle, M::joints, "angle");
    require_size(rate, M::joints, "rate");
    const bool idle = supervisor_.state() == State::stopping || supervisor_.state() == State::fault;
    supervisor_.begin_tick(command_of(command), {true, idle}, result_.stage_done);
    for (int i = 0; i < M::joints; ++i) {
      sample_.angle[i] = angle[static_cast<std::size_t>(i)];
      sample_.rate[i] = rate[static_cast<std::size_t>(i)];
    }
    result_ = controller_.tick(sample_, supervisor_);
    PythonTick out{.torque = {},
                   .s = {},
                   .effector = {result_.effector.x(), result_.effector.y()},
                   .desired_effector = {result_.desired_effector.x(), result_.desired_effector.y()},
                   .state = name(result_.state),
                   .fault = name(result_.fault),
                   .saturated = result_.saturated};
    for (const std::size_t j : scene_.motor_joints())
      out.torque.push_back(result_.torque[static_cast<int>(j)]);
    out.s.assign(result_.sliding.begin(), result_.sliding.end());
    return out;
  }

 private:
  Scene scene_;
  ReferenceBundle<double> reference_;
  Controller<M> controller_;
  Supervisor supervisor_;
  Sample<M> sample_;
  TickResult<M> result_;
};

template <class World>
class PlantOf final : public PythonPlant {
 public:
  using Plant = typename World::Plant;

  explicit PlantOf(const Scene& s)
      : scene_(s),
        motor_joints_(scene_.motor_joints()),
        motion_(make_motion<World>(scene_)),
        actuators_(scene_.effects, motor_joints_, scene_.seed) {}

  void step(std::span<const double> torque) override {
    require_size(torque, motor_joints_.size(), "torque");
    if (!std::ranges::all_of(torque, [](double v) { return std::isfinite(v); }))
      refuse("torque: must be finite");
    typename Plant::Joints asked{};
    for (std::size_t i = 0; i < torque.size(); ++i) asked[motor_joints_[i]] = torque[i];
    bool clipped = false;
    const double tick = scene_.tick();
    const auto delivered = actuators_.deliver(asked, tick, clipped);
    actuators_.advance(motion_, ticks_ * tick, tick, tick / steps_per_tick(scene_), delivered);
    ++ticks_;
    require_finite(motion_.output().q, t());
  }
  void output(std::vector<double>& q, std::vector<double>& qd) const override {
    const auto o = motion_.output();
    q.assign(o.q.begin(), o.q.end());
    qd.assign(o.qd.begin(), o.qd.end());
  }
  std::vector<double> shafts(bool rates) const override {
    std::vector<double> out;
    for (std::size_t j = 0; j < static_cast<std::size_t>(scene_.joints()); ++j) {
      const Shaft shaft = motion_.shaft(j);
      out.push_back(rates ? shaft.rate : shaft.angle);
    }
    return out;
  }
  double energy() const override { return motion_.energy(); }
  double t() const override { return static_cast<double>(ticks_) * scene_.tick(); }

 private:
  Scene scene_;
  std::vector<std::size_t> motor_joints_;
  Motion<Plant> motion_;
  Actuators<Plant> actuators_;
  std::uint32_t ticks_ = 0;
};

template <class T>
Json leg_case(const LegParams<T>& p) {
  return {{"l1", p.l1},
          {"l2", p.l2},
          {"lg1", p.lg1},
          {"lg2", p.lg2},
          {"m1", p.m1},
          {"m2", p.m2},
          {"J1", p.J1},
          {"J2", p.J2},
          {"c1", p.d1},
          {"c2", p.d2},
          {"gamma1", p.gamma1},
          {"gamma2", p.gamma2},
          {"rotor2", p.rotor2},
          {"asymmetry1", p.asymmetry1},
          {"asymmetry2", p.asymmetry2}};
}

void require_used(const Json& state, bool five_bar) {
  const bool placed = state.contains("x") || state.contains("y");
  for (const auto& [key, value] : state.items()) {
    const bool rate = key == "xd" || key == "yd";
    if (key != "theta" && key != "thetad" && !(five_bar && (key == "x" || key == "y" || rate)))
      refuse("state: there is no '{}'; theta, thetad{}", key, five_bar ? ", x, y, xd, yd" : "");
    if ((rate && !placed) || (key == "thetad" && !state.contains("theta")))
      refuse("state: '{}' needs {}", key, rate ? "'x' and 'y'" : "'theta'");
  }
  if (!placed && !state.contains("theta"))
    refuse("state: 'theta' is missing{}", five_bar ? ", or 'x' and 'y'" : "");
}

/// Adds effector and its velocity to a state that gives joints.
void close_chain(const Scene& scene, Json& state) {
  const FiveBar<double> m(params_of<FiveBar<double>>(scene.mechanism));
  const auto theta = state["theta"].get<std::vector<double>>();
  auto rate = state.value("thetad", std::vector<double>(theta.size(), 0.0));
  if ((theta.size() != 2 && theta.size() != 4) || rate.size() != theta.size())
    refuse("state: 'theta' and 'thetad' need 2 or 4 entries each");
  const std::size_t second = theta.size() / 2;
  const auto e = estimate_from_base(m, mode_of<FiveBar<double>>(scene), Vec2<double>(theta[0], theta[second]),
                                    Vec2<double>(rate[0], rate[second]));
  if (!e) refuse("state: these base angles close no loop in the scene's assembly mode");
  if (theta.size() == 2) {
    state.erase("theta");
    state.erase("thetad");
  }
  state["x"] = e->pose.effector.x();
  state["y"] = e->pose.effector.y();
  state["xd"] = e->rates.platform.x();
  state["yd"] = e->rates.platform.y();
}

}  // namespace

std::unique_ptr<PythonController> make_python_controller(const Scene& scene) {
  if (!scene.closed_loop()) throw InputError(scene.control_where, "'control.law' has no controller");
  return with_world(scene, [&]<class World>(World) -> std::unique_ptr<PythonController> {
    return std::make_unique<ControllerOf<World>>(scene);
  });
}
std::unique_ptr<PythonPlant> make_python_plant(const Scene& scene) {
  if (scene.accuracy)
    throw InputError(scene.simulation_where,
                     "'simulation.accuracy' is for whole runs: a Plant needs simulation.integrator and step");
  return with_world(scene, [&]<class World>(World) -> std::unique_ptr<PythonPlant> {
    return std::make_unique<PlantOf<World>>(scene);
  });
}

std::string model_case(const Scene& scene, const std::string& text) {
  const bool five_bar = scene.type == MechanismType::five_bar;
  Json state;
  try {
    state = Json::parse(text);
    require_used(state, five_bar);
    if (five_bar && !state.contains("x") && !state.contains("y")) close_chain(scene, state);
    if (!five_bar && !state.contains("thetad")) state["thetad"] = {0.0, 0.0};
    for (const char* rate : {"xd", "yd"}) {
      if (five_bar && !state.contains(rate)) state[rate] = 0.0;
    }
  } catch (const Json::exception&) {
    refuse("state: a table of numbers and lists of numbers is needed, each within the range of a double");
  }
  Scene exact = scene;  // the mechanism with the friction of the effects
  exact.model = {};
  exact.model.exact_friction = true;
  exact.believed.reset();
  const FiveBarParams<double> mechanism = believed_mechanism(exact);
  Json params;
  if (five_bar) {
    params = {{"l0", mechanism.l0}, {"m0", mechanism.m0}, {"g", mechanism.g}};
    params["legs"] = {leg_case(mechanism.legs[0]), leg_case(mechanism.legs[1])};
  } else {
    params = leg_case(mechanism.legs[0]);
    params["g"] = mechanism.g;
  }
  const Json mode = {{"sigma", {scene.working_mode[0], scene.working_mode[1]}},
                     {"assembly", scene.assembly_mode}};
  const Json one = {{"id", scene.name},
                    {"mechanism", five_bar ? "five_bar" : "rr"},
                    {"params", params},
                    {"mode", mode},
                    {"state", state}};
  return Json{{"cases", {one}}}.dump();
}

}  // namespace esmc::host
