#include "host_sim/operate/line_input.hpp"

#include <poll.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <utility>
#ifdef ESMC_LIBEDIT
#include <editline/readline.h>
#endif

namespace esmc::host {
namespace {

bool input_waits() {
  pollfd p{STDIN_FILENO, POLLIN, 0};
  return ::poll(&p, 1, 0) > 0;
}

#ifdef ESMC_LIBEDIT
/// What the callbacks of libedit, which have no argument of their own, share with the one prompt of the
/// process.
struct Edited {
  std::vector<std::string> words;
  bool done = false, end = false;
  std::string text;
};
Edited& edited_line() {
  static Edited e;
  return e;
}
void take_line(char* text) {
  Edited& e = edited_line();
  e.done = true;
  e.end = text == nullptr;
  if (text != nullptr) e.text = text;
  if (text != nullptr && *text != '\0') ::add_history(text);
  std::free(text);  // NOLINT(*-no-malloc): libedit has allocated it
}
char* complete(const char* text, int state) {
  static std::size_t next = 0;
  if (state == 0) next = 0;
  const auto& words = edited_line().words;
  while (next < words.size()) {
    const std::string& word = words[next++];
    if (word.starts_with(text)) return ::strdup(word.c_str());
  }
  return nullptr;
}
std::optional<std::string> edited(const std::string& prompt, const std::function<bool()>& meanwhile) {
  Edited& e = edited_line();
  e.done = e.end = false;
  e.text.clear();
  ::rl_callback_handler_install(prompt.c_str(), take_line);
  struct Restore {  // the terminal, whatever `meanwhile` throws
    ~Restore() { ::rl_callback_handler_remove(); }
  } restore;
  while (!e.done) {
    if (!meanwhile()) {
      std::fputc('\n', stdout);
      return std::nullopt;
    }
    if (input_waits()) ::rl_callback_read_char();
  }
  return e.end ? std::nullopt : std::optional(e.text);
}
#endif

}  // namespace

LineInput::LineInput([[maybe_unused]] std::vector<std::string> words)
    : terminal_(::isatty(STDIN_FILENO) != 0) {
#ifdef ESMC_LIBEDIT
  edited_line().words = std::move(words);
  if (!terminal_) return;
  ::rl_completion_entry_function = complete;
  ::using_history();
#endif
}

void LineInput::notice(const std::string& text) const {
  if (!terminal_) return;
  std::fputs(("\r\033[K" + text + "\n").c_str(), stdout);
  std::fflush(stdout);
#ifdef ESMC_LIBEDIT
  ::rl_on_new_line();
  ::rl_forced_update_display();
#endif
}

bool LineInput::read_some() {
  std::array<char, 4096> buffer{};
  const ssize_t n = ::read(STDIN_FILENO, buffer.data(), buffer.size());
  if (n < 0 && errno == EINTR) return true;
  if (n <= 0) open_ = false;
  if (n > 0) pending_.append(buffer.data(), static_cast<std::size_t>(n));
  return open_;
}

bool LineInput::silent() {
  if (!open_ || !pending_.empty()) return false;
  if (!input_waits()) return true;
  (void)read_some();
  if (terminal_) pending_.clear();
  return false;
}

std::optional<std::string> LineInput::line(const std::string& prompt,
                                           const std::function<bool()>& meanwhile) {
#ifdef ESMC_LIBEDIT
  if (terminal_) return edited(prompt, meanwhile);
#endif
  if (terminal_) {
    std::fputs(prompt.c_str(), stdout);
    std::fflush(stdout);
  }
  for (;;) {
    const std::size_t end = pending_.find('\n');
    if (end != std::string::npos || (!open_ && !pending_.empty())) {
      std::string out = pending_.substr(0, end);
      pending_.erase(0, end == std::string::npos ? end : end + 1);
      return out;
    }
    if (!open_ || !meanwhile()) return std::nullopt;
    if (input_waits()) (void)read_some();
  }
}

}  // namespace esmc::host
