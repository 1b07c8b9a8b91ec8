#pragma once
/// --out DIR: files are moved into place when the run is complete; a failed run leaves no partial result.

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
  /// Writes nothing; the files are compared.
  explicit OutputDirectory(Comparison& against) : against_(&against) {}
  OutputDirectory(const OutputDirectory&) = delete;
  OutputDirectory& operator=(const OutputDirectory&) = delete;
  ~OutputDirectory();

  [[nodiscard]] bool wanted() const { return !final_.empty(); }
  /// Temporary path of a file; empty when nothing is wanted.
  [[nodiscard]] std::string path(const std::string& name) const;
  /// The file, open; null when nothing is wanted. Throws InputError when it cannot be written.
  [[nodiscard]] std::FILE* open(const std::string& name) const;
  void write(const std::string& name, const std::string& text) const;
  /// Throws InputError where a file of the run, other than `copy`, would replace this one.
  void spare(const std::string& input, const std::string& copy = "") const;
  /// Moves all files into place or, when one cannot be replaced, none. Throws RunError.
  void commit();
  [[nodiscard]] std::string directory() const { return final_.string(); }

 private:
  void take_back() const;

  std::filesystem::path final_, partial_;
  Comparison* against_ = nullptr;
  std::vector<std::filesystem::path> created_;  ///< folders that did not exist, outermost first
};

/// Prints `text`, or writes it to `file` if that is not empty: completely or not at all. Throws InputError.
void print_or_write(const std::string& text, const std::string& file);

}  // namespace esmc::host
