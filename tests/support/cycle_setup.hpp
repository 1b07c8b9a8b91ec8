#pragma once
/// The two machines that the cycle is tested with, how their drives are mounted, and a controller for each.

#include <array>
#include <cmath>
#include <cstdint>

#include "firmware/cycle/controller.hpp"
#include "firmware/drive/odrive.hpp"
#include "firmware/link/command_link.hpp"

namespace esmc::test {

inline constexpr double turn = 2 * 3.14159265358979323846;

/// How an axis is mounted: written down twice, here for the drive and in AxisConfig for the controller.
struct Mounting {
  std::uint8_t node;
  double direction, gear, offset;
};
inline constexpr std::array<Mounting, 4> mountings{
    {{1, 1.0, 1.0, 0.125}, {9, -1.0, 3.0, -0.25}, {0x21, -1.0, 0.5, 0.5}, {0x3E, 1.0, 8.0, 0.0}}};

/// What a test chooses before it builds a rig.
template <class M>
struct Setup {
  ControllerConfig<M> controller{};
  std::array<double, static_cast<std::size_t>(M::joints)> angle{},
      rate{};  ///< of the joints, reported truthfully
  drive::odrive::Version version = drive::odrive::Version::v0_6;
  std::uint32_t retry_ticks = 150;
  std::uint32_t heartbeat_age_ticks_max = 20;
  double torque_mismatch = 0.0;  ///< N m at the joint; torque is said without a lag
  bool samples_timed = true;
  bool confirmed = true;
  bool zero_absolute = true;
  Vec<typename M::Scalar, M::joints> zero_pose = Vec<typename M::Scalar, M::joints>::Zero();
  HomingConfig<typename M::Scalar> homing{};
  link::LinkConfig link{};
  std::array<double, 4> gear{mountings[0].gear, mountings[1].gear, mountings[2].gear, mountings[3].gear};
};

// ---- the two machines

/// Joint angles of the leg whose base is at the origin and whose tip is at (x, y), elbow to the side `mode`.
inline std::array<double, 2> dyad_angles(double l1, double l2, double x, double y, int mode) {
  const double second = mode * std::acos((x * x + y * y - l1 * l1 - l2 * l2) / (2 * l1 * l2));
  return {std::atan2(y, x) - std::atan2(l2 * std::sin(second), l1 + l2 * std::cos(second)), second};
}

inline constexpr double half_base = 0.05, bar1 = 0.12, bar2 = 0.16;

/// theta11, theta12, theta21, theta22 with the effector at (x, y), working modes `mode1` and `mode2`.
inline std::array<double, 4> five_bar_angles(double x, double y, int mode1 = 1, int mode2 = 1) {
  const auto a = dyad_angles(bar1, bar2, x - half_base, y, mode1);
  const auto b = dyad_angles(bar1, bar2, -(x + half_base), y, mode2);
  return {a[0], a[1], b[0], b[1]};
}

template <class M>
Setup<M> setup();

template <>
inline Setup<FiveBar<double>> setup<FiveBar<double>>() {
  Setup<FiveBar<double>> s;
  auto& c = s.controller;
  FiveBarParams<double> p{.l0 = half_base, .m0 = 0.05, .g = 9.8, .legs = {}};
  p.legs[0] = {bar1, bar2, 0.06, 0.068, 0.1, 0.11, 2e-4, 7e-4, 0.01, 0.012, 0.0, 0.0};
  p.legs[1] = {bar1, bar2, 0.058, 0.07, 0.12, 0.1, 2.2e-4, 6.5e-4, 0.011, 0.01, 0.0, 0.0};
  c.mechanism = FiveBar<double>(p);
  c.mode = {{{1, 1}}, -1};
  c.gains.lambda.setConstant(20.0);
  c.gains.k.setConstant(8.0);
  c.gains.layer.setConstant(0.7);
  c.gains.independent = {20.0, 8.0, 0.7, 90.0, 15.0};
  c.reference = {.kind = ReferenceKind::circle,
                 .space = ReferenceSpace::effector,
                 .centre = {0.0, 0.17},
                 .amplitude = {0.02, 0.02},
                 .speed = {10.0, 0.0}};
  c.reference.phase[0] = {0, static_cast<std::uint64_t>(10.0 * 1e-3 / turn * 0x1p64)};
  c.limits = {.min_abs_sin_type1 = 0.02,
              .min_abs_sin_type2 = 0.05,
              .joint_speed = 50.0,
              .closure = 1e-3,
              .workspace_x = {-0.3, 0.3},
              .workspace_y = {-0.05, 0.3},
              .joint_angle = {{{-3.2, 3.2}, {-3.2, 3.2}}},
              .max_age_ticks = 2};
  c.torque_limit.setConstant(2.0);
  c.torque_weight = {1.0, 2.0, 0.5, 1.5};
  c.sample_time = 1e-3;
  s.angle = five_bar_angles(0.015, 0.18);
  return s;
}

template <>
inline Setup<Rr<float>> setup<Rr<float>>() {
  Setup<Rr<float>> s;
  auto& c = s.controller;
  const RrParams<float> p{{0.2F, 0.15F, 0.09F, 0.07F, 0.4F, 0.3F, 2e-3F, 1e-3F, 0.01F, 0.01F, 0.0F, 0.0F},
                          9.8F};
  c.mechanism = Rr<float>(p);
  c.mode = {1};
  c.gains.lambda.setConstant(20.0F);
  c.gains.k.setConstant(8.0F);
  c.gains.layer.setConstant(0.7F);
  c.gains.independent = {20.0F, 8.0F, 0.7F, 90.0F, 15.0F};
  c.reference = {.kind = ReferenceKind::sine,
                 .space = ReferenceSpace::base_joints,
                 .centre = {0.45F, 0.85F},
                 .amplitude = {0.1F, 0.2F},
                 .speed = {10.0F, 10.0F}};
  c.reference.phase[0] = c.reference.phase[1] = {0, static_cast<std::uint64_t>(10.0 * 1e-3 / turn * 0x1p64)};
  c.limits = {.min_abs_sin_type1 = 0.02F,
              .min_abs_sin_type2 = 0.05F,
              .joint_speed = 50.0F,
              .closure = 1e-3F,
              .workspace_x = {-0.4F, 0.4F},
              .workspace_y = {-0.4F, 0.4F},
              .joint_angle = {{{-3.2F, 3.2F}, {-3.2F, 3.2F}}},
              .max_age_ticks = 2};
  c.torque_limit.setConstant(3.0F);
  c.sample_time = 1e-3F;
  s.angle = {0.4, 0.9};
  return s;
}

}  // namespace esmc::test
