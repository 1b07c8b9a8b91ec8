#include "host_sim/python/calls.hpp"

#include <cxxabi.h>
#include <pthread.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cstdint>
#include <ctime>
#include <mutex>
#include <new>

#include "host_sim/error.hpp"
#include "host_sim/stop.hpp"

namespace esmc::host {
namespace {

namespace py = pybind11;
constexpr std::chrono::milliseconds patience{50};  // longest delay after Ctrl-C

/// Of the process.
struct Calls {
  std::timed_mutex running;
  std::atomic<pthread_t> owner{}, main{};  ///< thread whose turn it is, 0: none; Python's main thread
  std::atomic<bool> ending{false};         ///< the interpreter
};
Calls& calls() {
  static Calls all;
  return all;
}

thread_local PyThreadState* state = nullptr;  // of a call, while it is without the lock
thread_local std::int64_t heard_ms = 0;

/// A daemon thread at the end of the interpreter: it sleeps until the process is gone.
[[noreturn]] void freeze() {
  for (;;) ::pause();
}

void lock_again() {
  try {
    PyEval_RestoreThread(state);
  } catch (const abi::__forced_unwind&) {  // there is no interpreter; what this stack holds needs its lock
    freeze();
  }
}

/// Until nothing else is at work.
void wait_for_turn() {
  bool mine = calls().running.try_lock();
  while (!mine) {
    if (PyErr_CheckSignals() != 0) throw py::error_already_set();
    state = PyEval_SaveThread();
    mine = calls().running.try_lock_for(patience);
    lock_again();
  }
  calls().owner = ::pthread_self();
}
void give_up_turn() {
  calls().owner = 0;
  calls().running.unlock();
}

/// Coarse, because it is asked at every tick.
std::int64_t now_ms() {
  timespec t{};
  ::clock_gettime(CLOCK_MONOTONIC_COARSE, &t);
  return std::int64_t{t.tv_sec} * 1000 + t.tv_nsec / 1'000'000;
}

}  // namespace

Turn::Turn() {
  if (calls().owner == ::pthread_self())
    throw RunError("esmc is at work in this thread, or the interpreter ends: it takes no call of a handler");
  wait_for_turn();
  stop_requested() = false;
  heard_ms = now_ms();
  before_stop_check = &hear;
  state = PyEval_SaveThread();
}

Turn::~Turn() {
  before_stop_check = nullptr;
  give_up_turn();
  if (calls().ending) freeze();
  lock_again();
}

void Turn::hear() {
  const std::int64_t now = now_ms();
  if (now - heard_ms < patience.count()) return;
  heard_ms = now;
  before_stop_check = nullptr;
  if (calls().ending) {
    stop_requested() = true;
  } else if (calls().main == ::pthread_self()) {
    lock_again();
    if (PyErr_Occurred() == nullptr && PyErr_CheckSignals() != 0) stop_requested() = true;
    state = PyEval_SaveThread();
  }
  before_stop_check = &hear;
}

void prepare_calls() {
  calls().main = py::module_::import("threading").attr("main_thread")().attr("ident").cast<std::uintptr_t>();
  // As long as anything works, what it uses must not be destroyed. The turn is never given back.
  py::module_::import("atexit").attr("register")(py::cpp_function([] {
    calls().ending = true;
    wait_for_turn();
  }));
  ::pthread_atfork(nullptr, nullptr, [] {
    calls().main = ::pthread_self();
    if (calls().owner == ::pthread_self()) return;
    calls().owner = 0;  // the threads of the others are not in the child
    new (&calls().running) std::timed_mutex;
  });
}

}  // namespace esmc::host
