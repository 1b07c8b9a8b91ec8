#pragma once
/// What a live bench tells its pages and understands of them; JSON text both ways, docs/live.md has the
/// messages. Runs in the server's thread: reads scenes there, so that the loop gets only what is possible.

#include <deque>
#include <memory>
#include <string>
#include <vector>

#include "host_sim/live/exchange.hpp"
#include "host_sim/live/server.hpp"
#include "host_sim/record/run_options.hpp"

namespace esmc::host {

class LiveApi final : public Desk {
 public:
  /// `scene`: as the loop begins with. All live as long as the desk.
  LiveApi(const RunOptions& options, std::shared_ptr<const Scene> scene, Exchange& exchange);

  [[nodiscard]] std::unique_ptr<Client> on_connect() override;
  void turn() override;
  /// Messages that were no JSON, or none that a page sends.
  [[nodiscard]] std::uint64_t malformed() const { return malformed_; }
  /// Ticks whose samples found the way to the desk full, and late ones: told by the loop.
  struct Loop {
    std::atomic<std::uint64_t> late{0}, dropped{0};
  };
  [[nodiscard]] Loop& loop() { return loop_; }

 private:
  friend class Page;

  /// What is kept of samples or events, each with a number for ever.
  template <class T>
  struct Kept {
    std::deque<T> list;
    std::uint64_t first = 0;  ///< number of the oldest
    void add(T x, std::size_t most) {
      list.push_back(std::move(x));
      if (list.size() > most) {
        list.pop_front();
        ++first;
      }
    }
    [[nodiscard]] std::uint64_t end() const { return first + list.size(); }
    [[nodiscard]] const T& at(std::uint64_t number) const { return list[number - first]; }
  };

  /// Each throws InputError with the line that the page shows.
  void set(const std::vector<std::string>& sets);
  void send(LiveOrder o);
  [[nodiscard]] bool controller_here() const { return options_.bus == "virtual"; }
  [[nodiscard]] std::string scene_json() const;
  [[nodiscard]] std::string hello_json() const;

  RunOptions options_;
  std::vector<std::string> given_;  ///< the sets of the command line
  std::shared_ptr<const Scene> scene_;
  Exchange& exchange_;
  Kept<LiveSample> samples_;
  Kept<LiveEvent> events_;
  std::uint64_t scene_number_ = 1, malformed_ = 0;
  Loop loop_;
  Hand grip_;  ///< stiffness, damping and strength of a hand on this mechanism
};

/// An effect as a scene as run has it: payload, and `mass = 0.3`.
struct EffectText {
  std::string type, parameters;
};
std::vector<EffectText> effect_texts(const std::string& toml);
/// Sets with one more: the earlier one of the same key goes.
std::vector<std::string> with_set(std::vector<std::string> sets, const std::string& set);
/// A hand that this mechanism can be moved by: a fraction of what its motors can hold at full reach.
Hand usual_hand(const Scene& scene);
/// Reads and checks the scene of a bench. Throws InputError.
std::shared_ptr<const Scene> read_live_scene(const RunOptions& o);

}  // namespace esmc::host
