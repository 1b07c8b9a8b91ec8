#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "host_sim/controller/controller_config.hpp"
#include "host_sim/controller/program.hpp"
#include "host_sim/plan/spline.hpp"

namespace esmc::host {
namespace {

PhaseClock phase_clock(double phase, double speed, double tick) {
  const auto turns = [](double angle) {  // nearest 2^-64 turn of the angle modulo one turn
    const double t = angle / (2.0 * std::numbers::pi);
    return static_cast<std::uint64_t>(static_cast<std::int64_t>(std::ldexp(t - std::round(t), 63))) * 2U;
  };
  return {turns(phase), turns(speed * tick)};
}

Vec2<double> vec(const std::array<double, 2>& a) { return {a[0], a[1]}; }

Motion2<double> at_rest(const std::array<double, 2>& p) { return {vec(p), {0, 0}, {0, 0}}; }

/// Straight sides of a line or a polyline, at rest in every corner; each lasts a whole number of ticks.
void straight_sides(const ReferenceScene& r, double tick, ReferenceBundle<double>& out) {
  out.reference.kind = ReferenceKind::path;
  const std::size_t corners = r.points.size(), sides = r.repeat ? corners : corners - 1;
  std::uint32_t now = 0;
  for (std::size_t i = 0; i < sides; ++i) {
    const auto &a = r.points[i], &b = r.points[(i + 1) % corners];
    const double seconds =
        r.type == ReferenceType::line ? r.duration : std::hypot(b[0] - a[0], b[1] - a[1]) / r.speed;
    const auto ticks = static_cast<std::uint32_t>(std::max(1.0, std::round(seconds / tick)));
    out.path.push_back({now, 0.0, Quintic<double>::between(at_rest(a), at_rest(b), ticks * tick)});
    now += ticks;
  }
  if (r.repeat) out.reference.repeat_ticks = now;
}

/// Velocities and accelerations at the points of a table from natural cubic splines, then quintics between.
std::vector<PathSegment<double>> through_points(const std::vector<PathPoint>& points, double tick) {
  const std::size_t n = points.size();
  std::vector<Vec2<double>> at;
  std::vector<double> span;
  for (std::size_t i = 0; i < n; ++i) at.emplace_back(points[i].x, points[i].y);
  for (std::size_t i = 0; i + 1 < n; ++i) span.push_back(points[i + 1].t - points[i].t);
  const std::vector<Vec2<double>> m = plan::second_derivatives(at, span);
  const auto motion = [&](std::size_t i) {
    const std::size_t k = std::min(i, n - 2);
    const double h = span[k];
    const Vec2<double> chord = (at[k + 1] - at[k]) / h;
    const Vec2<double> v = i == k ? Vec2<double>(chord - h / 6.0 * (2.0 * m[k] + m[k + 1]))
                                  : Vec2<double>(chord + h / 6.0 * (m[k] + 2.0 * m[k + 1]));
    return Motion2<double>{at[i], v, m[i]};
  };
  std::vector<PathSegment<double>> out;
  for (std::size_t i = 0; i + 1 < n; ++i) {
    const auto start = static_cast<std::uint32_t>(std::ceil(points[i].t / tick - 1e-9));
    if (!out.empty() && out.back().start_tick == start) out.pop_back();  // it is over before a tick
    out.push_back({start, std::max(0.0, start * tick - points[i].t),
                   Quintic<double>::between(motion(i), motion(i + 1), span[i])});
  }
  return out;
}

/// Makes tick `first` the first one.
void skip(ReferenceBundle<double>& b, std::uint32_t first, double tick) {
  for (PhaseClock& c : b.reference.phase.items) c.start += c.per_tick * first;
  if (b.path.empty()) return;
  const std::uint32_t round = b.reference.repeat_ticks;
  if (round > 0) {  // for as long as a part of the scene may last
    const std::vector<PathSegment<double>> one = b.path;
    first %= round;
    for (std::uint32_t begin = round; begin < first + 1000U; begin += round) {
      for (PathSegment<double> s : one) {
        s.start_tick += begin;
        b.path.push_back(s);
      }
    }
    b.reference.repeat_ticks = 0;
  }
  while (b.path.size() > 1 && b.path[1].start_tick <= first) b.path.erase(b.path.begin());
  for (PathSegment<double>& s : b.path) {
    if (s.start_tick <= first) s.offset += (first - s.start_tick) * tick;
    s.start_tick = s.start_tick <= first ? 0 : s.start_tick - first;
  }
}

template <class S>
Quintic<S> in_scalar(const Quintic<double>& q) {
  Quintic<S> out;
  out.duration = static_cast<S>(q.duration);
  for (int i = 0; i < 6; ++i) out.c[i] = q.c[i].template cast<S>();
  return out;
}

}  // namespace

template <>
ReferenceBundle<double> make_reference<double>(const Scene& scene, Pacing pacing) {
  const ReferenceScene& r = scene.reference;
  ReferenceBundle<double> out;
  Reference<double>& ref = out.reference;
  const double tick = scene.tick();
  out.join_ticks = static_cast<std::uint32_t>(
      std::llround(r.join.value_or(pacing == Pacing::realtime ? 1.0 : 0.0) * scene.rate_hz));
  switch (r.type) {
    case ReferenceType::circle:
      ref.kind = ReferenceKind::circle;
      ref.centre = vec(r.center);
      ref.amplitude = {r.radius, r.radius};
      ref.speed = {r.speed, r.speed};
      ref.phase[0] = ref.phase[1] = phase_clock(r.phase, r.speed, tick);
      break;
    case ReferenceType::joint_sine:
      ref.kind = ReferenceKind::sine;
      ref.space = ReferenceSpace::base_joints;
      ref.centre = vec(r.offset);
      ref.amplitude = vec(r.amplitude);
      ref.speed = vec(r.omega);
      for (int i = 0; i < 2; ++i) {
        const auto u = static_cast<std::size_t>(i);
        ref.phase[i] = phase_clock(r.phases[u], r.omega[u], tick);
      }
      break;
    case ReferenceType::line:
    case ReferenceType::polyline:
      straight_sides(r, tick, out);
      break;
    case ReferenceType::file:
      ref.kind = ReferenceKind::path;
      out.path = through_points(r.table, tick);
      break;
    case ReferenceType::program: {
      const auto program = planned_program(scene);
      ref.kind = ReferenceKind::path;
      out.path = program->path;
      if (r.repeat) ref.repeat_ticks = program->ticks;
      break;
    }
    case ReferenceType::hold:
      if (r.position) {
        ref.kind = ReferenceKind::path;  // an empty path rests at the centre
        ref.centre = vec(*r.position);
      }
      break;
    case ReferenceType::none:
      break;
  }
  if (r.first_tick > 0) skip(out, r.first_tick, tick);
  return out;
}

template <>
ReferenceBundle<float> make_reference<float>(const Scene& scene, Pacing pacing) {
  const ReferenceBundle<double> exact = make_reference<double>(scene, pacing);
  const Reference<double>& r = exact.reference;
  ReferenceBundle<float> out;
  out.reference = {r.kind,  r.space, r.centre.cast<float>(), r.amplitude.cast<float>(), r.speed.cast<float>(),
                   r.phase, {},      r.repeat_ticks};
  for (const PathSegment<double>& s : exact.path)
    out.path.push_back({s.start_tick, static_cast<float>(s.offset), in_scalar<float>(s.curve)});
  out.join_ticks = exact.join_ticks;
  return out;
}

}  // namespace esmc::host
