/// The laws in space to the last bit, as law_bits_test.cpp has those of the plane.

#include <gtest/gtest.h>

#include <array>
#include <cstring>

#include "firmware/link/crc.hpp"
#include "host_sim/spatial/controller.hpp"

namespace esmc::host {
namespace {

template <class S>
HexapodParams<S> platform() {
  HexapodParams<S> p;
  p.platform = {S(2), Vec3<S>(S(0.03), S(0.04), S(0.05))};
  constexpr std::array<float, 6> x{0.26F, 0.26F, 0.12F, -0.38F, -0.38F, 0.12F},
      y{-0.3F, 0.3F, 0.38F, 0.07F, -0.07F, -0.38F};
  for (int j = 0; j < 6; ++j) {
    const auto low = static_cast<std::size_t>(j), high = static_cast<std::size_t>((j + 1) % 6);
    p.base[j] = Vec3<S>(S(x[low]), S(y[low]), S(0.01));
    p.joint[j] = Vec3<S>(S(0.25) * S(x[low] + x[high]), S(0.25) * S(y[low] + y[high]), S(-0.03));
  }
  p.home = Vec3<S>(S(0.01), S(0), S(0.5));
  p.cylinder = {S(0.1), S(0.5), S(0.002), S(0.0002), S(0)};
  p.rod = {S(0.12), S(0.3), S(0.001), S(0.0001), S(1)};
  p.gravity = S(9.8);
  return p;
}

/// Inputs of all laws and reaching laws along a motion that the body does not follow.
template <class M, class S = typename M::Scalar>
std::uint32_t bits(const M& mechanism, const Vec3<S>& home) {
  std::uint32_t crc = link::crc32_start;
  for (const SpatialLaw law : {SpatialLaw::esmc, SpatialLaw::esmc_projected, SpatialLaw::smc_euler}) {
    for (const Reaching reaching : {Reaching::sign, Reaching::tanh, Reaching::implicit}) {
      SpatialConfig<M> c;
      c.mechanism = mechanism;
      c.law = law;
      c.reaching = reaching;
      c.gains.point = {S(20), S(30), S(0.5)};
      c.gains.turn = {S(15), S(50), S(0.7)};
      c.force_limit = c.moment_limit = S(1e6);
      c.length = S(0.2);
      SpatialController<M> controller(c);
      SpatialReference<S> wanted, way;
      wanted.kind = way.kind = SpatialReferenceKind::sway;
      wanted.position = home;
      way.position = home + Vec3<S>(S(0.01), S(-0.02), S(0.015));
      wanted.axis = Vec3<S>(S(0.6), S(0), S(0.8));
      way.axis = Vec3<S>(S(0), S(-0.8), S(0.6));
      wanted.angle = way.angle = S(0.4);
      wanted.rate = way.rate = S(6);
      wanted.phase.per_tick = 1ULL << 54U;
      way.phase = {1ULL << 60U, 1ULL << 54U};
      for (std::uint32_t n = 0; n < 100; ++n) {
        const SpatialMotion<S> m = way.at(n, S(1e-3));
        const auto result =
            controller.tick({m.position, m.velocity, m.attitude, m.turning}, wanted.at(n, S(1e-3)));
        EXPECT_EQ(result.fault, SpatialFault::none);
        for (int i = 0; i < 6; ++i) {
          std::array<std::uint8_t, sizeof(S)> bytes{};
          const S value = result.input[i];
          std::memcpy(bytes.data(), &value, sizeof(S));
          for (const std::uint8_t b : bytes) crc = link::crc32_add(crc, b);
        }
      }
    }
  }
  return ~crc;
}

TEST(LawBitsInSpace, AreTheSameFromEveryCompilerAndOnEveryMachine) {
  EXPECT_EQ(bits(make_hexapod(platform<double>()), platform<double>().home), 1315917407U);
  EXPECT_EQ(bits(make_hexapod(platform<float>()), platform<float>().home), 413767186U);
  EXPECT_EQ(bits(make_free_body(platform<double>().platform, 9.8), Vec3<double>(Vec3<double>::Zero())),
            3062401448U);
  EXPECT_EQ(bits(make_free_body(platform<float>().platform, 9.8F), Vec3<float>(Vec3<float>::Zero())),
            757024909U);
}

}  // namespace
}  // namespace esmc::host
