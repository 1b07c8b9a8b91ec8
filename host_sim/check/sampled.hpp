#pragma once
/// Findings of `esmc check`, and its judgement of the sampled loop and of the steps of integration.

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <utility>

#include "host_sim/scene/scene.hpp"

namespace esmc::host {

class Findings {
 public:
  template <class... Values>
  void error(fmt::format_string<Values...> text, Values&&... values) {
    refused_ = true;
    list_.push_back({{"level", "error"}, {"text", fmt::format(text, std::forward<Values>(values)...)}});
  }
  template <class... Values>
  void warning(fmt::format_string<Values...> text, Values&&... values) {
    list_.push_back({{"level", "warning"}, {"text", fmt::format(text, std::forward<Values>(values)...)}});
  }
  [[nodiscard]] bool refused() const { return refused_; }
  [[nodiscard]] const nlohmann::ordered_json& list() const { return list_; }

 private:
  nlohmann::ordered_json list_ = nlohmann::ordered_json::array();
  bool refused_ = false;
};

/// Gains, layer and lambda against tick and delay: docs/theory.md, "Boundary layers and the implicit law".
void judge_gains(const Scene& scene, Findings& f);
/// The same for reaching `saturation` and `tanh`. `stiffness`: largest decay rate within the layer, 1/s.
void judge_layer(const Scene& scene, double stiffness, Findings& f);
/// Springs too stiff for an explicit method with a fixed step.
void judge_step(const Scene& scene, Findings& f);

}  // namespace esmc::host
