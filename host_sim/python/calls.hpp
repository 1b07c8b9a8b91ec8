#pragma once
/// Work without the interpreter's lock.

#include <pybind11/pybind11.h>

namespace esmc::host {

/// Without the interpreter's lock, one at a time: a flag of the process tells the work to stop.
///
/// The module has no handler of signals. In the main thread the work lets Python's own run now and then, and
/// ends if one of them raises; as in Python, other threads hear nothing of signals.
class Turn {
 public:
  Turn();  ///< waits for the turn
  Turn(const Turn&) = delete;
  Turn& operator=(const Turn&) = delete;
  ~Turn();

 private:
  static void hear();
};

/// f() without the interpreter's lock. It must not refer to what other threads of Python can change.
template <class F>
auto released(const F& f) {
  const auto run = [&] {
    const Turn turn;
    return f();
  };
  const auto raise = [] {
    if (PyErr_Occurred() != nullptr) throw pybind11::error_already_set();
  };
  try {
    auto out = run();
    raise();
    return out;
  } catch (...) {
    raise();
    throw;
  }
}

/// Once, by the module: calls end before the interpreter does, and the child of a fork has none.
void prepare_calls();

}  // namespace esmc::host
