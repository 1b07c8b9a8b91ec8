#include <gtest/gtest.h>

#include <string>

#include "host_sim/controller/board_costs.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {
namespace {

constexpr Board made_up{"made_up", true, 100e6, 200e3, 50e3, 100e3, 20e3};

Scene scene(const std::vector<std::string>& sets = {}) {
  return read_scene_text(std::string(starting_scene("five_bar")), "scene", sets);
}

TEST(BoardCosts, EveryBoardHoldsTheStartingScene) {
  EXPECT_EQ(budget_excess(scene(), made_up), "");
  for (const Board& b : boards) EXPECT_EQ(budget_excess(scene(), b), "") << b.name;
}

TEST(BoardCosts, OptionalPartsTakeFlash) {
  Board tight = made_up;
  tight.flash = tight.image_flash / 0.6;  // none is left for a part
  EXPECT_EQ(budget_excess(scene(), tight), "");
  for (const char* part : {"control.reaching=\"super_twisting\"", "control.reaching=\"implicit_coupled\"",
                           "control.disturbance_observer=20.0", "control.motors=\"all\""}) {
    EXPECT_NE(budget_excess(scene({part}), tight).find("bytes of flash of made_up"), std::string::npos)
        << part;
  }
}

TEST(BoardCosts, RamAboveItsShareIsRefused) {
  Board small = made_up;
  small.ram = 33e3;
  EXPECT_EQ(budget_excess(scene(), small),
            "the image takes 20000 of the 33000 bytes of RAM of made_up, at most 60 % are allowed");
}

TEST(BoardCosts, SlowClockIsRefused) {
  Board slow = made_up;
  slow.clock_hz = 1e6;
  EXPECT_NE(budget_excess(scene(), slow).find("of the 1000 cycles of a tick of made_up"), std::string::npos);
}

}  // namespace
}  // namespace esmc::host
