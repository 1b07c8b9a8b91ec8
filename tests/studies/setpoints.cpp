// Set points from outside, a new one every 1 to 200 ticks: limits, continuity and ends of the motion that the
// controller makes of them, by differences of its ticks. usage: setpoints TICKS [FIRST_SEED]

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <random>

#include "firmware/cycle/setpoint_generator.hpp"

namespace {

using namespace esmc;

/// Largest excess over each limit, relative to it, and largest distance from an end.
struct Worst {
  double speed = 0, acceleration = 0, jerk = 0, position = 0, end = 0;
  std::uint64_t ends = 0, points = 0;
};

template <class S>
class Episode {
 public:
  Episode(std::uint64_t seed, Worst& worst) : random_(seed), worst_(worst) {
    speed_ = std::exp(uniform(-4.0, 2.0));
    acceleration_ = speed_ * std::exp(uniform(0.0, 5.0));  // 0.007 to 1 s to the full speed
    tick_ = uniform(0, 1) < 0.5 ? 1e-3 : 2.5e-4;
    length_ = static_cast<unsigned>(uniform(0, 1) < 0.2 ? 0.0 : uniform(1.0, 64.99));
    angles_ = uniform(0, 1) < 0.3;
    range_ = angles_ ? 3.1 : std::exp(uniform(-4.0, 0.5));
    generator_ = SetpointGenerator<S>(S(speed_), S(acceleration_), S(tick_), {angles_, angles_}, length_);
    generator_.activate(true);
    target_ = point();
    generator_.start(target_, Vec2<S>::Zero());
    last_ = generator_.at();
  }
  void run(std::uint64_t ticks) {
    while (ticks_ < ticks) {
      target_ = point();
      ++worst_.points;
      generator_.advance();
      const bool holds =
          uniform(0, 1) < 0.05;  // both before the motion of the tick is read, as in the controller
      if (holds)
        generator_.hold();
      else
        generator_.go_to(target_);
      look();
      if (!holds && uniform(0, 1) < 0.02) {
        arrive();
      } else {
        for (int n = static_cast<int>(uniform(0, 199.99)); n > 0; --n) step();
      }
    }
  }

 private:
  double uniform(double a, double b) { return a + (b - a) * (double(random_() >> 11U) * 0x1p-53); }
  Vec2<S> point() { return {S(uniform(-range_, range_)), S(uniform(-range_, range_))}; }

  void step() {
    generator_.advance();
    look();
  }
  void look() {
    ++ticks_;
    const Motion2<S> m = generator_.at();
    const double v = S(speed_), a = S(acceleration_);  // as the generator has them
    const double h = S(tick_);
    // Rounding of a speed that is a mean of up to 64, which a difference of two shows.
    const double grain = 64.0 * double(std::numeric_limits<S>::epsilon());
    for (int i = 0; i < 2; ++i) {
      const double v0 = last_.velocity[i], v1 = m.velocity[i];
      raise(worst_.speed, std::abs(v1) / v - 1.0);
      raise(worst_.acceleration, std::abs(double(m.acceleration[i])) / a - 1.0);
      raise(worst_.acceleration, (std::abs(v1 - v0) - grain * v) / (a * h) - 1.0);
      if (length_ > 1)
        raise(
            worst_.jerk,
            std::abs(double(m.acceleration[i]) - double(last_.acceleration[i])) / (2.0 * a / length_) - 1.0);
      // Within |acceleration| <= a the position is no further than a h^2 / 4 from what both speeds say.
      const double way = double(m.position[i]) - double(last_.position[i]);
      const double scale = angles_ ? 4.0 * range_ : range_;
      raise(worst_.position, (std::abs(way - 0.5 * h * (v0 + v1)) - 0.25 * a * h * h) / scale);
    }
    last_ = m;
  }
  void arrive() {
    const double v = speed_, a = acceleration_;
    const double way = angles_ ? 3.2 : 2.0 * range_;
    const auto most = static_cast<std::uint64_t>((2.0 * way / v + 6.0 * v / a) / tick_) + length_ + 2U;
    for (std::uint64_t n = 0; n < most; ++n) step();
    ++worst_.ends;
    for (int i = 0; i < 2; ++i) {
      double off = double(last_.position[i]) - double(target_[i]);
      if (angles_) off = std::remainder(off, 6.283185307179586);
      raise(worst_.end, std::abs(off) / (angles_ ? 1.0 : range_));
      if (last_.velocity[i] != S(0) || last_.acceleration[i] != S(0)) worst_.end = 1.0;
    }
  }
  static void raise(double& worst, double v) { worst = v > worst || std::isnan(v) ? v : worst; }

  std::mt19937_64 random_;
  Worst& worst_;
  double speed_, acceleration_, tick_, range_;
  unsigned length_;
  bool angles_;
  SetpointGenerator<S> generator_;
  Vec2<S> target_;
  Motion2<S> last_;
  std::uint64_t ticks_ = 0;
};

/// Whether all limits were kept to `limits` and all ends reached to `ends`.
template <class S>
bool study(const char* name, std::uint64_t ticks, std::uint64_t seed, double limits, double ends) {
  Worst w;
  const std::uint64_t episode = std::min<std::uint64_t>(ticks, 100'000);
  for (std::uint64_t n = 0; n * episode < ticks; ++n) Episode<S>(seed + n, w).run(episode);
  std::printf(
      "%s: %llu ticks, %llu set points, %llu ends: excess of speed %.2g, acceleration %.2g, jerk %.2g; jump "
      "%.2g, end %.2g\n",
      name, static_cast<unsigned long long>(ticks), static_cast<unsigned long long>(w.points),
      static_cast<unsigned long long>(w.ends), w.speed, w.acceleration, w.jerk, w.position, w.end);
  const bool enough = w.points > ticks / 1000 && w.ends > 0;
  return enough && w.speed <= limits && w.acceleration <= limits && w.jerk <= limits &&
         w.position <= limits && w.end <= ends;
}

}  // namespace

int main(int argc, char** argv) {
  const std::uint64_t ticks = argc > 1 ? std::strtoull(argv[1], nullptr, 10) : 1'000'000;
  const std::uint64_t seed = argc > 2 ? std::strtoull(argv[2], nullptr, 10) : 1;
  const bool exact = study<double>("double", ticks, seed, 1e-12, 1e-8);
  const bool single = study<float>("float", ticks, seed, 1e-5, 1e-5);
  return exact && single ? 0 : 1;
}
