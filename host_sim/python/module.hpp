#pragma once
/// What the files of the Python module share.

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "host_sim/error.hpp"
#include "host_sim/python/calls.hpp"
#include "host_sim/record/recording.hpp"
#include "host_sim/record/run_options.hpp"
#include "host_sim/scene/scene.hpp"
#include "host_sim/scene/toml_text.hpp"

namespace esmc::host {

namespace py = pybind11;
using Array = py::array_t<double, py::array::c_style | py::array::forcecast>;

/// The value of a key as TOML.
std::string toml_of(const std::string& key, const py::handle& v, int depth = 0);
/// Sets a key after all others, or in the place of what was set for it before, where that is the same.
void put_set(std::vector<std::string>& sets, const std::string& key, const std::string& value);
/// An array of real numbers as the one of `v`, or a list, is; `what` names it. Throws InputError.
Array numbers(const py::object& v, const char* what, int dimensions = 1);
/// Of any mapping; `what` names it.
py::dict dict_of(const py::object& v, const char* what);
/// A text that may hold the name of a file: bytes that are not UTF-8 as \xff.
py::str readable(const std::string& text);

inline py::object parsed(const std::string& document) {
  return py::module_::import("json").attr("loads")(readable(document));
}

/// A scene file as it was when it was loaded, and what is set on top of it. Every change is checked at once.
struct PyScene {
  std::string file;  ///< absolute: files that the scene names lie beside it
  std::string text;
  std::vector<std::string> sets;
  Scene scene;

  PyScene(std::string path, std::string content, std::vector<std::string> changes)
      : file(std::move(path)),
        text(std::move(content)),
        sets(std::move(changes)),
        scene(read_scene_text(text, file, sets)) {}
  static PyScene load(const std::filesystem::path& path) {
    if (path == "-") refuse("Scene.load: '-' (stdin) is for the command");
    const std::string file = path.empty() ? "" : std::filesystem::absolute(path).string();
    return {file, read_text_file(file, "scene file"), {}};
  }
  PyScene& set(const std::string& key, const py::handle& value) {
    const std::string given = toml_of(key, value);  // may run code of Python, which may set keys
    auto more = sets;
    put_set(more, key, given);
    scene = read_scene_text(text, file, more);
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
  [[nodiscard]] std::vector<std::string> joints() const { return joint_names(scene.type); }
};

/// Refuses what __new__ alone has made: pybind11 would take it for a value.
template <class T>
struct MadeWhole : py::detail::type_caster_base<T> {
  bool load(py::handle from, bool convert) {
    using Instance = py::detail::instance;
    if (py::isinstance<T>(from) && !reinterpret_cast<Instance*>(from.ptr())  // NOLINT(*-reinterpret-cast)
                                        ->get_value_and_holder()
                                        .holder_constructed())
      throw py::type_error("this object was made by __new__ alone");
    return py::detail::type_caster_base<T>::load(from, convert);
  }
};

/// released(f) with a copy of the scene's text in the place of its file.
template <class F>
auto released(const PyScene& s, const F& f) {
  return released([&f, file = s.file, text = s.text] {
    const ReadBefore as_loaded(file, text);
    return f();
  });
}

/// rollout and sweep.
void define_batches(py::module_& m);

}  // namespace esmc::host

template <>
struct pybind11::detail::type_caster<esmc::host::PyScene> : esmc::host::MadeWhole<esmc::host::PyScene> {};
