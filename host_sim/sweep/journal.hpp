#pragma once
/// The finished cases of a sweep in a file that only grows, so that a killed sweep goes on where it was.
///
/// A head that says whose journal it is, then records of one size, each with a CRC-32 of its own. What a kill
/// or a full disk has left half-written at the end is cut off when the file is opened again.

#include <cstdint>
#include <string>
#include <vector>

namespace esmc::host {

/// What a case came to. `outcome`: see CaseOutcome; `values`: one per objective.
struct Finished {
  std::uint64_t index = 0;
  std::uint32_t outcome = 0;
  std::vector<double> values;
};

class Journal {
 public:
  /// Opens or creates FILE and takes hold of it: a second process that tries gets an error. `columns`:
  /// objectives. `identity`: of everything that decides a result. Throws InputError where the file is another
  /// sweep's, in use or cannot be written. `restart`: whatever stood there is thrown away first.
  Journal(const std::string& file, std::uint64_t identity, std::uint64_t cases, std::size_t columns,
          bool restart = false);
  Journal(const Journal&) = delete;
  Journal& operator=(const Journal&) = delete;
  ~Journal();

  /// What stood there when it was opened; every index once.
  [[nodiscard]] const std::vector<Finished>& found() const { return found_; }
  /// In one piece. Throws RunError where the disk is full; what was written before stays.
  void append(const std::vector<Finished>& cases);
  /// The sweep is complete and its files are in place.
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

/// Of the program that is running: another build may differ in the last bit. 0 where it cannot be read.
[[nodiscard]] std::uint64_t program_hash();

}  // namespace esmc::host
