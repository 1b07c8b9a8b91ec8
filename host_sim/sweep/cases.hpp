#pragma once
/// From a case of a sweep to its scene, with the checks of `esmc sim --set`.

#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "host_sim/scene/scene.hpp"
#include "host_sim/sweep/spec.hpp"

namespace esmc::host {

/// How a number of a Scene is set without reading the scene again.
struct Binding {
  using Set = std::function<void(Scene&, double)>;
  Set set = nullptr;             ///< null: the scene is read again
  double low = 0.0, high = 0.0;  ///< allowed
  bool low_open = false;
};

/// Scenes of a specification, one at a time. Not for several threads at once: each takes a copy.
///
/// Keys "plant...." change the true mechanism alone; the controller's model stays that of [mechanism] and
/// control.model. A key that is one number of the Scene is set there; for any other, and wherever other parts
/// of the scene depend on such a number, the scene is read again, which takes some 100 times as long.
class CaseScenes {
 public:
  /// Reads the scene of `spec`, which must outlive this and its copies, and tries the ends or the values of
  /// every axis. Throws InputError for a scene that cannot be read or that asks for simulation.accuracy; of
  /// an axis that does not fit it names the [[vary]].
  explicit CaseScenes(const SweepSpec& spec);

  /// The scene of a case, valid until the next call. Throws InputError where its values are impossible.
  [[nodiscard]] const Scene& at(std::uint64_t index);
  /// The scene as given, nothing varied.
  [[nodiscard]] const Scene& nominal() const;
  /// Value of an axis in a case: what cases.csv shows. A factor is shown as such.
  [[nodiscard]] SweepValue value(std::uint64_t index, std::size_t axis) const;
  /// Of the noise of a case.
  [[nodiscard]] std::uint64_t seed(std::uint64_t index) const;
  /// Mean duration of the cases, s.
  [[nodiscard]] double mean_duration() const;
  /// For tests: reads every scene again instead of changing the last one.
  void read_always();

 private:
  struct Tables;
  struct Bound {
    Binding binding;
    double nominal = 1.0;  ///< of a factor
    bool plant = false;
  };
  [[nodiscard]] double number(std::uint64_t index, std::size_t axis) const;
  [[nodiscard]] Scene read_with(const std::vector<std::string>& own) const;
  [[nodiscard]] Scene read(std::uint64_t index, bool all) const;
  [[nodiscard]] bool bind(std::uint64_t index, Scene& scene) const;
  [[nodiscard]] bool set_numbers(std::uint64_t index);
  void try_value(std::size_t axis, const SweepValue& v) const;
  void try_some(std::size_t axis) const;

  const SweepSpec* spec_;
  std::shared_ptr<const Tables> tables_;
  std::vector<Bound> bound_;
  bool any_mechanism_ = false;  ///< of the bound ones: the start has to be computed again
  bool any_plant_ = false;      ///< a key changes the true mechanism alone
  bool assembly_mode_given_ = false;
  std::optional<Scene> base_, scene_;  ///< base_: with all keys but the bound ones; null: read each case
  std::optional<std::vector<SweepValue>> read_for_;  ///< what base_ was read for
};

}  // namespace esmc::host
