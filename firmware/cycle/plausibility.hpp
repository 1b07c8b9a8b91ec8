#pragma once
/// Checks of a measurement against the previous one, against the command, and the confirmed zero.

#include <array>
#include <cstdint>
#include <optional>

#include "firmware/cycle/sample.hpp"
#include "firmware/safety/guards.hpp"

namespace esmc {

/// Compares an angle with its prediction from the previous sample and the rate. A difference shows a glitch,
/// a slipped coupling or the frame of another sensor.
template <class M>
class SampleJumpCheck {
 public:
  using S = typename M::Scalar;

  /// True unless a sample newer than the last one kept differs from its prediction by more than `jump` (rad)
  /// per tick between them; true before the first one and with jump = 0. The caller checks finite().
  [[nodiscard]] ESMC_INLINE Truth<S> plausible(int joint, const Sample<M>& now, S jump, S sample_time) const {
    const auto u = static_cast<unsigned>(joint);
    if (!(jump > S(0)) || !known_[u] || now.age_ticks[u] > age_[u]) return Truth<S>(true);
    const S ticks = S(age_[u] + 1 - now.age_ticks[u]);
    const S off = now.angle[joint] - last_[joint] - now.rate[joint] * (sample_time * ticks);
    return within(off, jump * ticks);
  }

  /// Keeps the sample for the next tick; call at the end of a tick. Every `step`-th joint has an encoder.
  void keep(const Sample<M>& now, int step) {
    for (int j = 0; j < M::joints; j += step) {
      const auto u = static_cast<unsigned>(j);
      if (now.age_ticks[u] <= (known_[u] ? age_[u] : forgotten)) {
        last_[j] = now.angle[j];
        known_[u] = true;
        age_[u] = now.age_ticks[u];
      } else if (age_[u] < forgotten) {
        ++age_[u];
      } else {
        known_[u] = false;
      }
    }
  }

 private:
  static constexpr std::uint32_t forgotten =
      1000;  ///< ticks after which the last sample is not used any more
  Vec<S, M::joints> last_ = Vec<S, M::joints>::Zero();
  /// Ticks, of the last sample at the end of the previous tick.
  std::array<std::uint32_t, static_cast<unsigned>(M::joints)> age_{};
  std::array<bool, static_cast<unsigned>(M::joints)> known_{};
};

/// Compares the torque that a drive reports, not every tick, with its command behind a first-order lag.
template <class M>
class TorqueFeedbackCheck {
 public:
  using S = typename M::Scalar;

  TorqueFeedbackCheck() = default;
  /// `tolerance`: N m, 0: no check; `time`: time constant of the lag, s; `sample_time`: s, > 0.
  TorqueFeedbackCheck(S tolerance, S time, S sample_time)
      : tolerance_(tolerance), share_(sample_time / (time + sample_time)) {}
  [[nodiscard]] bool compares() const { return tolerance_ > S(0); }  ///< false: plausible() is always true

  /// Feeds the lag with the torques commanded in this tick, N m at the joints; call at the end of a tick.
  void commanded(const Vec<S, M::joints>& torque) {
    if (compares()) expected_ += (torque - expected_) * share_;
  }

  /// Forgets the deviations counted so far; call in ticks without torque, whose reports do not count.
  void forget() { off_ = {}; }
  /// Compares the torque reported for a joint, N m; call once per tick. False: the last five reports, or
  /// more, differed by more than the tolerance. An empty report is not counted.
  [[nodiscard]] bool plausible(int joint, const std::optional<float>& reported) {
    auto& n = off_[static_cast<unsigned>(joint)];
    if (!compares() || !reported) return true;
    const S gap = S(*reported) - expected_[joint];
    n = within(gap, tolerance_) ? 0 : n + 1;
    return n < patience;
  }

 private:
  static constexpr int patience = 5;
  S tolerance_{}, share_{1};
  Vec<S, M::joints> expected_ = Vec<S, M::joints>::Zero();
  std::array<int, static_cast<unsigned>(M::joints)> off_{};
};

/// Zero of encoders that lose it without power: their angles are valid once the zero pose is confirmed.
template <class M>
class ZeroPose {
 public:
  using S = typename M::Scalar;

  ZeroPose() = default;
  /// `absolute`: encoders keep their zero, without confirm(). `pose`: of the joints at confirm(), rad.
  ZeroPose(bool absolute, const Vec<S, M::joints>& pose) : absolute_(absolute), pose_(pose) {}

  [[nodiscard]] bool confirmed() const { return absolute_ || confirmed_; }  ///< angles are valid
  /// Shift of a joint, rad, to be added to the angle of its encoder; 0 before the first confirm().
  [[nodiscard]] S shift(int joint) const { return shift_[joint]; }
  [[nodiscard]] const Vec<S, M::joints>& pose() const { return pose_; }  ///< rad, of the joints at confirm()
  /// Sets the shifts: the mechanism stands in its zero pose. `angle`: of the encoders, rad, with the present
  /// shift; the caller checks that it is finite and fresh. No effect with absolute encoders.
  void confirm(const Vec<S, M::joints>& angle) {
    if (absolute_) return;
    shift_ += pose_ - angle;
    confirmed_ = true;
  }
  void forget() { confirmed_ = false; }  ///< an encoder may have lost its zero; no effect if absolute

 private:
  bool absolute_ = true, confirmed_ = false;
  Vec<S, M::joints> pose_ = Vec<S, M::joints>::Zero(), shift_ = Vec<S, M::joints>::Zero();
};

}  // namespace esmc
