/// Hard cases of tests/gallery, solved by SUNDIALS: CVODE between events, which its root finding locates, and
/// IDA on the closed chain. Prints t and the value that the case is about, every millisecond. usage:
/// peers_hard stick_slip | accumulation | backlash | gear_spring | stiff_friction | payload_jump | fall_cvode
/// | fall_ida

#include <cvode/cvode.h>
#include <ida/ida.h>
#include <nvector/nvector_serial.h>
#include <sundials/sundials_context.h>
#include <sunlinsol/sunlinsol_dense.h>
#include <sunmatrix/sunmatrix_dense.h>

#include <Eigen/Dense>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <string>
#include <vector>

namespace {

using Values = std::vector<double>;
using Function = std::function<void(double, const double*, double*)>;

void require(int flag, const char* what) {
  if (flag >= 0) return;
  std::fprintf(stderr, "peers_hard: %s returns %d\n", what, flag);
  std::exit(1);
}

SUNContext context() {
  static SUNContext c = [] {
    SUNContext made = nullptr;
    require(SUNContext_Create(nullptr, &made), "SUNContext_Create");
    return made;
  }();
  return c;
}

/// One stretch of CVODE from (t, y): prints y[0] at every millisecond, ends at `end` or at a root and leaves
/// (t, y) there.
class Stretch {
 public:
  Stretch(Function f, Function roots, int root_count, int method)
      : f_(std::move(f)), roots_(std::move(roots)), root_count_(root_count), method_(method) {}

  /// True where it ended at a root.
  bool run(double& t, Values& y, double end) {
    const auto n = static_cast<sunindextype>(y.size());
    N_Vector at = N_VNew_Serial(n, context());
    for (std::size_t i = 0; i < y.size(); ++i) NV_Ith_S(at, i) = y[i];
    void* memory = CVodeCreate(method_, context());
    require(CVodeInit(memory, rhs, t, at), "CVodeInit");
    require(CVodeSetUserData(memory, this), "CVodeSetUserData");
    require(CVodeSStolerances(memory, 1e-12, 1e-15), "CVodeSStolerances");
    require(CVodeSetMaxNumSteps(memory, 10000000), "CVodeSetMaxNumSteps");
    require(CVodeSetStopTime(memory, end), "CVodeSetStopTime");
    SUNMatrix matrix = SUNDenseMatrix(n, n, context());
    SUNLinearSolver solver = SUNLinSol_Dense(at, matrix, context());
    require(CVodeSetLinearSolver(memory, solver, matrix), "CVodeSetLinearSolver");
    if (root_count_ > 0) require(CVodeRootInit(memory, root_count_, root), "CVodeRootInit");
    bool found = false;
    while (!found && t < end) {
      const double next = (std::floor(t * 1e3 + 1e-6) + 1.0) * 1e-3;
      const int flag = CVode(memory, std::min(next, end), at, &t, CV_NORMAL);
      require(flag, "CVode");
      found = flag == CV_ROOT_RETURN;
      if (std::abs(t - next) < 1e-12) std::printf("%.9g,%.17g\n", t, NV_Ith_S(at, 0));
    }
    for (std::size_t i = 0; i < y.size(); ++i) y[i] = NV_Ith_S(at, i);
    CVodeFree(&memory);
    SUNLinSolFree(solver);
    SUNMatDestroy(matrix);
    N_VDestroy(at);
    return found;
  }

 private:
  static int rhs(double t, N_Vector y, N_Vector dy, void* self) {
    static_cast<Stretch*>(self)->f_(t, NV_DATA_S(y), NV_DATA_S(dy));
    return 0;
  }
  static int root(double t, N_Vector y, double* g, void* self) {
    static_cast<Stretch*>(self)->roots_(t, NV_DATA_S(y), g);
    return 0;
  }

  Function f_, roots_;
  int root_count_, method_;
};

constexpr double inertia = 1e-3;

void stick_slip() {
  constexpr double amp = 0.08, omega = 20.0, friction = 0.05, end = 1.0;
  double t = 0.0;
  Values y{0.0, 0.0};
  int way = 0;
  const auto torque = [](double u) { return amp * std::sin(omega * u); };
  while (t < end) {
    Stretch s(
        [&](double u, const double* x, double* dx) {
          dx[0] = way != 0 ? x[1] : 0.0;
          dx[1] = way != 0 ? (torque(u) - way * friction) / inertia : 0.0;
        },
        [&](double u, const double* x, double* g) {
          g[0] = way != 0 ? x[1] : std::abs(torque(u)) - friction;
        },
        1, CV_ADAMS);
    if (!s.run(t, y, end)) break;
    if (way != 0) y[1] = 0.0;
    const bool slips = way == 0 || std::abs(torque(t)) > friction;
    way = slips ? (torque(t) > 0.0 ? 1 : -1) : 0;
  }
}

void accumulation() {
  constexpr double stop = 0.5, pull = 10.0, end = 0.6;
  double t = 0.0;
  Values y{stop, -1.0};
  bool rests = false;
  while (t < end) {
    Stretch s(
        [&](double, const double* x, double* dx) { dx[0] = rests ? 0.0 : x[1], dx[1] = rests ? 0.0 : pull; },
        [](double, const double* x, double* g) { g[0] = x[0] - stop; }, rests ? 0 : 1, CV_ADAMS);
    if (!s.run(t, y, end)) break;
    y = {stop, -0.5 * y[1]};
    if (std::abs(y[1]) < 1e-6) y[1] = 0.0, rests = true;
  }
}

void backlash() {
  constexpr double rotor = 1e-4, gap = 0.02, stiffness = 200.0, amp = 0.05, omega = 30.0, end = 0.4;
  double t = 0.0;
  Values y{0.0, 0.0, 0.0, 0.0};  // wheel, twist; rates
  int flank = 0;
  while (t < end) {
    Stretch s(
        [&](double u, const double* x, double* dx) {
          const double force = flank != 0 ? stiffness * (x[1] - 0.5 * flank * gap) : 0.0;
          dx[0] = x[2], dx[1] = x[3], dx[2] = force / inertia;
          dx[3] = (amp * std::sin(omega * u) - force) / rotor - force / inertia;
        },
        [](double, const double* x, double* g) { g[0] = x[1] - 0.5 * gap, g[1] = x[1] + 0.5 * gap; }, 2,
        CV_ADAMS);
    if (!s.run(t, y, end)) break;
    const int side = y[1] > 0.0 ? 1 : -1;
    y[1] = 0.5 * side * gap;
    flank = side * y[3] > 0.0 ? side : 0;
  }
}

void gear_spring() {
  constexpr double rotor = 1e-4, stiffness = 1e6, damping = 1.0, torque = 0.1;
  double t = 0.0;
  Values y{0.0, 0.0, 0.0, 0.0};
  Stretch(
      [](double, const double* x, double* dx) {
        const double force = stiffness * x[1] + damping * x[3];
        dx[0] = x[2], dx[1] = x[3], dx[2] = force / inertia,
        dx[3] = (torque - force) / rotor - force / inertia;
      },
      nullptr, 0, CV_BDF)
      .run(t, y, 0.1);
}

void stiff_friction() {
  double t = 0.0;
  Values y{0.0, 0.0};  // the rate first, as it is what is compared
  Stretch(
      [](double u, const double* x, double* dx) {
        dx[0] = (0.04 * std::sin(10.0 * u) - 0.05 * std::tanh(x[0] / 1e-4)) / inertia, dx[1] = x[0];
      },
      nullptr, 0, CV_BDF)
      .run(t, y, 0.3);
}

void payload_jump() {
  constexpr double l1 = 0.30, l2 = 0.25, lg1 = 0.15, lg2 = 0.11, m1 = 1.2, m2 = 0.8, J1 = 1e-2, J2 = 4.5e-3,
                   tau1 = 0.6, tau2 = 0.2;
  double t = 0.0, load = 0.0;
  Values y{0.3, 1.0, 0.0, 0.0};
  Stretch s(
      [&](double, const double* x, double* dx) {
        const double c = m2 * l1 * lg2 + load * l1 * l2, a = J1 + m1 * lg1 * lg1 + (m2 + load) * l1 * l1,
                     b = c * std::cos(x[1] - x[0]), d = J2 + m2 * lg2 * lg2 + load * l2 * l2,
                     e = c * std::sin(x[1] - x[0]);
        const double r1 = tau1 - tau2 + e * x[3] * x[3], r2 = tau2 - e * x[2] * x[2], det = a * d - b * b;
        dx[0] = x[2], dx[1] = x[3], dx[2] = (d * r1 - b * r2) / det, dx[3] = (a * r2 - b * r1) / det;
      },
      nullptr, 0, CV_ADAMS);
  s.run(t, y, 0.20037);
  load = 0.5;
  s.run(t, y, 0.60063);
  load = 0.0;
  s.run(t, y, 1.0);
}

/// The five-bar of five_bar_circle.toml: four bar angles, counter-clockwise from the x axis.
struct FiveBar {
  static constexpr double base = 0.05, g = 9.8, l1 = 0.12, l2 = 0.16, lg1 = 0.06, lg2 = 0.068, m = 0.1,
                          J1 = 2e-4, J2 = 7e-4;
  Eigen::Matrix4d mass = Eigen::Matrix4d::Zero();
  Eigen::Vector4d force;
  Eigen::Matrix<double, 2, 4> jacobian;
  Eigen::Vector2d gap, bend;

  FiveBar(const double* a, const double* w) {
    gap << 2 * base, 0.0;
    bend.setZero();
    for (int k = 0; k < 4; k += 2) {
      const double c = m * l1 * lg2, s = c * std::sin(a[k + 1] - a[k]);
      mass(k, k) = J1 + m * lg1 * lg1 + m * l1 * l1;
      mass(k, k + 1) = mass(k + 1, k) = c * std::cos(a[k + 1] - a[k]);
      mass(k + 1, k + 1) = J2 + m * lg2 * lg2;
      force[k] = s * w[k + 1] * w[k + 1] - g * (m * lg1 + m * l1) * std::cos(a[k]);
      force[k + 1] = -s * w[k] * w[k] - g * m * lg2 * std::cos(a[k + 1]);
    }
    for (int k = 0; k < 4; ++k) {
      const double l = (k < 2 ? 1.0 : -1.0) * (k % 2 == 0 ? l1 : l2), x = l * std::cos(a[k]),
                   y = l * std::sin(a[k]);
      gap += Eigen::Vector2d(x, y);
      jacobian.col(k) << -y, x;
      bend -= w[k] * w[k] * Eigen::Vector2d(x, y);
    }
  }
};

Values fall_start() {
  const double pi = std::acos(-1.0), t11 = 0.33914579427821183820, t12 = 1.85318013531281830819,
               t21 = 1.31276054418215195822, t22 = 1.48475269532538599760;
  return {t11, t11 + t12, pi - t21, pi - t21 - t22, 0, 0, 0, 0};
}

void fall_cvode() {  // index 1: accelerations by multipliers
  double t = 0.0;
  Values y = fall_start();
  Stretch(
      [](double, const double* x, double* dx) {
        const FiveBar b(x, x + 4);
        Eigen::Matrix<double, 6, 6> left = Eigen::Matrix<double, 6, 6>::Zero();
        left << b.mass, b.jacobian.transpose(), b.jacobian, Eigen::Matrix2d::Zero();
        Eigen::Matrix<double, 6, 1> right;
        right << b.force, -b.bend;
        const Eigen::Matrix<double, 6, 1> s = left.partialPivLu().solve(right);
        for (int k = 0; k < 4; ++k) dx[k] = x[4 + k], dx[4 + k] = s[k];
      },
      nullptr, 0, CV_ADAMS)
      .run(t, y, 0.25);
}

/// Gear, Gupta and Leimkuhler's form: closure in positions and in rates, two multipliers each.
int ida_residual(double, N_Vector y, N_Vector dy, N_Vector r, void*) {
  const double *x = NV_DATA_S(y), *dx = NV_DATA_S(dy);
  Eigen::Map<Eigen::Matrix<double, 12, 1>> out(NV_DATA_S(r));
  const FiveBar b(x, x + 4);
  const Eigen::Map<const Eigen::Vector4d> w(x + 4), da(dx), dw(dx + 4);
  const Eigen::Map<const Eigen::Vector2d> lambda(x + 8), mu(x + 10);
  out << da - w + b.jacobian.transpose() * mu, b.mass * dw - b.force + b.jacobian.transpose() * lambda,
      b.jacobian * w, b.gap;
  return 0;
}

void fall_ida() {
  const Values start = fall_start();
  N_Vector y = N_VNew_Serial(12, context()), dy = N_VNew_Serial(12, context()),
           kind = N_VNew_Serial(12, context());
  N_VConst(0.0, y);
  N_VConst(0.0, dy);
  for (int i = 0; i < 12; ++i) NV_Ith_S(kind, i) = i < 8 ? 1.0 : 0.0;
  for (int i = 0; i < 8; ++i) NV_Ith_S(y, i) = start[static_cast<std::size_t>(i)];
  const FiveBar b(start.data(), start.data() + 4);
  Eigen::Matrix<double, 6, 6> left;
  left << b.mass, b.jacobian.transpose(), b.jacobian, Eigen::Matrix2d::Zero();
  Eigen::Matrix<double, 6, 1> right;
  right << b.force, -b.bend;
  const Eigen::Matrix<double, 6, 1> s = left.partialPivLu().solve(right);
  for (int i = 0; i < 4; ++i) NV_Ith_S(dy, 4 + i) = s[i];
  for (int i = 0; i < 2; ++i) NV_Ith_S(y, 8 + i) = s[4 + i];
  void* memory = IDACreate(context());
  require(IDAInit(memory, ida_residual, 0.0, y, dy), "IDAInit");
  N_Vector tolerance =
      N_VNew_Serial(12, context());  // of the multipliers a loose one: they follow from the motion
  for (int i = 0; i < 12; ++i) NV_Ith_S(tolerance, i) = i < 8 ? 1e-10 : 1.0;
  require(IDASVtolerances(memory, 1e-10, tolerance), "IDASVtolerances");
  require(IDASetId(memory, kind), "IDASetId");
  require(IDASetSuppressAlg(memory, SUNTRUE), "IDASetSuppressAlg");
  require(IDASetMaxNumSteps(memory, 1000000), "IDASetMaxNumSteps");
  SUNMatrix matrix = SUNDenseMatrix(12, 12, context());
  SUNLinearSolver solver = SUNLinSol_Dense(y, matrix, context());
  require(IDASetLinearSolver(memory, solver, matrix), "IDASetLinearSolver");
  for (int n = 1; n <= 250; ++n) {
    double t = 0.0;
    require(IDASolve(memory, n * 1e-3, &t, y, dy, IDA_NORMAL), "IDASolve");
    std::printf("%.9g,%.17g\n", t, NV_Ith_S(y, 0));
  }
}

}  // namespace

int main(int count, char** words) {
  const std::string name = count == 2 ? words[1] : "";
  const std::pair<const char*, void (*)()> cases[] = {{"stick_slip", stick_slip},
                                                      {"accumulation", accumulation},
                                                      {"backlash", backlash},
                                                      {"gear_spring", gear_spring},
                                                      {"stiff_friction", stiff_friction},
                                                      {"payload_jump", payload_jump},
                                                      {"fall_cvode", fall_cvode},
                                                      {"fall_ida", fall_ida}};
  for (const auto& [known, solve] : cases)
    if (name == known) return solve(), 0;
  std::fprintf(stderr,
               "usage: peers_hard stick_slip | accumulation | backlash | gear_spring | stiff_friction | "
               "payload_jump | fall_cvode | fall_ida\n");
  return 2;
}
