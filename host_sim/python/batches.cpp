/// rollout and sweep of the Python module.

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>

#include "host_sim/python/module.hpp"
#include "host_sim/python/rollout.hpp"
#include "host_sim/sweep/sweep.hpp"

namespace esmc::host {
namespace {

/// None in the processes that mpirun has started beside the first one.
py::object sweep(const std::filesystem::path& spec, const std::filesystem::path& out, int threads,
                 bool restart) {
  if (threads < 0 || threads > 4096) refuse("threads = {}: 0 (all processors) to 4096", threads);
  Capture c;
  SweepOptions o;
  o.spec = spec.string();
  o.out = out.string();
  o.command_line = "esmc.sweep";
  o.jobs = threads;
  o.json = true;
  o.restart = restart;
  o.capture = &c;
  (void)released([&] { return run_sweep(o); });
  return c.document.empty() ? py::object(py::none()) : parsed(c.document);
}

double finite(const std::string& key, const py::handle& v) {
  const double number = PyFloat_AsDouble(v.ptr());
  if (PyErr_Occurred() != nullptr || !std::isfinite(number)) {
    PyErr_Clear();
    refuse("parameters['{}']: values are finite numbers, bools or strings", key);
  }
  return number;
}

SweepValue sweep_value(const std::string& key, const py::handle& v) {
  if (py::isinstance<py::bool_>(v)) return v.cast<bool>();
  if (py::isinstance<py::int_>(v)) return v.cast<std::int64_t>();
  if (py::isinstance<py::str>(v)) return v.cast<std::string>();
  return finite(key, v);
}

std::vector<Objective> objectives_of(const std::vector<std::string>& names) {
  std::vector<Objective> out;
  for (std::size_t i = 0; i < objective_count; ++i) {
    const auto o = static_cast<Objective>(i);
    if (names.empty() ? o != Objective::tick_ns
                      : std::ranges::count(names, std::string(objectives[i].name)) > 0)
      out.push_back(o);
  }
  for (const std::string& n : names) {
    if (std::ranges::none_of(objectives, [&](const ObjectiveText& o) { return o.name == n; }))
      refuse("objectives: there is no '{}'", n);
  }
  return out;
}

RolloutParameter parameter_of(const std::string& key, const py::handle& v) {
  RolloutParameter out{key, {}};
  if (py::isinstance<py::tuple>(v)) {
    const auto pair = py::reinterpret_borrow<py::tuple>(v);
    if (pair.size() != 2) refuse("parameters['{}']: a range is a tuple (from, to)", key);
    const std::pair range(finite(key, pair[0]), finite(key, pair[1]));
    if (range.first > range.second) refuse("parameters['{}']: a range needs from <= to", key);
    out.values = range;
    return out;
  }
  py::object list = py::hasattr(v, "tolist") ? v.attr("tolist")() : py::reinterpret_borrow<py::object>(v);
  const bool text = py::isinstance<py::str>(list) || py::isinstance<py::bytes>(list);
  if (!text && py::isinstance(list, py::module_::import("collections.abc").attr("Sequence")))
    list = py::list(list);
  if (!py::isinstance<py::list>(list))
    refuse("parameters['{}']: a range (from, to), or a list or array with a value per case", key);
  std::vector<SweepValue> values;
  for (const auto& item : list) values.push_back(sweep_value(key, item));
  out.values = std::move(values);
  return out;
}

/// The torques of driven cases into the request. Returns the array, which must live as long as that.
Array torques_of(const PyScene& s, const py::object& torques, std::uint32_t every, RolloutRequest& r,
                 std::optional<std::uint64_t>& n) {
  const Array out = numbers(torques, "torques", 3);
  const std::size_t motors = s.scene.motor_joints().size();
  if (out.size() == 0 || static_cast<std::size_t>(out.shape(2)) != motors ||
      out.shape(1) > std::numeric_limits<std::uint32_t>::max())
    refuse("torques: an array of shape (cases, ticks, {}) is needed, N m", motors);
  if (n && *n != static_cast<std::uint64_t>(out.shape(0)))
    refuse("torques: {} cases, n = {}", out.shape(0), *n);
  r.torque = {out.data(), static_cast<std::size_t>(out.size())};
  if (!std::ranges::all_of(r.torque, [](double v) { return std::isfinite(v); }))
    refuse("torques: must be finite");
  if (s.scene.accuracy) refuse("torques: simulation.accuracy is for whole runs");
  n = static_cast<std::uint64_t>(out.shape(0));
  r.ticks = static_cast<std::uint32_t>(out.shape(1));
  r.every = every;
  return out;
}

/// q and qd of driven cases: (cases, coordinates), or with `every` (cases, rows, coordinates).
void add_states(const RolloutRequest& r, RolloutResult&& result, py::dict& out) {
  const auto kept = std::make_unique<std::vector<double>>(std::move(result.states)).release();
  const py::capsule owner(kept, [](void* p) { delete static_cast<std::vector<double>*>(p); });
  const std::size_t row = 2 * result.coordinates * sizeof(double);
  for (const bool rates : {false, true}) {
    std::vector<std::size_t> shape{r.cases, result.rows, result.coordinates},
        strides{result.rows * row, row, sizeof(double)};
    if (r.every == 0) {
      shape.erase(shape.begin() + 1);
      strides.erase(strides.begin() + 1);
    }
    out[rates ? "qd" : "q"] =
        py::array_t<double>(shape, strides, kept->data() + (rates ? result.coordinates : 0), owner);
  }
}

py::dict rollout(const PyScene& s, const py::object& parameters, std::optional<std::uint64_t> n,
                 std::uint64_t seed, int threads, const std::vector<std::string>& wanted,
                 const py::object& torques, std::uint32_t every) {
  RolloutRequest r{.scene = s.file,
                   .sets = s.sets,
                   .parameters = {},
                   .seed = seed,
                   .threads = threads,
                   .objectives = {},
                   .torque = {},
                   .ticks = 0,
                   .every = 0};
  const bool driven = !torques.is_none();
  if (driven && !wanted.empty()) refuse("torques: there are no objectives, the result has q and qd");
  if (!driven && every != 0) refuse("every: is of runs with torques");
  if (!driven) r.objectives = objectives_of(wanted);
  const Array given = driven ? torques_of(s, torques, every, r, n) : Array();
  for (const auto& [key, value] : dict_of(parameters, "parameters"))
    r.parameters.push_back(parameter_of(py::str(key).cast<std::string>(), value));
  for (const RolloutParameter& p : r.parameters) {
    if (const auto* values = std::get_if<1>(&p.values); values != nullptr && !n) n = values->size();
  }
  r.cases = n.value_or(1);
  RolloutResult result = released(s, [&] { return driven ? run_driven(r) : run_rollout(r); });
  const auto numpy = py::module_::import("numpy");
  py::dict out;
  for (std::size_t a = 0; a < r.parameters.size(); ++a)
    out[py::str(r.parameters[a].key)] = numpy.attr("array")(py::cast(result.parameters[a]));
  const std::size_t columns = r.objectives.size();
  for (std::size_t c = 0; c < columns; ++c) {
    py::array_t<double> column(static_cast<py::ssize_t>(r.cases));
    auto to = column.mutable_unchecked<1>();
    for (std::size_t i = 0; i < r.cases; ++i)
      to(static_cast<py::ssize_t>(i)) = result.objectives[i * columns + c];
    out[py::str(std::string(objectives[static_cast<std::size_t>(r.objectives[c])].name))] = column;
  }
  out["outcome"] = numpy.attr("array")(py::cast(result.outcomes));
  out["seed"] = py::array_t<std::uint64_t>(static_cast<py::ssize_t>(r.cases), result.seeds.data());
  if (driven) add_states(r, std::move(result), out);
  return out;
}

}  // namespace

void define_batches(py::module_& m) {
  m.def("rollout", &rollout, py::arg("scene"), py::arg("parameters"), py::arg("n") = py::none(),
        py::arg("seed") = 1, py::arg("threads") = 0, py::arg("objectives") = std::vector<std::string>{},
        py::arg("torques") = py::none(), py::arg("every") = 0,
        "n runs on all cores. parameters: {key: (from, to)} samples a range by latin hypercube, {key: list "
        "or array} gives each case its value; keys as in a sweep. Returns arrays of shape (n,): parameters, "
        "objectives (_m, _rad, _nm: m, rad, N m), outcome, seed (with which run repeats the case). torques, "
        "shape (n, ticks, motors), N m at the joints: the true mechanism under these, each held for a tick, "
        "without controller. Then the result has q and qd at the end, shape (n, coordinates) as in "
        "final_state, or with every = k at each k-th tick from the start on and at the end, shape (n, rows, "
        "coordinates).");
  m.def("sweep", &sweep, py::arg("spec"), py::arg("out") = "", py::arg("threads") = 0,
        py::arg("restart") = false,
        "Runs the specification of a sweep as `esmc sweep SPEC --out OUT` does, and goes on with one that "
        "was interrupted there or here. Returns summary.json as a dict; under mpirun None but in the first "
        "process.");
}

}  // namespace esmc::host
