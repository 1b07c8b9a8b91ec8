// The loop of a live bench, without a clock and without a page: it is the loop of esmc hil, and what an
// operator orders in between does what it says.

#include "host_sim/live/session.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "host_sim/error.hpp"
#include "host_sim/loop/run.hpp"

namespace esmc::host {
namespace {

const std::string five_bar = ESMC_SCENES "/five_bar_circle.toml", rr = ESMC_SCENES "/rr_line.toml";

Scene scene_of(const std::string& file, const std::vector<std::string>& sets = {}) {
  RunOptions o;
  o.scene = file;
  o.sets = sets;
  Scene scene = read_loop_scene(o);
  prepare_live_scene(scene);
  return scene;
}
std::unique_ptr<LiveSession> session_of(const std::string& file, const std::vector<std::string>& sets = {}) {
  return make_live_session(std::make_shared<const Scene>(scene_of(file, sets)));
}
void run(LiveSession& s, int ticks) {
  for (int i = 0; i < ticks; ++i) s.tick();
}
SceneOrder change(const LiveSession& s, const std::string& file, const std::vector<std::string>& sets) {
  auto next = std::make_shared<const Scene>(scene_of(file, sets));
  const RestartLevel takes = restart_level(s.scene(), *next);
  return {next, takes, "test"};
}
/// Ticks until the supervisor says so, or a number that no test allows.
int ticks_until(LiveSession& s, const std::string& state, int most = 5000) {
  for (int n = 0; n < most; ++n) {
    if (s.sample().state == state) return n;
    s.tick();
  }
  return most;
}
double miss(const LiveSample& s) {
  return std::hypot(s.effector[0] - s.desired[0], s.effector[1] - s.desired[1]);
}
double size(const std::array<double, 2>& v) { return std::hypot(v[0], v[1]); }
bool told(LiveSession& s, const std::string& text) {
  bool found = false;
  for (const LiveEvent& e : s.take_events()) found = found || e.text.find(text) != std::string::npos;
  return found;
}
const InjectionRow& row(std::string_view name) {
  for (const InjectionRow& r : injection_rows()) {
    if (r.name == name) return r;
  }
  throw std::logic_error("no such fault");
}

/// Of esmc hil: what its summary says.
nlohmann::json hil(const std::string& file, std::vector<std::string> sets, const char* name) {
  RunOptions o;
  o.scene = file;
  o.sets = std::move(sets);
  o.out = testing::TempDir() + name;
  testing::internal::CaptureStdout();
  EXPECT_EQ(run_hil(o), 0);
  (void)testing::internal::GetCapturedStdout();
  auto summary = nlohmann::json::parse(std::ifstream(o.out + "/summary.json"));
  std::filesystem::remove_all(o.out);
  return summary;
}

struct Loop {
  const char* name;
  std::string file;
  std::vector<std::string> sets;
};
class SameLoop : public testing::TestWithParam<Loop> {};

TEST_P(SameLoop, LeftAloneItIsTheLoopOfHil) {
  auto sets = GetParam().sets;
  sets.insert(sets.end(), {"reference.join=0.3", "simulation.duration=1.5"});
  const auto summary = hil(GetParam().file, sets, GetParam().name);
  const auto s = session_of(GetParam().file, sets);
  while (s->run_ticks() < summary["ticks"].get<std::uint64_t>()) {
    ASSERT_LT(s->ticks(), 10'000U);
    s->tick();
  }
  EXPECT_EQ(s->digest(), summary["digest"].get<std::string>());
}
INSTANTIATE_TEST_SUITE_P(
    Scenes, SameLoop,
    testing::Values(Loop{"FiveBar", five_bar, {}}, Loop{"Arm", rr, {}},
                    Loop{"Cia402", five_bar, {"drives.protocol=cia402", "drives.rated_torque=[0.5, 0.5]"}},
                    Loop{"Friction", ESMC_SCENES "/five_bar_friction.toml", {}}),
    [](const auto& loop) { return std::string(loop.param.name); });

/// In the text of a scene as run the believed mechanism has the same name whichever it is.
TEST(LiveSession, AnotherFileBehindTheSameNameIsAnotherController) {
  const auto believing = [&](const std::string& file) {
    return scene_of(five_bar, {"control.model.mechanism=\"" + file + "\""});
  };
  const Scene same = believing("five_bar_circle.toml"), other = believing("five_bar_robust.toml");
  EXPECT_EQ(same.toml, other.toml);
  EXPECT_EQ(restart_level(same, believing("five_bar_circle.toml")), RestartLevel::nothing);
  EXPECT_EQ(restart_level(same, other), RestartLevel::restart);
  EXPECT_EQ(restart_level(scene_of(five_bar), same), RestartLevel::restart);
}

TEST(LiveSession, AnotherLawTakesOverWhereTheMechanismStands) {
  const auto s = session_of(five_bar);
  run(*s, 1500);
  ASSERT_STREQ(s->sample().state, "running");
  const auto before = s->run_ticks();
  s->order(change(*s, five_bar, {"control.law=smc", "control.gain=60"}));
  EXPECT_LT(ticks_until(*s, "halting"), 3);
  EXPECT_LT(ticks_until(*s, "enabling", 400), 400);
  EXPECT_TRUE(s->sample().brake);
  const auto stands = s->sample().effector;
  EXPECT_LT(ticks_until(*s, "running", 400), 400);
  EXPECT_NEAR(s->sample().effector[0], stands[0], 1e-4);  // held meanwhile, joined from there
  EXPECT_NEAR(s->sample().effector[1], stands[1], 1e-4);
  EXPECT_LT(miss(s->sample()), 1e-3);
  EXPECT_EQ(s->scene().law, LawChoice::smc);
  EXPECT_GT(s->run_ticks(), before);
  run(*s, 1500);
  EXPECT_STREQ(s->sample().state, "running");
  EXPECT_LT(miss(s->sample()), 5e-3);
}

TEST(LiveSession, EffectsComeAndGoUnderTheRunningLaw) {
  const auto s = session_of(five_bar);
  run(*s, 2000);
  const LiveSample before = s->sample();
  s->order(change(*s, five_bar, {"effects=[{type=\"payload\", mass=0.3}]"}));
  s->tick();
  EXPECT_STREQ(s->sample().state, "running");
  EXPECT_NEAR(s->sample().effector[0], before.effector[0], 2e-3);  // from where it was
  double worst = 0.0;
  for (int i = 0; i < 1000; ++i) {
    s->tick();
    worst = std::max(worst, miss(s->sample()));
    ASSERT_STREQ(s->sample().state, "running");
  }
  EXPECT_GT(worst, 1e-4);  // 0.3 kg that the controller knows nothing of
  s->order(change(*s, five_bar, {}));
  run(*s, 1000);
  EXPECT_LT(miss(s->sample()), 1e-5);
}

TEST(LiveSession, WhatAChangeTakes) {
  const auto s = session_of(five_bar);
  const auto takes = [&](const std::vector<std::string>& sets) { return change(*s, five_bar, sets).takes; };
  EXPECT_EQ(takes({"effects=[{type=\"torque_lag\", time_constant=0.001}]"}), RestartLevel::nothing);
  EXPECT_EQ(takes({"simulation.step=2e-4"}), RestartLevel::nothing);
  EXPECT_EQ(takes({"effects=[{type=\"encoder\", bits=14}]"}), RestartLevel::restart);
  EXPECT_EQ(takes({"control.lambda=20"}), RestartLevel::restart);
  EXPECT_EQ(takes({"reference.radius=0.05"}), RestartLevel::restart);
  EXPECT_EQ(takes({"mechanism.leg.m2=0.2"}), RestartLevel::home);
  EXPECT_THROW((void)restart_level(s->scene(), scene_of(rr)), InputError);
  EXPECT_THROW((void)scene_of(five_bar, {"effects=[{type=\"bit_timing\"}]"}), InputError);
}

TEST(LiveSession, AHandIsFeltAndAnswered) {
  const auto s = session_of(five_bar, {"reference.type=hold", "initial.position=[0.0, 0.2]"});
  run(*s, 1500);
  const auto rest = s->sample();
  EXPECT_EQ(size(rest.force), 0.0);
  Hand hand{.holding = true, .anchor = {0.05, 0.2}, .stiffness = 60.0, .damping = 0.5, .most = 5.0};
  s->order(hand);
  run(*s, 500);
  const auto pulled = s->sample();
  EXPECT_NEAR(pulled.force[0], 60.0 * (0.05 - pulled.effector[0]),
              1e-9 + 0.5 * 0.05);  // at rest nearly: no damping
  EXPECT_GT(pulled.force[0], 2.0);
  EXPECT_GT(std::abs(pulled.torque[0] - rest.torque[0]) + std::abs(pulled.torque[1] - rest.torque[1]), 0.1);
  hand.anchor = {1.0, 0.2};
  s->order(hand);
  s->tick();
  EXPECT_NEAR(size(s->sample().force), 5.0, 1e-12);  // nobody pulls harder
  s->order(Hand{.most = 5.0});
  run(*s, 500);
  EXPECT_EQ(size(s->sample().force), 0.0);
  EXPECT_NEAR(s->sample().effector[0], rest.effector[0], 1e-4);
}

TEST(LiveSession, AFaultIsNamedLatchedAndReset) {
  const auto s = session_of(five_bar);
  run(*s, 1500);
  s->order(usual_injection(row("drive_error"), 0));
  EXPECT_LT(ticks_until(*s, "fault"), 20);
  EXPECT_STREQ(s->sample().fault, "drive_error");
  EXPECT_EQ(s->sample().torque, (std::array<double, 4>{}));
  EXPECT_TRUE(told(*s, "drive_error: torque off"));
  s->order(LiveCommand::start);
  run(*s, 3);
  EXPECT_STREQ(s->sample().state, "fault");  // not without a reset
  s->order(LiveCommand::reset);
  s->tick();
  EXPECT_TRUE(s->sample().brake || (s->tick(), s->sample().brake));
  EXPECT_LT(ticks_until(*s, "running", 500), 500);
  EXPECT_STREQ(s->sample().fault, "none");
}

/// What a page may inject follows the scene that it has asked for; the drives of before are still there.
TEST(LiveSession, NoFaultOfDrivesThatAreNotThereYet) {
  const auto s = session_of(five_bar, {"drives.protocol=mit"});
  run(*s, 1500);
  s->order(change(*s, five_bar, {"drives.protocol=odrive"}));
  s->order(usual_injection(row("not_finite"), 0));
  run(*s, 20);
  EXPECT_TRUE(told(*s, "not_finite: no fault of these drives"));
  EXPECT_STREQ(s->sample().fault, "none");
}

TEST(LiveSession, AnIntegrationThatFailsWaitsForHome) {
  const auto s = session_of(five_bar);
  run(*s, 1500);
  s->fail("radau5 cannot solve its equations");
  EXPECT_TRUE(told(*s, "radau5 cannot solve its equations: home"));
  s->tick();
  const double x = s->sample().effector[0];
  run(*s, 50);
  EXPECT_EQ(s->sample().effector[0], x) << "it stays where it is";
  s->order(LiveCommand::home);
  EXPECT_LT(ticks_until(*s, "running", 500), 500);
}

TEST(LiveSession, AChangeInAFaultWaitsForTheReset) {
  const auto s = session_of(five_bar);
  run(*s, 1500);
  s->order(usual_injection(row("enable_open"), 0));
  ASSERT_LT(ticks_until(*s, "fault"), 20);
  run(*s, 30);
  s->order(change(*s, five_bar, {"control.law=ctc"}));
  run(*s, 10);
  EXPECT_STREQ(s->sample().state, "fault");
  EXPECT_EQ(s->scene().law, LawChoice::esmc);
  s->order(LiveCommand::reset);
  EXPECT_LT(ticks_until(*s, "running", 500), 500);
  EXPECT_EQ(s->scene().law, LawChoice::ctc);
}

TEST(LiveSession, HomeTakesAChangeThatWaits) {
  const auto s = session_of(five_bar);
  run(*s, 1500);
  s->order(change(*s, five_bar, {"control.law=ctc"}));
  s->order(LiveCommand::home);
  EXPECT_LT(ticks_until(*s, "running", 500), 500);
  EXPECT_EQ(s->scene().law, LawChoice::ctc);
  EXPECT_THROW((void)change(*s, five_bar, {"control.motors=all", "drives.nodes=[1,2,3,4]"}), InputError);
}

TEST(LiveSession, EveryFaultThatIsOfferedIsOverAfterAResetOrHome) {
  const auto s = session_of(five_bar);
  int offered = 0;
  for (const InjectionRow& r : injection_rows()) {
    if (!can_inject(r, s->scene().drives.protocol)) continue;
    ++offered;
    SCOPED_TRACE(r.name);
    s->order(LiveCommand::home);
    ASSERT_LT(ticks_until(*s, "running", 500), 500);
    run(*s, 1100);
    s->order(usual_injection(r, 1));
    s->tick();
    EXPECT_EQ(s->sample().injecting, r.name);
    run(*s, 100);
    s->order(Injection{});
    s->tick();
    EXPECT_EQ(s->sample().injecting, "");
  }
  EXPECT_GT(offered, 25);
}

TEST(LiveSession, HomeIsTheBeginning) {
  const auto fresh = session_of(rr), used = session_of(rr);
  run(*fresh, 700);
  run(*used, 900);
  used->order(usual_injection(row("sensor_jump"), 0));
  run(*used, 300);
  used->order(LiveCommand::home);
  run(*used, 700);
  EXPECT_EQ(used->sample().q, fresh->sample().q);
  EXPECT_EQ(used->digest(), fresh->digest());
}

TEST(LiveSession, AHaltEndsBehindTheBrake) {
  const auto s = session_of(five_bar);
  run(*s, 1500);
  s->order(LiveCommand::halt);
  EXPECT_LT(ticks_until(*s, "disabled", 3000), 3000);
  run(*s, 2);
  EXPECT_TRUE(s->sample().brake);
  EXPECT_TRUE(s->at_rest());
  const auto q = s->sample().q;
  run(*s, 500);
  EXPECT_EQ(s->sample().q, q);
  s->order(LiveCommand::start);
  EXPECT_LT(ticks_until(*s, "running", 500), 500);
}

}  // namespace
}  // namespace esmc::host
