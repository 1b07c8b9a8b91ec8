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

void require_threads(int threads) {
  if (threads < 0 || threads > 4096) refuse("threads = {}: 0 (all processors) to 4096", threads);
}

/// None in the processes that mpirun has started beside the first one.
py::object sweep(const std::filesystem::path& spec, const std::filesystem::path& out, int threads,
                 bool restart) {
  require_threads(threads);
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
  if (py::hasattr(v, "tolist")) return sweep_value(key, v.attr("tolist")());  // a scalar of numpy
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

/// What a key goes through: a tuple is a range that is sampled, a list has a value per case.
std::pair<Vary, Axis> parameter_of(const std::string& key, const py::handle& v) {
  Vary vary{.key = key, .where = "parameters['" + key + "']", .values = {}};
  Axis axis;
  if (py::isinstance<py::tuple>(v)) {
    const auto pair = py::reinterpret_borrow<py::tuple>(v);
    if (pair.size() != 2) refuse("{}: a range is a tuple (from, to)", vary.where);
    axis.from = finite(key, pair[0]);
    axis.to = finite(key, pair[1]);
    if (axis.from > axis.to) refuse("{}: a range needs from <= to", vary.where);
    return {std::move(vary), axis};
  }
  py::object list = py::hasattr(v, "tolist") ? v.attr("tolist")() : py::reinterpret_borrow<py::object>(v);
  const bool text = py::isinstance<py::str>(list) || py::isinstance<py::bytes>(list);
  if (!text && py::isinstance(list, py::module_::import("collections.abc").attr("Sequence")))
    list = py::list(list);
  if (!py::isinstance<py::list>(list))
    refuse("{}: a range (from, to), or a list or array with a value per case", vary.where);
  for (const auto& item : list) vary.values.push_back(sweep_value(key, item));
  axis.listed = vary.values.size();
  axis.in_order = true;
  return {std::move(vary), axis};
}

/// The design of `spec`, whose keys and seed are set: `n` cases, or as many as the first list has values.
Design design_of(const SweepSpec& spec, std::vector<Axis> axes, std::optional<std::uint64_t> n) {
  for (const Axis& a : axes) {
    if (a.in_order && !n) n = a.listed;
  }
  const std::uint64_t cases = n.value_or(1);
  if (cases == 0 || cases > Design::most_cases) refuse("n = {}: 1 to {}", cases, Design::most_cases);
  for (std::size_t i = 0; i < axes.size(); ++i) {
    if (axes[i].in_order && axes[i].listed != cases)
      refuse("{}: {} values for {} cases", spec.vary[i].where, axes[i].listed, cases);
  }
  return {Sampling::latin_hypercube, cases, spec.seed, std::move(axes)};
}

/// The torques of driven cases into `given`. Returns the array, which must live as long as that.
Array torques_of(const PyScene& s, const py::object& torques, GivenTorques& given,
                 std::optional<std::uint64_t>& n) {
  const Array out = numbers(torques, "torques", 3);
  const std::size_t motors = s.scene.motor_joints().size();
  if (out.size() == 0 || static_cast<std::size_t>(out.shape(2)) != motors ||
      out.shape(1) > std::numeric_limits<std::uint32_t>::max())
    refuse("torques: an array of shape (cases, ticks, {}) is needed, N m", motors);
  if (n && *n != static_cast<std::uint64_t>(out.shape(0)))
    refuse("torques: {} cases, n = {}", out.shape(0), *n);
  given.torque = {out.data(), static_cast<std::size_t>(out.size())};
  if (!std::ranges::all_of(given.torque, [](double v) { return std::isfinite(v); }))
    refuse("torques: must be finite");
  if (s.scene.accuracy) refuse("torques: simulation.accuracy is for whole runs");
  n = static_cast<std::uint64_t>(out.shape(0));
  given.ticks = static_cast<std::uint32_t>(out.shape(1));
  return out;
}

/// q and qd of driven cases: (cases, coordinates), or with `every` (cases, rows, coordinates).
void add_states(bool every, RolloutResult&& result, py::dict& out) {
  const auto kept = std::make_unique<std::vector<double>>(std::move(result.states)).release();
  const py::capsule owner(kept, [](void* p) { delete static_cast<std::vector<double>*>(p); });
  const std::size_t row = 2 * result.coordinates * sizeof(double);
  for (const bool rates : {false, true}) {
    std::vector<std::size_t> shape{result.outcomes.size(), result.rows, result.coordinates},
        strides{result.rows * row, row, sizeof(double)};
    if (!every) {
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
  SweepSpec spec;
  spec.file = spec.scene = s.file;
  spec.sets = s.sets;
  spec.seed = seed;
  GivenTorques given{.every = every};
  const bool driven = !torques.is_none();
  if (driven && !wanted.empty()) refuse("torques: there are no objectives, the result has q and qd");
  if (!driven && every != 0) refuse("every: is of runs with torques");
  if (!driven) spec.wanted = objectives_of(wanted);
  const Array kept = driven ? torques_of(s, torques, given, n) : Array();
  std::vector<Axis> axes;
  for (const auto& [key, value] : dict_of(parameters, "parameters")) {
    auto [vary, axis] = parameter_of(py::str(key).cast<std::string>(), value);
    spec.vary.push_back(std::move(vary));
    axes.push_back(axis);
  }
  spec.design = design_of(spec, std::move(axes), n);
  require_threads(threads);
  RolloutResult result =
      released(s, [&] { return driven ? run_driven(spec, threads, given) : run_rollout(spec, threads); });
  const auto numpy = py::module_::import("numpy");
  py::dict out;
  for (std::size_t a = 0; a < spec.vary.size(); ++a)
    out[py::str(spec.vary[a].key)] = numpy.attr("array")(py::cast(result.parameters[a]));
  const std::size_t columns = spec.wanted.size(), cases = result.outcomes.size();
  for (std::size_t c = 0; c < columns; ++c) {
    py::array_t<double> column(static_cast<py::ssize_t>(cases));
    auto to = column.mutable_unchecked<1>();
    for (std::size_t i = 0; i < cases; ++i)
      to(static_cast<py::ssize_t>(i)) = result.objectives[i * columns + c];
    out[py::str(std::string(objectives[static_cast<std::size_t>(spec.wanted[c])].name))] = column;
  }
  out["outcome"] = numpy.attr("array")(py::cast(result.outcomes));
  out["seed"] = py::array_t<std::uint64_t>(static_cast<py::ssize_t>(cases), result.seeds.data());
  if (driven) add_states(every != 0, std::move(result), out);
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
