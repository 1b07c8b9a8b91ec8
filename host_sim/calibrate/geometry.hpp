#pragma once
/// Lengths and encoder zeros of a mechanism, from what redundant encoders have measured and, where there is
/// any, from measured positions of the effector. Equations of its own, in complex numbers: nothing of the
/// controller's model is used.

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <optional>
#include <string>
#include <vector>

#include "host_sim/least_squares.hpp"

namespace esmc::host {

/// Entry i of a vector of unknowns. An RR arm has neither the half base nor leg 2.
enum Unknown : int {
  unknown_l0,
  unknown_l11,
  unknown_l12,
  unknown_l21,
  unknown_l22,  // m
  unknown_o11,
  unknown_o12,
  unknown_o21,
  unknown_o22,  // rad, to be added to the readings of the encoders
  unknown_fx,
  unknown_fy,
  unknown_fa,  // frame of the effector readings: origin in the base frame, m, and angle, rad
  unknowns
};
using Unknowns = Vector;  ///< `unknowns` entries

/// "half_base", "leg 1 l1", "offset theta11", ...; "" for one that an RR arm does not have.
[[nodiscard]] const char* name_of(int unknown, bool five_bar);
[[nodiscard]] constexpr bool is_length(int unknown) { return unknown <= unknown_l22; }
/// "m" or "rad".
[[nodiscard]] constexpr const char* unit_of(int unknown) {
  return is_length(unknown) || unknown == unknown_fx || unknown == unknown_fy ? "m" : "rad";
}

/// theta11, theta12, theta21, theta22 as measured, rad; RR: the first two.
using MeasuredAngles = std::array<double, 4>;
/// A position of the effector from another instrument, and the encoders' angles at that instant.
struct EffectorReading {
  MeasuredAngles angle{};
  double x = 0.0, y = 0.0;  ///< m
};

/// An equation, one per reading: a complex number that the right unknowns make 0, two rows of the least
/// squares. J: derivative by each unknown. Those by the offsets are those by the angles as well.
struct Row {
  std::complex<double> residual;
  std::array<std::complex<double>, unknowns> J{};
};

/// The bars as complex numbers in the base frame; those of leg 2, whose own frame is mirrored, from tip to
/// base.
struct Bars {
  std::array<std::complex<double>, 4> direction, bar;
  Bars(const Unknowns& u, const MeasuredAngles& a) {
    const double one = a[0] + u[unknown_o11], two = a[2] + u[unknown_o21];
    direction = {std::polar(1.0, one), std::polar(1.0, one + a[1] + u[unknown_o12]), std::polar(1.0, -two),
                 std::polar(1.0, -two - a[3] - u[unknown_o22])};
    for (std::size_t i = 0; i < 4; ++i) bar[i] = u[unknown_l11 + static_cast<int>(i)] * direction[i];
  }
  /// Adds `leg1` times the tip of leg 1 and `leg2` times the path from the tip of leg 2 to its base.
  void add_to(Row& r, double leg1, double leg2) const {
    const std::complex<double> i(0.0, 1.0);
    r.residual += leg1 * (bar[0] + bar[1]) + leg2 * (bar[2] + bar[3]);
    for (std::size_t k = 0; k < 4; ++k) r.J[unknown_l11 + k] = (k < 2 ? leg1 : leg2) * direction[k];
    r.J[unknown_o11] = leg1 * i * (bar[0] + bar[1]);
    r.J[unknown_o12] = leg1 * i * bar[1];
    r.J[unknown_o21] = -leg2 * i * (bar[2] + bar[3]);
    r.J[unknown_o22] = -leg2 * i * bar[3];
  }
};

/// Tip of leg 1 less tip of leg 2, m, with phi of corrected angles:
/// 2 l0 + l11 e^{i phi11} + l12 e^{i phi12} + l21 e^{-i phi21} + l22 e^{-i phi22}.
inline Row closure_row(const Unknowns& u, const MeasuredAngles& a) {
  Row r;
  r.residual = 2.0 * u[unknown_l0];
  r.J[unknown_l0] = 2.0;
  Bars(u, a).add_to(r, 1.0, 1.0);
  return r;
}

/// The reading, brought into the base frame, less the effector, m: the mean of both tips (RR: its tip).
inline Row effector_row(const Unknowns& u, bool five_bar, const EffectorReading& reading,
                        const MeasuredAngles& a) {
  const std::complex<double> turned =
      std::polar(1.0, u[unknown_fa]) * std::complex<double>(reading.x, reading.y);
  Row r;
  r.residual = std::complex<double>(u[unknown_fx], u[unknown_fy]) + turned;
  r.J[unknown_fx] = 1.0;
  r.J[unknown_fy] = {0.0, 1.0};
  r.J[unknown_fa] = std::complex<double>(0.0, 1.0) * turned;
  Bars(u, a).add_to(r, five_bar ? -0.5 : -1.0, five_bar ? 0.5 : 0.0);
  return r;
}

/// L^-1 z of the Cholesky factor L of a covariance of real and imaginary part: in units of its uncertainty.
struct Whitening {
  double l11, l21, l22;
  Whitening(double s11, double s21, double s22)
      : l11(std::sqrt(s11)), l21(s21 / l11), l22(std::sqrt(s22 - l21 * l21)) {}
  [[nodiscard]] std::complex<double> operator()(const std::complex<double>& z) const {
    const double x = z.real() / l11;
    return {x, (z.imag() - l21 * x) / l22};
  }
};

/// A row in units of its uncertainty, for angles with standard deviation `sigma` (rad) and one of `own` (m)
/// of each coordinate. `row_at(angles)` gives the row. `correct`: it is taken at the angles as corrected to
/// fulfil it, where the derivatives are free of the readings' noise.
template <class RowAt>
Row whitened(RowAt row_at, const MeasuredAngles& angle, double sigma, double own, bool correct) {
  MeasuredAngles by{};
  Row r = row_at(angle);
  for (int pass = 0;; ++pass) {
    double s11 = own * own + 1e-300, s21 = 0.0, s22 = s11;
    for (std::size_t k = 0; k < by.size(); ++k) {
      const std::complex<double> a = r.J[unknown_o11 + k];
      r.residual -= a * by[k];
      s11 += sigma * sigma * a.real() * a.real();
      s21 += sigma * sigma * a.real() * a.imag();
      s22 += sigma * sigma * a.imag() * a.imag();
    }
    const Whitening white(s11, s21, s22);
    r.residual = white(r.residual);
    for (auto& z : r.J) z = white(z);
    if (!correct || pass == 2) return r;
    MeasuredAngles next{}, at = angle;
    double largest = 0.0;
    for (std::size_t k = 0; k < by.size(); ++k) {
      next[k] = -sigma * sigma * (std::conj(r.J[unknown_o11 + k]) * r.residual).real();
      at[k] += next[k];
      largest = std::max(largest, std::abs(next[k]));
    }
    if (!(largest < 0.1)) return r;  // no small correction: the derivatives as they are
    by = next;
    r = row_at(at);
  }
}

struct CalibrationProblem {
  bool five_bar = true;
  /// Where the fit starts, and the value kept along directions that nothing determines.
  Unknowns nominal = Unknowns::Zero(unknowns);
  std::vector<MeasuredAngles> angles;  ///< five-bar: each closes the loop
  std::vector<EffectorReading> effector;
  double effector_sigma = 1e-4;  ///< m, > 0, of each coordinate of a reading
  double encoder_sigma = 3e-5;   ///< rad, > 0; a five-bar's is taken from how well the loop closes instead
  bool half_base_known = false;  ///< `nominal` has it exactly
  bool free_frame = false;       ///< position readings are in a frame of their own
};

/// A combination of unknowns that the data do not determine.
struct WeakDirection {
  double sigma = 0.0;  ///< standard uncertainty as a part of a length, or rad; may be infinite
  std::string text;    ///< "half_base and all lengths together: the scale", "0.7 leg 1 l1 - 0.7 leg 2 l1"
};

struct Calibration {
  Unknowns value = Unknowns::Zero(unknowns);
  Matrix covariance = Matrix::Zero(unknowns, unknowns);
  std::vector<int> estimated;        ///< which of the unknowns; the others are nominal, or not there
  std::vector<WeakDirection> weak;   ///< along these `value` is nominal, and the covariance that of nominal
                                     ///< values: 0.5 % of mean_length, 5 mrad
  double mean_length = 1.0;          ///< m
  double encoder_sigma = 0.0;        ///< rad, of one reading, as the residuals have it
  double closure_rms = 0.0;          ///< m
  double closure_rms_nominal = 0.0;  ///< m, with the unknowns as they were
  double effector_rms = 0.0;         ///< m, of the position readings
  bool converged = false;
  bool in_numbers = true;  ///< false: far from any mechanism; only `value` is set

  [[nodiscard]] double sigma(int unknown) const {
    return std::sqrt(std::max(0.0, covariance(unknown, unknown)));
  }  ///< standard uncertainty, m or rad
};

/// Least squares in which angles and positions carry the errors (a Gauss-Helmert model): the correction of
/// all readings by as little as makes the loop close, weighted by their standard deviations. The covariance
/// is that of the estimator for residuals that are correlated in time (blocks of consecutive rows), not that
/// of white noise. Where the data determine nothing at all, every direction is weak and `value` nominal.
[[nodiscard]] Calibration calibrate(const CalibrationProblem& problem);

/// Effector x + i y, m, in the base frame from the base encoders (RR: both) of a row: the solution next to
/// the one that the passive encoders tell. Empty: these lengths cannot be closed.
[[nodiscard]] std::optional<std::complex<double>> effector_from_base(const Unknowns& u, bool five_bar,
                                                                     const MeasuredAngles& angle);

/// Standard uncertainty of the effector at these angles, m (root of the sum of both variances), that follows
/// from the covariance of the calibration. Infinite where its lengths cannot be closed there.
[[nodiscard]] double effector_sigma(const Calibration& c, bool five_bar, const MeasuredAngles& angle);

/// An encoder that is off the centre of its shaft: a sine of its own angle in the readings, which lengths and
/// offsets would take up.
struct EccentricEncoder {
  int joint = 0;                     ///< in the order of the model
  double amount = 0.0, sigma = 0.0;  ///< rad
};

/// The encoders of a five-bar for whose eccentricity what `c` leaves of the loop speaks clearly, and which
/// shifts a value by more than 1.5 standard uncertainties. The shifts are added to the covariance of `c`.
std::vector<EccentricEncoder> name_eccentric(const CalibrationProblem& p, Calibration& c);

}  // namespace esmc::host
