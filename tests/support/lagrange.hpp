#pragma once
/// The oracle: planar mechanisms written as positions only, in long double. Rates, biases, inertia and forces
/// all come from differentiating positions and energies; no Jacobian, recursion or mirrored frame is shared
/// with firmware/. About 1e-18 x the condition of what is asked.

#include "tests/support/dual.hpp"

namespace esmc::test {

/// Constants of one bar: the mass centre at `centre` along it and `across` to its left.
struct Bar {
  Real length = 0, centre = 0, across = 0, mass = 0, inertia = 0;
  Real viscous = 0, coulomb = 0;  ///< of the joint that carries it
};

inline Real resist(const Bar& b, Real rate) {
  const Real direction = rate > 0 ? Real(1) : (rate < 0 ? Real(-1) : Real(0));
  return b.viscous * rate + b.coulomb * direction;
}

/// Kinetic energy from positions: every inertial coordinate k carries ½ weight_k (its rate)^2.
template <class Model, class T>
T kinetic(const Model& m, const std::array<T, Model::n>& q, const std::array<T, Model::n>& qd) {
  const auto c = m.inertial(along(q, qd));
  const auto w = m.weight();
  T sum = Real(0);
  for (std::size_t k = 0; k < c.size(); ++k) sum += T(w[k]) * c[k].d * c[k].d;
  return T(Real(0.5)) * sum;
}

/// M(q) and the rest of d/dt dT/dqd - dT/dq + dV/dq = M qdd + rest.
template <class Model>
struct LagrangeForm {
  Square<Model::n> mass{};
  Row<Model::n> rest{};
};

template <class Model>
LagrangeForm<Model> lagrange(const Model& m, const Row<Model::n>& q, const Row<Model::n>& qd) {
  constexpr std::size_t n = Model::n;
  using D = Dual<Real>;
  using DD = Dual<D>;
  const auto unit = [](std::size_t i) {
    Row<n> u{};
    u[i] = 1;
    return u;
  };
  LagrangeForm<Model> out;
  const Row<n> zero{};
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = 0; j < n; ++j) {
      out.mass[i][j] =
          kinetic<Model, DD>(m, along(q, zero, zero, zero), along(qd, unit(i), unit(j), zero)).d.d;
    }
    // d/dq (dT/dqd_i) along the motion, less dT/dq_i, plus dV/dq_i
    out.rest[i] = kinetic<Model, DD>(m, along(q, zero, qd, zero), along(qd, unit(i), zero, zero)).d.d -
                  kinetic<Model, D>(m, along(q, unit(i)), along(qd, zero)).d +
                  m.potential(along(q, unit(i))).d;
  }
  return out;
}

template <class Model>
Real energy(const Model& m, const Row<Model::n>& q, const Row<Model::n>& qd) {
  return kinetic<Model, Real>(m, q, qd) + m.potential(q);
}

/// Values, rates and accelerations of the channels of model.md section 4 (coordinates q, rates p, p').
template <class Model>
auto channel_rates(const Model& m, const Row<Model::n>& q, const Row<Model::n>& qd) {
  const auto c = m.channels(along(q, qd));
  std::array<Real, Model::rows> out;
  for (std::size_t i = 0; i < out.size(); ++i) out[i] = c[i].d;
  return out;
}
/// Second derivative along a and b: with a = b = qd and ab = qdd the accelerations.
template <class Model>
auto channel_accelerations(const Model& m, const Row<Model::n>& q, const Row<Model::n>& a,
                           const Row<Model::n>& b, const Row<Model::n>& ab) {
  const auto c = m.channels(along(q, a, b, ab));
  std::array<Real, Model::rows> out;
  for (std::size_t i = 0; i < out.size(); ++i) out[i] = c[i].d.d;
  return out;
}

/// An open chain of N bars in its own frame; joint i turns bar i (angle relative to bar i-1) or, if
/// `slides`, moves it along its own axis by q_i. Channels in the order of firmware's Serial: joint
/// coordinates, bar angles, mass centres.
template <std::size_t N>
struct Chain {
  static constexpr std::size_t n = N;
  static constexpr std::size_t rows = 4 * N;
  std::array<Bar, N> bar{};
  std::array<bool, N> slides{};
  Real gravity = 0;

  template <class T>
  std::array<T, rows> channels(const std::array<T, N>& q) const {
    std::array<T, rows> out;
    T angle = Real(0), x = Real(0), y = Real(0);
    for (std::size_t i = 0; i < N; ++i) {
      if (!slides[i]) angle += q[i];
      const T c = cosine(angle), s = sine(angle), slide = slides[i] ? q[i] : T(Real(0));
      x += slide * c;
      y += slide * s;
      out[i] = q[i];
      out[N + i] = angle;
      out[2 * N + 2 * i] = x + T(bar[i].centre) * c - T(bar[i].across) * s;
      out[2 * N + 2 * i + 1] = y + T(bar[i].centre) * s + T(bar[i].across) * c;
      x += T(bar[i].length) * c;
      y += T(bar[i].length) * s;
    }
    return out;
  }
  template <class T>
  std::array<T, 2> tip(const std::array<T, N>& q) const {
    Chain end = *this;  // a mass centre at the tip of the last bar
    end.bar[N - 1].centre = bar[N - 1].length;
    end.bar[N - 1].across = 0;
    const auto c = end.channels(q);
    return {c[rows - 2], c[rows - 1]};
  }
  template <class T>
  std::array<T, rows> inertial(const std::array<T, N>& q) const {
    return channels(q);
  }
  [[nodiscard]] std::array<Real, rows> weight() const {
    std::array<Real, rows> w{};
    for (std::size_t i = 0; i < N; ++i) {
      w[N + i] = bar[i].inertia;
      w[2 * N + 2 * i] = w[2 * N + 2 * i + 1] = bar[i].mass;
    }
    return w;
  }
  template <class T>
  T potential(const std::array<T, N>& q) const {
    const auto c = channels(q);
    T sum = Real(0);
    for (std::size_t i = 0; i < N; ++i) sum += T(gravity * bar[i].mass) * c[2 * N + 2 * i + 1];
    return sum;
  }
  /// Joint accelerations under joint torques (forces) tau and friction.
  [[nodiscard]] Row<N> accelerate(const Row<N>& q, const Row<N>& qd, const Row<N>& tau) const {
    const auto eq = lagrange(*this, q, qd);
    Row<N> right;
    for (std::size_t i = 0; i < N; ++i) right[i] = tau[i] - resist(bar[i], qd[i]) - eq.rest[i];
    return eliminate(eq.mass, right);
  }
};

/// The 5R in redundant inertial coordinates: x, y of the effector and the four bar angles, counter-clockwise
/// in N (leg 1 at +l0: proximal, distal; leg 2 at -l0: proximal, distal), held together by four closure
/// equations.
struct FiveBarModel {
  static constexpr std::size_t n = 6;
  static constexpr std::size_t rows = 18;
  using Q = Row<n>;
  std::array<Bar, 4> bar{};
  Real half_base = 0, effector_mass = 0, gravity = 0;

  /// x, y, then per bar the mass centre and the angle, all in N.
  template <class T>
  std::array<T, 14> inertial(const std::array<T, n>& q) const {
    std::array<T, 14> out;
    out[0] = q[0];
    out[1] = q[1];
    for (std::size_t leg = 0; leg < 2; ++leg) {
      T x = leg == 0 ? half_base : -half_base, y = Real(0);
      for (std::size_t k = 2 * leg; k < 2 * leg + 2; ++k) {
        const T c = cosine(q[2 + k]), s = sine(q[2 + k]);
        out[2 + 3 * k] = x + T(bar[k].centre) * c;
        out[3 + 3 * k] = y + T(bar[k].centre) * s;
        out[4 + 3 * k] = q[2 + k];
        x += T(bar[k].length) * c;
        y += T(bar[k].length) * s;
      }
    }
    return out;
  }
  [[nodiscard]] std::array<Real, 14> weight() const {
    std::array<Real, 14> w{effector_mass, effector_mass};
    for (std::size_t k = 0; k < 4; ++k) {
      w[2 + 3 * k] = w[3 + 3 * k] = bar[k].mass;
      w[4 + 3 * k] = bar[k].inertia;
    }
    return w;
  }
  template <class T>
  T potential(const std::array<T, n>& q) const {
    const auto c = inertial(q);
    T sum = T(gravity * effector_mass) * c[1];
    for (std::size_t k = 0; k < 4; ++k) sum += T(gravity * bar[k].mass) * c[3 + 3 * k];
    return sum;
  }
  /// Tip of leg 1 less the effector, tip of leg 2 less the effector.
  template <class T>
  std::array<T, 4> closure(const std::array<T, n>& q) const {
    std::array<T, 4> out;
    for (std::size_t leg = 0; leg < 2; ++leg) {
      const T& a = q[2 + 2 * leg];
      const T& b = q[3 + 2 * leg];
      const T base = leg == 0 ? half_base : -half_base, l1 = bar[2 * leg].length,
              l2 = bar[2 * leg + 1].length;
      out[2 * leg] = base + l1 * cosine(a) + l2 * cosine(b) - q[0];
      out[2 * leg + 1] = l1 * sine(a) + l2 * sine(b) - q[1];
    }
    return out;
  }
  /// The 18 channels of model.md section 9, leg 2 seen in its mirrored frame.
  template <class T>
  std::array<T, rows> channels(const std::array<T, n>& q) const {
    const auto c = inertial(q);
    const T pi = 3.14159265358979323846264338327950288L, base = half_base;
    const T mirror_a = pi - q[4], mirror_b = pi - q[5];
    return {q[0],
            q[1],
            q[2],
            q[3] - q[2],
            q[2],
            q[3],
            c[2] - base,
            c[3],
            c[5] - base,
            c[6],
            mirror_a,
            mirror_b - mirror_a,
            mirror_a,
            mirror_b,
            -(c[8] + base),
            c[9],
            -(c[11] + base),
            c[12]};
  }

  [[nodiscard]] std::array<Row<n>, 4> closure_jacobian(const Q& q) const {
    std::array<Row<n>, 4> J{};
    for (std::size_t j = 0; j < n; ++j) {
      Q unit{};
      unit[j] = 1;
      const auto c = closure(along(q, unit));
      for (std::size_t i = 0; i < 4; ++i) J[i][j] = c[i].d;
    }
    return J;
  }
  /// Second derivative of the closure along a and b.
  [[nodiscard]] Row<4> closure_curvature(const Q& q, const Q& a, const Q& b) const {
    const auto c = closure(along(q, a, b, Q{}));
    return {c[0].d.d, c[1].d.d, c[2].d.d, c[3].d.d};
  }
  /// Fills in the coordinates that are not in `known` so that closure_jacobian x = right.
  [[nodiscard]] Q complete(const Q& q, std::array<std::size_t, 2> known, Q x, const Row<4>& right) const {
    const auto J = closure_jacobian(q);
    Square<4> A{};
    Row<4> b = right;
    std::array<std::size_t, 4> free{};
    std::size_t count = 0;
    for (std::size_t j = 0; j < n; ++j) {
      const bool is_known = j == known[0] || j == known[1];
      for (std::size_t i = 0; i < 4; ++i) {
        if (is_known)
          b[i] -= J[i][j] * x[j];
        else
          A[i][count] = J[i][j];
      }
      if (!is_known) free[count++] = j;
    }
    const Row<4> y = eliminate(A, b);
    for (std::size_t j = 0; j < 4; ++j) x[free[j]] = y[j];
    return x;
  }
  /// Closes the loop by Newton's method, the coordinates in `known` held.
  [[nodiscard]] Q close(Q q, std::array<std::size_t, 2> known) const {
    for (int step = 0; step < 8; ++step) {
      const auto c = closure(q);
      const Q move = complete(q, known, Q{}, {-c[0], -c[1], -c[2], -c[3]});
      for (std::size_t j = 0; j < n; ++j) q[j] += move[j];
    }
    return q;
  }
  static constexpr std::array<std::size_t, 2> by_effector{0, 1};
  static constexpr std::array<std::size_t, 2> by_base{2, 4};

  /// Rates (and accelerations, given what `right` the closure asks) from two known ones.
  [[nodiscard]] Q rates(const Q& q, std::array<std::size_t, 2> known, Real first, Real second) const {
    Q x{};
    x[known[0]] = first;
    x[known[1]] = second;
    return complete(q, known, x, {});
  }
  [[nodiscard]] Q accelerations(const Q& q, const Q& a, const Q& b, std::array<std::size_t, 2> known,
                                Real first, Real second) const {
    const Row<4> k = closure_curvature(q, a, b);
    Q x{};
    x[known[0]] = first;
    x[known[1]] = second;
    return complete(q, known, x, {-k[0], -k[1], -k[2], -k[3]});
  }

  /// Rates of the joints in the order theta11, theta12, theta21, theta22 of the model (leg 2 clockwise).
  static Row<4> joint_rates(const Q& qd) { return {qd[2], qd[3] - qd[2], -qd[4], -(qd[5] - qd[4])}; }

  /// Accelerations of all six coordinates under joint torques (in the same order), friction and gravity.
  [[nodiscard]] Q accelerate(const Q& q, const Q& qd, const Row<4>& tau) const {
    const auto eq = lagrange(*this, q, qd);
    const auto J = closure_jacobian(q);
    const Row<4> rate = joint_rates(qd), k = closure_curvature(q, qd, qd);
    Row<4> t;
    for (std::size_t i = 0; i < 4; ++i) t[i] = tau[i] - resist(bar[i], rate[i]);
    // Virtual work t . d theta, joint by joint.
    const Q force{0, 0, t[0] - t[1], t[1], -(t[2] - t[3]), -t[3]};
    Square<10> A{};
    Row<10> b{};
    for (std::size_t i = 0; i < n; ++i) {
      for (std::size_t j = 0; j < n; ++j) A[i][j] = eq.mass[i][j];
      for (std::size_t c = 0; c < 4; ++c) A[i][n + c] = A[n + c][i] = J[c][i];
      b[i] = force[i] - eq.rest[i];
    }
    for (std::size_t c = 0; c < 4; ++c) b[n + c] = -k[c];
    const Row<10> x = eliminate(A, b);
    return {x[0], x[1], x[2], x[3], x[4], x[5]};
  }
  /// D2 = sin(phi12 + phi22) and sin theta_j2 with the signs of model.md.
  static Real sin_type2(const Q& q) { return std::sin(q[3] - q[5]) * Real(-1); }
  static Real sin_type1(const Q& q, int leg) {
    return leg == 0 ? std::sin(q[3] - q[2]) : -std::sin(q[5] - q[4]);
  }
};

}  // namespace esmc::test
