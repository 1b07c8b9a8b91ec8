#pragma once
/// Lines of standard input, while something else goes on: with history and completion at a terminal, plain
/// ones otherwise.

#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace esmc::host {

class LineInput {
 public:
  /// `words`: what is completed.
  explicit LineInput(std::vector<std::string> words);
  LineInput(const LineInput&) = delete;
  LineInput& operator=(const LineInput&) = delete;

  /// The next line; empty: there is none any more, or `meanwhile`, which is called every few milliseconds,
  /// returned false.
  std::optional<std::string> line(const std::string& prompt, const std::function<bool()>& meanwhile);
  /// Shows a text above the line that is being edited; no effect where there is no terminal.
  void notice(const std::string& text) const;
  [[nodiscard]] bool terminal() const { return terminal_; }
  /// Whether standard input is open and nothing waits there; does not block. What waits is kept for line();
  /// at a terminal it is dropped: the line that ends a jog is no command.
  bool silent();

 private:
  /// Reads what is there; false: the end of the input.
  bool read_some();

  bool terminal_, open_ = true;
  std::string pending_;
};

}  // namespace esmc::host
