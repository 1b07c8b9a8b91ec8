#pragma once
/// Motions that the console streams as samples at the controller's rate: when it is gone, they end.

#include <array>
#include <functional>
#include <optional>

#include "host_sim/controller/controller_config.hpp"
#include "host_sim/operate/connection.hpp"

namespace esmc::host {

/// Position and velocity in one of the two spaces of the command interface: m, m/s or rad, rad/s.
struct SpaceMotion {
  std::array<double, 2> position{}, velocity{};
};
/// A motion in space `from` as the mechanism that the controller of `scene` believes in makes it in the other
/// space and in the modes of `scene`; base joints in [-pi, pi]. Empty: out of reach, or at a singularity.
std::optional<SpaceMotion> in_other_space(const Scene& scene, link::Space from, const SpaceMotion& motion);

/// A stream of samples.
class SampleStream {
 public:
  /// `own`: space of the samples that it is given, `space`: of the controller. `scene`: null, or that of the
  /// controller; needed where the spaces differ. `connection` and `scene` must outlive this.
  SampleStream(Connection& connection, link::Space space, link::Space own, const Scene* scene);

  /// The sample in the controller's space; empty: out of reach, or beyond a limit of the scene or, by more
  /// than `share` of it, of the command interface.
  [[nodiscard]] std::optional<SpaceMotion> sample(const SpaceMotion& m, double share = 1.0) const;
  /// Largest size, in the controller's space, of a unit velocity on an axis here; infinite at a singularity.
  [[nodiscard]] double gain(const std::array<double, 2>& position, std::size_t axis) const;
  [[nodiscard]] double speed() const { return speed_; }                ///< command.speed
  [[nodiscard]] double acceleration() const { return acceleration_; }  ///< command.acceleration
  [[nodiscard]] double period() const { return period_; }              ///< s, between samples

  /// Sends samples at rest until the controller follows them. False: it does not.
  bool begin(const std::array<double, 2>& position);
  /// Waits for the next instant, sends the sample that `next` makes of the time passed (s) since the last.
  void step(const std::function<SpaceMotion(double passed)>& next);
  /// At rest: some more samples, and the order to hold, until the stream has ended.
  void end();
  /// The controller follows samples, or would: the stream has not begun. An order of another console ends it.
  [[nodiscard]] bool running() const {
    return link_.status().state == State::running && (!begun_ || link_.status().streaming);
  }

 private:
  /// Share of the wall's time that passes for the controller: less than 1 in an emulator.
  double controller_share(Connection::Clock::time_point now);

  Connection& link_;
  link::Space space_, own_;
  const Scene* scene_;
  double speed_, acceleration_, period_;
  std::array<double, 2> given_{}, sent_{};  // position of the last sample, in `own` and `space`
  bool any_ = false, begun_ = false;
  std::uint64_t heard_ticks_ = 0;
  std::optional<std::uint64_t> counted_;  // ticks of the controller at counted_from_
  Connection::Clock::time_point counted_from_;
  double share_ = 1.0;
  Connection::Clock::time_point last_;
};

/// Along `axis` from rest at `position` with half of the acceleration that the controller allows, at `speed`
/// while go_on(), and to rest. False: it came to rest before a limit. The stream has begun.
bool jog_along(SampleStream& stream, std::array<double, 2> position, std::size_t axis, double speed,
               const std::function<bool()>& go_on);

/// A path of a scene's reference, by the time since its begin.
class StreamedPath {
 public:
  /// Throws InputError unless the reference has an end (line, polyline, file, program) and does not repeat.
  explicit StreamedPath(const Scene& scene);
  StreamedPath(const StreamedPath&) = delete;
  StreamedPath& operator=(const StreamedPath&) = delete;
  [[nodiscard]] link::Space space() const;
  [[nodiscard]] double duration() const { return duration_; }  ///< s
  [[nodiscard]] SpaceMotion at(double t) const;
  /// Throws Refused where a sample would be beyond a limit, or too fast for the command interface.
  void require_within(const SampleStream& stream) const;

 private:
  double tick_;
  ReferenceBundle<double> bundle_;
  Reference<double> reference_;
  double duration_ = 0.0;
};
/// Along the path while go_on(), then to rest on it. True: to its end. The stream has begun at its start.
bool follow_path(SampleStream& stream, const StreamedPath& path, const std::function<bool()>& go_on);

}  // namespace esmc::host
