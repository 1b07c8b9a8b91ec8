#pragma once
/// The equations of an identification: regressors of every tick, and their means under smooth windows.

#include <cstddef>
#include <vector>

#include "host_sim/identify/identification.hpp"

namespace esmc::host {

/// Columns of one leg: a, c, h, s.
inline constexpr int per_leg = 4;
[[nodiscard]] constexpr int inertial_columns(bool five_bar) { return five_bar ? 2 * per_leg + 1 : per_leg; }
[[nodiscard]] constexpr int joints_of(bool five_bar) { return five_bar ? 4 : 2; }
inline constexpr int hops_per_window = 4;
inline constexpr double delay_min = -5.0, delay_max = 50.0;  ///< ticks

/// The regressor of one tick: momentum, and what acts on it, per base joint (2 rows) and parameter.
struct Tick {
  Matrix momentum;  ///< D^T p
  Matrix force;     ///< what changes it beside the torque: -(D_dot^T p + D^T dT/dq) + weight + friction
  Eigen::Matrix<double, 4, 2> joint;                ///< rates of the joints per rate of the base joints
  Eigen::Matrix<double, 4, 2> joint_dot;            ///< its derivative along the motion, 1/s
  Eigen::Vector4d angle = Eigen::Vector4d::Zero();  ///< of the joints, rad
  Matrix reversal;  ///< torque of a Coulomb friction of 1 N m that turns round one tick too early, per joint
  Eigen::Vector4d relative = Eigen::Vector4d::Zero();  ///< rates of the joints, rad/s
};

/// All equations: W parameters = torque(delay), in N m: means under the windows. The problem must outlive
/// them.
class Equations {
 public:
  /// Throws InputError where base angles fit no closed mechanism.
  explicit Equations(const IdentifyProblem& p);

  /// The right-hand side: torques act `delay` ticks after they were asked for, each until the next, less what
  /// is believed and no parameter. `joint`: the torque of this joint alone; -1: all of them.
  [[nodiscard]] Vector torque(double delay, int joint = -1) const;

  /// The mean under each window of what `of` adds to it at a tick.
  template <class F>
  [[nodiscard]] Vector windowed(const F& of) const {
    Vector out = Vector::Zero(W.rows());
    for (std::size_t k = 0; k < first_.size(); ++k) {
      for (std::size_t i = 1; i < share_.size(); ++i)
        out.segment<2>(2 * static_cast<Eigen::Index>(k)) += of(ticks_[first_[k] + i], share_[i], slope_[i]);
    }
    return out;
  }

  Matrix W, reversal;
  [[nodiscard]] int windows() const { return static_cast<int>(first_.size()); }

 private:
  const IdentifyProblem& p_;
  double length_;                      ///< of a window, ticks
  std::vector<double> share_, slope_;  ///< of a tick in the mean, and per s: of its momentum
  Vector known_;                       ///< torque of what is believed and no parameter
  std::vector<Tick> ticks_;
  std::vector<std::size_t> first_;
};

}  // namespace esmc::host
