#pragma once
/// Findings of `esmc check`, and its judgement of the sampled loop and of the steps of integration.

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <utility>

#include "host_sim/scene/scene.hpp"

namespace esmc::host {

class Findings {
 public:
  /// Adds an error, formatted by fmt; refused() is true from then on. warning() adds a warning.
  template <class... Values>
  void error(fmt::format_string<Values...> text, Values&&... values) {
    refused_ = true;
    list_.push_back({{"level", "error"}, {"text", fmt::format(text, std::forward<Values>(values)...)}});
  }
  template <class... Values>
  void warning(fmt::format_string<Values...> text, Values&&... values) {
    list_.push_back({{"level", "warning"}, {"text", fmt::format(text, std::forward<Values>(values)...)}});
  }
  [[nodiscard]] bool refused() const { return refused_; }                     ///< there is an error
  [[nodiscard]] const nlohmann::ordered_json& list() const { return list_; }  ///< [{level, text}]

 private:
  nlohmann::ordered_json list_ = nlohmann::ordered_json::array();
  bool refused_ = false;
};

/// Adds findings on gains, layer and lambda: docs/theory.md, "Boundary layers and the implicit law".
void judge_gains(const Scene& scene, Findings& f);
/// Adds findings on the layers of `saturation` and `tanh`. `stiffness`: largest decay rate within them, 1/s.
void judge_layer(const Scene& scene, double stiffness, Findings& f);
/// Adds findings on springs too stiff for an explicit method with a fixed step.
void judge_step(const Scene& scene, Findings& f);

}  // namespace esmc::host
