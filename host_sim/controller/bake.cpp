#include "host_sim/controller/bake.hpp"

#include <vector>

#include "host_sim/version.hpp"

namespace esmc::host {
namespace {

using bake::initialiser;

/// A table of points is kept in the image's memory.
constexpr std::size_t segments_max = 256;

/// The firmware's types of an axis and of its settings.
struct AxisTypes {
  const char *axis, *settings;
};
AxisTypes types_of(const Scene& s) {
  if (s.drives.protocol == Protocol::cia402) return {"Cia402Axis", "Cia402Settings"};
  if (s.drives.protocol == Protocol::mit) return {"MitAxis", "MitAxis::Settings"};
  if (s.drives.protocol == Protocol::moteus) return {"MoteusAxis", "MoteusAxis::Settings"};
  return {"OdriveAxis", "OdriveTable"};
}
std::string settings_text(const Scene& scene, Pacing pacing, std::size_t i) {
  if (scene.drives.protocol == Protocol::cia402) return initialiser(cia402_settings(scene, i));
  if (scene.drives.protocol == Protocol::mit) return initialiser(mit_settings(scene, i));
  if (scene.drives.protocol == Protocol::moteus) return initialiser(moteus_settings(scene, i));
  return initialiser(odrive_settings(scene, pacing, i).table);
}

/// Tables of the drives' settings, the statements that make the axes from them, and the bare values of both.
struct AxesText {
  std::string tables, make, values;
};
/// Table `name` with the text `make(i)` of drive i, in the order of the scene.
template <class Make>
void add_table(AxesText& out, const Scene& scene, const char* type, const char* name, const Make& make) {
  out.tables += fmt::format("inline constexpr drive::{} {}[] = {{\n", type, name);
  for (std::size_t i = 0; i < scene.drives.nodes.size(); ++i) {
    out.tables += "    " + make(i) + ",\n";
    out.values += make(i);
  }
  out.tables += "};\n";
}

AxesText axes_text(const Scene& scene, Pacing pacing) {
  AxesText out;
  const AxisTypes types = types_of(scene);
  add_table(out, scene, "AxisConfig", "mounts", [&](std::size_t i) { return initialiser(mount(scene, i)); });
  add_table(out, scene, types.settings, "settings",
            [&](std::size_t i) { return settings_text(scene, pacing, i); });
  for (std::size_t i = 0; i < scene.drives.nodes.size(); ++i) {
    const std::string place = fmt::format("  c.axes[{}]", axis_of(scene, i));
    const OdriveSettings s = scene.odrive() ? odrive_settings(scene, pacing, i) : OdriveSettings{};
    const std::string more =
        scene.odrive() ? initialiser(s.version) + ", " + initialiser(s.retry_ticks) + ", " : "";
    out.make += fmt::format("{} = drive::{}(mounts[{}], {}settings[{}]);\n", place, types.axis, i, more, i);
    if (!scene.odrive()) continue;
    out.make += fmt::format("{}.restarts_within({});\n", place, initialiser(s.silence_ticks));
    if (s.proof_ticks > 0)
      out.make += fmt::format("{}.prove_watchdog({});\n", place, initialiser(s.proof_ticks));
    out.values += fmt::format(" {} {} {} {} ", initialiser(s.version), initialiser(s.retry_ticks),
                              initialiser(s.silence_ticks), initialiser(s.proof_ticks));
  }
  return out;
}

std::string line_text(const Scene& scene) {
  return scene.drives.protocol == Protocol::cia402
             ? fmt::format("drive::CanopenLine({}, {})", scene.drives.controller_node, heartbeat_ticks(scene))
             : "{}";
}

/// All constants of the image.
template <class M>
std::string constants(const Scene& scene, Pacing pacing,
                      const ReferenceBundle<typename M::Scalar>& reference) {
  using S = typename M::Scalar;
  const AxesText axes = axes_text(scene, pacing);
  std::string path;
  for (const PathSegment<S>& s : reference.path) path += "      " + initialiser(s) + ",\n";
  const std::string body = std::visit([&](const auto& c) { return bake::cycle_text(c, line_text(scene)); },
                                      make_cycle_config<M>(scene, pacing, reference));
  return fmt::format(
      "namespace esmc::baked {{\n\n"
      "using Scalar = {};\n"
      "using Mechanism = {}<Scalar>;\n"
      "using Node = Cycle<Mechanism, drive::{}>;\n"
      "inline constexpr std::uint32_t bitrate = {};      // bit/s\n"
      "inline constexpr std::uint32_t data_bitrate = {}; // bit/s of a CAN FD frame's data; 0: classic\n"
      "inline constexpr std::uint32_t period_ns = {};    // of a tick\n"
      "inline constexpr bool lockstep = {};              // a tick is a complete set of samples, and not a "
      "time\n"
      "inline constexpr bool armed_by_link = {};\n\n"
      "inline constexpr {}Params<Scalar> believed{};\n{}\n"
      "/// `session`: of the link to a supervisor computer; another one at every power-up, 1 to 255.\n"
      "inline Node::Config config([[maybe_unused]] std::uint8_t session) {{\n"
      "{}  Node::Config c{{\n{}}};\n"
      "{}  c.link.session = session;\n"
      "  return c;\n"
      "}}\n\n"
      "}}  // namespace esmc::baked\n",
      std::is_same_v<S, float> ? "float" : "double", M::joints == 4 ? "FiveBar" : "Rr", types_of(scene).axis,
      static_cast<std::uint32_t>(scene.bitrate), static_cast<std::uint32_t>(scene.data_bitrate),
      static_cast<std::uint32_t>(std::llround(1e9 / scene.rate_hz)), pacing == Pacing::lockstep,
      armed_by_link(scene), M::joints == 4 ? "FiveBar" : "Rr",
      initialiser(params_of<M>(believed_mechanism(scene))), axes.tables,
      path.empty() ? "  constexpr std::span<const PathSegment<Scalar>> path{};\n"
                   : "  static const PathSegment<Scalar> path[] = {\n" + path + "  };\n",
      body, axes.make);
}

template <class M>
std::string header(const Scene& scene, Pacing pacing) {
  const auto reference = make_reference<typename M::Scalar>(scene, pacing);
  if (const std::size_t pieces = reference.path.size(); pieces > segments_max)
    refuse_at(scene.reference_where, "a path of {} pieces does not fit into a board's memory; allowed are {}",
              pieces, segments_max);
  return fmt::format(
             "// Made by esmc bake {} from the scene \"{}\". Not to be edited.\n"
             "#pragma once\n\n"
             "#include \"boards/baked.hpp\"\n\n",
             version, printable(scene.name)) +
         constants<M>(scene, pacing, reference);
}

/// The values of `constants` without the text around them, so that rewording it keeps the identity.
template <class M>
std::string values(const Scene& scene, Pacing pacing, const ReferenceBundle<typename M::Scalar>& reference) {
  const AxesText axes = axes_text(scene, pacing);
  std::string out =
      fmt::format("{} {} {} {} {} {}", static_cast<int>(scene.type), static_cast<int>(scene.drives.protocol),
                  static_cast<std::uint32_t>(scene.bitrate), std::llround(1e9 / scene.rate_hz),
                  pacing == Pacing::lockstep, armed_by_link(scene));
  out += initialiser(cast<typename M::Scalar>(believed_mechanism(scene))) + axes.values + line_text(scene);
  for (const auto& s : reference.path) out += initialiser(s);
  out += std::visit([&](const auto& c) { return bake::cycle_text(c, ""); },
                    make_cycle_config<M>(scene, pacing, reference));
  std::erase_if(out, [](char c) { return c == ' ' || c == '\n'; });
  return out;
}

}  // namespace

std::uint32_t identity_of(Scene scene, Pacing pacing) {
  scene.identity = 0;
  const auto values_of = [&]<class M>(const M*) {
    return values<M>(scene, pacing, make_reference<double>(scene, pacing));
  };
  const std::string text = with_mechanism<double>(scene, values_of);
  const std::vector<std::uint8_t> bytes(text.begin(), text.end());
  return link::crc32(bytes);
}

std::string baked_header(const Scene& scene, Pacing pacing, bool single_precision) {
  const auto of = [&]<class M>(const M*) { return header<M>(scene, pacing); };
  return single_precision ? with_mechanism<float>(scene, of) : with_mechanism<double>(scene, of);
}

}  // namespace esmc::host
