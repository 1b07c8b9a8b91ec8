/// The Python module esmc. docs/python.md is its page, esmc.pyi its types.

#include "host_sim/python/module.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cmath>
#include <memory>

#include "host_sim/check/check.hpp"
#include "host_sim/loop/run.hpp"
#include "host_sim/python/loop.hpp"
#include "host_sim/record/compare.hpp"
#include "host_sim/studies/studies.hpp"
#include "host_sim/version.hpp"

namespace esmc::host {
namespace {

struct Run {
  Capture capture;
  py::object summary;
};
struct Plan : Run {};

}  // namespace
}  // namespace esmc::host

namespace pybind11::detail {
template <>
struct type_caster<esmc::host::Run> : esmc::host::MadeWhole<esmc::host::Run> {};
template <>
struct type_caster<esmc::host::Plan> : esmc::host::MadeWhole<esmc::host::Plan> {};
template <>
struct type_caster<esmc::host::PythonTick> : esmc::host::MadeWhole<esmc::host::PythonTick> {};
template <>
struct type_caster<esmc::host::PythonController> : esmc::host::MadeWhole<esmc::host::PythonController> {};
template <>
struct type_caster<esmc::host::PythonPlant> : esmc::host::MadeWhole<esmc::host::PythonPlant> {};
}  // namespace pybind11::detail

namespace esmc::host {
namespace {

std::shared_ptr<Run> run(const PyScene& s, const std::string& mode, std::uint64_t seed) {
  if (mode != "sim" && mode != "hil") refuse("mode = {:?}: sim or hil", mode);
  auto out = std::make_shared<Run>();
  RunOptions o = s.options(out->capture);
  o.seed = seed;
  (void)released(s, [&] { return mode == "sim" ? run_sim(o) : run_hil(o); });
  out->summary = parsed(out->capture.document);
  return out;
}

std::shared_ptr<Plan> plan(const PyScene& s) {
  auto out = std::make_shared<Plan>();
  (void)released(s, [o = s.options(out->capture)] { return run_plan(o); });
  out->summary = parsed(out->capture.document);
  return out;
}

/// Columns as views into the run, which they keep alive.
template <class Of>
py::dict log_of(const py::object& self) {
  const KeptLog& log = self.cast<const Of&>().capture.log;
  const std::size_t columns = log.columns.size(), rows = columns == 0 ? 0 : log.values.size() / columns;
  py::dict out;
  for (std::size_t c = 0; c < columns; ++c) {
    out[py::str(log.columns[c])] =
        py::array_t<double>({rows}, {columns * sizeof(double)}, log.values.data() + c, self);
  }
  if (!log.states.empty()) out["state"] = py::module_::import("numpy").attr("array")(py::cast(log.states));
  return out;
}

/// The document of a command.
template <int (*command)(const RunOptions&)>
py::object document_of(const PyScene& s) {
  Capture c;
  (void)released(s, [o = s.options(c)] { return command(o); });
  return parsed(c.document);
}
py::object compare(const std::filesystem::path& a, const std::filesystem::path& b, double tolerance) {
  if (!std::isfinite(tolerance) || tolerance < 0.0) refuse("tolerance = {}: must be 0 or more", tolerance);
  Capture c;
  const CompareOptions o{
      .a = a.string(), .b = b.string(), .tolerance = tolerance, .out = "", .command_line = "", .capture = &c};
  (void)released([&] { return run_compare(o); });
  return parsed(c.document);
}

/// Lists of numbers become arrays, at every depth.
py::object arrays(const py::object& v) {
  if (py::isinstance<py::dict>(v)) {
    py::dict out;
    for (const auto& [key, value] : py::reinterpret_borrow<py::dict>(v))
      out[key] = arrays(py::reinterpret_borrow<py::object>(value));
    return out;
  }
  return py::isinstance<py::list>(v) ? py::object(py::module_::import("numpy").attr("array")(v)) : v;
}

py::object model(const PyScene& s, const py::object& given) {
  const py::dict state = dict_of(given, "state");
  std::string plain;
  try {
    const auto list = py::cpp_function([](const py::object& v) { return v.attr("tolist")(); });
    plain = py::module_::import("json")
                .attr("dumps")(state, py::arg("default") = list, py::arg("allow_nan") = false)
                .cast<std::string>();
  } catch (const py::error_already_set& e) {
    if (!e.matches(PyExc_Exception)) throw;
    const auto why = py::str(e.value()).cast<std::string>();
    refuse("state: a dict of finite numbers and arrays of them is needed ({})", why);
  }
  const std::string document = evaluate(model_case(s.scene, plain), "state", false);
  return arrays(parsed(document)["cases"][py::int_(0)]);
}

std::span<const double> span_of(const Array& a) { return {a.data(), static_cast<std::size_t>(a.size())}; }
Array array_of(const std::vector<double>& v) { return Array(static_cast<py::ssize_t>(v.size()), v.data()); }

template <std::vector<double> PythonTick::*member>
Array of_tick(const PythonTick& t) {
  return array_of(t.*member);
}
/// q or qd of a plant, or of its joints alone.
template <bool rates, bool joints>
Array coordinates(const PythonPlant& p) {
  std::vector<double> q, qd;
  p.output(q, qd);
  auto& v = rates ? qd : q;
  if (joints && v.size() == 6) v.erase(v.begin(), v.begin() + 2);
  return array_of(v);
}

/// Of the encoders of drives.
template <bool rates>
Array shafts(const PythonPlant& p) {
  return array_of(p.shafts(rates));
}

void define_scene(py::module_& m) {
  py::class_<PyScene>(m, "Scene", "A scene file and what is set on top of it.")
      .def_static(
          "load", &PyScene::load, py::arg("path"),
          "Reads a scene file (TOML), once; path: str or os.PathLike. Raises InputError with file, line and "
          "key.")
      .def("set", &PyScene::set, py::arg("key"), py::arg("value"),
           py::return_value_policy::reference_internal,
           "Sets a key as --set does, entries counted from 1. Raises InputError, and then changes nothing.")
      .def(
          "copy", [](const PyScene& s) { return s; }, "A scene of its own with the same settings.")
      .def_property_readonly(
          "toml", [](const PyScene& s) { return s.scene.toml; }, "The scene as it will run.")
      .def_property_readonly(
          "name", [](const PyScene& s) { return s.scene.name; }, "Of the scene.")
      .def_property_readonly(
          "duration", [](const PyScene& s) { return s.scene.duration; }, "Of a run, s.")
      .def_property_readonly(
          "tick", [](const PyScene& s) { return s.scene.tick(); }, "Sample time of the controller, s.")
      .def_property_readonly("joints", &PyScene::joints, "Names in the order of the model.")
      .def_property_readonly("motors", &PyScene::motors,
                             "Names of the joints with motors, in the order of torques.")
      .def("__repr__",
           [](const PyScene& s) {
             return readable(fmt::format("<esmc.Scene {:?} of ", s.scene.name) + s.file + ">");
           })
      .def(py::pickle(
          [](const PyScene& s) {
            return py::make_tuple(std::filesystem::path(s.file), py::bytes(s.text), s.sets);
          },
          [](const py::tuple& t) {
            using State = std::tuple<std::filesystem::path, std::string, std::vector<std::string>>;
            auto [file, text, sets] = t.cast<State>();
            return PyScene(file.string(), std::move(text), std::move(sets));
          }));
  py::class_<Run, std::shared_ptr<Run>>(m, "Run", "What a run left.")
      .def_readonly("summary", &Run::summary, "The document that --json prints, as a dict.")
      .def_property_readonly("log", &log_of<Run>,
                             "Columns of log.csv by name: arrays of shape (ticks,), views into the run. s, "
                             "m, rad, m/s, rad/s, N m.")
      .def_property_readonly(
          "digest", [](const Run& r) { return r.summary["digest"]; },
          "16 hex digits over q and qd at every tick, as the command prints it.")
      .def("__repr__", [](const Run& r) {
        return py::str("<esmc.Run of {!r}: {} ticks, digest {}>")
            .format(r.summary["scene"], r.summary["ticks"], r.summary["digest"]);
      });
  py::class_<Plan, std::shared_ptr<Plan>>(m, "Plan", "A timed program.")
      .def_readonly("summary", &Plan::summary,
                    "The document that `esmc plan --json` prints, as a dict: duration_s, limits_active, ...")
      .def_property_readonly("path", &log_of<Plan>,
                             "Columns of path.csv by name: arrays of shape (ticks + 1,), views into the "
                             "plan. s, m, rad, their derivatives, N m.");
}

void define_loop(py::module_& m) {
  py::class_<PythonTick>(m, "Tick", "Result of a controller's tick.")
      .def_property_readonly("torque", &of_tick<&PythonTick::torque>,
                             "N m at the joint, per motor, shape (motors,)")
      .def_property_readonly("s", &of_tick<&PythonTick::s>,
                             "Sliding variables, m/s or rad/s, shape (channels,)")
      .def_property_readonly("effector", &of_tick<&PythonTick::effector>, "Estimate, m, shape (2,)")
      .def_property_readonly("reference", &of_tick<&PythonTick::desired_effector>, "m, shape (2,)")
      .def_readonly("state", &PythonTick::state, "Of the supervisor: enabling, running, ...")
      .def_readonly("fault", &PythonTick::fault, "its name, or \"none\"")
      .def_readonly("saturated", &PythonTick::saturated, "whether a torque was at its limit")
      .def("__repr__", [](const PythonTick& t) {
        return fmt::format("<esmc.Tick {}, fault {}, torque [{}]>", t.state, t.fault,
                           fmt::join(t.torque, ", "));
      });
  py::class_<PythonController>(m, "Controller",
                               "The firmware's controller of a scene, enabled, without a bus.")
      .def(py::init([](const PyScene& s) { return make_python_controller(s.scene); }), py::arg("scene"))
      .def(
          "tick",
          [](PythonController& c, const py::object& angle, const py::object& rate,
             const std::string& command) {
            const Array angles = numbers(angle, "angle"), rates = numbers(rate, "rate");
            return c.tick(span_of(angles), span_of(rates), command);
          },
          py::arg("angle"), py::arg("rate"), py::arg("command") = "none",
          "One tick of the sample time. angle, rate: of all joints, shape (joints,), rad and rad/s; those "
          "without a sensor are not used. command: none, stop, halt, reset, or enable, which a controller "
          "needs after a stop or a reset.");
  py::class_<PythonPlant>(m, "Plant", "The true mechanism of a scene with its effects, without sensors.")
      .def(py::init([](const PyScene& s, std::uint64_t seed) {
             Scene seeded = s.scene;
             seeded.seed = seed;
             return make_python_plant(seeded);
           }),
           py::arg("scene"), py::arg("seed") = 1, "seed: of the jitter, as the result of a rollout has it.")
      .def(
          "step",
          [](PythonPlant& p, const py::object& torque) { p.step(span_of(numbers(torque, "torque"))); },
          py::arg("torque"), "Advances by one tick under torque, shape (motors,), N m at the joint.")
      .def_property_readonly("t", &PythonPlant::t, "Time since the start, s")
      .def_property_readonly("angle", &coordinates<false, true>, "Of all joints, rad, shape (joints,)")
      .def_property_readonly("rate", &coordinates<true, true>, "Of all joints, rad/s, shape (joints,)")
      .def_property_readonly("shaft_angle", &shafts<false>,
                             "What a drive's encoder would read, at each joint, rad, shape (joints,): the "
                             "joint's angle, or with "
                             "joint_flexibility or backlash that of its rotor.")
      .def_property_readonly("shaft_rate", &shafts<true>, "Likewise, rad/s, shape (joints,)")
      .def_property_readonly(
          "q", &coordinates<false, false>,
          "As final_state.q of a run: with a five-bar x and y, then the joints; m, rad, shape (coordinates,)")
      .def_property_readonly("qd", &coordinates<true, false>,
                             "As final_state.qd, m/s, rad/s, shape (coordinates,)")
      .def_property_readonly("energy", &PythonPlant::energy,
                             "kinetic and potential, J, of the bars, without gears' springs and rotors");
}

void raise(const py::handle& type, const std::string& text) {
  PyErr_SetObject(type.ptr(), readable(text).ptr());
}

void translate_errors(py::module_& m) {
  static py::exception<InputError> input(m, "InputError", PyExc_ValueError);
  static py::exception<RunError> failed(m, "RunError", PyExc_RuntimeError);
  input.doc() = "Bad input: file, line and key are in the text.";
  failed.doc() = "The input was fine, the run was not.";
  py::register_exception_translator([](std::exception_ptr p) {  // NOLINT(performance-unnecessary-value-param)
    try {
      if (p) std::rethrow_exception(p);
    } catch (const InputErrors& e) {
      raise(input, fmt::format("{}", fmt::join(e.lines(), "\n")));
    } catch (const InputError& e) {
      raise(input, e.what());
    } catch (const RunError& e) {
      raise(failed, e.what());
    } catch (const py::cast_error&) {  // of an entry of a list, tuple or dict
      input("an argument holds a value of the wrong type or size");
    }
  });
}

}  // namespace
}  // namespace esmc::host

// NOLINTNEXTLINE: pybind11's macro
PYBIND11_MODULE(esmc, m) {
  using namespace esmc::host;
  m.doc() =
      "Simulator, controller and batches of esmc: the RR arm and the 5R five-bar under sliding-mode control.";
  m.attr("__version__") = version;
  prepare_calls();
  translate_errors(m);
  define_scene(m);
  define_loop(m);
  define_batches(m);
  m.def("run", &run, py::arg("scene"), py::arg("mode") = "sim", py::arg("seed") = 1,
        "Runs a scene as `esmc sim` or `esmc hil` on the virtual bus does, with the same digest. seed: of "
        "noise, 0 or more.");
  m.def("plan", &plan, py::arg("scene"),
        "Times the program of a scene, reference.type = \"program\", as `esmc plan` does.");
  m.def("check", &document_of<run_check>, py::arg("scene"),
        "The document of `esmc check --json`, as a dict.");
  m.def("margins", &document_of<run_margins>, py::arg("scene"),
        "The document of `esmc margins --json`, as a dict.");
  m.def("compare", &compare, py::arg("a"), py::arg("b"), py::arg("tolerance") = 0.0,
        "The document of `esmc compare A B --json`, as a dict. a, b: directories of runs.");
  m.def("model", &model, py::arg("scene"), py::arg("state"),
        "The scene's mechanism as `esmc eval` has it, in SI units. [\"model\"] are arrays, with n "
        "coordinates (five-bar 18, arm 8): C (n, 2), A (n - 2, n), b (n - 2,), M_diag, g, f, bias (n,), H "
        "(2, 2), h (2,). With a five-bar also [\"state\"] and [\"singularity\"], with an arm "
        "[\"effector\"]. state: a mapping with theta and thetad (all joints, or the two base joints), or "
        "with a five-bar x, y, xd, yd; rad, m, s.");
}
