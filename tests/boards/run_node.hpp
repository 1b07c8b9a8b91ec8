#pragma once
/// A cycle in lockstep with the drives and the mechanism of a scene, on the virtual bus.

#include <string>

#include "host_sim/loop/plant_end.hpp"

namespace esmc::test {

struct NodeRun {
  std::string digest;
  State state{};
  Fault fault{};
  std::uint64_t frames = 0;
};

/// `frames_path`: every frame of the bus, as `esmc hil` writes it.
template <class Node>
NodeRun run_node(Node& node, const host::RunOptions& options, const host::Scene& scene,
                 const std::string& frames_path) {
  using World = std::conditional_t<Node::Mechanism::joints == 4, host::FiveBarTraits, host::RrTraits>;
  const auto bus = std::make_unique<hal::VirtualBus<2>>();
  host::FrameLog frames(frames_path.empty() ? nullptr : std::fopen(frames_path.c_str(), "wb"), "virtual",
                        static_cast<std::uint32_t>(scene.bitrate), scene.fast_bit());
  host::PlantEnd<World, hal::VirtualBus<2>::Port> plant(scene, options, bus->port(0), frames, nullptr, false);
  node.command(Command::enable);
  while (!plant.finished()) {
    plant.publish();
    node.receive(bus->port(1));
    if (!node.complete()) break;
    node.tick(bus->port(1));
    node.request(bus->port(1));
    if (!plant.await_torques()) break;
    plant.advance({});
  }
  frames.close();
  return {plant.recorder().statistics().digest.text(), node.supervisor().state(), node.supervisor().fault(),
          frames.frames()};
}

}  // namespace esmc::test
