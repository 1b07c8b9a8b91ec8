#pragma once
/// What the files of the Python module share: Scene, and calls without the interpreter's lock.

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <csignal>
#include <filesystem>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "host_sim/error.hpp"
#include "host_sim/record/run_options.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

namespace py = pybind11;
using Array = py::array_t<double, py::array::c_style | py::array::forcecast>;

/// Without the interpreter's lock. Ctrl-C ends the run as it ends a command, and Python hears of it after.
class Released {
 public:
  Released() : lock_(running()) {
    stop_requested() = false;
    before_ = std::signal(SIGINT, [](int) { stop_requested() = true; });
  }
  Released(const Released&) = delete;
  Released& operator=(const Released&) = delete;
  ~Released() {
    std::signal(SIGINT, before_);
    if (stop_requested().exchange(false)) interrupted() = true;
  }
  /// To be called with the interpreter's lock: raises KeyboardInterrupt after Ctrl-C.
  static void check() {
    if (!interrupted().exchange(false)) return;
    PyErr_SetNone(PyExc_KeyboardInterrupt);
    throw py::error_already_set();
  }

 private:
  static std::mutex& running() {
    static std::mutex m;
    return m;
  }
  static std::atomic<bool>& interrupted() {
    static std::atomic<bool> flag{false};
    return flag;
  }
  py::gil_scoped_release release_;
  std::unique_lock<std::mutex> lock_;
  void (*before_)(int) = nullptr;
};

/// f() without the interpreter's lock, one at a time.
template <class F>
auto released(const F& f) {
  const auto run = [&] {
    const Released guard;
    return f();
  };
  try {
    auto out = run();
    Released::check();
    return out;
  } catch (const RunError&) {
    Released::check();
    throw;
  }
}

/// The value of a key as TOML.
std::string toml_of(const std::string& key, const py::handle& v, int depth = 0);

inline py::object parsed(const std::string& document) {
  return py::module_::import("json").attr("loads")(document);
}

/// A scene file, found again from another working directory, and what is set on top of it. Every change is
/// checked at once.
struct PyScene {
  std::string file;
  std::vector<std::string> sets;
  Scene scene;

  PyScene(std::string path, std::vector<std::string> changes)
      : file(std::move(path)), sets(std::move(changes)) {
    if (file == "-") refuse("Scene.load: '-' (stdin) is for the command");
    if (!file.empty()) file = std::filesystem::absolute(file).string();
    scene = read_scene(file, sets);
  }
  PyScene& set(const std::string& key, const py::handle& value) {
    auto more = sets;
    more.push_back(key + "=" + toml_of(key, value));
    scene = read_scene(file, more);
    sets = std::move(more);
    return *this;
  }
  [[nodiscard]] RunOptions options(Capture& to) const {
    RunOptions o;
    o.scene = file;
    o.sets = sets;
    o.json = true;
    o.capture = &to;
    return o;
  }
  [[nodiscard]] std::vector<std::string> motors() const {
    std::vector<std::string> out;
    for (const std::size_t j : scene.motor_joints()) out.push_back(joints()[j]);
    return out;
  }
  [[nodiscard]] std::vector<std::string> joints() const {
    if (scene.type == MechanismType::five_bar) return {"theta11", "theta12", "theta21", "theta22"};
    return {"theta1", "theta2"};
  }
};

/// rollout and sweep.
void define_batches(py::module_& m);

}  // namespace esmc::host
