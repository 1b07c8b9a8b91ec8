#pragma once
/// Coefficients of Radau IIA of order 5, HW table IV.5.6 and IV.8.

#include <array>

namespace esmc::host::radau5 {

inline constexpr double r6 = 2.449489742783178098197284074705891391966;  // sqrt 6
inline constexpr std::array<double, 3> c{(4.0 - r6) / 10.0, (4.0 + r6) / 10.0, 1.0};
/// Inverse of the Runge-Kutta matrix.
inline constexpr std::array<std::array<double, 3>, 3> inverse{{
    {2.0 + r6 / 2.0, -1.2 + 29.0 * r6 / 30.0, 0.4 - 4.0 * r6 / 15.0},
    {-1.2 - 29.0 * r6 / 30.0, 2.0 - r6 / 2.0, 0.4 + 4.0 * r6 / 15.0},
    {-1.0 + 8.0 * r6 / 3.0, -1.0 - 8.0 * r6 / 3.0, 5.0},
}};
/// Its real eigenvalue, and the weights of the stages in the error: HW (IV.8.18) times that eigenvalue.
inline constexpr double eigenvalue = 3.637834252744495732208418513577775;
inline constexpr std::array<double, 3> error{(-13.0 - 7.0 * r6) / 3.0, (-13.0 + 7.0 * r6) / 3.0, -1.0 / 3.0};

}  // namespace esmc::host::radau5
