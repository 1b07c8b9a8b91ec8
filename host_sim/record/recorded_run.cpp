/// Apart from recording.cpp, which a fuzz target links without the reader of scenes.

#include <filesystem>

#include "host_sim/error.hpp"
#include "host_sim/record/recording.hpp"

namespace esmc::host {

RecordedRun open_run(const std::string& log, const std::string& scene) {
  namespace fs = std::filesystem;
  std::error_code ignored;
  if (log.find('\0') != std::string::npos) refuse("the log must be a file name, without NUL");
  if (fs::is_directory(log, ignored)) require_csv(log);
  if (log.ends_with(".npy")) refuse("{}: log.csv is needed: run it with --log csv", log);
  RecordedRun out;
  out.log = fs::is_directory(log, ignored) ? (fs::path(log) / "log.csv").string() : log;
  if (!fs::exists(out.log, ignored)) refuse("{}: there is no such log", out.log);
  out.scene_file = scene.empty() ? (fs::path(out.log).parent_path() / "scene.toml").string() : scene;
  if (scene.empty() && !fs::exists(out.scene_file, ignored))
    refuse("{}: there is no scene beside the log: --scene FILE says which mechanism it is of",
           out.scene_file);
  out.scene = read_scene(out.scene_file, {});
  return out;
}

}  // namespace esmc::host
