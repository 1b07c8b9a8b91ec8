#pragma once
/// Messages between a live bench and its pages: JSON text both ways, listed in docs/live.md. Runs in the
/// server's thread and reads scenes there, so that the loop gets only scenes that are possible.

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "host_sim/live/session.hpp"
#include "host_sim/record/run_mcap.hpp"
#include "host_sim/record/run_options.hpp"
#include "host_sim/web/server.hpp"

namespace esmc::host {

class LiveApi final : public Service {
 public:
  /// `scene`: the one that the loop begins with. `exchange` must outlive this, and this its clients.
  LiveApi(const RunOptions& options, std::shared_ptr<const Scene> scene, Exchange& exchange);

  [[nodiscard]] std::unique_ptr<Client> on_connect() override;
  void on_timer() override;
  /// /log.csv and /log.mcap, of the samples that are kept, and /scene.toml, as it runs now.
  [[nodiscard]] std::unique_ptr<Served> download(std::string_view path) override;
  /// Every sample goes to `file` as well, from now on; null: not any more. Before the server runs, or after
  /// it.
  void record_to(RunMcap* file);
  /// Number of messages that are no JSON, or that no page sends.
  [[nodiscard]] std::uint64_t malformed() const { return malformed_; }
  /// Set by the loop: late ticks, and samples dropped because the queue was full.
  struct LoopCounts {
    std::atomic<std::uint64_t> late{0}, dropped{0};
  };
  [[nodiscard]] LoopCounts& loop() { return loop_; }

 private:
  friend class Page;

  /// Each throws InputError with the line that the page shows.
  void set(const std::vector<std::string>& sets);
  void send(LiveOrder o);
  [[nodiscard]] bool controller_here() const { return options_.bus == "virtual"; }
  [[nodiscard]] bool injectable(const InjectionRow& row) const;
  [[nodiscard]] std::string scene_json() const;
  [[nodiscard]] std::string hello_json() const;
  [[nodiscard]] std::string log_csv() const;
  [[nodiscard]] std::string log_mcap() const;

  RunOptions options_;
  std::vector<std::string> given_;  ///< the sets of the command line
  std::shared_ptr<const Scene> scene_;
  Exchange& exchange_;
  History<LiveSample> samples_;
  History<LiveEvent> events_;
  std::uint64_t scene_number_ = 1, malformed_ = 0;
  LoopCounts loop_;
  RunMcap* mcap_ = nullptr;
  Hand usual_hand_;
  std::optional<Hand> release_;  ///< the hand of a page that has gone, to be sent
};

/// An effect of a scene: payload, and `mass = 0.3`.
struct EffectText {
  std::string type, parameters;
};
std::vector<EffectText> effect_texts(const std::string& toml);  ///< of a scene, in its order
/// Returns `sets` with `set` at the end, in place of an earlier one of the same key.
std::vector<std::string> with_set(std::vector<std::string> sets, const std::string& set);
/// A hand that can move this mechanism: half of the force that its motors can hold at full reach.
Hand usual_hand(const Scene& scene);
/// Reads and checks the scene of a bench. Throws InputError.
std::shared_ptr<const Scene> read_live_scene(const RunOptions& o);

struct LiveOptions {
  RunOptions run;
  int port = 0;                    ///< 0: one that is free
  std::optional<double> duration;  ///< s; none: until Ctrl-C
};

/// Prints the pages' address, runs until `duration` or Ctrl-C, prints a summary. Returns the exit status 0,
/// with faults too. Throws InputError or RunError.
int run_live(const LiveOptions& o);

}  // namespace esmc::host
