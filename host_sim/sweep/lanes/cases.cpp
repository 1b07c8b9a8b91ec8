#include "host_sim/sweep/lanes/cases.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <utility>

#include "host_sim/controller/numbers.hpp"
#include "host_sim/controller/robust.hpp"
#include "host_sim/plant/plant.hpp"
#include "host_sim/stop.hpp"

namespace esmc::host {
namespace {

using M = FiveBar<double>;

/// As Motion and its engine begin.
void put_start(const Scene& scene, LaneCase& out) {
  FiveBarPlant::Joints angle{}, rate{};
  std::copy_n(scene.start_angle.begin(), angle.size(), angle.begin());
  std::copy_n(scene.start_rate.begin(), rate.size(), rate.begin());
  FiveBarPlant::State state = FiveBarPlant::from_joints(angle, rate);
  FiveBarPlant(scene.mechanism).project(state.angle, state.rate);
  out.angle = state.angle;
  out.rate = state.rate;
}

void put_steps(const Scene& scene, LaneSettings& s) {
  s.tick = scene.tick();
  s.steps = std::max(
      1, static_cast<int>(std::ceil(s.tick / (s.tick / steps_per_tick(scene)) - 1e-9)));  // as Actuators
  s.step = s.tick / s.steps;
}

/// False where lanes do not cover the mechanism: another one, effects, four motors.
bool plant_fits(const Scene& s) {
  return s.type == MechanismType::five_bar && s.effects.empty() && !s.all_motors && s.method == Method::rk4 &&
         !s.accuracy;
}
/// False where the scene has another part that they do not cover: four sensors, a reference of the joints or
/// of the measured start.
bool fits_lanes(const Scene& s) {
  return plant_fits(s) && s.closed_loop() && !s.all_sensors &&
         s.reference.type != ReferenceType::joint_sine && s.reference.type != ReferenceType::none &&
         (s.reference.type != ReferenceType::hold || s.reference.position);
}

/// Every number that its motions depend on, to the last bit. A new field does not compile until it is here.
std::vector<double> numbers_of(const ReferenceBundle<double>& b) {
  const auto& [kind, space, centre, amplitude, speed, phase, unused, repeat_ticks] = b.reference;
  std::vector<double> out;
  put(out, kind, space, centre, amplitude, speed, repeat_ticks, b.join_ticks);
  for (const PhaseClock& c : phase.items)
    put(out, std::bit_cast<double>(c.start), std::bit_cast<double>(c.per_tick));
  for (const auto& [start_tick, offset, curve] : b.path) {
    put(out, start_tick, offset, curve.duration);
    for (const Vec2<double>& c : curve.c.items) put(out, c);
  }
  return out;
}
bool same(const ReferenceBundle<double>& a, const ReferenceBundle<double>& b) {
  if (a.path.size() != b.path.size()) return false;
  const std::vector<double> of_a = numbers_of(a), of_b = numbers_of(b);
  return std::memcmp(of_a.data(), of_b.data(), of_a.size() * sizeof(double)) == 0;
}

}  // namespace

void fill_references(const LaneSettings& settings, const LaneCase* cases, int lanes, std::uint32_t first,
                     std::uint32_t count, double* out) {
  const int columns = settings.one_reference ? 1 : lanes;
  for (std::uint32_t i = 0; i < count; ++i, out += static_cast<std::ptrdiff_t>(6 * columns)) {
    for (int lane = 0; lane < columns; ++lane) {
      const Motion2<double> m = cases[lane].reference.at(first + i);
      const double values[] = {m.position[0], m.position[1],     m.velocity[0],
                               m.velocity[1], m.acceleration[0], m.acceleration[1]};
      for (int c = 0; c < 6; ++c) out[c * columns + lane] = values[c];
    }
  }
}

const std::vector<LaneKernel>& lane_kernels() {
  static const std::vector<LaneKernel> list = [] {
    std::vector<LaneKernel> out;
#ifdef ESMC_WIDE_LANES
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
        __builtin_cpu_supports("avx512vl"))
      out.push_back({"AVX-512", 8, &lane_kernel_avx512});
    if (__builtin_cpu_supports("avx2")) out.push_back({"AVX2", 4, &lane_kernel_avx2});
#endif
    out.push_back({"baseline", 2, &lane_kernel_baseline});
    return out;
  }();
  return list;
}

bool wants_base_errors(const std::vector<Objective>& wanted) {
  return std::ranges::any_of(
      wanted, [](Objective o) { return o >= Objective::rms_rad && o <= Objective::settled_max_rad; });
}

bool make_lane_job(const Scene& scene, const std::vector<Objective>& wanted, LaneJob& out) {
  if (!fits_lanes(scene)) return false;
  // What a reference depends on is known once it is made: a program is timed with model, limits and law.
  auto bundle = make_reference(scene, Pacing::lockstep);
  if (!out.bundle || !same(*out.bundle, bundle))
    out.bundle = std::make_shared<const ReferenceBundle<double>>(std::move(bundle));
  const ControllerConfig<M> c = make_controller<M>(scene, Pacing::lockstep, *out.bundle);
  if (c.join_ticks > 0 || c.ramp_ticks > 0 || c.sign_test_move > 0.0) return false;
  if (c.reach != nullptr || c.observer != nullptr || c.predict != nullptr || c.correct != nullptr)
    return false;
  LaneSettings& s = out.settings;
  s = {};
  s.law = c.law;
  s.reaching = c.reaching;
  s.working_mode = scene.working_mode;
  s.assembly_mode = scene.assembly_mode;
  s.ticks = tick_count(scene);
  put_steps(scene, s);
  s.base_errors = wants_base_errors(wanted);
  LaneCase& n = out.numbers;
  n.controller = c;
  n.reference = JoinedReference<double>(c.reference, 0, c.sample_time);
  n.believed = believed_mechanism(scene);
  n.plant = scene.mechanism;
  s.true_lengths = same_lengths(n.believed, n.plant);
  put_start(scene, n);
  return true;
}

void share_reference(std::vector<LaneJob>& jobs, SharedTrack& track) {
  LaneSettings& s = jobs.front().settings;
  const auto& bundle = jobs.front().bundle;
  s.one_reference = std::ranges::all_of(jobs, [&](const LaneJob& j) { return j.bundle == bundle; });
  constexpr std::uint32_t longest_track = 1U << 16U;  // 3 MB
  if (!s.one_reference || s.ticks > longest_track) return;
  if (track.of != bundle || track.tick != s.tick || track.rows.size() != std::size_t{6} * s.ticks) {
    track = {bundle, s.tick, std::vector<double>(std::size_t{6} * s.ticks)};
    fill_references(s, &jobs.front().numbers, 1, 0, s.ticks, track.rows.data());
  }
  s.track = track.rows.data();
}

bool make_driven_job(const Scene& scene, std::uint32_t ticks, std::uint32_t every, LaneJob& out) {
  if (!plant_fits(scene)) return false;
  out.settings = {};
  out.settings.ticks = ticks;
  out.settings.driven = true;
  out.settings.every = every;
  put_steps(scene, out.settings);
  out.numbers.believed = out.numbers.plant = scene.mechanism;
  put_start(scene, out.numbers);
  return true;
}

void run_lane_jobs(const LaneKernel& kernel, const std::vector<LaneJob>& jobs, std::vector<LaneScore>& out) {
  const auto lanes = static_cast<std::size_t>(kernel.lanes);
  std::vector<LaneCase> cases;
  for (std::size_t i = 0; i < lanes; ++i)
    cases.push_back(jobs[std::min(i, jobs.size() - 1)].numbers);  // the rest for nothing
  out.assign(lanes, {});
  LaneSettings settings = jobs.front().settings;
  settings.stopped = +[] { return stop_requested().load(); };
  kernel.run(settings, cases.data(), out.data());
  out.resize(jobs.size());
}

}  // namespace esmc::host
