/// MuJoCo as a reader of what `esmc export` writes. mujoco_reader FILE: for every line on stdin one line of
/// numbers on stdout.
///   names                        joint names in the order of q
///   start                        q, v of the keyframe
///   effector q                   x, z of the site `effector`
///   forward softness q v u       accelerations under the motor torques u. softness: 1 - solimp of the
///   closure friction                     viscous and dry friction of the joints gravity g from now on g m/s2
///   downwards (an URDF does not say) inverse q v a                joint torques without dry friction, which
///   MuJoCo smooths run T N motors(offset n (amp omega phase)*n)    N + 1 states from the keyframe on,
///   torques evaluated at every stage
#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iostream>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

namespace {

using Model = std::unique_ptr<mjModel, decltype(&mj_deleteModel)>;
using Data = std::unique_ptr<mjData, decltype(&mj_deleteData)>;

struct Term {
  double amp, omega, phase;
};
struct Wave {
  double offset = 0.0;
  std::vector<Term> terms;
};
std::vector<Wave> waves;  // MuJoCo's callback has no argument of ours

void read(std::istream& in, double* to, int n) {
  for (int i = 0; i < n; ++i) in >> to[i];
}

void print(const double* from, int n, const char* end = "\n") {
  for (int i = 0; i < n; ++i) std::printf("%.17g ", from[i]);
  std::printf("%s", end);
}

void kinematics(const mjModel& m, mjData& d) {
  mj_fwdPosition(&m, &d);
  mj_fwdVelocity(&m, &d);
}

/// J' v of the closure: the change of J v along the motion with v held; central differences, fourth order.
/// MuJoCo's connect leaves it out of the acceleration that it asks for, and lets its springs make up for it.
std::vector<double> curvature(const mjModel& m, mjData& d) {
  const std::vector<double> q(d.qpos, d.qpos + m.nq);
  const double speed = std::max(1.0, mju_norm(d.qvel, m.nv)), h = 1e-3 / speed;
  std::vector<double> out(3 * static_cast<std::size_t>(m.neq), 0.0);
  constexpr double weight[] = {1.0 / 12.0, -2.0 / 3.0, 2.0 / 3.0, -1.0 / 12.0}, at[] = {-2, -1, 1, 2};
  for (int k = 0; k < 4; ++k) {
    for (int i = 0; i < m.nq; ++i) d.qpos[i] = q[static_cast<std::size_t>(i)] + at[k] * h * d.qvel[i];
    kinematics(m, d);
    for (std::size_t i = 0; i < out.size(); ++i) out[i] += weight[k] * d.efc_vel[i] / h;
  }
  std::copy(q.begin(), q.end(), d.qpos);
  return out;
}

void forward(mjModel& m, mjData& d, std::istream& in) {
  double softness = 0.0;
  in >> softness;
  for (int i = 0; i < m.neq; ++i) m.eq_solimp[mjNIMP * i] = m.eq_solimp[mjNIMP * i + 1] = 1.0 - softness;
  mj_resetData(&m, &d);
  read(in, d.qpos, m.nq);
  read(in, d.qvel, m.nv);
  read(in, d.ctrl, m.nu);
  const std::vector<double> missing = curvature(m, d);
  kinematics(m, d);
  for (std::size_t i = 0; i < missing.size(); ++i) d.efc_aref[i] -= missing[i];
  mj_fwdActuation(&m, &d);
  mj_fwdAcceleration(&m, &d);
  mj_fwdConstraint(&m, &d);
  print(d.qacc, m.nv);
}

void control(const mjModel* m, mjData* d) {
  for (int i = 0; i < m->nu; ++i) {
    const Wave& w = waves[static_cast<std::size_t>(i)];
    d->ctrl[i] = w.offset;
    for (const Term& t : w.terms) d->ctrl[i] += t.amp * std::sin(t.omega * d->time + t.phase);
  }
}

void run(const mjModel& m, mjData& d, std::istream& in) {
  double end = 0.0;
  int n = 0;
  in >> end >> n;
  waves.assign(static_cast<std::size_t>(m.nu), {});
  for (Wave& w : waves) {
    int terms = 0;
    in >> w.offset >> terms;
    for (int i = 0; i < terms; ++i) {
      Term t{};
      in >> t.amp >> t.omega >> t.phase;
      w.terms.push_back(t);
    }
  }
  mj_resetDataKeyframe(&m, &d, 0);
  mjcb_control = control;
  const long steps = std::lround(end / n / m.opt.timestep);
  for (int k = 0; k <= n; ++k) {
    print(d.qpos, m.nq, "");
    for (long i = 0; k < n && i < steps; ++i) mj_step(&m, &d);
  }
  mjcb_control = nullptr;
  std::printf("\n");
}

bool answer(mjModel& m, mjData& d, std::istream& in) {
  std::string what;
  in >> what;
  if (what == "names") {
    for (int i = 0; i < m.njnt; ++i) std::printf("%s ", mj_id2name(&m, mjOBJ_JOINT, i));
    std::printf("\n");
  } else if (what == "start") {
    print(m.key_qpos, m.nq, "");
    print(m.key_qvel, m.nv);
  } else if (what == "friction") {
    print(m.dof_damping, m.nv, "");
    print(m.dof_frictionloss, m.nv);
  } else if (what == "gravity") {
    in >> m.opt.gravity[2];
    m.opt.gravity[2] = -m.opt.gravity[2];
    std::printf("\n");
  } else if (what == "effector") {
    read(in, d.qpos, m.nq);
    mj_fwdPosition(&m, &d);
    const double* p = d.site_xpos + 3 * mj_name2id(&m, mjOBJ_SITE, "effector");
    std::printf("%.17g %.17g\n", p[0], p[2]);
  } else if (what == "forward") {
    forward(m, d, in);
  } else if (what == "inverse") {
    read(in, d.qpos, m.nq);
    read(in, d.qvel, m.nv);
    read(in, d.qacc, m.nv);
    m.opt.disableflags |= mjDSBL_FRICTIONLOSS;
    mj_inverse(&m, &d);
    m.opt.disableflags &= ~mjDSBL_FRICTIONLOSS;
    print(d.qfrc_inverse, m.nv);
  } else if (what == "run") {
    run(m, d, in);
  } else {
    return false;
  }
  std::fflush(stdout);
  return true;
}

}  // namespace

int main(int argc, char** argv) {
  char error[1000] = "no file given";
  const Model m(argc == 2 ? mj_loadXML(argv[1], nullptr, error, sizeof error) : nullptr, &mj_deleteModel);
  if (!m) {
    std::cerr << "mujoco_reader: " << error << "\n";
    return 2;
  }
  const Data d(mj_makeData(m.get()), &mj_deleteData);
  for (std::string line; std::getline(std::cin, line);) {
    std::istringstream in(line);
    if (!answer(*m, *d, in)) return 2;
  }
  return 0;
}
