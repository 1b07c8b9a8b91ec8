#pragma once
/// Messages between the operator's pages and the console behind them: JSON text both ways, listed in
/// docs/operate.md. Pages are served in a thread of their own; a mutex guards what both threads touch.

#include <chrono>
#include <cstdint>
#include <deque>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "host_sim/web/server.hpp"

namespace esmc::host {

class OperatorPage;

class PageApi final : public Service {
 public:
  using Clock = std::chrono::steady_clock;
  using Words = std::vector<std::string>;
  /// What goes before all orders, by rank.
  enum class Stop : std::uint8_t {
    none,
    left,  ///< the page in control is gone: what this console has armed comes to rest
    halt,
    off,
  };
  struct Order {
    Words words;                ///< of a command of the console
    std::uint64_t hold_to = 0;  ///< of a jog: its number while the page holds it; 0: another command
  };

  /// `hello`: what a page has to know once. `allowed`: commands that a page may give, besides jog. Counted
  /// from when the page in control was last there, a jog ends after `window`, and it has left after
  /// `absence`.
  PageApi(const nlohmann::ordered_json& hello, std::vector<std::string_view> allowed, Clock::duration window,
          Clock::duration absence);
  ~PageApi() override;

  // Of the server's thread.
  [[nodiscard]] std::unique_ptr<Client> on_connect() override;
  void on_timer() override {}

  // Of the console's thread.
  /// The state to be shown from now on, one JSON object.
  void publish(std::string now);
  /// A row of the plots, a JSON array.
  void add_row(std::string row);
  /// A line of the pages' log.
  void tell(double t, const char* kind, const std::string& text);
  [[nodiscard]] std::optional<Order> next_order();
  /// The stop that waits to be carried out. Orders given before it are gone.
  [[nodiscard]] Stop stop();
  void stop_done(Stop carried_out);
  /// Whether the page in control was there since the last call: one sign of life each.
  [[nodiscard]] bool take_life();
  /// Whether the jog with this number goes on: held, by a page that is there.
  [[nodiscard]] bool held(std::uint64_t jog);
  /// Messages that no page of ours sends, and those beyond the rate.
  [[nodiscard]] std::uint64_t malformed();

 private:
  friend class OperatorPage;

  void raise(Stop s);
  void give_word(const OperatorPage* to);

  std::mutex mutex_;
  std::string hello_, now_ = "null";
  std::vector<std::string_view> allowed_;
  Clock::duration window_, absence_;
  History<std::string> rows_, events_;
  std::deque<Order> orders_;
  Stop stop_ = Stop::none;
  const OperatorPage* word_ = nullptr;  ///< the page in control; the others watch
  Clock::time_point life_{};            ///< when that page was there for certain
  bool life_taken_ = true, absent_ = false;
  std::uint64_t jog_ = 0, jogs_ = 0;  ///< the jog that is held, 0: none; their count
  std::uint64_t malformed_ = 0;
};

}  // namespace esmc::host
