#include "host_sim/scene/reader.hpp"

#include <algorithm>

#include "host_sim/scene/scene.hpp"

namespace esmc::host {
namespace {

constexpr std::uint32_t block = 32;  // identifiers, as docs/esmc.dbc has them

/// [lower, upper] around the scene's own values, which the controller starts with; zeros: not given.
std::array<double, 2> gain_range(Section& s, const char* key, const PerKind& own) {
  const auto given = s.optional_numbers(key, {2});
  if (!given) return {0.0, 0.0};
  const std::array<double, 2> r{(*given)[0], (*given)[1]};
  if (!(r[0] < r[1])) s.fail(key, "must be [lower, upper] with lower < upper");
  for (const double v : {own.position, own.angle}) {
    if (!(r[0] <= v && v <= r[1])) s.fail(key, "must contain what [control] has, {:g}", v);
  }
  return r;
}

}  // namespace

std::vector<std::uint32_t> drive_identifiers(const Scene& scene) {
  std::vector<std::uint32_t> out;
  const DriveScene& d = scene.drives;
  const auto nodes = [&](std::initializer_list<std::uint32_t> functions) {
    for (const int n : d.nodes) {
      for (const std::uint32_t f : functions) out.push_back(f + static_cast<std::uint32_t>(n));
    }
  };
  switch (d.protocol) {
    case Protocol::odrive:
    case Protocol::odrive_0_5:
      for (const int n : d.nodes) out.push_back(static_cast<std::uint32_t>(n) * block);
      out.push_back(0x3F * block);  // 0.6: to all, and unaddressed ones
      break;
    case Protocol::cia402:  // the predefined connection set: EMCY, four PDO each way, SDO, heartbeat
      nodes({0x080, 0x180, 0x200, 0x280, 0x300, 0x380, 0x400, 0x480, 0x500, 0x580, 0x600, 0x700});
      for (const std::uint32_t id : {0x000U, 0x080U, 0x100U, 0x7E4U, 0x7E5U})
        out.push_back(id);  // NMT, SYNC, TIME, LSS
      out.push_back(0x700U + static_cast<std::uint32_t>(d.controller_node));
      break;
    case Protocol::mit:
      nodes({0});
      for (const int id : d.master_id) out.push_back(static_cast<std::uint32_t>(id));
      break;
    case Protocol::moteus:  // whose low eight bits are the destination, 7Fh for all; and replies, to 0
      for (const std::uint32_t source : {0x000U, 0x100U, 0x200U, 0x300U, 0x400U, 0x500U, 0x600U, 0x700U}) {
        out.push_back(source);
        out.push_back(source + 0x7F);
        nodes({source});
      }
      break;
  }
  return out;
}

void read_command(Section s, Scene& scene) {
  if (scene.robust_gain) {
    s.fail("",
           "[command] and control.gain = \"robust\" exclude each other: the interface has one gain per kind "
           "of channel, the design one per channel; give control.gain as numbers (esmc design says which)");
  }
  CommandScene& c = scene.command.emplace();
  s.read_fields(scene);
  const auto base = static_cast<std::uint32_t>(c.base_id);
  if (base % block != 0) s.fail("base_id", "must be a multiple of {}", block);
  for (const std::uint32_t id : drive_identifiers(scene)) {
    if (id / block != base / block) continue;
    s.fail("base_id",
           "takes the identifiers 0x{:03x} to 0x{:03x}, and the drives of this scene have 0x{:03x}", base,
           base + block - 1, id);
  }
  c.arm_by_link = s.text("arm") == "link";
  // A console answers Status, which in a slow loop are far apart; after 5 s without one it has lost the
  // controller, and no default may keep a mechanism in motion for longer.
  const double status = std::min(c.status_ticks * scene.tick(), 5.0);
  c.timeout = s.optional_number("timeout").value_or(c.arm_by_link ? std::max(1.0, 3.0 * status) : 0.0);
  const double longest = 32767.0 * scene.tick();  // an order carries 16 bits of the tick
  c.order_age = s.optional_number("order_age").value_or(std::min(std::max(0.5, 2.0 * status), longest));
  if (c.order_age > longest * (1.0 + 1e-9))
    s.fail("order_age", "must be at most 32767 ticks, {:g} s", longest);
  const double most = CommandScene::jerk_ticks_max * scene.tick();
  c.jerk_time = s.optional_number("jerk_time").value_or(std::min(0.02, most));
  if (c.jerk_time > most * (1.0 + 1e-9))
    s.fail("jerk_time", "must be at most {} ticks, {:g} s", CommandScene::jerk_ticks_max, most);
  c.lambda = gain_range(s, "lambda", scene.lambda);
  c.gain = gain_range(s, "gain", scene.gain);
  for (const char* key : {"lambda", "gain"}) {
    if (s.has(key) && !scene.sliding()) s.fail(key, "is for the laws esmc, esmc_projected and smc");
  }
  s.finish();
}

}  // namespace esmc::host
