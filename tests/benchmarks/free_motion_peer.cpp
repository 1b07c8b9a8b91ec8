#include "tests/benchmarks/free_motion_peer.hpp"

#include <Simbody.h>

#include <algorithm>
#include <cmath>
#include <ctime>

namespace esmc {
namespace test {
namespace {

double cpu_s() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

/// Two pin chains; the tip of leg 1 stays on the line through the tip of leg 2 along the axis of the pins.
class Peer {
 public:
  explicit Peer(const PeerStart& p)
      : p_(p), matter_(system_), forces_(system_), gravity_(forces_, matter_, SimTK::Vec3(0, -p.g, 0)) {
    using namespace SimTK;
    const auto bar = [](double m, double lg, double J, double tip, double length) {
      const Vec3 c(lg, 0, 0), e(length, 0, 0);
      Inertia about_joint = Inertia(J, J, J).shiftFromMassCenter(c, m);
      if (tip > 0.0) about_joint += Inertia(e, tip);
      const double all = m + tip;
      return Body::Rigid(MassProperties(all, (m * c + tip * e) / all, about_joint));
    };
    for (int leg = 0; leg < 2; ++leg) {
      const Vec3 base(leg == 0 ? p.l0 : -p.l0, 0, 0), elbow(p.l1, 0, 0);
      MobilizedBody::Pin first(matter_.Ground(), Transform(base), bar(p.m1, p.lg1, p.J1, 0.0, p.l1),
                               Transform());
      MobilizedBody::Pin second(first, Transform(elbow), bar(p.m2, p.lg2, p.J2, leg == 0 ? p.m0 : 0.0, p.l2),
                                Transform());
      pin_.push_back(first);
      pin_.push_back(second);
    }
    const Vec3 tip(p.l2, 0, 0);
    Constraint::PointOnLine(pin_[3], UnitVec3(0, 0, 1), tip, pin_[1], tip);
    system_.realizeTopology();
  }

  SimTK::State start() const {
    SimTK::State state = system_.getDefaultState();
    const double angle[] = {p_.angle[0], p_.angle[1] - p_.angle[0], p_.angle[2], p_.angle[3] - p_.angle[2]};
    for (std::size_t i = 0; i < 4; ++i) pin_[i].setOneQ(state, 0, angle[i]);
    system_.realize(state, SimTK::Stage::Acceleration);
    return state;
  }
  double acceleration(const SimTK::State& s, std::size_t pin) const { return pin_[pin].getOneUDot(s, 0); }

  PeerRun run(double accuracy, bool project_every_step, int seconds) const {
    const SimTK::State state = start();
    SimTK::RungeKuttaMersonIntegrator integrator(system_);
    integrator.setAccuracy(accuracy);
    integrator.setConstraintTolerance(std::min(accuracy, 1e-6));
    integrator.setProjectEveryStep(project_every_step);
    PeerRun out;
    const double begin = cpu_s();
    integrator.initialize(state);
    for (int s = 0; s < seconds; ++s) {
      while (integrator.getTime() < s + 1.0)
        integrator.stepTo(s + 1.0);  // the first call only reports the start
      const SimTK::State& at = integrator.getState();
      system_.realize(at, SimTK::Stage::Position);
      const SimTK::Vec3 tip(p_.l2, 0, 0), a = pin_[1].findStationLocationInGround(at, tip),
                                          gap = a - pin_[3].findStationLocationInGround(at, tip);
      out.path.push_back({a[0], a[1]});
      out.closure = std::max(out.closure, std::hypot(gap[0], gap[1]));
    }
    out.cpu_ms = 1e3 * (cpu_s() - begin);
    return out;
  }

 private:
  PeerStart p_;
  SimTK::MultibodySystem system_;
  SimTK::SimbodyMatterSubsystem matter_;
  SimTK::GeneralForceSubsystem forces_;
  SimTK::Force::Gravity gravity_;
  std::vector<SimTK::MobilizedBody::Pin> pin_;
};

}  // namespace

std::array<double, 4> peer_accelerations(const PeerStart& s) {
  const Peer peer(s);
  const SimTK::State state = peer.start();
  return {peer.acceleration(state, 0), peer.acceleration(state, 1), peer.acceleration(state, 2),
          peer.acceleration(state, 3)};
}

PeerRun peer_run(const PeerStart& s, double accuracy, bool project_every_step, int seconds) {
  return Peer(s).run(accuracy, project_every_step, seconds);
}

}  // namespace test
}  // namespace esmc
