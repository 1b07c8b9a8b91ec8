#include "host_sim/operate/jog_stream.hpp"

#include <algorithm>
#include <cmath>

namespace esmc::host {

JogStream::JogStream(Connection& connection, link::Space space, const std::array<double, 2>& position,
                     std::size_t axis)
    : link_(connection),
      space_(space),
      position_(position),
      axis_(axis),
      acceleration_(0.5 * static_cast<double>(connection.parameter(link::Index::acceleration))),
      period_(std::max(static_cast<double>(connection.parameter(link::Index::sample_time)), 5e-4)),
      last_(Connection::Clock::now()) {}

bool JogStream::begin() {
  const auto give_up = Connection::Clock::now() + std::chrono::seconds(20);
  while (!link_.status().streaming && link_.status().state == State::running && !link_.stopped()) {
    if (Connection::Clock::now() > give_up) return false;
    step(0.0);
  }
  return link_.status().streaming;
}

bool JogStream::run(double speed, const std::function<bool()>& go_on, const Scene* scene) {
  bool limit = false;
  while (go_on() && !limit) {
    step(speed);
    limit = scene != nullptr && would_leave(*scene);
  }
  while (speed_ != 0.0 && link_.status().state == State::running) step(0.0);
  // A stream that only stops is lost. Without waiting for an answer: the next sample would be due.
  while (link_.status().streaming && link_.status().state == State::running) {
    link_.send(link_.client().order(link::Order::hold));
    const auto next =
        Connection::Clock::now() + std::chrono::duration_cast<Connection::Clock::duration>(Seconds(period_));
    for (auto now = Connection::Clock::now(); now < next; now = Connection::Clock::now())
      link_.pump(next - now);
  }
  return !limit;
}

void JogStream::step(double wanted_speed) {
  const auto next = last_ + std::chrono::duration_cast<Connection::Clock::duration>(Seconds(period_));
  for (auto now = Connection::Clock::now(); now < next; now = Connection::Clock::now())
    link_.pump(next - now);
  const auto now = Connection::Clock::now();
  const double passed = Seconds(now - last_).count();
  last_ = now;
  const double change = acceleration_ * passed, before = speed_;
  speed_ += std::clamp(wanted_speed - speed_, -change, change);
  position_[axis_] += 0.5 * (before + speed_) * passed;
  std::array<double, 2> velocity{};
  velocity[axis_] = speed_;
  const auto frames = link_.client().sample(space_, position_, velocity);
  if (!frames) throw Refused("out_of_bounds: beyond the range of the command interface");
  for (const hal::CanFrame& f : *frames) link_.send(f);
}

bool JogStream::would_leave(const Scene& scene) const {
  const auto& box = space_ == link::Space::effector ? scene.limits.workspace : scene.limits.joint_angle;
  if (!box) return false;
  const double way =
      speed_ * std::abs(speed_) / (2.0 * acceleration_) + speed_ * 5.0 * period_;  // to rest, and a reserve
  const double end = position_[axis_] + way;
  return end > (*box)[axis_][1] || end < (*box)[axis_][0];
}

}  // namespace esmc::host
