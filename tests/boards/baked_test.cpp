/// The constants that `esmc bake` wrote of a scene against the scene itself: the same configuration, number
/// by number, and the same run, frame by frame. usage: baked_SCENE FOLDER SCENE [--set KEY=VALUE...]; one
/// program for each baked scene.

#include <fmt/format.h>

#include <algorithm>
#include <fstream>
#include <sstream>

#include "host_sim/controller/bake.hpp"
#include "scene.hpp"
#include "tests/boards/run_node.hpp"

namespace {

using namespace esmc;
using baked::Mechanism;
using baked::Node;
using baked::Scalar;

int failures = 0;
void same(const std::string& what, const std::string& baked, const std::string& scene) {
  if (baked == scene) return;
  ++failures;
  const auto at = static_cast<std::size_t>(
      std::mismatch(baked.begin(), baked.end(), scene.begin(), scene.end()).first - baked.begin());
  const std::size_t from = at < 60 ? 0 : at - 60;
  fmt::print("{} differs:\n  baked ..{}\n  scene ..{}\n", what, baked.substr(from, 120),
             scene.substr(std::min(from, scene.size()), 120));
}

std::string content(const std::string& path) {
  std::ostringstream out;
  out << std::ifstream(path).rdbuf();
  return out.str();
}

std::string settings(const host::Scene& scene, std::size_t i) {
  switch (scene.drives.protocol) {
    case host::Protocol::cia402:
      return host::bake::initialiser(host::cia402_settings(scene, i));
    case host::Protocol::mit:
      return host::bake::initialiser(host::mit_settings(scene, i));
    case host::Protocol::moteus:
      return host::bake::initialiser(host::moteus_settings(scene, i));
    case host::Protocol::odrive:
    case host::Protocol::odrive_0_5:
      break;
  }
  return host::bake::initialiser(host::odrive_settings(scene, host::Pacing::lockstep, i).table);
}

}  // namespace

int main(int argc, char** argv) {
  using host::bake::initialiser;
  host::RunOptions options;
  const std::string folder = argv[1];
  options.scene = argv[2];
  for (int i = 4; i < argc; i += 2) options.sets.emplace_back(argv[i]);
  const host::Scene scene = host::read_loop_scene(options);
  const auto reference = host::make_reference<Scalar>(scene, host::Pacing::lockstep);
  const auto wanted =
      std::get<Node::Config>(host::make_cycle_config<Mechanism>(scene, host::Pacing::lockstep, reference));
  const Node::Config got = baked::config(wanted.link.session);

  same("configuration", host::bake::cycle_text(got, ""), host::bake::cycle_text(wanted, ""));
  const auto belief = host::believed_mechanism(scene);
  if constexpr (Mechanism::joints == 4) {
    same("mechanism", initialiser(baked::believed), initialiser(host::cast<Scalar>(belief)));
  } else {
    const auto cast = host::cast<Scalar>(belief);
    same("mechanism", initialiser(baked::believed), initialiser(RrParams<Scalar>{cast.legs[0], cast.g}));
  }
  same("drives", std::to_string(std::size(baked::mounts)), std::to_string(scene.drives.nodes.size()));
  for (std::size_t i = 0; i < std::size(baked::mounts); ++i) {
    same(fmt::format("mount {}", i), initialiser(baked::mounts[i]), initialiser(host::mount(scene, i)));
    same(fmt::format("settings {}", i), initialiser(baked::settings[i]), settings(scene, i));
  }
  const auto path = got.controller.reference.path;
  same("path", std::to_string(path.size()), std::to_string(reference.path.size()));
  for (std::size_t i = 0; i < path.size(); ++i)
    same(fmt::format("path {}", i), initialiser(path[i]), initialiser(reference.path[i]));

  Node a(got), b(wanted);
  const test::NodeRun one = test::run_node(a, options, scene, folder + "/baked.log");
  const test::NodeRun other = test::run_node(b, options, scene, folder + "/scene.log");
  same("digest", one.digest, other.digest);
  same("frames", content(folder + "/baked.log"), content(folder + "/scene.log"));
  if (one.state != State::running || one.fault != Fault::none || one.frames < 300) {
    fmt::print("the run came to nothing: state {}, fault {}, {} frames\n", name(one.state), name(one.fault),
               one.frames);
    ++failures;
  }
  fmt::print("{} frames, digest {}\n", one.frames, one.digest);
  return failures == 0 ? 0 : 1;
}
