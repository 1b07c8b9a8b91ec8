#pragma once
/// Sums over the ticks of a run. S is double, or several runs side by side (host_sim/sweep/lanes).

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>

#include "firmware/safety/guards.hpp"

namespace esmc::host {

/// The larger of two numbers, NaN if either is NaN: std::max may drop a NaN.
[[nodiscard]] inline double larger(double a, double b) { return b > a || std::isnan(b) ? b : a; }

inline constexpr double settling_time = 0.25;  ///< s: errors from then on are settled

/// Root mean square and maximum of an error, over the whole run and after the start transient.
/// A sample of several components counts each component (base joints) or is one distance (effector).
template <class S>
class ErrorSums {
 public:
  void add(bool settled, S error) {
    all_.add(error);
    if (settled) settled_.add(error);
  }
  struct Moments {
    S square = 0.0, largest = 0.0;
    std::uint64_t count = 0;
    void add(S e) {
      square += e * e;
      largest = larger(largest, e);
      ++count;
    }
    [[nodiscard]] double rms() const {
      return count > 0 ? std::sqrt(square / static_cast<double>(count)) : 0.0;
    }
  };
  [[nodiscard]] const Moments& all() const { return all_; }
  [[nodiscard]] const Moments& settled() const { return settled_; }

  ErrorSums() = default;
  ErrorSums(const Moments& all, const Moments& settled) : all_(all), settled_(settled) {}

 private:
  Moments all_, settled_;
};
using ErrorStatistics = ErrorSums<double>;

/// Errors, torque and power of a run.
template <class S>
struct RunSums {
  ErrorSums<S> effector, base;  ///< m; rad
  S torque_max = 0.0;           ///< N m at a joint
  S delta_sum = 0.0;            ///< of |torque - torque of the tick before|, N m
  S power_sum = 0.0;            ///< W
  S saturated_ticks = 0.0;
  std::uint64_t deltas = 0;  ///< summands of delta_sum

  /// A tick. `torque`: N m, per motor, at most four; `power`: sum of |torque rate| over the motors, W.
  void add(std::span<const S> torque, S power, Truth<S> saturated) {
    using std::abs;
    saturated_ticks += S(saturated);
    power_sum += power;
    for (std::size_t i = 0; i < torque.size(); ++i) {
      torque_max = larger(torque_max, abs(torque[i]));
      if (begun) {
        delta_sum += abs(torque[i] - last_torque[i]);
        ++deltas;
      }
      last_torque[i] = torque[i];
    }
    begun = true;
  }
  /// Mean change of a motor's torque from tick to tick, N m.
  [[nodiscard]] double torque_activity() const {
    return deltas > 0 ? delta_sum / static_cast<double>(deltas) : 0.0;
  }

  std::array<S, 4> last_torque{};
  bool begun = false;
};

}  // namespace esmc::host
