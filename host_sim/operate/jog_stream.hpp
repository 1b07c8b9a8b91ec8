#pragma once
/// Samples of a motion along one axis, at the controller's rate: hold-to-run.

#include <array>
#include <functional>

#include "host_sim/operate/connection.hpp"

namespace esmc::host {

class JogStream {
 public:
  /// From rest at `position`, m or rad, along `axis` 0 or 1. `connection` must outlive this.
  JogStream(Connection& connection, link::Space space, const std::array<double, 2>& position,
            std::size_t axis);

  /// Sends samples at rest until the controller follows them. False: it does not.
  bool begin();
  /// Takes up `speed` with half of the acceleration that the controller allows, keeps it while go_on(), and
  /// comes to rest. False: it came to rest before a limit of the scene (null: not known, the controller alone
  /// watches).
  bool run(double speed, const std::function<bool()>& go_on, const Scene* scene);

 private:
  using Seconds = std::chrono::duration<double>;
  /// Waits for the next instant, advances by the time that has passed, and sends a sample.
  void step(double wanted_speed);
  [[nodiscard]] bool would_leave(const Scene& scene) const;

  Connection& link_;
  link::Space space_;
  std::array<double, 2> position_;
  std::size_t axis_;
  double speed_ = 0.0, acceleration_, period_;
  Connection::Clock::time_point last_;
};

}  // namespace esmc::host
