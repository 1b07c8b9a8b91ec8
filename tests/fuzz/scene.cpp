/// Files of the host: scenes (TOML), overrides, reference tables (CSV) and a vendor's endpoints (JSON). What
/// is bad is refused with an InputError and nothing else; what is accepted has the numbers that a controller
/// needs, and reads back.

#include <sys/mman.h>
#include <unistd.h>

#include <cmath>
#include <string>

#include "host_sim/error.hpp"
#include "host_sim/scene/scene.hpp"
#include "tests/fuzz/bytes.hpp"
#include "tests/fuzz/scene_builder.hpp"

namespace {

using namespace esmc;
using fuzz::require;
using host::Scene;

/// A file that lies in memory, under a name that does not change.
constexpr int file_number = 100;
const std::string file_name = "/proc/self/fd/100";
void write_file(const std::string& text) {
  static const bool made = [] {
    const int fd = memfd_create("input", 0);
    return fd >= 0 && dup2(fd, file_number) == file_number && close(fd) == 0;
  }();
  require(made && ftruncate(file_number, 0) == 0, "a file in memory");
  require(pwrite(file_number, text.data(), text.size(), 0) == static_cast<ssize_t>(text.size()),
          "a file in memory");
}

const std::string five_bar = R"(name = "fuzz"
[mechanism]
type = "five_bar"
half_base = 0.05
effector_mass = 0.05
gravity = 9.8
leg = { l1 = 0.12, l2 = 0.16, lg1 = 0.06, lg2 = 0.068, m1 = 0.1, m2 = 0.1, J1 = 2e-4, J2 = 7e-4 }
working_mode = ["+", "+"]
assembly_mode = "-"
[control]
law = "esmc"
lambda = 40.0
gain = 150.0
torque_limit = 2.0
[reference]
type = "circle"
center = [0.0, 0.17]
radius = 0.02
speed = 10.0
[drives]
nodes = [1, 2]
[simulation]
duration = 0.1
step = 1e-4
)";

void judge(const Scene& s) {
  require(std::isfinite(s.rate_hz) && s.rate_hz > 0 && std::isfinite(s.duration) && s.duration > 0,
          "times above zero");
  const auto joints = static_cast<std::size_t>(s.joints());
  require(s.start_angle.size() == joints && s.start_rate.size() == joints, "a start for every joint");
  for (std::size_t i = 0; i < joints; ++i)
    require(std::isfinite(s.start_angle[i]) && std::isfinite(s.start_rate[i]), "a finite start");
  if (s.closed_loop()) {
    require(s.torque_limit.size() == static_cast<std::size_t>(s.motors()), "a limit for every motor");
    for (const double t : s.torque_limit) require(std::isfinite(t) && t >= 0, "a torque limit is a number");
    require(s.limits.joint_speed > 0 && s.limits.max_age_ticks >= 0, "limits");
  }
  for (const double g : s.drives.gear_ratio) require(std::isfinite(g) && g > 0, "gear ratios above zero");
  for (const double d : s.drives.direction) require(d == 1 || d == -1, "directions are signs");
}

Scene read(const std::string& text, const std::vector<std::string>& sets) {
  const Scene s = host::read_scene_text(text, "fuzz.toml", sets);
  judge(s);
  return s;
}

/// The scene as run is the same scene.
void read_twice(const std::string& text, const std::vector<std::string>& sets) {
  const Scene s = read(text, sets);
  std::vector<std::string> beside;  // what it names lies beside it, elsewhere
  for (const host::Companion& c : s.companions) beside.push_back(c.key() + "=" + c.source);
  try {
    require(read(s.toml, beside).toml == s.toml, "a scene as run reads back as itself");
  } catch (const host::InputError& e) {
    require(false, e.what());
  }
}

/// A scene that is nearly right, beside a file of one of the kinds that scenes name.
void built(fuzz::Bytes& in, bool two_legs, bool with_overrides) {
  in.one_of(
      4, [&] { write_file("t,x,y\n0.0,0.0,0.17\n0.05,0.01,0.17\n0.1,0.0,0.18\n"); },
      [&] { write_file(five_bar); },
      [&] {
        write_file(
            R"({"fw_version": "0.6.10", "endpoints": {"axis0.config.motor.torque_constant": {"id": 10, "type": "float"}}})");
      },
      [&] { write_file("\377\n"); });
  fuzz::SceneBuilder scene(in, two_legs, file_name);
  if (!with_overrides) {
    scene.change();
    read_twice(scene.text(), {});
    return;
  }
  const std::vector<std::string> sets = scene.overrides(1 + static_cast<int>(in.below(4)));
  scene.change();
  read_twice(scene.text(), sets);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const std::string rest(reinterpret_cast<const char*>(data) + 1, size - 1);
  try {
    switch (data[0] % 8) {
      case 0:
        read_twice(rest, {});
        break;
      case 1: {
        std::vector<std::string> sets;
        for (std::size_t at = 0; at < rest.size();) {
          const std::size_t end = std::min(rest.find('\n', at), rest.size());
          sets.push_back(rest.substr(at, end - at));
          at = end + 1;
        }
        read_twice(five_bar, sets);
        break;
      }
      case 2:
        write_file(rest);
        (void)read(five_bar, {"reference.type=file", "reference.path=" + file_name});
        break;
      case 3: {
        write_file(rest);
        std::string text;
        const auto e = host::read_odrive_endpoints("fuzz", file_name, text);
        require(text == rest, "the text is what is in the file");
        require(e.list.size() <= host::odrive_values.size(), "each value once");
        break;
      }
      default: {
        fuzz::Bytes in(data + 1, size - 1);
        built(in, (data[0] & 1U) == 0, (data[0] & 2U) != 0);
        break;
      }
    }
  } catch (const host::InputError& e) {
    require(e.what()[0] != '\0', "a refusal says why");
  }
  return 0;
}
