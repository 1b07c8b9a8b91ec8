#pragma once
/// The finished cases of a sweep in a file that only grows, so that a killed sweep can be continued.
///
/// A head with the sweep's identity, then records of one size, each with its CRC-32. A record that a kill or
/// a full disk has cut short is removed when the file is opened again.

#include <cstdint>
#include <string>
#include <vector>

#include "host_sim/sweep/finished.hpp"

namespace esmc::host {

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

  std::string file_;
  std::uint64_t cases_;
  std::size_t objectives_;
  int descriptor_ = -1;
  std::vector<Finished> found_;
};

/// Hash of the running program, as another build may differ in the last bit. 0 where it cannot be read.
[[nodiscard]] std::uint64_t program_hash();

}  // namespace esmc::host
