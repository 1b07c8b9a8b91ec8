#include "host_sim/operate/sample_stream.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "firmware/cycle/estimate.hpp"

namespace esmc::host {
namespace {

using Seconds = std::chrono::duration<double>;

/// NaN if one of them is.
double larger(const std::array<double, 2>& v) {
  const double a = std::abs(v[0]), b = std::abs(v[1]);
  return b > a || std::isnan(b) ? b : a;
}
Vec2<double> vec(const std::array<double, 2>& v) { return {v[0], v[1]}; }
std::array<double, 2> pair(const Vec2<double>& v) { return {v[0], v[1]}; }

}  // namespace

std::optional<SpaceMotion> in_other_space(const Scene& scene, link::Space from, const SpaceMotion& motion) {
  return with_mechanism<double>(scene, [&]<class M>(const M*) -> std::optional<SpaceMotion> {
    const M m(params_of<M>(believed_mechanism(scene)));
    const auto mode = mode_of<M>(scene);
    const Vec2<double> x = vec(motion.position), v = vec(motion.velocity), none = Vec2<double>::Zero();
    typename M::Pose pose;
    typename M::Rates rates, unused;
    const bool there = from == link::Space::effector
                           ? desired_at_effector(m, mode, x, v, none, pose, rates, unused)
                           : desired_at_base(m, mode, x, v, none, pose, rates, unused);
    if (!there) return std::nullopt;
    const SpaceMotion out = from == link::Space::effector
                                ? SpaceMotion{pair(M::base_angles(pose)), pair(M::base(rates))}
                                : SpaceMotion{pair(pose.effector), pair(m.tip_rate(pose, rates))};
    if (!std::isfinite(larger(out.velocity))) return std::nullopt;
    return out;
  });
}

SampleStream::SampleStream(Connection& connection, link::Space space, link::Space own, const Scene* scene)
    : link_(connection),
      space_(space),
      own_(own),
      scene_(scene),
      speed_(static_cast<double>(connection.parameter(link::Index::speed))),
      acceleration_(static_cast<double>(connection.parameter(link::Index::acceleration))),
      period_(std::max(static_cast<double>(connection.parameter(link::Index::sample_time)), 5e-4)),
      last_(Connection::Clock::now()) {}

std::optional<SpaceMotion> SampleStream::sample(const SpaceMotion& m, double share) const {
  std::optional<SpaceMotion> out = m;
  if (own_ != space_) out = in_other_space(*scene_, own_, m);
  if (!out || !(larger(out->velocity) <= share * speed_)) return std::nullopt;
  const auto inside = [&](link::Space space, const std::array<double, 2>& at) {
    if (scene_ == nullptr) return true;  // the controller alone watches
    const auto& box = space == link::Space::effector ? scene_->limits.workspace : scene_->limits.joint_angle;
    return !box ||
           (at[0] >= (*box)[0][0] && at[0] <= (*box)[0][1] && at[1] >= (*box)[1][0] && at[1] <= (*box)[1][1]);
  };
  if (!inside(own_, m.position) || !inside(space_, out->position)) return std::nullopt;
  return out;
}

double SampleStream::gain(const std::array<double, 2>& position, std::size_t axis) const {
  if (own_ == space_) return 1.0;
  SpaceMotion unit{position, {}};
  unit.velocity[axis] = 1.0;
  const auto there = in_other_space(*scene_, own_, unit);
  return there ? larger(there->velocity) : std::numeric_limits<double>::infinity();
}

bool SampleStream::begin(const std::array<double, 2>& position) {
  if (!link_.obeyed(link::Order::stream)) return false;
  const auto give_up = Connection::Clock::now() + std::chrono::seconds(20);
  while (!link_.status().streaming && running() && !link_.stopped()) {
    if (Connection::Clock::now() > give_up) return false;
    step([&](double) { return SpaceMotion{position, {}}; });
  }
  begun_ = link_.status().streaming;
  return begun_;
}

double SampleStream::controller_share(Connection::Clock::time_point now) {
  constexpr double window = 0.5,
                   real = 0.9;  // s; a share above this one is how Status came, not a slow clock
  const std::uint64_t ticks = link_.news().ticks;
  if (ticks == heard_ticks_) return share_;  // seen where they change, which is when they came
  heard_ticks_ = ticks;
  const double wall = Seconds(now - counted_from_).count();
  if (counted_ && ticks > *counted_ && wall < window) return share_;
  if (counted_ && ticks > *counted_) {
    const double share = static_cast<double>(ticks - *counted_) *
                         static_cast<double>(link_.parameter(link::Index::sample_time)) / wall;
    share_ = share > real ? 1.0 : share;
  }
  counted_ = ticks;
  counted_from_ = now;
  return share_;
}

void SampleStream::step(const std::function<SpaceMotion(double passed)>& next) {
  const auto due = last_ + std::chrono::duration_cast<Connection::Clock::duration>(Seconds(period_));
  for (auto now = Connection::Clock::now(); now < due; now = Connection::Clock::now()) link_.pump(due - now);
  const auto now = Connection::Clock::now();
  const double passed = Seconds(now - last_).count() * controller_share(now);
  last_ = now;
  const SpaceMotion own = next(passed);
  given_ = own.position;
  auto m = own_ == space_ ? std::optional(own) : in_other_space(*scene_, own_, own);
  if (!m) throw Refused("out_of_bounds: out of reach, or at a singularity");
  if (own_ != space_ && space_ == link::Space::base_joints && any_) {  // not round the circle
    for (std::size_t i = 0; i < 2; ++i)
      m->position[i] = sent_[i] + std::remainder(m->position[i] - sent_[i], 2.0 * std::numbers::pi);
  }
  sent_ = m->position;
  any_ = true;
  const auto frames = link_.client().sample(space_, m->position, m->velocity);
  if (!frames) throw Refused("out_of_bounds: beyond the range of the command interface");
  for (const hal::CanFrame& f : *frames) link_.send(f);
}

void SampleStream::end() {
  // Of a sample and an order to hold in one tick the order counts, and would brake from the sample before.
  const std::uint32_t heard = link_.news().statuses;
  while (running() && link_.news().statuses < heard + 3)
    step([&](double) { return SpaceMotion{given_, {}}; });
  // A stream that only stops is lost. Without waiting for an answer: the next sample would be due.
  while (running()) {
    link_.send(link_.client().order(link::Order::hold));
    const auto next =
        Connection::Clock::now() + std::chrono::duration_cast<Connection::Clock::duration>(Seconds(period_));
    for (auto now = Connection::Clock::now(); now < next; now = Connection::Clock::now())
      link_.pump(next - now);
  }
}

bool jog_along(SampleStream& stream, std::array<double, 2> position, std::size_t axis, double speed,
               const std::function<bool()>& go_on) {
  double v = 0.0;
  const auto step = [&](double wanted) {
    stream.step([&](double passed) {
      const double change = 0.5 * stream.acceleration() / stream.gain(position, axis) * passed, before = v;
      v += std::clamp(wanted - v, -change, change);
      position[axis] += 0.5 * (before + v) * passed;
      SpaceMotion m{position, {}};
      m.velocity[axis] = v;
      return m;
    });
  };
  // Where it would come to rest from here, and a reserve, it must still be able to go on.
  const auto would_leave = [&] {
    const double a = 0.5 * stream.acceleration() / stream.gain(position, axis);
    SpaceMotion m{position, {}};
    m.velocity[axis] = v;
    m.position[axis] += v * std::abs(v) / (2.0 * a) + v * 5.0 * stream.period();
    return !stream.sample(m, 1.0 + 1e-6);
  };
  bool limit = false;
  while (go_on() && !limit) {
    step(speed);
    limit = would_leave();
  }
  while (v != 0.0 && stream.running()) step(0.0);
  stream.end();
  return !limit;
}

StreamedPath::StreamedPath(const Scene& scene)
    : tick_(scene.tick()),
      bundle_(make_reference<double>(scene, Pacing::lockstep)),
      reference_(bundle_.get()) {
  if (reference_.kind != ReferenceKind::path || reference_.path.empty() || reference_.repeat_ticks != 0)
    refuse_at(
        scene.file,
        "{}: its reference has no end; `run FILE` is for line, polyline, file and program without repeat",
        scene.file);
  const PathSegment<double>& last = reference_.path.back();
  duration_ = last.start_tick * tick_ - last.offset + last.curve.duration;
}

link::Space StreamedPath::space() const {
  return reference_.space == ReferenceSpace::base_joints ? link::Space::base_joints : link::Space::effector;
}

SpaceMotion StreamedPath::at(double t) const {
  const double whole = std::floor(std::clamp(t, 0.0, duration_) / tick_), rest = t - whole * tick_;
  const Motion2<double> m = reference_.at(static_cast<std::uint64_t>(whole), tick_);
  return t >= duration_
             ? SpaceMotion{pair(reference_.at(static_cast<std::uint64_t>(whole) + 1, tick_).position), {}}
             : SpaceMotion{pair(m.position + m.velocity * rest + m.acceleration * (0.5 * rest * rest)),
                           pair(m.velocity + m.acceleration * rest)};
}

void StreamedPath::require_within(const SampleStream& stream) const {
  std::optional<SpaceMotion> before;
  for (double t = 0.0; t <= duration_ + tick_; t += tick_) {
    const auto now = stream.sample(at(t), 1.0 + 1e-3);
    if (!now)
      throw Refused(
          fmt::format("out_of_bounds: at t = {:.3f} s the path is out of reach, beyond a limit of the scene, "
                      "or faster than command.speed = {:g}",
                      t, stream.speed()));
    for (std::size_t i = 0; before && i < 2; ++i) {
      const double a = std::abs(now->velocity[i] - before->velocity[i]) / tick_;
      if (a > stream.acceleration() * (1.0 + 1e-3))
        throw Refused(
            fmt::format("out_of_bounds: at t = {:.3f} s the path takes {:.3g} m/s2 or rad/s2, "
                        "command.acceleration is {:g}",
                        t, a, stream.acceleration()));
    }
    before = now;
  }
}

bool follow_path(SampleStream& stream, const StreamedPath& path, const std::function<bool()>& go_on) {
  double t = 0.0, rate = 1.0;  // rate: of the path's time
  const double slowing = 0.5 * stream.acceleration() / stream.speed();
  while (t < path.duration() && rate > 0.0 && stream.running()) {
    const bool on = rate == 1.0 && go_on();
    stream.step([&](double passed) {
      const double before = rate;
      if (!on) rate = std::max(0.0, rate - slowing * passed);
      t += 0.5 * (before + rate) * passed;
      SpaceMotion m = path.at(t);
      for (double& v : m.velocity) v *= rate;
      return m;
    });
  }
  const bool over = t >= path.duration();
  if (over && stream.running()) stream.step([&](double) { return path.at(path.duration()); });
  stream.end();
  return over;
}

}  // namespace esmc::host
