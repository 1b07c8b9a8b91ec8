#pragma once
/// The torques of the motors over a stretch of time: held by the drives, or an open-loop scene's waveforms.

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

namespace esmc::host {

/// tau(t) = offset + sum amp sin(omega t + phase), N m.
struct Waveform {
  struct Term {
    double amp, omega, phase;
  };
  double offset = 0.0;
  std::vector<Term> terms;

  /// Torque, N m, at time t, s.
  [[nodiscard]] double at(double t) const {
    double v = offset;
    for (const Term& term : terms) v += term.amp * std::sin(term.omega * t + term.phase);
    return v;
  }
};

/// Waveforms per motor, placed on joints and limited by what the drives deliver.
struct OpenLoop {
  std::vector<Waveform> wave;
  std::vector<std::size_t> joint;                          ///< of each waveform, model order
  double limit = std::numeric_limits<double>::infinity();  ///< N m, either way

  /// Torques per joint, N m, at time t, s; 0 at joints without a motor.
  template <class Joints>
  [[nodiscard]] Joints at(double t) const {
    Joints out{};
    for (std::size_t i = 0; i < wave.size(); ++i) out[joint[i]] = std::clamp(wave[i].at(t), -limit, limit);
    return out;
  }
};

template <class Joints>
struct MotorTorques {
  Joints held{};                   ///< N m per joint, model convention
  const OpenLoop* open = nullptr;  ///< instead of held; must outlive this

  [[nodiscard]] Joints at(double t) const { return open == nullptr ? held : open->at<Joints>(t); }
};

}  // namespace esmc::host
