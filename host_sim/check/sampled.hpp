#pragma once
/// What `esmc check` has to say of a scene, and its judgement of what is sampled: the loop near the surface,
/// and steps of integration.

#include <nlohmann/json.hpp>
#include <string>
#include <utility>

#include "host_sim/scene/scene.hpp"

namespace esmc::host {

class Findings {
 public:
  void error(std::string text) { add("error", std::move(text)); }
  void warning(std::string text) { add("warning", std::move(text)); }
  [[nodiscard]] bool refused() const { return refused_; }
  [[nodiscard]] const nlohmann::ordered_json& list() const { return list_; }

 private:
  void add(const char* level, std::string text) {
    refused_ = refused_ || std::string(level) == "error";
    list_.push_back({{"level", level}, {"text", std::move(text)}});
  }
  nlohmann::ordered_json list_ = nlohmann::ordered_json::array();
  bool refused_ = false;
};

/// Gains, layer and lambda against tick and delay: docs/theory.md, "Boundary layers and the implicit law".
void judge_gains(const Scene& scene, Findings& f);
/// The same for reaching `saturation` and `tanh`. `stiffness`: the fastest that anything dies within the
/// layer, 1/s.
void judge_layer(const Scene& scene, double stiffness, Findings& f);
/// What an explicit method with a fixed step makes of stiff springs.
void judge_step(const Scene& scene, Findings& f);

}  // namespace esmc::host
