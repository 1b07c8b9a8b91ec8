/// What a campaign demands follows from the scene: true at every rate and time-out, and no wider than that. A
/// loop that keeps what its scene says is acquitted, one that is a little worse than it says is condemned.

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "host_sim/campaign/episode.hpp"
#include "host_sim/scene/scene.hpp"

namespace {

using namespace esmc;
using namespace esmc::host;

using Sets = std::vector<std::string>;

constexpr std::array protocols{"odrive", "odrive_0.5", "cia402", "mit"};
constexpr std::array rates{100.0, 200.0, 250.0, 333.0, 500.0, 800.0, 1000.0, 2000.0, 5000.0};

Scene scene(const std::string& protocol, double rate, const Sets& more = {}) {
  Sets sets{"simulation.step=1e-3", "limits.halt_time=0.1", "drives.protocol=\"" + protocol + "\"",
            fmt::format("control.rate_hz={}", rate)};
  sets.insert(sets.end(), more.begin(), more.end());
  return read_scene_text(std::string(starting_scene("five_bar")), "scene of a test", sets);
}

struct Outcome {
  int episodes = 0, violations = 0;
  std::map<std::string, int> invariants, faults;  // of the violations
  std::map<std::string, int> latched;             // by the kind of fault
  std::string first;

  void add(const EpisodeResult& e) {
    ++episodes;
    if (!e.first_fault.empty()) ++latched[std::string(e.injection.row->name)];
    if (e.verdict.invariant.empty()) return;
    if (violations++ == 0) {
      first = fmt::format("seed {}: {}, {} at tick {}, latched {}", e.seed, describe(e.injection),
                          e.verdict.invariant, e.verdict.tick, e.first_fault);
    }
    ++invariants[std::string(e.verdict.invariant)];
    ++faults[std::string(e.injection.row->name)];
  }
};

/// Episodes of the loop of `real`, judged by what `promised` says; `only`: with this fault.
Outcome run(const Scene& real, const Scene& promised, int episodes, std::uint64_t seed = 1,
            std::string_view only = {}) {
  const EpisodeKind<FiveBarTraits> kind(real, promised);
  Outcome out;
  for (int i = 0; i < episodes; ++i) {
    const std::uint64_t at = seed + static_cast<std::uint64_t>(i);
    out.add(kind.run(at, Draw(at), nullptr, only));
  }
  return out;
}
Outcome run(const Scene& s, int episodes, std::uint64_t seed = 1) { return run(s, s, episodes, seed); }

// ---- times -----------------------------------------------------------------------------------------------

TEST(EpisodeTimes, OfOneKilohertzAreThoseOfTheRecord) {
  for (const char* protocol : protocols) {
    const Scene s = scene(protocol, 1000.0);
    const EpisodeTimes t = episode_times(s), usual;
    EXPECT_EQ(t.watchdog_ms, 12.0) << protocol;
    EXPECT_EQ(t.watchdog_ms, usual.watchdog_ms);
    EXPECT_EQ(t.watchdog_ticks, usual.watchdog_ticks);
    EXPECT_EQ(t.beat_ticks, usual.beat_ticks);
    EXPECT_EQ(t.jump, usual.jump);
    EXPECT_EQ(t.max_age_ticks, 2);
    EXPECT_EQ(t.open_ticks, usual.open_ticks);
    EXPECT_EQ(t.steps_per_tick, 1);
    EXPECT_EQ(t.heartbeat_ticks, 30);
    EXPECT_LT(t.frames_ms, 1.0);
    // With these, what is due is what a table of numbers once said.
    for (std::uint64_t seed = 0; seed < 400; ++seed) {
      Draw d(seed);
      const Injection i = draw_injection(d, t, protocol_traits(s.drives.protocol));
      const std::string name(i.row->name);
      EXPECT_LE(i.length, i.row->longest == 0 ? i.length : i.row->longest) << name;
      const auto due = [&](const char* of, int ticks, double safe_ms) {
        if (name != of) return;
        EXPECT_EQ(i.notice_ticks, ticks) << name;
        EXPECT_EQ(i.safe_ms, safe_ms) << name;
      };
      due("drive_error", 12, 13.0);
      due("heartbeat_lost", 32, 33.0);
      due("burst_loss", 2, 3.0);
      due("controller_bus_off", 1, 12.0);
      due("flood", 0, 1.0);
      due("emergency_stop", 1, 2.0);
      EXPECT_TRUE(i.fits_too.empty() || t.out_of_range) << name << i.fits_too;
    }
    if (testing::Test::HasFailure()) return;
  }
}

TEST(EpisodeTimes, FollowTheScene) {
  const EpisodeTimes slow = episode_times(scene("odrive", 100.0));
  EXPECT_NEAR(slow.watchdog_ms, 50.0, 1e-9) << "30 ms and two ticks";
  EXPECT_EQ(slow.watchdog_ticks, 4);
  EXPECT_EQ(slow.beat_ticks, 1);
  EXPECT_EQ(slow.heartbeat_ticks, 3);
  EXPECT_NEAR(slow.jump, 0.5, 1e-12);
  EXPECT_EQ(slow.steps_per_tick, 10);
  const EpisodeTimes fast = episode_times(scene("odrive", 5000.0, {"bus.bitrate=500000"}));
  EXPECT_NEAR(fast.watchdog_ms, 10.4, 1e-9);
  EXPECT_EQ(fast.beat_ticks, 50);
  EXPECT_EQ(fast.heartbeat_ticks, 150);
  EXPECT_NEAR(fast.frames_ms, 3 * 0.270, 1e-12);
  // A CiA 402 drive counts whole milliseconds, from our heartbeat.
  const EpisodeTimes whole = episode_times(scene("cia402", 1000.0, {"drives.watchdog_timeout=0.0141"}));
  EXPECT_NEAR(whole.watchdog_ms, 17.0, 1e-9);
  EXPECT_EQ(whole.feed_ticks, 4);
  EXPECT_NEAR(episode_times(scene("mit", 1000.0, {"drives.watchdog_timeout=0.0141"})).watchdog_ms, 16.1,
              1e-9);
}

TEST(EpisodeTimes, SayWhatAGapOutlasts) {
  EpisodeTimes t;  // a drive that beats every 10 ticks and holds for 11
  t.heartbeat_ticks = 30;
  EXPECT_EQ(t.heartbeat_late(1), 10);
  EXPECT_EQ(t.heartbeat_late(11), 20);
  EXPECT_FALSE(t.heartbeat_expires(21));
  EXPECT_TRUE(t.heartbeat_expires(22));
  EXPECT_FALSE(t.watchdog_expires(9));
  EXPECT_TRUE(t.watchdog_expires(10));
  t.feed_ticks = 3;
  EXPECT_FALSE(t.watchdog_expires(6));
  EXPECT_TRUE(t.watchdog_expires(7));
}

/// Names that fit a fault on a scene and not on every one.
std::set<std::string> fits_too(const Scene& s, std::string_view fault) {
  std::set<std::string> out;
  const EpisodeTimes t = episode_times(s);
  for (std::uint64_t seed = 0; seed < 1000; ++seed) {
    Draw d(seed);
    const Injection i = draw_injection(d, t, protocol_traits(s.drives.protocol));
    if (i.row->name == fault) out.insert(i.fits_too);
  }
  return out;
}

TEST(FitsToo, OnlyWhereTheSceneMakesItPossible) {
  const std::set<std::string> none{""};
  EXPECT_EQ(fits_too(scene("odrive", 1000.0), "scattered_loss"), none);
  const std::set<std::string> slow = fits_too(scene("odrive", 100.0), "scattered_loss");
  ASSERT_EQ(slow.size(), 1U);
  EXPECT_TRUE(lists(*slow.begin(), "working_mode"));
  EXPECT_FALSE(lists(*slow.begin(), "malformed_frame"));
  // The ranges of an MIT drive, and those that hold whatever the guards let pass.
  EXPECT_EQ(fits_too(scene("mit", 1000.0), "frozen_sensor"), std::set<std::string>{" drive_error"});
  const Sets wide{"drives.position_range=40.0", "drives.velocity_range=200.0"};
  EXPECT_EQ(fits_too(scene("mit", 1000.0, wide), "frozen_sensor"), none);
  EXPECT_EQ(fits_too(scene("odrive", 1000.0), "frozen_sensor"), none);
  // 1 / lambda is 25 ms: one sample of 20 ms may be missing, and not two.
  Scene asked = scene("odrive", 1000.0);
  asked.drives.endpoints.emplace();
  for (const char* bent : {"corruption", "scattered_loss", "commands_lost"}) {
    EXPECT_EQ(fits_too(asked, bent), (std::set<std::string>{"", " drive_configuration"}))
        << bent << ", while arming";
    EXPECT_EQ(fits_too(scene("odrive", 1000.0), bent), none) << bent;
  }
  for (const char* whole : {"nothing", "duplication", "frozen_sensor"})
    EXPECT_EQ(fits_too(asked, whole), none) << whole;
  EXPECT_EQ(fits_too(scene("odrive", 50.0, {"limits.max_age_ticks=1"}), "frame_loss"), none);
  const std::set<std::string> open = fits_too(scene("odrive", 50.0), "frame_loss");
  ASSERT_EQ(open.size(), 2U);
  EXPECT_TRUE(open.contains("") && lists(*open.rbegin(), "type2_singularity"));
}

// ---- what must show --------------------------------------------------------------------------------------

const InjectionRow& row(std::string_view name) {
  for (const InjectionRow& r : injection_rows()) {
    if (r.name == name) return r;
  }
  throw std::runtime_error("no such fault");
}
bool shows(const Scene& s, const char* fault, double amount, int choice = 0, std::size_t drive = 0) {
  Injection i;
  i.row = &row(fault);
  i.amount = amount;
  i.choice = choice;
  i.drive = drive;
  return has_to_show(i, s);
}

TEST(HasToShow, AJumpOfMoreThanTheGuardBears) {
  const Scene usual = scene("odrive", 1000.0), off = scene("odrive", 1000.0, {"limits.feedback_jump=0"}),
              wide = scene("odrive", 1000.0, {"limits.feedback_jump=1.0"});
  EXPECT_TRUE(shows(usual, "sensor_jump", -0.15));
  EXPECT_FALSE(shows(usual, "sensor_jump", 0.09));
  EXPECT_FALSE(shows(off, "sensor_jump", 3.0));
  EXPECT_FALSE(shows(wide, "sensor_jump", 1.9));
  EXPECT_TRUE(shows(wide, "sensor_jump", 2.1));
  // Without that guard a wrong angle need not show; a wrong speed has to, and a number that is none.
  EXPECT_TRUE(shows(usual, "huge", 1e3, 0));
  EXPECT_FALSE(shows(off, "huge", 1e3, 0));
  EXPECT_TRUE(shows(off, "huge", 1e3, 1));
  EXPECT_FALSE(
      shows(scene("odrive", 1000.0, {"limits.feedback_jump=0", "limits.joint_speed=1e5"}), "huge", 1e3, 1));
  EXPECT_TRUE(shows(off, "not_finite", 0.0));
  EXPECT_TRUE(shows(off, "flood", 0.0));
  // Both numbers of a CiA 402 drive are at an end; a reply in MIT mode is an error then.
  EXPECT_TRUE(shows(scene("cia402", 1000.0, {"limits.feedback_jump=0"}), "end_of_range", 0.5));
  EXPECT_TRUE(shows(scene("mit", 1000.0, {"limits.feedback_jump=0"}), "end_of_range", 0.5));
}
TEST(HasToShow, NoJumpByWholeSpansOfAPosition) {
  const Scene s = scene("mit", 1000.0, {"drives.position_range=1.0"});
  EXPECT_TRUE(shows(s, "sensor_jump", 0.9));
  EXPECT_FALSE(shows(s, "sensor_jump", 2.01));
}
TEST(HasToShow, UnreadSensorNeedNotShow) {
  const Sets four{"control.motors=\"all\"", "drives.nodes=[1, 2, 3, 4]"};
  const Scene base = scene("odrive", 1000.0, four);
  for (std::size_t drive = 0; drive < 4; ++drive) {
    const bool read = drive % 2 == 0;
    EXPECT_EQ(shows(base, "sensor_jump", 1.0, 0, drive), read) << drive;
    EXPECT_EQ(shows(base, "not_finite", 0.0, 0, drive), read) << drive;
    EXPECT_TRUE(shows(base, "drive_silent", 0.0, 0, drive)) << drive;
  }
  Sets all = four;
  all.emplace_back("control.sensors=\"all\"");
  EXPECT_TRUE(shows(scene("odrive", 1000.0, all), "sensor_jump", 1.0, 0, 1));
}

// ---- whole episodes --------------------------------------------------------------------------------------

TEST(Campaign, NothingIsFoundAtAnyRate) {
  for (const char* protocol : protocols) {
    for (const double rate : rates) {
      const Outcome o = run(scene(protocol, rate), 80);
      EXPECT_EQ(o.violations, 0) << protocol << " at " << rate << " Hz: " << o.first;
      EXPECT_GT(o.latched.size(), 10U) << protocol << " at " << rate << " Hz";
    }
  }
}

TEST(Campaign, NothingIsFoundWithOtherTimes) {
  const std::array<Sets, 7> others{
      {{"drives.watchdog_timeout=0.05"},
       {"limits.feedback_jump=0"},
       {"drives.heartbeat_timeout=0.1"},
       {"limits.max_age_ticks=0"},
       {"limits.max_age_ticks=5", "drives.heartbeat_timeout=0.02"},
       {"limits.max_age_ticks=5", "drives.watchdog_timeout=0.03", "limits.feedback_jump=0"},
       {"reference.join=0.1", "limits.max_age_ticks=40", "limits.feedback_jump=1.0"}}};
  for (const char* protocol : {"odrive", "odrive_0.5", "cia402", "mit", "moteus"}) {
    for (const double rate : {100.0, 333.0, 1000.0, 2000.0}) {
      for (const Sets& sets : others) {
        const Outcome o = run(scene(protocol, rate, sets), 30, 500);
        EXPECT_EQ(o.violations, 0) << protocol << " at " << rate << " Hz, " << sets[0] << ": " << o.first;
      }
    }
  }
}

/// A drive that lets go three ticks later than its scene says; one of CiA 402 counts whole ms.
TEST(Campaign, AWatchdogThatTripsLateIsFoundAtAnyRate) {
  std::vector<std::pair<double, Sets>> loops;
  for (const double rate : rates) loops.push_back({rate, {}});
  loops.push_back({1000.0, {"drives.watchdog_timeout=0.1"}});  // longer than most episodes are
  for (const char* protocol : protocols) {
    for (const auto& [rate, sets] : loops) {
      const Scene promised = scene(protocol, rate, sets);
      Scene late = promised;
      late.drives.watchdog_timeout += 3.0 * late.tick();
      const Outcome o = run(late, promised, 120);
      EXPECT_GE(o.invariants.contains("watchdog") ? o.invariants.at("watchdog") : 0, 2)
          << protocol << " at " << rate << " Hz";
      for (const auto& [name, n] : o.invariants) {
        EXPECT_TRUE(name == "watchdog" || name == "safe_time")
            << protocol << " at " << rate << " Hz: " << o.first;
      }
    }
  }
}

/// A controller that bears more than its scene says.
TEST(Campaign, GuardsThatAreWiderThanTheirSceneSaysAreFoundAtAnyRate) {
  for (const char* protocol : protocols) {
    for (const double rate : {100.0, 333.0, 1000.0, 5000.0}) {
      const Scene promised = scene(protocol, rate);
      Scene real = promised;
      real.limits.feedback_jump = 0.0;
      real.limits.max_age_ticks += 1;
      // By a beat more: how old the last one is when the next is lost, the judge does not know.
      real.drives.heartbeat_timeout += 0.01 + 4.0 * real.tick();
      bool noticed_late = false;
      const auto found = [&](std::string_view fault) {
        const Outcome o = run(real, promised, 40, 1, fault);
        noticed_late = noticed_late || o.invariants.contains("notice_time");
        return o.violations > 0;
      };
      EXPECT_TRUE(found("sensor_jump")) << protocol << " at " << rate << " Hz";
      EXPECT_TRUE(found("drive_silent")) << protocol << " at " << rate << " Hz";
      EXPECT_TRUE(found("burst_loss")) << protocol << " at " << rate << " Hz";
      // In MIT mode a heartbeat is a sample.
      EXPECT_EQ(found("heartbeat_lost"), std::string(protocol) != "mit")
          << protocol << " at " << rate << " Hz";
      EXPECT_TRUE(noticed_late) << protocol << " at " << rate << " Hz";
    }
  }
}

TEST(Campaign, ALoopThatFailsByItselfIsNoMatterForACampaign) {
  const Scene s = scene("odrive", 1000.0, {"drives.heartbeat_timeout=0.005"});  // the drives beat every 10 ms
  try {
    const EpisodeKind<FiveBarTraits> kind(s);
    ADD_FAILURE() << "a campaign began";
  } catch (const RunError& e) {
    EXPECT_NE(std::string(e.what()).find("heartbeat_lost"), std::string::npos) << e.what();
  }
}

}  // namespace
