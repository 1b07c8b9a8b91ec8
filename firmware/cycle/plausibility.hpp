#pragma once
/// What a message alone cannot show: whether it fits the one before, the command it answers, the pose that
/// was confirmed.

#include <array>
#include <cstdint>
#include <optional>

#include "firmware/cycle/sample.hpp"
#include "firmware/safety/guards.hpp"

namespace esmc {

/// The samples of a tick against those before: an angle that moved, but not by its own rate, is a glitch, a
/// slipped coupling or another sensor's frame.
template <class M>
class SampleJumpCheck {
 public:
  using S = typename M::Scalar;

  /// Whether a sample of a joint that is newer than the last one is within `jump` rad per tick between them
  /// of where its rate takes it from there; it may itself be some ticks old. Finite samples only. True before
  /// the first one, and with jump = 0.
  [[nodiscard]] bool plausible(int joint, const Sample<M>& now, S jump, S sample_time) const {
    const auto u = static_cast<unsigned>(joint);
    if (!(jump > S(0)) || !known_[u] || now.age_ticks[u] > age_[u]) return true;
    const S ticks = S(age_[u] + 1 - now.age_ticks[u]);
    const S off = now.angle[joint] - last_[joint] - now.rate[joint] * (sample_time * ticks);
    return within(off, jump * ticks);
  }

  /// At the end of a tick. `step`: of the joints that have an encoder.
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
  static constexpr std::uint32_t forgotten = 1000;  ///< ticks: what was known before says nothing any more
  Vec<S, M::joints> last_ = Vec<S, M::joints>::Zero();
  std::array<std::uint32_t, static_cast<unsigned>(M::joints)>
      age_{};  ///< ticks, of the last one at the end of the tick before
  std::array<bool, static_cast<unsigned>(M::joints)> known_{};
};

/// The torque that a drive reports against what it was told, allowed the time it takes to follow. It need not
/// report in every tick.
template <class M>
class TorqueFeedbackCheck {
 public:
  using S = typename M::Scalar;

  TorqueFeedbackCheck() = default;
  /// `tolerance`: N m, 0: anything goes; `time`: s, of the first-order lag that the drive is allowed.
  TorqueFeedbackCheck(S tolerance, S time, S sample_time)
      : tolerance_(tolerance), share_(sample_time / (time + sample_time)) {}
  [[nodiscard]] bool compares() const { return tolerance_ > S(0); }

  /// At the end of a tick: what goes to the joints from now on, N m.
  void told(const Vec<S, M::joints>& torque) {
    if (compares()) expected_ += (torque - expected_) * share_;
  }

  /// What was off before there was torque says nothing.
  void forget() { off_ = {}; }
  /// Once per tick. False once a joint's reported torque has been off for `patience` reports in a row; none
  /// reported, none compared.
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

/// The zero of encoders that lose it without power. Until the operator has put the mechanism into its zero
/// pose and confirmed it, angles mean nothing.
template <class M>
class ZeroPose {
 public:
  using S = typename M::Scalar;

  ZeroPose() = default;
  /// `absolute`: encoders that keep their zero; nothing is to confirm then.
  ZeroPose(bool absolute, const Vec<S, M::joints>& pose) : absolute_(absolute), pose_(pose) {}

  [[nodiscard]] bool confirmed() const { return absolute_ || confirmed_; }
  /// rad, to be added to what the encoder of a joint says.
  [[nodiscard]] S shift(int joint) const { return shift_[joint]; }
  /// The mechanism stands in its zero pose and the encoders, shift included, say `angle`.
  void confirm(const Vec<S, M::joints>& angle) {
    if (absolute_) return;
    shift_ += pose_ - angle;
    confirmed_ = true;
  }
  void forget() { confirmed_ = false; }

 private:
  bool absolute_ = true, confirmed_ = false;
  Vec<S, M::joints> pose_ = Vec<S, M::joints>::Zero(), shift_ = Vec<S, M::joints>::Zero();
};

}  // namespace esmc
