#pragma once
/// The finished cases of a sweep in a file that only grows, so that a killed sweep can be continued.
///
/// A head with the sweep's identity, then records of one size, each with its CRC-32. A record that a kill or
/// a full disk has cut short is removed when the file is opened again.

#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

#include "host_sim/error.hpp"

namespace esmc::host {

/// A finished case.
struct Finished {
  std::uint64_t index = 0;     ///< of the case
  std::uint32_t outcome = 0;   ///< see runner.hpp
  std::vector<double> values;  ///< one per objective
};

/// Values as bytes: for the journal, and for messages between processes of the same machine architecture.
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

class Journal {
 public:
  /// Opens or creates FILE and locks it. `columns`: objectives. `identity`: hash of everything that decides a
  /// result. `restart`: earlier records are removed. Throws InputError where the file is another sweep's, in
  /// use or cannot be written.
  Journal(const std::string& file, std::uint64_t identity, std::uint64_t cases, std::size_t columns,
          bool restart = false);
  Journal(const Journal&) = delete;
  Journal& operator=(const Journal&) = delete;
  ~Journal();

  /// The records at opening; every index once.
  [[nodiscard]] const std::vector<Finished>& found() const { return found_; }
  /// Writes finished cases in one piece. Throws RunError where the disk is full; earlier records stay.
  void append(const std::vector<Finished>& cases);
  /// Deletes the file; call when the sweep is complete and its files are in place.
  void remove();

 private:
  [[nodiscard]] std::size_t record_size() const;
  void read_back();
  [[noreturn]] void refuse(const std::string& why);
  [[noreturn]] void refuse_unwritable();

  std::string file_;
  std::uint64_t cases_;
  std::size_t objectives_;
  int descriptor_ = -1;
  std::vector<Finished> found_;
};

/// Hash of the archives that compute, the same in the command and in the Python module: another build may
/// differ in the last bit. The build makes it.
extern const char* const program_hash;

}  // namespace esmc::host
