#pragma once
/// A plant of its own for judging simulation.accuracy and `esmc check`: bodies in Cartesian coordinates (x,
/// y, angle of each bar) held together by forces at the joints, small steps of RK4, its own search for
/// events. It shares neither coordinates nor equations nor code with the program.

#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>
#include <vector>

namespace judge {

using Vector = std::vector<double>;

/// A x = b by elimination with pivots; A is row by row, both are used up.
inline Vector solve(Vector a, Vector b) {
  const std::size_t n = b.size();
  for (std::size_t k = 0; k < n; ++k) {
    std::size_t p = k;
    for (std::size_t i = k + 1; i < n; ++i)
      if (std::abs(a[i * n + k]) > std::abs(a[p * n + k])) p = i;
    if (p != k) {
      for (std::size_t j = 0; j < n; ++j) std::swap(a[k * n + j], a[p * n + j]);
      std::swap(b[k], b[p]);
    }
    for (std::size_t i = k + 1; i < n; ++i) {
      const double f = a[i * n + k] / a[k * n + k];
      if (f == 0.0) continue;
      for (std::size_t j = k; j < n; ++j) a[i * n + j] -= f * a[k * n + j];
      b[i] -= f * b[k];
    }
  }
  for (std::size_t k = n; k-- > 0;) {
    for (std::size_t j = k + 1; j < n; ++j) b[k] -= a[k * n + j] * b[j];
    b[k] /= a[k * n + k];
  }
  return b;
}

struct Leg {
  double l1, l2, lg1, lg2, m1, m2, J1, J2;
};
struct Wave {
  double offset = 0, amp = 0, omega = 0, phase = 0;
  [[nodiscard]] double at(double t) const { return offset + amp * std::sin(omega * t + phase); }
  [[nodiscard]] double rate(double t) const { return amp * omega * std::cos(omega * t + phase); }
};

struct Case {
  bool five_bar = false, closed = false;
  std::array<Leg, 2> leg{};
  double base = 0.05, effector_mass = 0.0, gravity = 9.8, duration = 1.0;
  std::array<double, 2> start{}, start_rate{};  ///< base joints; the arm: both
  std::array<Wave, 2> wave{};                   ///< torque of each motor, or reference of each base joint
  double kp = 0, kd = 0, torque_max = 0;
  bool rubs = false, stops = false, soft = false, gear = false, play = false, load = false;
  std::array<double, 4> friction{};
  std::array<double, 4> viscous{};
  std::array<double, 2> lower{}, upper{};
  double restitution = 0, stop_stiffness = 0;
  double gear_stiffness = 0, gear_damping = 0, rotor = 0, gap = 0;
  double load_mass = 0, load_from = 0, load_to = 0;
  // Of verdict_judge only:
  std::size_t motors = 2;                   ///< 4: on the passive joints, too
  double lag = 0;                           ///< s, of the torque behind its command
  std::array<double, 2> force{}, anchor{};  ///< N; m
  double hand_stiffness = 0, hand_damping = 0;
  bool rough = false;  ///< events to 1e-9 s only, and at most 40 of them per step
};

class Plant {
 public:
  explicit Plant(const Case& c) : c_(c), bars_(c.five_bar ? 4 : 2), joints_(bars_) {
    const double pi = std::acos(-1.0);
    if (c.five_bar) {
      const double a = c.start[0], b = pi - c.start[1], r1 = c.leg[0].l2, r2 = c.leg[1].l2;
      const double ax = c.base + c.leg[0].l1 * std::cos(a), ay = c.leg[0].l1 * std::sin(a),
                   bx = -c.base + c.leg[1].l1 * std::cos(b), by = c.leg[1].l1 * std::sin(b);
      const double dx = bx - ax, dy = by - ay, d = std::hypot(dx, dy),
                   along = (d * d + r1 * r1 - r2 * r2) / (2.0 * d), h = std::sqrt(r1 * r1 - along * along);
      double nx = -dy / d, ny = dx / d;
      if (ny < 0) nx = -nx, ny = -ny;
      const double tx = ax + along * dx / d + h * nx, ty = ay + along * dy / d + h * ny;
      phi_ = {a, std::atan2(ty - ay, tx - ax), b, std::atan2(ty - by, tx - bx)};
    } else {
      phi_ = {c.start[0], c.start[0] + c.start[1]};
    }
    place();
    state_.assign(lag_at(c.motors), 0.0);
    std::copy(q_.begin(), q_.end(), state_.begin());
    for (std::size_t m = 0; m < c.motors; ++m) state_[rotor_at(m)] = angle(state_, motor(m));
    // Rates of the start: an impulse that gives the base joints theirs.
    if (c.start_rate[0] != 0.0 || c.start_rate[1] != 0.0) {
      const std::vector<std::size_t> both{base(0), base(1)};
      const Vector v = constrained(state_, Vector(coordinates(), 0.0), Vector(rows(), 0.0), both,
                                   {c.start_rate[0], c.start_rate[1]})
                           .first;
      std::copy(v.begin(), v.end(), state_.begin() + static_cast<long>(coordinates()));
      for (std::size_t m = 0; m < c.motors; ++m) state_[spin_at(m)] = joint_rate(state_, motor(m));
    }
    begin_modes();
  }

  /// Runs the case in steps of at most `step`; returns q as final_state has it, empty: it went wrong.
  Vector run(double step, double tick) {
    const auto ticks = static_cast<std::size_t>(std::llround(c_.duration / tick));
    const auto parts = static_cast<std::size_t>(std::ceil(tick / step - 1e-9));
    for (std::size_t n = 0; n < ticks; ++n) {
      const double t = static_cast<double>(n) * tick;
      if (c_.closed) {
        for (std::size_t m = 0; m < 2; ++m) {
          const double e = c_.wave[m].at(t) - seen(m), ed = c_.wave[m].rate(t) - seen_rate(m);
          held_torque_[m] = std::min(std::max(c_.kp * e + c_.kd * ed, -c_.torque_max), c_.torque_max);
        }
      }
      Vector stamps{t, t + tick};
      for (const double s : {c_.load_from, c_.load_to})
        if (c_.load && s > t + 1e-12 && s < t + tick - 1e-12) stamps.insert(stamps.end() - 1, s);
      for (std::size_t k = 0; k + 1 < stamps.size(); ++k) {
        const double middle = 0.5 * (stamps[k] + stamps[k + 1]);
        loaded_ = c_.load && middle > c_.load_from && middle < c_.load_to;
        judge_rest(stamps[k]);
        const double h = (stamps[k + 1] - stamps[k]) / static_cast<double>(parts);
        for (std::size_t i = 0; i < parts; ++i)
          if (!advance(stamps[k] + static_cast<double>(i) * h, h)) return {};
      }
    }
    Vector out;
    if (c_.five_bar) {
      const double d = length(1) - centre(1);
      out = {state_[3] + d * std::cos(state_[5]), state_[4] + d * std::sin(state_[5])};
    }
    for (std::size_t j = 0; j < joints_; ++j) out.push_back(angle(state_, j));
    for (const double v : out)
      if (!std::isfinite(v)) return {};
    return out;
  }
  /// Moves the plant from t, s, over h under constant torques of the motors, with or without payload and
  /// force. False: it went wrong.
  bool move(double t, double h, const std::array<double, 4>& torque, bool loaded, bool pushed) {
    held_torque_ = torque;
    loaded_ = loaded;
    pushed_ = pushed;
    judge_rest(t);
    return advance(t, h);
  }
  /// Angle and rate of joint j: as the encoder on its motor sees it, or of the joint without one.
  [[nodiscard]] std::array<double, 2> seen_joint(std::size_t j) const {
    for (std::size_t m = 0; m < c_.motors; ++m)
      if (motor(m) == j) return {seen(m), seen_rate(m)};
    return {angle(state_, j), joint_rate(state_, j)};
  }
  [[nodiscard]] long events() const { return events_; }
  /// Turns the first bar by `by`: a perturbed start.
  void nudge(double by) {
    state_[2] += by;
    to_constraints(state_);
    for (std::size_t m = 0; m < c_.motors; ++m) state_[rotor_at(m)] = angle(state_, motor(m));
  }

 private:
  [[nodiscard]] std::size_t coordinates() const { return 3 * bars_; }
  [[nodiscard]] std::size_t rows() const { return c_.five_bar ? 10 : 4; }
  [[nodiscard]] std::size_t rotor_at(std::size_t m) const { return 2 * coordinates() + m; }
  [[nodiscard]] std::size_t spin_at(std::size_t m) const { return rotor_at(c_.motors) + m; }
  [[nodiscard]] std::size_t lag_at(std::size_t m) const { return spin_at(c_.motors) + (c_.lag > 0 ? m : 0); }
  [[nodiscard]] std::size_t base(std::size_t m) const { return c_.five_bar ? 2 * m : m; }
  [[nodiscard]] std::size_t motor(std::size_t m) const { return c_.motors == 4 ? m : base(m); }
  [[nodiscard]] double centre(std::size_t b) const { return b % 2 == 0 ? leg(b).lg1 : leg(b).lg2; }
  [[nodiscard]] double length(std::size_t b) const { return b % 2 == 0 ? leg(b).l1 : leg(b).l2; }
  [[nodiscard]] double mass(std::size_t b) const { return b % 2 == 0 ? leg(b).m1 : leg(b).m2; }
  [[nodiscard]] const Leg& leg(std::size_t b) const { return c_.leg[b / 2]; }
  /// At the tip of bar 1: of the effector and of what it carries.
  [[nodiscard]] double tip_mass() const { return c_.effector_mass + (loaded_ ? c_.load_mass : 0.0); }
  [[nodiscard]] double base_x(std::size_t bar) const {
    return c_.five_bar ? (bar < 2 ? c_.base : -c_.base) : 0.0;
  }

  void place() {
    q_.assign(coordinates(), 0.0);
    for (std::size_t b = 0; b < bars_; ++b) {
      double x = base_x(b), y = 0;
      if (b % 2 == 1) {
        x += length(b - 1) * std::cos(phi_[b - 1]);
        y += length(b - 1) * std::sin(phi_[b - 1]);
      }
      q_[3 * b] = x + centre(b) * std::cos(phi_[b]);
      q_[3 * b + 1] = y + centre(b) * std::sin(phi_[b]);
      q_[3 * b + 2] = phi_[b];
    }
  }

  // Joint j: bar j against bar j - 1 or the ground; the second leg counts the other way.
  [[nodiscard]] double sign(std::size_t j) const { return j < 2 ? 1.0 : -1.0; }
  [[nodiscard]] double angle(const Vector& s, std::size_t j) const {
    const double own = s[3 * j + 2];
    if (j % 2 == 1) return sign(j) * (own - s[3 * j - 1]);
    return j < 2 ? own : std::acos(-1.0) - own;
  }
  [[nodiscard]] double rate(const Vector& v, std::size_t j, std::size_t from) const {
    return sign(j) * (v[from + 3 * j + 2] - (j % 2 == 1 ? v[from + 3 * j - 1] : 0.0));
  }
  [[nodiscard]] double joint_rate(const Vector& s, std::size_t j) const { return rate(s, j, coordinates()); }
  void add_torque(Vector& f, std::size_t j, double torque) const {
    f[3 * j + 2] += sign(j) * torque;
    if (j % 2 == 1) f[3 * j - 1] -= sign(j) * torque;
  }
  [[nodiscard]] double seen(std::size_t m) const {
    return c_.gear ? state_[rotor_at(m)] : angle(state_, motor(m));
  }
  [[nodiscard]] double seen_rate(std::size_t m) const {
    return c_.gear ? state_[spin_at(m)] : joint_rate(state_, motor(m));
  }

  /// Rows of the joints' forces: value, Jacobian (times v gives the rate) and -J' v.
  struct Constraints {
    Vector value, jacobian, bias;
  };
  [[nodiscard]] Constraints constraints(const Vector& s) const {
    const std::size_t n = coordinates(), r = rows();
    Constraints k{Vector(r, 0.0), Vector(r * n, 0.0), Vector(r, 0.0)};
    const auto point = [&](std::size_t row, std::size_t bar, double along, double side) {
      const double c = std::cos(s[3 * bar + 2]), sn = std::sin(s[3 * bar + 2]), w = s[n + 3 * bar + 2];
      k.value[row] += side * (s[3 * bar] + along * c);
      k.value[row + 1] += side * (s[3 * bar + 1] + along * sn);
      k.jacobian[row * n + 3 * bar] += side;
      k.jacobian[row * n + 3 * bar + 2] -= side * along * sn;
      k.jacobian[(row + 1) * n + 3 * bar + 1] += side;
      k.jacobian[(row + 1) * n + 3 * bar + 2] += side * along * c;
      k.bias[row] += side * along * c * w * w;
      k.bias[row + 1] += side * along * sn * w * w;
    };
    for (std::size_t b = 0; b < bars_; ++b) {
      point(2 * b, b, -centre(b), 1.0);
      if (b % 2 == 0) {
        k.value[2 * b] -= base_x(b);
      } else {
        point(2 * b, b - 1, length(b - 1) - centre(b - 1), -1.0);
      }
    }
    if (c_.five_bar) {
      point(8, 1, length(1) - centre(1), 1.0);
      point(8, 3, length(3) - centre(3), -1.0);
    }
    return k;
  }
  /// Inverse of the masses times f. A payload sits at the tip of bar 1: a mass of its own would need its own
  /// coordinates, so it is put onto that bar.
  [[nodiscard]] Vector over_mass(const Vector& s, const Vector& f) const {
    Vector a(f.size());
    for (std::size_t b = 0; b < bars_; ++b) {
      const double m = mass(b), J = b % 2 == 0 ? leg(b).J1 : leg(b).J2, p = b == 1 ? tip_mass() : 0.0;
      if (p == 0.0) {
        a[3 * b] = f[3 * b] / m;
        a[3 * b + 1] = f[3 * b + 1] / m;
        a[3 * b + 2] = f[3 * b + 2] / J;
        continue;
      }
      const double d = length(1) - centre(1), c = std::cos(s[5]), sn = std::sin(s[5]);
      const Vector x =
          solve({m + p, 0, -p * d * sn, 0, m + p, p * d * c, -p * d * sn, p * d * c, J + p * d * d},
                {f[3], f[4], f[5]});
      std::copy(x.begin(), x.end(), a.begin() + 3);
    }
    return a;
  }
  /// Accelerations (or changes of rates) under forces f, with the joints' rows equal to `bias` and the
  /// relative rates of `locked` equal to `wanted`; and the torques that lock.
  [[nodiscard]] std::pair<Vector, Vector> constrained(const Vector& s, const Vector& f, const Vector& bias,
                                                      const std::vector<std::size_t>& locked,
                                                      const Vector& wanted) const {
    const std::size_t n = coordinates(), r0 = rows(), r = r0 + locked.size();
    Vector j = constraints(s).jacobian;
    j.resize(r * n, 0.0);
    Vector right = bias;
    for (std::size_t i = 0; i < locked.size(); ++i) {
      Vector row(n, 0.0);
      add_torque(row, locked[i], 1.0);
      std::copy(row.begin(), row.end(), j.begin() + static_cast<long>((r0 + i) * n));
      right.push_back(wanted[i]);
    }
    const Vector free = over_mass(s, f);
    Vector a(r * r, 0.0);
    std::vector<Vector> by(r);
    for (std::size_t i = 0; i < r; ++i) {
      const auto at = j.begin() + static_cast<long>(i * n);
      by[i] = over_mass(s, Vector(at, at + static_cast<long>(n)));
      for (std::size_t k = 0; k < n; ++k) right[i] -= j[i * n + k] * free[k];
    }
    for (std::size_t i = 0; i < r; ++i)
      for (std::size_t m = 0; m < r; ++m)
        for (std::size_t k = 0; k < n; ++k) a[i * r + m] += j[i * n + k] * by[m][k];
    const Vector force = solve(std::move(a), right);
    Vector out = free;
    for (std::size_t i = 0; i < r; ++i)
      for (std::size_t k = 0; k < n; ++k) out[k] += force[i] * by[i][k];
    return {out, Vector(force.begin() + static_cast<long>(r0), force.end())};
  }
  void to_constraints(Vector& s) const {
    for (int pass = 0; pass < 2; ++pass) {
      Vector value = constraints(s).value;
      for (double& v : value) v = -v;
      const Vector d = constrained(s, Vector(coordinates(), 0.0), value, {}, {}).first;
      for (std::size_t i = 0; i < coordinates(); ++i) s[i] += d[i];
    }
    const std::size_t n = coordinates();
    const Constraints k = constraints(s);
    Vector rest(rows(), 0.0);
    for (std::size_t i = 0; i < rows(); ++i)
      for (std::size_t m = 0; m < n; ++m) rest[i] -= k.jacobian[i * n + m] * s[n + m];
    std::vector<std::size_t> locked;
    Vector wanted;
    if (locked_.size() == 1) locked = locked_, wanted = {-joint_rate(s, locked_[0])};
    const Vector d = constrained(s, Vector(n, 0.0), rest, locked, wanted).first;
    for (std::size_t i = 0; i < n; ++i) s[n + i] += d[i];
  }

  // ---- modes ----
  /// Depth in the stop that the joint of motor m is in.
  [[nodiscard]] double depth(const Vector& s, std::size_t m, int side) const {
    const double q = angle(s, base(m));
    return side > 0 ? q - c_.upper[m] : c_.lower[m] - q;
  }
  [[nodiscard]] double hold_max(const Vector& s, std::size_t j) const {
    double t = c_.rubs ? c_.friction[j] : 0.0;
    for (std::size_t m = 0; m < 2; ++m)
      if (base(m) == j && c_.soft && stop_[m] != 0)
        t += 0.5 * c_.stop_stiffness * (1 - c_.restitution * c_.restitution) *
             std::max(0.0, depth(s, m, stop_[m]));
    return t;
  }
  [[nodiscard]] double through(const Vector& s, std::size_t m) const {
    if (c_.play && tooth_[m] == 0) return 0.0;
    const double twist = s[rotor_at(m)] - angle(s, motor(m)) - (c_.play ? 0.5 * c_.gap * tooth_[m] : 0.0);
    return c_.gear_stiffness * twist + c_.gear_damping * (s[spin_at(m)] - joint_rate(s, motor(m)));
  }
  [[nodiscard]] double followed(double t, const Vector& s, std::size_t m) const {
    return c_.lag > 0 ? s[lag_at(m)] : drive(t, m);
  }
  [[nodiscard]] double drive(double t, std::size_t m) const {
    return c_.closed ? held_torque_[m] : c_.wave[m].at(t);
  }
  /// All forces but the reactions of locked joints.
  [[nodiscard]] Vector forces(double t, const Vector& s) const {
    Vector f(coordinates(), 0.0);
    for (std::size_t b = 0; b < bars_; ++b) f[3 * b + 1] = -mass(b) * c_.gravity;
    const std::size_t n = coordinates();
    const double p = tip_mass(), d = length(1) - centre(1), c = std::cos(s[5]), sn = std::sin(s[5]),
                 w = s[n + 5];
    f[3] += p * d * c * w * w;
    f[4] += p * d * sn * w * w - p * c_.gravity;
    f[5] -= p * c_.gravity * d * c;
    if (pushed_) {
      const double fx = c_.force[0] + c_.hand_stiffness * (c_.anchor[0] - s[3] - d * c) -
                        c_.hand_damping * (s[n + 3] - d * sn * w),
                   fy = c_.force[1] + c_.hand_stiffness * (c_.anchor[1] - s[4] - d * sn) -
                        c_.hand_damping * (s[n + 4] + d * c * w);
      f[3] += fx;
      f[4] += fy;
      f[5] += d * (c * fy - sn * fx);
    }
    for (std::size_t j = 0; j < joints_; ++j) {
      double torque = -c_.viscous[j] * joint_rate(s, j);
      if (!is_locked(j)) torque -= way_[j] * hold_max(s, j);
      add_torque(f, j, torque);
    }
    for (std::size_t m = 0; m < c_.motors; ++m)
      add_torque(f, motor(m), c_.gear ? through(s, m) : followed(t, s, m));
    for (std::size_t m = 0; m < 2; ++m) {
      if (!c_.soft || stop_[m] == 0) continue;
      add_torque(f, base(m),
                 -0.5 * c_.stop_stiffness * (1 + c_.restitution * c_.restitution) * stop_[m] *
                     std::max(0.0, depth(s, m, stop_[m])));
    }
    return f;
  }
  [[nodiscard]] bool is_locked(std::size_t j) const {
    for (const std::size_t l : locked_)
      if (l == j) return true;
    return false;
  }
  [[nodiscard]] Vector slope(double t, const Vector& s) const {
    const std::size_t n = coordinates();
    Vector d(s.size(), 0.0);
    if (locked_.size() < 2) {
      const Vector a =
          constrained(s, forces(t, s), constraints(s).bias, locked_, Vector(locked_.size(), 0.0)).first;
      for (std::size_t i = 0; i < n; ++i) {
        d[i] = s[n + i];
        d[n + i] = a[i];
      }
    }
    for (std::size_t m = 0; m < c_.motors; ++m) {
      if (c_.lag > 0) d[lag_at(m)] = (drive(t, m) - s[lag_at(m)]) / c_.lag;
      if (!c_.gear) continue;
      d[rotor_at(m)] = s[spin_at(m)];
      d[spin_at(m)] = (followed(t, s, m) - through(s, m)) / c_.rotor;
    }
    return d;
  }
  [[nodiscard]] Vector stepped(double t, double h, const Vector& s) const {
    const auto plus = [](const Vector& a, double k, const Vector& b) {
      Vector out = a;
      for (std::size_t i = 0; i < a.size(); ++i) out[i] += k * b[i];
      return out;
    };
    const Vector k1 = slope(t, s), k2 = slope(t + h / 2, plus(s, h / 2, k1)),
                 k3 = slope(t + h / 2, plus(s, h / 2, k2)), k4 = slope(t + h, plus(s, h, k3));
    Vector out = s;
    for (std::size_t i = 0; i < s.size(); ++i) out[i] += h / 6 * (k1[i] + 2 * k2[i] + 2 * k3[i] + k4[i]);
    if (locked_.size() < 2) to_constraints(out);
    return out;
  }

  /// Free accelerations of the joints in `who`, and what a unit torque at each does to all of them.
  struct Yield {
    Vector free;
    std::vector<Vector> by;
  };
  [[nodiscard]] Yield yields(double t, const Vector& s, std::vector<std::size_t> who) {
    const std::vector<std::size_t> kept = std::exchange(locked_, {});
    const std::array<int, 4> ways = way_;
    for (const std::size_t j : who) way_[j] = 0;
    Yield y;
    const Vector a = constrained(s, forces(t, s), constraints(s).bias, {}, {}).first;
    for (const std::size_t j : who) y.free.push_back(rate(a, j, 0));
    for (const std::size_t j : who) {
      Vector f(coordinates(), 0.0);
      add_torque(f, j, 1.0);
      const Vector b = constrained(s, f, Vector(rows(), 0.0), {}, {}).first;
      y.by.emplace_back();
      for (const std::size_t k : who) y.by.back().push_back(rate(b, k, 0));
    }
    way_ = ways;
    locked_ = kept;
    return y;
  }
  /// Accelerations of the joints at rest under the best reactions within their bounds, by relaxation.
  [[nodiscard]] Vector relaxed(double t, const Vector& s, std::vector<std::size_t> who) {
    const Yield y = yields(t, s, who);
    Vector a = y.free, r(who.size(), 0.0);
    for (int sweep = 0; sweep < 20000; ++sweep) {
      double change = 0;
      for (std::size_t i = 0; i < who.size(); ++i) {
        double low = -hold_max(s, who[i]), high = -low;
        for (std::size_t m = 0; m < 2; ++m) {
          if (base(m) != who[i] || c_.soft || stop_[m] == 0) continue;
          (stop_[m] > 0 ? low : high) = stop_[m] > 0 ? -1e30 : 1e30;
        }
        const double next = std::min(std::max(r[i] - a[i] / y.by[i][i], low), high), d = next - r[i];
        r[i] = next;
        for (std::size_t k = 0; k < who.size(); ++k) a[k] += d * y.by[i][k];
        change = std::max(change, std::abs(d * y.by[i][i]));
      }
      if (change < 1e-15) break;
    }
    return a;
  }
  static constexpr double still = 1e-9;  // rad/s2: an acceleration that is none

  [[nodiscard]] std::vector<std::size_t> resting() const {
    std::vector<std::size_t> out;
    for (std::size_t j = 0; j < joints_; ++j) {
      bool wall = false;
      for (std::size_t m = 0; m < 2; ++m) wall = wall || (base(m) == j && stop_[m] != 0 && !c_.soft);
      if ((wall || hold_max(state_, j) > 0) && std::abs(joint_rate(state_, j)) < 1e-10) out.push_back(j);
    }
    return out;
  }
  /// Who stays at rest at t, of those without rate.
  void judge_rest(double t) {
    const std::vector<std::size_t> who = resting();
    locked_.clear();
    if (who.empty()) return;
    const Vector a = relaxed(t, state_, who);
    for (std::size_t i = 0; i < who.size(); ++i) {
      const std::size_t j = who[i];
      if (std::abs(a[i]) <= still) {
        locked_.push_back(j);
      } else {
        way_[j] = a[i] > 0 ? 1 : -1;
        for (std::size_t m = 0; m < 2; ++m)
          if (base(m) == j && !c_.soft && stop_[m] == -way_[j]) stop_[m] = 0;
      }
    }
    if (locked_.size() > 1)
      for (std::size_t i = 0; i < coordinates(); ++i) state_[coordinates() + i] = 0;
  }
  void begin_modes() {
    for (std::size_t j = 0; j < joints_; ++j) way_[j] = joint_rate(state_, j) > 0 ? 1 : -1;
    tooth_ = {};
    stop_ = {0, 0};
    locked_.clear();
  }

  /// Whether the modes of `s` (at t) are still those in force. Beyond by rounding only counts as in force.
  [[nodiscard]] bool in_force(double t, const Vector& s) {
    for (std::size_t j = 0; j < joints_; ++j)
      if (!is_locked(j) && hold_max(s, j) > 0 && way_[j] * joint_rate(s, j) < -1e-12) return false;
    if (!locked_.empty()) {
      for (const double a : relaxed(t, s, locked_))
        if (std::abs(a) > still) return false;
    }
    for (std::size_t m = 0; c_.stops && m < 2; ++m) {
      for (const int side : {-1, 1})
        if (stop_[m] == 0 && depth(s, m, side) > 1e-13) return false;
      if (c_.soft && stop_[m] != 0 && depth(s, m, stop_[m]) < -1e-13) return false;
    }
    for (std::size_t m = 0; c_.play && m < c_.motors; ++m) {
      for (const int side : {-1, 1}) {
        if (tooth_[m] == 0 && pressed(s, m, side) > 1e-13) return false;
        if (tooth_[m] == side && pressed(s, m, side) < -1e-13) return false;
      }
    }
    return true;
  }
  /// > 0: flank `side` of gear m presses.
  [[nodiscard]] double pressed(const Vector& s, std::size_t m, int side) const {
    const double deep = side * (s[rotor_at(m)] - angle(s, motor(m))) - 0.5 * c_.gap;
    const double force =
        c_.gear_stiffness * deep + c_.gear_damping * side * (s[spin_at(m)] - joint_rate(s, motor(m)));
    return deep > 0 ? std::min(deep, force) : deep;
  }

  bool advance(double t, double h) {
    for (int events = 0; h > 0; ++events) {
      const bool accepted = events > 40 && c_.rough;
      if (events > 400 && !accepted) return false;
      Vector next = stepped(t, h, state_);
      for (const double v : next)
        if (!std::isfinite(v)) return false;
      if (accepted || in_force(t + h, next)) {
        state_ = std::move(next);
        if (accepted) change_modes(t + h);
        return true;
      }
      double low = 0, high = h;
      while (high - low > 1e-16 + 1e-14 * h) {
        const double middle = 0.5 * (low + high);
        if (in_force(t + middle, stepped(t, middle, state_))) {
          low = middle;
        } else {
          high = middle;
        }
        if (high - low < (c_.rough ? 1e-9 : 1e-15)) break;
      }
      state_ = stepped(t, high, state_);
      t += high;
      h -= high;
      change_modes(t);
      ++events_;
    }
    return true;
  }
  void change_modes(double t) {
    bool hit = false;
    for (std::size_t m = 0; c_.play && m < c_.motors; ++m) {
      for (const int side : {-1, 1}) {
        const double p = pressed(state_, m, side);
        if (tooth_[m] == 0 && p > 1e-13) {
          tooth_[m] = side;
        } else if (tooth_[m] == side && p < -1e-13) {
          tooth_[m] = 0;
        }
      }
    }
    for (std::size_t m = 0; c_.stops && m < 2; ++m) {
      for (const int side : {-1, 1}) {
        if (stop_[m] == 0 && depth(state_, m, side) > 1e-13) {
          stop_[m] = side;
          hit = hit || !c_.soft;
          const std::size_t j = base(m);
          if (c_.soft && !is_locked(j)) way_[j] = joint_rate(state_, j) > 0 ? 1 : -1;
        } else if (c_.soft && stop_[m] == side && depth(state_, m, side) < -1e-13) {
          stop_[m] = 0;
        }
      }
    }
    if (hit) impact();
    // A rate that has passed zero is zero: its joint rests, or turns if others still move it (a dead point).
    for (std::size_t j = 0; j < joints_; ++j) {
      const double w = joint_rate(state_, j);
      if (is_locked(j) || hold_max(state_, j) == 0 || way_[j] * w >= -1e-12 || hit) continue;
      bool others = false;
      for (std::size_t k = 0; k < joints_; ++k)
        others = others || (k != j && std::abs(joint_rate(state_, k)) > 1e-8);
      if (!locked_.empty() && others) {
        way_[j] = -way_[j];
        continue;
      }
      const Vector d = constrained(state_, Vector(coordinates(), 0.0), Vector(rows(), 0.0), {j}, {-w}).first;
      for (std::size_t i = 0; i < coordinates(); ++i) state_[coordinates() + i] += d[i];
      if (!locked_.empty())
        for (std::size_t i = 0; i < coordinates(); ++i) state_[coordinates() + i] = 0;
    }
    judge_rest(t);
  }
  void impact() {
    locked_.clear();
    std::array<double, 2> before{}, p{};
    std::array<Vector, 2> by;
    for (std::size_t m = 0; m < 2; ++m) {
      before[m] = joint_rate(state_, base(m));
      Vector f(coordinates(), 0.0);
      add_torque(f, base(m), 1.0);
      by[m] = constrained(state_, f, Vector(rows(), 0.0), {}, {}).first;
    }
    for (int sweep = 0; sweep < 2000; ++sweep) {
      for (std::size_t m = 0; m < 2; ++m) {
        if (stop_[m] == 0) continue;
        const double back = c_.restitution * std::max(0.0, stop_[m] * before[m]);
        const double w = stop_[m] * joint_rate(state_, base(m)) + (back > 1e-7 ? back : 0.0);
        const double next = std::max(0.0, p[m] + w / rate(by[m], base(m), 0)), d = next - p[m];
        p[m] = next;
        for (std::size_t i = 0; i < coordinates(); ++i) state_[coordinates() + i] -= stop_[m] * d * by[m][i];
      }
    }
    for (std::size_t m = 0; m < 2; ++m)
      if (stop_[m] * joint_rate(state_, base(m)) < -1e-11) stop_[m] = 0;
    for (std::size_t j = 0; j < joints_; ++j) way_[j] = joint_rate(state_, j) > 0 ? 1 : -1;
  }

  Case c_;
  std::size_t bars_, joints_;
  Vector phi_, q_, state_;
  std::array<double, 4> held_torque_{};
  std::array<int, 4> way_{};
  std::array<int, 2> stop_{};
  std::array<int, 4> tooth_{};
  std::vector<std::size_t> locked_;
  bool loaded_ = false, pushed_ = false;
  long events_ = 0;
};

}  // namespace judge
