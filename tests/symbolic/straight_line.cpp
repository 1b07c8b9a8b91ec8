// Prints tests/benchmarks/straight_line.hpp: the forward dynamics of the five-bar in base-joint coordinates
// [F23]-[F25] and three laws from state to torque, as programs without loops, from expressions sent through
// the templates of firmware/mechanism and firmware/control.

#include <algorithm>
#include <cstdio>
#include <exception>
#include <iostream>
#include <sstream>

#include "firmware/control/fused_law.hpp"
#include "firmware/mechanism/five_bar.hpp"
#include "firmware/mechanism/rr.hpp"
#include "tests/symbolic/graph.hpp"

namespace esmc::test {
namespace {

using S = Expression;

/// Prints the part of the graph that its outputs need, in the order in which it was made.
class Program {
 public:
  explicit Program(const std::vector<S>& outputs)
      : seen_(graph().size()), fixed_(graph().size()), kept_(graph().size()), name_(graph().size()) {
    for (const S& out : outputs) visit(out.id());
    // A fixed value is a member when something that varies, or an output, asks for it.
    for (const int i : order_) {
      const Node& n = graph()[at(i)];
      if (fixed_[at(i)] || !computed(n)) continue;
      keep(n.a);
      if (binary(n)) keep(n.b);
    }
    for (const S& out : outputs) keep(out.id());
    for (const int i : order_) {
      if (kept_[at(i)]) {
        number(i, "k");
        members_ += (members_.empty() ? "" : ", ") + name_[at(i)] + "{}";
      } else if (fixed_[at(i)] && computed(graph()[at(i)])) {
        number(i, "c");
      }
    }
  }

  /// Statements that compute the members.
  [[nodiscard]] std::string constructor() const {
    std::ostringstream out;
    for (const int i : order_) {
      if (!fixed_[at(i)] || name_[at(i)].empty()) continue;
      out << "    " << (kept_[at(i)] ? "" : "const S ") << name_[at(i)] << " = " << right_side(i) << ";\n";
    }
    return out.str();
  }
  /// Statements that compute everything else: first the angles and, all at once as the plant does, their
  /// sines.
  [[nodiscard]] std::string body() {
    std::ostringstream out;
    std::vector<int> angles;
    for (const int i : order_) {
      const Node& n = graph()[at(i)];
      if (fixed_[at(i)] || (n.op != Op::sine && n.op != Op::cosine)) continue;
      if (std::find(angles.begin(), angles.end(), n.a) == angles.end()) angles.push_back(n.a);
    }
    for (const int i : angles) statement(i, out);
    if (!angles.empty()) out << "    const auto a = sin_cos(std::array<S, " << angles.size() << ">{";
    for (std::size_t k = 0; k < angles.size(); ++k) out << (k == 0 ? "" : ", ") << name(angles[k]);
    if (!angles.empty()) out << "});\n";
    for (const int i : order_) {
      const Node& n = graph()[at(i)];
      if (fixed_[at(i)] || !computed(n)) continue;
      ++operations_;
      if (n.op == Op::sine || n.op == Op::cosine) {
        const auto k = std::find(angles.begin(), angles.end(), n.a) - angles.begin();
        name_[at(i)] = std::string("a.") + (n.op == Op::sine ? "sin[" : "cos[") + std::to_string(k) + "]";
        continue;
      }
      statement(i, out);
    }
    return out.str();
  }
  [[nodiscard]] const std::string& members() const { return members_; }
  [[nodiscard]] std::string name(int i) const {
    const Node& n = graph()[at(i)];
    if (!name_[at(i)].empty()) return name_[at(i)];
    if (n.op == Op::variable || n.op == Op::parameter) return n.name;
    std::ostringstream out;
    out.precision(17);
    out << n.value;
    return out.str().find_first_of(".e") == std::string::npos ? out.str() + ".0" : out.str();
  }
  [[nodiscard]] int operations() const { return operations_; }

 private:
  static const std::vector<Node>& graph() { return S::graph(); }
  static std::size_t at(int i) { return static_cast<std::size_t>(i); }
  static bool binary(const Node& n) { return takes_two(n.op); }
  static bool computed(const Node& n) {
    return n.op != Op::constant && n.op != Op::parameter && n.op != Op::variable;
  }
  /// Operands first: the order is that of the formulas, whatever the compiler evaluated first.
  void visit(int i) {
    if (seen_[at(i)]) return;
    seen_[at(i)] = true;
    const Node n = graph()[at(i)];
    if (n.op == Op::step) throw std::domain_error("the program would depend on a sign");
    if (computed(n)) visit(n.a);
    if (binary(n)) visit(n.b);
    fixed_[at(i)] =
        n.op != Op::variable && (!computed(n) || fixed_[at(n.a)]) && (!binary(n) || fixed_[at(n.b)]);
    order_.push_back(i);
  }
  void keep(int i) {
    if (fixed_[at(i)] && graph()[at(i)].op != Op::constant) kept_[at(i)] = true;
  }
  /// Computes node i, and before it what it is computed from, unless that is done already.
  void statement(int i, std::ostringstream& out) {
    const Node n = graph()[at(i)];
    if (!computed(n) || !name_[at(i)].empty()) return;
    statement(n.a, out);
    if (binary(n)) statement(n.b, out);
    number(i, "t");
    out << "    const S " << name_[at(i)] << " = " << right_side(i) << ";\n";
  }
  void number(int i, const std::string& letter) {
    int& last = count_[letter];
    name_[at(i)] = letter + std::to_string(++last) + (letter == "k" ? "_" : "");
  }
  [[nodiscard]] std::string right_side(int i) const {
    const Node& n = graph()[at(i)];
    switch (n.op) {
      case Op::parameter:
        return n.name;
      case Op::add:
        return name(n.a) + " + " + name(n.b);
      case Op::subtract:
        return name(n.a) + " - " + name(n.b);
      case Op::multiply:
        return name(n.a) + " * " + name(n.b);
      case Op::saturate:
        return "saturated(" + name(n.a) + ", " + name(n.b) + ")";
      case Op::arc_tangent:
        return "angle_of_unit(" + name(n.a) + ", " + name(n.b) + ")";
      case Op::negate:
        return "-" + name(n.a);
      case Op::invert:
        return "1.0 / " + name(n.a);
      default:
        throw std::logic_error("not a statement");
    }
  }

  std::vector<bool> seen_, fixed_, kept_;
  std::vector<std::string> name_;  // empty: a number, a parameter or variable by its own name
  std::vector<int> order_;
  std::string members_;
  std::map<std::string, int> count_;
  int operations_ = 0;
};

/// A bar moves as two point masses at its ends would, with what is left of its inertia: the outer bar's go to
/// the elbow and to the effector, and a bar that turns about the ground has but an inertia and a weight. So
/// no mass centre is left to follow.
struct Leg {
  LegParams<S> params;
  S at_effector;    ///< mass, kg
  S weight_moment;  ///< about the base joint, bar 1 level, per g, kg m
};

Leg reduced_leg(const std::string& j) {
  const auto of = [&](const char* name) { return S::parameter("p.legs[" + j + "]." + name); };
  const S l1 = of("l1"), l2 = of("l2"), first = of("m1") * of("lg1"), second = of("m2") * of("lg2");
  const S tip = second / l2, elbow = of("m2") - tip;
  Leg out;
  out.params.l1 = l1;
  out.params.l2 = l2;
  out.params.J1 = of("J1") + first * of("lg1") + elbow * l1 * l1;
  out.params.J2 = of("J2") + second * of("lg2") - second * l2;
  out.at_effector = tip;
  out.weight_moment = first + elbow * l1;
  return out;
}

/// A class whose constructor takes what is fixed and whose call operator the rest.
void print_class(const std::string& name, const std::string& comment, const std::string& fixed,
                 const std::string& call_comment, const std::string& arguments,
                 const std::vector<S>& outputs) {
  Program program(outputs);
  const std::string constructor = program.constructor(), body = program.body();
  std::cout << "/// " << comment << "\ntemplate <class S>\nclass " << name
            << " {\n public:\n  static constexpr int operations = " << program.operations()
            << ";  ///< per call; a sine counts as one\n\n  explicit " << name << "(" << fixed << ") {\n"
            << constructor << "  }\n\n  /// " << call_comment << "\n  [[nodiscard]] std::array<S, "
            << outputs.size() << "> operator()(" << arguments << ") const {\n"
            << body << "    return {";
  for (std::size_t i = 0; i < outputs.size(); ++i)
    std::cout << (i == 0 ? "" : ", ") << program.name(outputs[i].id());
  std::cout << "};\n  }\n\n private:\n  S " << program.members() << ";\n};\n\n";
}

void print_forward_dynamics() {
  const List<Leg, 2> leg{{reduced_leg("0"), reduced_leg("1")}};
  FiveBarParams<S> params;
  const S g = S::parameter("p.g");
  params.l0 = S::parameter("p.l0");
  params.m0 = S::parameter("p.m0") + leg[0].at_effector + leg[1].at_effector;
  params.g = g;
  params.legs = {leg[0].params, leg[1].params};
  const FiveBar<S> m(params);
  Vec<S, 4> theta, torque;
  for (int i = 0; i < 4; ++i) {
    theta[i] = S::variable("theta[" + std::to_string(i) + "]");
    torque[i] = S::variable("torque[" + std::to_string(i) + "]");
  }
  const Vec2<S> rate(S::variable("rate[0]"), S::variable("rate[1]"));
  const auto pose = m.pose(theta);
  for (int j = 0; j < 2; ++j)
    torque[Eigen::Index{2} * j] -= leg[j].weight_moment * g * pose.leg[j].axis[0].x();
  const auto rates = m.base_rates(pose, rate);
  // H_a a + h_a = C^_a^T tau [F25], by Cramer's rule.
  Mat<S, 2, 2> H;
  for (int k = 0; k < 2; ++k) {
    const auto column = m.channel_rates(pose, m.base_rates(pose, Vec2<S>::Unit(k)));
    H.col(k) = m.base_torque(pose, column.cwiseProduct(m.mass()));
  }
  const auto drift = m.channel_accelerations(pose, rates, m.base_accelerations(pose, rates, Vec2<S>::Zero()));
  const Vec2<S> h = m.base_torque(pose, m.force(drift, rates));
  const Vec2<S> F =
      m.gather_on_base(pose, Vec2<S>::Zero(), {{torque.template head<2>(), torque.template tail<2>()}}) - h;
  const S scale = S(1) / (H(0, 0) * H(1, 1) - H(1, 0) * H(1, 0));
  const Vec2<S> a((H(1, 1) * F[0] - H(1, 0) * F[1]) * scale, (H(0, 0) * F[1] - H(1, 0) * F[0]) * scale);
  const auto all = m.base_accelerations(pose, rates, a);
  const std::vector<S> outputs{all.leg[0][0], all.leg[0][1], all.leg[1][0], all.leg[1][1]};

  print_class(
      "StraightLine",
      "Joint accelerations of a five-bar without friction, by minimal coordinates. Pole at type 2.",
      "const FiveBarParams<S>& p",
      "theta11, theta12, theta21, theta22 (closed), rad; theta11', theta21', rad/s; joint torques, N m.",
      "const std::array<S, 4>& theta, const std::array<S, 2>& rate, const std::array<S, 4>& "
      "torque",
      outputs);
}

S variable(const std::string& name) { return S::variable(name); }
Vec2<S> pair(const std::string& name) { return {variable(name + ".x()"), variable(name + ".y()")}; }
Vec2<S> entries(const std::string& name) { return {variable(name + "[0]"), variable(name + "[1]")}; }

Dyad<S>::Pose dyad_pose(const std::string& name) {
  Dyad<S>::Pose p;
  for (int i = 0; i < 2; ++i) {
    p.axis[i] = pair(name + ".axis[" + std::to_string(i) + "]");
    p.turn[i] = pair(name + ".turn[" + std::to_string(i) + "]");
  }
  return p;
}
FiveBar<S>::Pose pose_of(const std::string& name, const FiveBar<S>*) {
  FiveBar<S>::Pose p;
  for (int j = 0; j < 2; ++j) p.leg[j] = dyad_pose(name + ".leg[" + std::to_string(j) + "]");
  p.effector = pair(name + ".effector");
  p.sin_type2 = variable(name + ".sin_type2");
  return p;
}
Rr<S>::Pose pose_of(const std::string& name, const Rr<S>*) {
  return {dyad_pose(name + ".arm"), pair(name + ".effector")};
}
FiveBar<S>::Rates rates_of(const std::string& name, const FiveBar<S>*) {
  FiveBar<S>::Rates r;
  r.platform = pair(name + ".platform");
  for (int j = 0; j < 2; ++j) r.leg[j] = entries(name + ".leg[" + std::to_string(j) + "]");
  return r;
}
Rr<S>::Rates rates_of(const std::string& name, const Rr<S>*) { return entries(name); }

LegParams<S> leg_of(const std::string& name) {
  LegParams<S> p;
  const auto of = [&](const char* member) { return S::parameter(name + "." + member); };
  p.l1 = of("l1"), p.l2 = of("l2"), p.lg1 = of("lg1"), p.lg2 = of("lg2");
  p.m1 = of("m1"), p.m2 = of("m2"), p.J1 = of("J1"), p.J2 = of("J2");
  return p;
}

/// Torque of the base joints, implicit or saturation, from the very structure that the law takes.
template <class M>
void print_law(const std::string& name, const std::string& of, const std::string& params, const M& m,
               LawKind law) {
  Gains<M> g;
  for (int i = 0; i < M::channels; ++i) {
    const std::string row = "[" + std::to_string(i) + "]";
    g.lambda[i] = S::parameter("g.lambda" + row);
    g.k[i] = S::parameter("g.k" + row);
    g.layer[i] = S::parameter("g.layer" + row);
  }
  g.independent.lambda = S::parameter("g.independent.lambda");
  const M* type = nullptr;
  Tracking<M> t;
  t.pose = pose_of("t.pose", type);
  t.desired_pose = pose_of("t.desired_pose", type);
  t.rates = rates_of("t.rates", type);
  t.desired_rates = rates_of("t.desired_rates", type);
  t.desired_acceleration = rates_of("t.desired_acceleration", type);
  typename M::Channels acceleration, sliding;
  fused_acceleration(law, m, g, Reaching::implicit, t, acceleration, sliding);
  const Vec2<S> torque = m.base_torque(t.pose, m.force(acceleration, t.rates));
  print_class(name, of + " from state and reference to base-joint torque, without friction.",
              "const " + params + "<S>& p, const Gains<" + (M::joints == 4 ? "FiveBar" : "Rr") + "<S>>& g",
              "N m.", std::string("const Tracking<") + (M::joints == 4 ? "FiveBar" : "Rr") + "<S>>& t",
              {torque[0], torque[1]});
}

void print() {
  std::cout
      << "#pragma once\n"
         "/// Generated by tests/symbolic/straight_line.cpp from the templates of firmware/mechanism and\n"
         "/// firmware/control; a test compares. Do not edit. A yardstick: what these equations cost without "
         "loops,\n"
         "/// matrices, and products with 0 and 1.\n\n"
         "#include <array>\n\n"
         "#include \"firmware/control/law.hpp\"\n"
         "#include \"firmware/mechanism/params.hpp\"\n"
         "#include \"firmware/mechanism/rr.hpp\"\n\n"
         "// clang-format off\n"
         "namespace esmc::test {\n\n";
  print_forward_dynamics();
  FiveBarParams<S> five_bar;
  five_bar.l0 = S::parameter("p.l0"), five_bar.m0 = S::parameter("p.m0"), five_bar.g = S::parameter("p.g");
  five_bar.legs = {leg_of("p.legs[0]"), leg_of("p.legs[1]")};
  RrParams<S> arm;
  arm.arm = leg_of("p.arm"), arm.g = S::parameter("p.g");
  print_law("StraightProjected", "esmc_projected of the five-bar", "FiveBarParams", FiveBar<S>(five_bar),
            LawKind::esmc_projected);
  print_law("StraightEsmc", "esmc of the five-bar", "FiveBarParams", FiveBar<S>(five_bar), LawKind::esmc);
  print_law("StraightArm", "esmc of the RR arm", "RrParams", Rr<S>(arm), LawKind::esmc);
  std::cout << "}  // namespace esmc::test\n";
}

}  // namespace
}  // namespace esmc::test

int main() try {
  esmc::test::print();
  return 0;
} catch (const std::exception& e) {
  std::fputs(e.what(), stderr);
  return 1;
}
