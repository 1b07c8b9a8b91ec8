#include "host_sim/loop/timed_exchange.hpp"

#include <algorithm>

namespace esmc::host {

BusSummary timed_bus_summary(TimedBus& bus, const Scene& scene, std::uint64_t frames) {
  const TimedBus::Counts& c = bus.counts();
  BusSummary s;
  s.frames = frames;
  s.lost = c.refused;
  s.load = bus.now() > 0 ? static_cast<double>(bus.busy_bits()) / static_cast<double>(bus.now()) : 0.0;
  BusSummary::Disturbances d{
      c.errors, c.missed, c.duplicated, c.corrupted, find_effect<BitTiming>(scene.effects).has_value(),
      {},       {}};
  for (const TimedBus::Latency& l : bus.latencies()) {
    d.messages.push_back({l.id, l.extended, l.frames, bus.seconds(l.sum) / static_cast<double>(l.frames),
                          bus.seconds(l.largest)});
  }
  std::ranges::sort(d.messages, {}, [](const BusSummary::Message& m) { return std::pair(m.extended, m.id); });
  for (std::size_t i = 0; i <= scene.drives.nodes.size(); ++i) {
    const ErrorCounters e = bus.counters(i);
    const char* state = e.state() == ErrorCounters::State::active
                            ? "active"
                            : (e.state() == ErrorCounters::State::passive ? "passive" : "off");
    d.nodes.push_back({i == 0 ? "controller" : fmt::format("drive {}", i), state, e.transmit(), e.receive()});
  }
  s.disturbances = std::move(d);
  return s;
}

}  // namespace esmc::host
