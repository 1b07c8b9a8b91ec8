#pragma once
/// A finished case, and values as bytes: for the journal, and for messages between processes. Both sides have
/// the same machine architecture.

#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

#include "host_sim/error.hpp"

namespace esmc::host {

struct Finished {
  std::uint64_t index = 0;     ///< of the case
  std::uint32_t outcome = 0;   ///< see runner.hpp
  std::vector<double> values;  ///< one per objective
};

template <class T>
void put(std::string& out, const T& v) {
  const std::size_t at = out.size();
  out.resize(at + sizeof(T));
  std::memcpy(out.data() + at, &v, sizeof(T));
}
inline void put(std::string& out, const Finished& f) {
  put(out, f.index);
  put(out, f.outcome);
  for (const double v : f.values) put(out, v);
}

/// Reads from `at` on what `put` wrote. Throws RunError where the bytes end too early.
template <class T>
T take(const std::string& in, std::size_t& at) {
  T v{};
  if (at + sizeof(T) > in.size()) throw RunError("a message of another process is too short");
  std::memcpy(&v, in.data() + at, sizeof(T));
  at += sizeof(T);
  return v;
}
inline Finished take_finished(const std::string& in, std::size_t& at, std::size_t values) {
  Finished f;
  f.index = take<std::uint64_t>(in, at);
  f.outcome = take<std::uint32_t>(in, at);
  for (std::size_t i = 0; i < values; ++i) f.values.push_back(take<double>(in, at));
  return f;
}

}  // namespace esmc::host
