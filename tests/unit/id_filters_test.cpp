/// The identifiers that each axis has to hear, from the tables of docs/drives.md and docs/cia402.md.

#include "hal/id_filters.hpp"

#include <gtest/gtest.h>

#include <array>
#include <set>

#include "firmware/drive/cia402_axis.hpp"
#include "firmware/drive/mit_axis.hpp"
#include "firmware/drive/moteus_axis.hpp"
#include "firmware/drive/odrive_axis.hpp"

namespace {

using namespace esmc;
using Identifiers = std::set<std::uint32_t>;

/// Of `first` to `end`, those that the axis hears.
template <class Axis>
Identifiers heard(const Axis& axis, std::uint32_t first, std::uint32_t end, bool extended) {
  hal::IdFilters filters;
  axis.add_filters(filters);
  Identifiers out;
  for (std::uint32_t id = first; id < end; ++id) {
    const hal::CanFrame f{.id = id, .extended = extended};
    for (const hal::IdFilter& one : filters.list()) {
      if (one.matches(f)) out.insert(id);
    }
  }
  return out;
}
Identifiers range(std::uint32_t first, std::uint32_t end) {
  Identifiers out;
  for (std::uint32_t id = first; id < end; ++id) out.insert(id);
  return out;
}

TEST(IdFilters, OdriveHearsItsNodeAndFrom06OnTheBroadcast) {
  const drive::AxisConfig config{.node = 2};
  Identifiers both = range(0x40, 0x60);
  both.merge(range(0x7E0, 0x800));
  const drive::OdriveAxis newer(config, drive::OdriveAxis::Version::v0_6, 150),
      older(config, drive::OdriveAxis::Version::v0_5_6, 150);
  EXPECT_EQ(heard(newer, 0, 0x800, false), both);
  EXPECT_EQ(heard(older, 0, 0x800, false), range(0x40, 0x60));
  EXPECT_EQ(heard(newer, 0, 0x8000, true), Identifiers{});
}

TEST(IdFilters, Cia402HearsItsNodeAndWhatAControllerSends) {
  drive::Cia402Axis::Settings settings;
  settings.master_node = 0x7F;
  Identifiers expected{0x000, 0x080, 0x77F};
  for (std::uint32_t function = 0; function < 16; ++function) expected.insert(function << 7U | 5U);
  EXPECT_EQ(heard(drive::Cia402Axis({.node = 5}, settings), 0, 0x800, false), expected);
}

TEST(IdFilters, MitHearsCommandsAndReplies) {
  drive::MitAxis::Settings settings;
  settings.master_id = 0x123;
  EXPECT_EQ(heard(drive::MitAxis({.node = 3}, settings), 0, 0x800, false), (Identifiers{3, 0x123}));
  settings.dialect = drive::mit::Dialect::cubemars_v3;
  Identifiers expected;
  for (std::uint32_t packet = 0; packet < 0x40; ++packet) expected.insert(packet << 8U | 3U);
  EXPECT_EQ(heard(drive::MitAxis({.node = 3}, settings), 0, 0x10000, true), expected);
}

TEST(IdFilters, MoteusHearsEverySourceAndItsReplies) {
  for (const std::uint8_t node : std::array<std::uint8_t, 6>{1, 4, 6, 7, 8, 9}) {
    Identifiers standard, extended;
    for (const std::uint32_t to : std::array<std::uint32_t, 2>{node, 0x7F}) {  // 7Fh: to all drives
      for (std::uint32_t source = 0; source < 8; ++source) standard.insert(source << 8U | to);
      for (std::uint32_t source = 0; source < 0x100; ++source) extended.insert(source << 8U | to);
    }
    if (node < 8) standard.insert(node * 0x100U);
    for (std::uint32_t source = 0; node >= 8 && source < 0x100; ++source) extended.insert(source << 8U);
    const drive::MoteusAxis axis({.node = node}, {});
    EXPECT_EQ(heard(axis, 0, 0x800, false), standard);
    EXPECT_EQ(heard(axis, 0, 0x20000, true), extended);
  }
}

TEST(IdFilters, FourMoteusFitWhateverTheirNodesAre) {
  for (const std::uint8_t first : std::array<std::uint8_t, 4>{1, 6, 8, 100}) {
    hal::IdFilters filters;
    for (std::uint8_t i = 0; i < 4; ++i)
      drive::MoteusAxis({.node = static_cast<std::uint8_t>(first + i)}, {}).add_filters(filters);
    EXPECT_FALSE(filters.list().empty()) << int{first};
  }
}

TEST(IdFilters, TooManyHearEverything) {
  hal::IdFilters filters;
  for (std::uint32_t id = 0; id < hal::IdFilters::capacity; ++id) {
    filters.add({id, 0x7FF, false});
    filters.add({id, 0x7FF, false});
  }
  EXPECT_EQ(filters.list().size(), hal::IdFilters::capacity);
  filters.add({0x7FF, 0x7FF, false});
  EXPECT_TRUE(filters.list().empty());
}

}  // namespace
