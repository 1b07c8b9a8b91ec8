/// What values of Python become, and texts for it.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "host_sim/python/module.hpp"

namespace esmc::host {
namespace {

std::string quoted(const std::string& text) {
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') out += '\\';
    out +=
        static_cast<unsigned char>(c) < 0x20U || c == 0x7F ? fmt::format("\\u{:04X}", c) : std::string(1, c);
  }
  return out + "\"";
}

}  // namespace

std::string toml_of(const std::string& key, const py::handle& v, int depth) {
  if (depth > 16) refuse("{}: the value is nested too deeply", key);
  if (py::isinstance<py::bool_>(v)) return v.cast<bool>() ? "true" : "false";
  if (py::isinstance<py::str>(v)) return quoted(v.cast<std::string>());
  if (py::isinstance<py::int_>(v)) return py::str(v).cast<std::string>();
  if (py::isinstance<py::dict>(v)) {
    std::string out;
    for (const auto& [name, value] : py::reinterpret_borrow<py::dict>(v))
      out += (out.empty() ? "" : ", ") + quoted(py::str(name).cast<std::string>()) + " = " +
             toml_of(key, value, depth + 1);
    return "{" + out + "}";
  }
  if (py::hasattr(v, "tolist")) return toml_of(key, v.attr("tolist")(), depth + 1);  // of numpy
  if (py::isinstance<py::list>(v) || py::isinstance<py::tuple>(v)) {
    std::string out;
    for (const auto& item : v) out += (out.empty() ? "" : ", ") + toml_of(key, item, depth + 1);
    return "[" + out + "]";
  }
  if (!py::isinstance<py::float_>(v))
    throw py::type_error(key + ": a scene takes bool, int, float, str, lists and dicts of them, not " +
                         py::str(py::type::of(v)).cast<std::string>());
  const auto number = v.cast<double>();
  if (!std::isfinite(number)) refuse("{}: a scene takes finite numbers only", key);
  const std::string text = fmt::format("{}", number);
  return text.find_first_of(".e") == std::string::npos ? text + ".0" : text;
}

namespace {

/// Whether the command line would take it without quotes.
bool is_plain(std::string_view key) {
  return std::ranges::all_of(key, [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == '.';
  });
}
bool lies_in(std::string_view key, std::string_view table) {
  return key.size() > table.size() && key.starts_with(table) && key[table.size()] == '.';
}

/// Of what a conversion raised, unless it is no error of the argument.
std::string reason(const py::error_already_set& e) {
  if (!e.matches(PyExc_Exception)) throw py::error_already_set(e);
  return py::str(e.value()).cast<std::string>();
}

}  // namespace

void put_set(std::vector<std::string>& sets, const std::string& key, const std::string& value) {
  const std::string set = key + "=" + value;
  std::vector<std::string> kept;  // of those after the former set, in reverse
  // Tables merge, and a type takes keys of the file with it: what they find matters.
  bool whole = is_plain(key) && !value.starts_with('{') && !key.ends_with("type");
  for (std::size_t i = sets.size(); whole && i-- > 0;) {
    const std::string_view other(sets[i].data(), sets[i].find('='));
    if (other == key && !sets[i].substr(key.size() + 1).starts_with('{')) {
      sets.resize(i);
      sets.push_back(set);
      sets.insert(sets.end(), kept.rbegin(), kept.rend());
      return;
    }
    // The first entry of `legs` that is set makes two legs of the `leg` of its time, and `leg` is then of
    // both.
    const bool of_legs = other.starts_with("mechanism.legs") ||
                         (key.starts_with("mechanism.legs") && other.starts_with("mechanism.leg"));
    whole = is_plain(other) && other != key && !lies_in(key, other) && !of_legs;
    if (!lies_in(other, key)) kept.push_back(sets[i]);
  }
  sets.push_back(set);
}

py::str readable(const std::string& text) {
  PyObject* const out =
      PyUnicode_DecodeUTF8(text.data(), static_cast<py::ssize_t>(text.size()), "backslashreplace");
  if (out == nullptr) throw py::error_already_set();
  return py::reinterpret_steal<py::str>(out);
}

Array numbers(const py::object& v, const char* what, int dimensions) {
  const bool plain = Py_TYPE(v.ptr()) == py::detail::npy_api::get().PyArray_Type_;
  Array out;
  if (plain && py::isinstance<Array>(v)) {
    out = py::reinterpret_borrow<Array>(v);
  } else {
    try {
      const auto numpy = py::module_::import("numpy");
      const py::array any = numpy.attr("asarray")(v);
      const char kind = any.dtype().kind();
      if (std::string_view("biufO").find(kind) == std::string_view::npos ||
          py::isinstance(v, numpy.attr("ma").attr("MaskedArray")))
        refuse("{}: an array of real numbers is needed", what);
      if (kind == 'O') {  // of which numpy would also take texts
        for (const auto& item : any.attr("flat")) {
          if (PyFloat_AsDouble(item.ptr()) == -1.0 && PyErr_Occurred() != nullptr)
            throw py::error_already_set();
        }
      }
      out = any.attr("astype")("d");
    } catch (const py::error_already_set& e) {
      refuse("{}: an array of real numbers is needed ({})", what, reason(e));
    }
  }
  if (out.ndim() != dimensions)
    refuse("{}: an array of {} dimension{} is needed, this one has {}", what, dimensions,
           dimensions == 1 ? "" : "s", out.ndim());
  return out;
}

py::dict dict_of(const py::object& v, const char* what) {
  if (py::isinstance<py::dict>(v)) return py::reinterpret_borrow<py::dict>(v);
  if (!py::isinstance(v, py::module_::import("collections.abc").attr("Mapping")))
    throw py::type_error(fmt::format("{}: a dict or another mapping is needed", what));
  return py::dict(v);
}

}  // namespace esmc::host
