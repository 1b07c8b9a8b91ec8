#pragma once
/// How host tools fail: bad input (exit 2) and failed runs (exit 1), each one line on stderr.

#include <stdexcept>
#include <string>

namespace esmc::host {

/// Bad input. `where` is "FILE:LINE" or empty where none applies.
class InputError : public std::runtime_error {
 public:
  InputError(const std::string& where, const std::string& what)
      : std::runtime_error(where.empty() ? what : where + ": " + what) {}
};

/// The input was fine, the run was not.
class RunError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

}  // namespace esmc::host
