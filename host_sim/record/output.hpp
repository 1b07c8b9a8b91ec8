#pragma once
/// --out DIR: files are moved into place when the run is complete; a failed run leaves no partial result.

#include <cstdio>
#include <filesystem>
#include <functional>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

namespace esmc::host {

class Comparison;

/// Whether a run may leave a file of this name.
[[nodiscard]] bool is_output_name(const std::string& name);

class OutputDirectory {
 public:
  OutputDirectory() = default;
  /// Creates DIR if need be; "": no file is wanted. Throws InputError when it cannot be written, or has a
  /// file of an output's name that no earlier run has left.
  explicit OutputDirectory(const std::string& directory);
  /// Writes no file; compares the contents with those of a recording.
  explicit OutputDirectory(Comparison& against) : against_(&against) {}
  OutputDirectory(const OutputDirectory&) = delete;
  OutputDirectory& operator=(const OutputDirectory&) = delete;
  ~OutputDirectory();

  [[nodiscard]] bool wanted() const { return !final_.empty(); }  ///< files are written
  /// Temporary path of a file; empty when nothing is wanted.
  [[nodiscard]] std::string path(const std::string& name) const;
  /// Opens a file for writing; null when nothing is wanted. Throws InputError when it cannot be written.
  [[nodiscard]] std::FILE* open(const std::string& name) const;
  /// Writes a whole file; no effect when none is wanted. Throws RunError when the disk is full.
  void write(const std::string& name, const std::string& text) const;
  /// Throws InputError where an output of the run, other than `copy`, would replace the file `input`.
  void spare(const std::string& input, const std::string& copy = "") const;
  /// Moves all files into place and removes those of an earlier run, or changes nothing and throws RunError.
  void commit();
  [[nodiscard]] std::string directory() const { return final_.string(); }  ///< DIR; "": none

 private:
  void take_back() const;

  std::filesystem::path final_, partial_;
  Comparison* against_ = nullptr;
  std::vector<std::filesystem::path> created_;  ///< folders that did not exist, outermost first
  std::unique_ptr<const std::vector<std::string>> unfinished_;  ///< what std::quick_exit removes, in order
};

/// A JSON document as commands print and write it: `schema`, the version of its keys, comes first; text that
/// is no UTF-8, as names of files may be, is replaced. Ends with a line end.
std::string document_text(const nlohmann::ordered_json& document, int indent = 2);

/// What a study found.
struct StudyOutput {
  std::string name;                        ///< in `out`: NAME.json
  const nlohmann::ordered_json& document;  ///< what --json prints
  std::string text;                        ///< what is printed without
  std::function<std::string()> page;       ///< report.html; called where files are wanted
};
/// The end of every study: its files into place, then its document with `json`, else its text.
void publish(const StudyOutput& s, bool json, OutputDirectory& out);

/// Prints `text`, or writes it to `file` if that is not empty: completely or not at all. Throws InputError.
void print_or_write(const std::string& text, const std::string& file);

}  // namespace esmc::host
