// Closed chains that are no benchmark: prismatic joints, plates, friction. Oracle: Lagrange's equations of
// each chain, positions differentiated (tests/support/lagrange.hpp), with multipliers by elimination.

#include <gtest/gtest.h>

#include "host_sim/problems/closed_chains.hpp"
#include "tests/support/random_mechanism.hpp"

namespace esmc::test {
namespace {

using R = Link<Joint::revolute>;
using Rp = Link<Joint::revolute, Shape::plate>;
using Pp = Link<Joint::prismatic, Shape::plate>;
using Long = Serial<double, Rp, Pp, Rp>;
using Short = Serial<double, R, R>;

template <std::size_t N>
List<Body<double>, static_cast<int>(N)> bodies(Random& r, Chain<N>& oracle, bool plates) {
  List<Body<double>, static_cast<int>(N)> out{};
  for (std::size_t i = 0; i < N; ++i) {
    Body<double>& b = out[static_cast<int>(i)];
    b = {r.in<double>(0.2, 0.5), r.in<double>(-0.1, 0.4), plates ? r.in<double>(-0.2, 0.2) : 0.0,
         r.in<double>(0.1, 1),   r.in<double>(0.01, 0.1), r.in<double>(0, 0.1),
         r.in<double>(0, 0.1)};
    oracle.bar[i] = {Real(b.length),  Real(b.centre),  Real(b.centre_across), Real(b.mass),
                     Real(b.inertia), Real(b.viscous), Real(b.coulomb)};
  }
  return out;
}

/// Tip of the chain, its derivative along `a`, its second derivative along `a` twice.
template <std::size_t N>
std::array<Row<2>, 3> tip(const Chain<N>& c, const Row<N>& q, const Row<N>& a) {
  const auto x = c.tip(along(q, a, a, Row<N>{}));
  return {{{x[0].v.v, x[1].v.v}, {x[0].v.d, x[1].v.d}, {x[0].d.d, x[1].d.d}}};
}

/// Fills in the block of one chain: mass, free force, and the derivatives of its tip with the closure's sign.
template <std::size_t N, std::size_t M>
void add_chain(const Chain<N>& c, const Row<N>& q, const Row<N>& v, const Row<N>& load, std::size_t first,
               Real sign, Square<M>& A, Row<M>& b) {
  constexpr std::size_t coordinates = M - 2;
  const auto eq = lagrange(c, q, v);
  for (std::size_t i = 0; i < N; ++i) {
    for (std::size_t j = 0; j < N; ++j) A[first + i][first + j] = eq.mass[i][j];
    b[first + i] = load[i] - resist(c.bar[i], v[i]) - eq.rest[i];
    Row<N> unit{};
    unit[i] = 1;
    const auto column = tip(c, q, unit)[1];
    for (std::size_t k = 0; k < 2; ++k)
      A[coordinates + k][first + i] = A[first + i][coordinates + k] = sign * column[k];
  }
  for (std::size_t k = 0; k < 2; ++k) b[coordinates + k] -= sign * tip(c, q, v)[2][k];
}

template <std::size_t N, class V>
Row<N> part(const V& v, int first) {
  Row<N> out{};
  for (std::size_t i = 0; i < N; ++i) out[i] = Real(v[first + static_cast<int>(i)]);
  return out;
}

/// The tips of both chains on one another.
TEST(ClosedChains, AccelerationsAreLagrangeWithMultipliers) {
  using Mechanism = host::ClosedChains<host::Closures<host::TipOnTip<0, 1>>, Long, Short>;
  static_assert(Mechanism::coordinates == 5 && Mechanism::rows == 2);
  Accuracy acceleration("acceleration"), gap("gap");
  for (std::uint64_t seed = 0; seed < 300; ++seed) {
    Random r(seed);
    Chain<3> a;
    Chain<2> b;
    a.slides = {false, true, false};
    a.gravity = b.gravity = Real(9.81);
    const Long first(bodies(r, a, true), 9.81);
    const Short second(bodies(r, b, false), 9.81);
    Mechanism::Mounting mounting;
    mounting.base = {{r.vector<double, 2>(1), r.vector<double, 2>(1)}};
    mounting.zero = r.vector<double, 5>(1);
    const Mechanism m(first, second, mounting);
    Vec<double, 5> q = r.vector<double, 5>(1);
    const Vec<double, 5> v = r.vector<double, 5>(3), load = r.vector<double, 5>(2);
    q[4] = std::copysign(0.5 + std::fabs(q[4]), q[4]) - mounting.zero[4];  // no elbow stretched
    const auto got = m.acceleration(q, v, [&](const auto&, Vec<double, 5>& force) { force += load; });

    // The sum of q and zero is rounded; the oracle takes it as it is.
    const Vec<double, 5> turned = q + mounting.zero;
    const Row<3> qa = part<3>(turned, 0);
    const Row<2> qb = part<2>(turned, 3);
    Square<7> A{};
    Row<7> right{};
    add_chain(a, qa, part<3>(v, 0), part<3>(load, 0), 0, Real(1), A, right);
    add_chain(b, qb, part<2>(v, 3), part<2>(load, 3), 3, Real(-1), A, right);
    const auto x = eliminate(A, right);
    Vec<Real, 5> want;
    for (int i = 0; i < 5; ++i) want[i] = x[static_cast<unsigned>(i)];
    acceleration.compare(seed, got, want, 10);

    const auto ta = tip(a, qa, part<3>(v, 0))[0], tb = tip(b, qb, part<2>(v, 3))[0];
    const auto open = m.gap(q);
    for (int i = 0; i < 2; ++i) {
      const auto k = static_cast<unsigned>(i);
      const Real base_a = Real(mounting.base[0][i]), base_b = Real(mounting.base[1][i]);
      gap.take(seed, std::fabs(Real(open[i]) - (base_a + ta[k] - base_b - tb[k])));
    }
  }
  acceleration.expect_below(1e-13);
  gap.expect_below(2e-15);
}

}  // namespace
}  // namespace esmc::test
