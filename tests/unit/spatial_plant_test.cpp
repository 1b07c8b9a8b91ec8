// The plant in space against closed forms and what has to be conserved: the torque-free top, and a platform
// let go.

#include <gtest/gtest.h>

#include "tests/support/spatial_case.hpp"

namespace esmc::test {
namespace {

/// Jacobi's sn, cn, dn of u and modulus k, 0 < k < 1, by the arithmetic-geometric mean and its descent.
struct Jacobi {
  Real sn, cn, dn;
};
Jacobi jacobi(Real u, Real k) {
  std::array<Real, 12> a{1}, c{k};
  Real b = std::sqrt(1 - k * k);
  std::size_t n = 0;
  while (n + 1 < a.size() && std::fabs(c[n]) > 1e-19L) {
    a[n + 1] = (a[n] + b) / 2;
    c[n + 1] = (a[n] - b) / 2;
    b = std::sqrt(a[n] * b);
    ++n;
  }
  Real phi = std::ldexp(a[n] * u, static_cast<int>(n)), before = phi;
  for (; n > 0; --n) {
    before = phi;
    phi = (phi + std::asin(c[n] / a[n] * std::sin(phi))) / 2;
  }
  return {std::sin(phi), std::cos(phi), std::cos(phi) / std::cos(before - phi)};
}

/// A top of Dzhanibekov's: spun about the middle axis it turns over, again and
/// again, as Jacobi's functions say.
TEST(TorqueFreeTop, TurnsOverAsJacobiSays) {
  const Vec3<double> I(0.01, 0.02, 0.035);
  const SpatialPlant plant({1.0, I}, 0.0);
  // Next to the separatrix: most of the time it spins about the middle axis. At t = 0 omega_2 = 0, so that sn
  // starts at 0.
  const double first = 3.0, third = 1.3;
  SpatialState s;
  s.turning = {first, 0, third};
  const Real I1 = Real(I[0]), I2 = Real(I[1]), I3 = Real(I[2]);
  const Real w1 = Real(first), w3 = Real(third);
  const Real T2 = I1 * w1 * w1 + I3 * w3 * w3, L2 = I1 * I1 * w1 * w1 + I3 * I3 * w3 * w3;
  ASSERT_LT(L2, T2 * I2);
  // Landau and Lifshitz, section 37, with the axes named from the other end, as L2 < 2 E I2 asks.
  const Real a1 = std::sqrt((T2 * I3 - L2) / (I1 * (I3 - I1))),
             a2 = std::sqrt((L2 - T2 * I1) / (I2 * (I2 - I1))),
             a3 = std::sqrt((L2 - T2 * I1) / (I3 * (I3 - I1)));
  const Real k = std::sqrt((I3 - I2) * (L2 - T2 * I1) / ((I2 - I1) * (T2 * I3 - L2)));
  ASSERT_LT(k, 1);
  const Real rate = std::sqrt((I2 - I1) * (T2 * I3 - L2) / (I1 * I2 * I3));
  const V3d momentum = plant.angular_momentum(s);
  const double energy = plant.energy(s).kinetic;
  double work = 0, worst = 0;
  int over = 0;
  double last = 0.0, most = 0.0;
  for (int n = 1; n <= 40000; ++n) {
    plant.step(s, {}, 5e-4, work);
    const Jacobi j = jacobi(rate * 5e-4L * n, k);
    const Quaternion<double> q{s.attitude[0], s.attitude.tail<3>()};
    const Vec3<double> omega = rotated(q.conjugate(), s.turning);
    const Vec3<double> want(static_cast<double>(a1 * j.dn), static_cast<double>(a2 * j.sn),
                            static_cast<double>(a3 * j.cn));
    worst = std::fmax(worst, (omega - want).cwiseAbs().maxCoeff());
    if (n > 1 && (omega.y() > 0) != (last > 0)) ++over;
    last = omega.y();
    most = std::fmax(most, std::fabs(last));
  }
  EXPECT_LT(worst, 1e-8);
  EXPECT_GE(over, 4);
  EXPECT_GT(I[1] * most, 0.99 * momentum.norm()) << "about the middle axis";
  EXPECT_LT((plant.angular_momentum(s) - momentum).norm(),
            1e-9 * momentum.norm());  // in N: judges the attitude too
  EXPECT_NEAR(plant.energy(s).kinetic, energy, 1e-10 * energy);
  EXPECT_EQ(work, 0);
}

/// A platform with motors that push as they like: what they do is what energy changes by, for each of 13
/// bodies.
TEST(PlatformOnLegs, EnergyIsWhatTheMotorsDid) {
  for (std::uint64_t seed = 0; seed < 5; ++seed) {
    Random r(seed);
    const auto p = random_hexapod<double>(r);
    const SpatialPlant plant(p);
    SpatialState s = PlatformState<double>::near_home(p, r).plant();
    s.velocity *= 0.2;
    s.turning *= 0.2;
    const auto total = [&] {
      const auto e = plant.energy(s);
      return e.kinetic + e.potential;
    };
    const double before = total();
    double work = 0;
    SpatialPlant::Input u{};
    for (double& f : u) f = r.in<double>(0, 20);
    double most = 0;
    for (int n = 0; n < 400; ++n) {
      plant.step(s, u, 2.5e-4, work);
      most = std::fmax(most, plant.energy(s).kinetic);
    }
    EXPECT_GT(std::fabs(work), 0.01);
    EXPECT_LT(std::fabs(total() - before - work), 1e-8 * most) << seed;
  }
}

}  // namespace
}  // namespace esmc::test
