#pragma once
/// `esmc compare`: two runs side by side.

#include <string>

namespace esmc::host {

struct Capture;

struct CompareOptions {
  std::string a, b;        ///< directories of runs
  double tolerance = 0.0;  ///< times max(1, the larger magnitude of two numbers)
  std::string out;
  std::string command_line;
  bool json = false;
  Capture* capture = nullptr;  ///< takes the document, nothing is printed; null: none
};

/// Compares scenes, summaries and logs. Returns 1 where a number of the summaries or logs is beyond the
/// tolerance, a word differs, or one log has rows or columns that the other has not. Throws InputError for a
/// directory that no run has left.
int run_compare(const CompareOptions& o);

}  // namespace esmc::host
