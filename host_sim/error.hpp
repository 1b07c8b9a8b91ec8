#pragma once
/// How host tools fail: bad input (exit 2) and failed runs (exit 1), each one line on stderr.

#include <fmt/core.h>

#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace esmc::host {

/// Bad input. `where` is "FILE:LINE" or empty where none applies.
class InputError : public std::runtime_error {
 public:
  InputError(const std::string& where, const std::string& what)
      : std::runtime_error(where.empty() ? what : where + ": " + what) {}
};

/// Several errors of one file, a line each; what() is the first one.
class InputErrors : public InputError {
 public:
  /// `lines`: one or more.
  explicit InputErrors(std::vector<std::string> lines)
      : InputError("", lines.front()), lines_(std::move(lines)) {}
  [[nodiscard]] const std::vector<std::string>& lines() const { return lines_; }

 private:
  std::vector<std::string> lines_;
};

/// Throws InputError with a formatted text.
template <class... T>
[[noreturn]] void refuse_at(const std::string& where, fmt::format_string<T...> text, T&&... values) {
  throw InputError(where, fmt::format(text, std::forward<T>(values)...));
}
template <class... T>
[[noreturn]] void refuse(fmt::format_string<T...> text, T&&... values) {
  refuse_at("", text, std::forward<T>(values)...);
}

/// The input was fine, the run was not.
class RunError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

inline constexpr int exit_interrupted = 130;  ///< as a shell has it after Ctrl-C
/// Ctrl-C, where nothing is left to be said but that.
class Interrupted : public RunError {
 public:
  using RunError::RunError;
};

/// A state that is not finite any more: at a fixed step the end of the run, while searching for a step a
/// reason to go on.
class Diverged : public RunError {
 public:
  using RunError::RunError;
};

/// Returns the text with control characters as escapes (\n, \t, \x1b), for a terminal.
inline std::string printable(std::string_view text) {
  constexpr const char* digits = "0123456789abcdef";
  std::string out;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const auto c = static_cast<unsigned char>(text[i]),
               next = static_cast<unsigned char>(i + 1 < text.size() ? text[i + 1] : 0);
    const bool c1 = c == 0xC2U && next >= 0x80U && next <= 0x9FU;  // U+0080 to U+009F in UTF-8
    if (c1) ++i;
    const unsigned code = c1 ? next : c;
    if (code == '\n') {
      out += "\\n";
    } else if (code == '\t') {
      out += "\\t";
    } else if (c1 || code < 0x20U || code == 0x7FU) {
      out += {'\\', 'x', digits[code / 16U], digits[code % 16U]};
    } else {
      out += text[i];
    }
  }
  return out;
}

}  // namespace esmc::host
