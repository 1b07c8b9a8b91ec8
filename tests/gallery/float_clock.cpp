/// The circle of five_bar_circle.toml as a controller in 32-bit floats computes it, at 1 kHz: tick, x, y, in
/// stretches of twenty ticks, up to a billion.

#include <cmath>
#include <cstdio>
#include <numbers>

#include "firmware/control/reference.hpp"

int main() {
  esmc::Reference<float> circle;
  circle.kind = esmc::ReferenceKind::circle;
  circle.centre = {0.0F, 0.17F};
  circle.amplitude = {0.07F, 0.07F};
  circle.speed = {10.0F, 10.0F};
  const auto step =
      static_cast<std::uint64_t>(std::llrint(0.01L / (2 * std::numbers::pi_v<long double>)*0x1p62L)) * 4U;
  circle.phase.items[0] = {0, step};
  for (std::uint64_t decade = 1; decade <= 100'000'000; decade *= 10)
    for (std::uint64_t part = 1; part < 10; ++part)
      for (std::uint64_t tick = decade * part; tick < decade * part + 20; ++tick) {
        const auto at = circle.at(tick, 0.001F).position;
        std::printf("%llu,%.9g,%.9g\n", static_cast<unsigned long long>(tick), double(at[0]), double(at[1]));
      }
}
