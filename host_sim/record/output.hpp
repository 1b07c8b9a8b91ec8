#pragma once
/// --out DIR: everything is written beside DIR's final names and moved into place when the run is complete,
/// so that a failed run leaves nothing partial behind.

#include <cstdio>
#include <filesystem>
#include <string>
#include <vector>

namespace esmc::host {

class Comparison;

class OutputDirectory {
 public:
  OutputDirectory() = default;
  /// Creates DIR if need be. Throws InputError when it cannot be written.
  explicit OutputDirectory(const std::string& directory);
  /// Nothing is written; what a run would write is compared.
  explicit OutputDirectory(Comparison& against) : against_(&against) {}
  OutputDirectory(const OutputDirectory&) = delete;
  OutputDirectory& operator=(const OutputDirectory&) = delete;
  ~OutputDirectory();

  [[nodiscard]] bool wanted() const { return !final_.empty(); }
  /// Path to write a file under for now; empty when nothing is wanted.
  [[nodiscard]] std::string path(const std::string& name) const;
  /// The same, open; null when nothing is wanted. Throws InputError when it cannot be written.
  [[nodiscard]] std::FILE* open(const std::string& name) const;
  void write(const std::string& name, const std::string& text) const;
  /// Throws InputError where a file of the run would replace this one, or take it away; but for `copy`, which
  /// is the same.
  void spare(const std::string& input, const std::string& copy = "") const;
  /// Moves everything into place, or nothing: what stood there comes back when one of the files cannot be
  /// replaced.
  void commit();
  [[nodiscard]] std::string directory() const { return final_.string(); }

 private:
  void take_back() const;

  std::filesystem::path final_, partial_;
  Comparison* against_ = nullptr;
  std::vector<std::filesystem::path> created_;  ///< folders that did not exist, outermost first
};

/// Prints `text`, or makes it the content of `file` if that is not empty: all of it or nothing. Throws
/// InputError when the file cannot be written.
void print_or_write(const std::string& text, const std::string& file);

}  // namespace esmc::host
