#pragma once
/// The random scenes of the studies of simulation.accuracy.

#include <cstdint>
#include <random>
#include <string>

#include "tests/studies/accuracy_judge.hpp"

namespace judge {

class Draw {
 public:
  explicit Draw(std::uint64_t seed) : bits_(seed * 7919 + 17) {}
  double in(double low, double high) {
    return low + (high - low) * (static_cast<double>(bits_() >> 11U) * 0x1p-53);
  }
  bool chance(double p) { return in(0, 1) < p; }

 private:
  std::mt19937_64 bits_;
};

inline Case draw(std::uint64_t seed) {
  Draw d(seed);
  Case c;
  c.five_bar = d.chance(0.5);
  c.closed = d.chance(0.5);
  const double scale = c.five_bar ? 1.0 : 10.0;  // of torques
  Leg leg = c.five_bar ? Leg{0.12, 0.16, 0.06, 0.068, 0.1, 0.1, 2e-4, 7e-4}
                       : Leg{0.30, 0.25, 0.15, 0.11, 1.2, 0.8, 1.0e-2, 4.5e-3};
  for (double* v : {&leg.m1, &leg.m2, &leg.J1, &leg.J2}) *v *= d.in(0.8, 1.2);
  c.leg = {leg, leg};
  c.gravity = d.chance(0.7) ? 9.8 : 0.0;
  c.duration = std::round(d.in(300, 1000)) * 1e-3;
  c.start =
      c.five_bar ? std::array{d.in(0.75, 1.3), d.in(0.75, 1.3)} : std::array{d.in(-1, 1), d.in(0.4, 1.6)};
  if (d.chance(0.3)) c.start_rate = {d.in(-2, 2), d.in(-2, 2)};
  for (std::size_t m = 0; m < 2; ++m) {
    c.wave[m] = c.closed ? Wave{c.start[m] + d.in(-0.1, 0.1), d.in(0.05, 0.3), d.in(2, 12), d.in(0, 6)}
                         : Wave{scale * d.in(-0.05, 0.05), scale * d.in(0.0, 0.15), d.in(2, 20), d.in(0, 6)};
  }
  c.kp = scale * d.in(1, 5);
  c.kd = c.kp * d.in(0.02, 0.06);
  c.torque_max = scale * 2.0;
  c.rubs = d.chance(0.7);
  for (double& f : c.friction) f = scale * d.in(0.002, 0.05);
  if (!c.five_bar) c.friction[2] = c.friction[3] = 0;
  if (d.chance(0.4)) c.viscous.fill(scale * d.in(0.0005, 0.005));
  c.stops = d.chance(0.5);
  c.soft = c.stops && d.chance(0.5);
  c.restitution = d.chance(0.3) ? 0.0 : d.in(0.1, 0.7);
  c.stop_stiffness = scale * d.in(20, 300);
  for (std::size_t m = 0; m < 2; ++m) {
    c.lower[m] = c.start[m] - d.in(0.05, 0.6);
    c.upper[m] = c.start[m] + d.in(0.05, 0.6);
  }
  c.gear = d.chance(0.3);
  c.play = c.gear && d.chance(0.6);
  c.gear_stiffness = scale * d.in(20, 200);
  c.rotor = (c.five_bar ? 1e-4 : 5e-3) * d.in(1, 4);
  c.gear_damping = std::sqrt(c.gear_stiffness * c.rotor) * d.in(0.05, 0.5);
  c.gap = d.in(0.002, 0.02);
  c.load = d.chance(0.3);
  c.load_mass = leg.m2 * d.in(0.1, 1.0);
  c.load_from = d.chance(0.3) ? 0.0 : c.duration * d.in(0.1, 0.5);
  c.load_to = c.duration * d.in(0.6, 1.2);
  return c;
}

inline std::string number(double v) {
  char text[40];
  std::snprintf(text, sizeof text, "%.17g", v);
  const std::string s = text;
  return s.find_first_of(".en") == std::string::npos ? s + ".0" : s;
}
template <class Values>
std::string list(const Values& v, std::size_t n) {
  std::string out;
  for (std::size_t i = 0; i < n; ++i) out += (i == 0 ? "" : ", ") + number(v[i]);
  return "[" + out + "]";
}

inline std::string scene(const Case& c) {
  const Leg& l = c.leg[0];
  std::string s = "[mechanism]\ntype = \"" + std::string(c.five_bar ? "five_bar" : "rr") + "\"\n";
  if (c.five_bar) s += "half_base = " + number(c.base) + "\nassembly_mode = \"-\"\n";
  s += "gravity = " + number(c.gravity) +
       "\nworking_mode = " + (c.five_bar ? "[\"+\", \"+\"]\n" : "[\"+\"]\n");
  s += "leg = { l1 = " + number(l.l1) + ", l2 = " + number(l.l2) + ", lg1 = " + number(l.lg1) +
       ", lg2 = " + number(l.lg2) + ", m1 = " + number(l.m1) + ", m2 = " + number(l.m2) +
       ", J1 = " + number(l.J1) + ", J2 = " + number(l.J2) + " }\n[control]\n";
  if (c.closed) {
    s += "law = \"pd\"\nkp = " + number(c.kp) + "\nkd = " + number(c.kd) +
         "\ntorque_limit = " + number(c.torque_max) + "\n[reference]\ntype = \"joint_sine\"\n";
    const std::array<double, 2> offset{c.wave[0].offset, c.wave[1].offset}, amp{c.wave[0].amp, c.wave[1].amp},
        omega{c.wave[0].omega, c.wave[1].omega}, phase{c.wave[0].phase, c.wave[1].phase};
    s += "offset = " + list(offset, 2) + "\namplitude = " + list(amp, 2) + "\nomega = " + list(omega, 2) +
         "\nphase = " + list(phase, 2) + "\n";
    s += "[limits]\nmin_abs_sin_type1 = 0.0\nmin_abs_sin_type2 = 0.0\njoint_speed = 1e5\nfeedback_jump = "
         "0.0\n";
  } else {
    s += "law = \"open_loop\"\ntorque = [";
    for (std::size_t m = 0; m < 2; ++m) {
      const Wave& w = c.wave[m];
      s += (m == 0 ? "" : ", ") + std::string("{ offset = ") + number(w.offset) +
           ", terms = [{ amp = " + number(w.amp) + ", omega = " + number(w.omega) +
           ", phase = " + number(w.phase) + " }] }";
    }
    s += "]\n";
  }
  s += "[initial]\njoints = " + list(c.start, 2) + "\njoint_rates = " + list(c.start_rate, 2) +
       "\n[simulation]\nduration = " + number(c.duration) + "\naccuracy = 1e-6\n";
  if (c.rubs)
    s += "[[effects]]\ntype = \"coulomb_friction\"\ntorque = " + list(c.friction, c.five_bar ? 4 : 2) + "\n";
  if (c.viscous[0] > 0)
    s += "[[effects]]\ntype = \"viscous_friction\"\ncoefficient = " + list(c.viscous, 2) + "\n";
  if (c.stops) {
    s += "[[effects]]\ntype = \"end_stops\"\nlower = " + list(c.lower, 2) + "\nupper = " + list(c.upper, 2) +
         "\nrestitution = " + number(c.restitution) + "\n";
    if (c.soft) s += "stiffness = " + number(c.stop_stiffness) + "\n";
  }
  if (c.gear)
    s += "[[effects]]\ntype = \"joint_flexibility\"\nstiffness = " + number(c.gear_stiffness) +
         "\ndamping = " + number(c.gear_damping) + "\nrotor_inertia = " + number(c.rotor) + "\n";
  if (c.play) s += "[[effects]]\ntype = \"backlash\"\ngap = " + number(c.gap) + "\n";
  if (c.load)
    s += "[[effects]]\ntype = \"payload\"\nmass = " + number(c.load_mass) +
         "\nfrom = " + number(c.load_from) + "\nto = " + number(c.load_to) + "\n";
  return s;
}

/// The same without what could have an event: springs of the gears and payloads stay.
inline Case draw_smooth(std::uint64_t seed) {
  Case c = draw(seed);
  c.rubs = c.stops = c.soft = c.play = false;
  return c;
}

}  // namespace judge
