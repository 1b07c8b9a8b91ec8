#pragma once
/// The peer's side of free_motion.cpp: plain data, because its headers and ours want different language
/// standards.

#include <array>
#include <vector>

namespace esmc::test {

struct PeerRun {
  std::vector<std::array<double, 2>> path;  ///< effector at the end of each second, m
  double closure = 0.0;                     ///< largest distance of the tips, m
  double cpu_ms = 1e300;
};

/// Absolute angles of the four bars, at rest; both legs alike; effector mass and gravity.
struct PeerStart {
  std::array<double, 4> angle;
  double l0, l1, l2, lg1, lg2, m1, m2, J1, J2, m0, g;
};

/// Accelerations of the four joints (relative, all counter-clockwise) at the start.
std::array<double, 4> peer_accelerations(const PeerStart& s);
/// `seconds` of motion by the Runge-Kutta-Merson integrator.
PeerRun peer_run(const PeerStart& s, double accuracy, bool project_every_step, int seconds);

}  // namespace esmc::test
