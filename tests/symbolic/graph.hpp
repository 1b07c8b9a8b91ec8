#pragma once
/// A scalar that records what is done with it: a graph of operations in which equal ones are one, constants
/// are folded, and nothing is reordered but x + (z - x) = z. Sent through the templates of firmware/mechanism
/// it yields a program without loops, matrices or multiplications by 0 and 1.

#include <Eigen/Core>
#include <bit>
#include <compare>
#include <cstdint>
#include <map>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "firmware/numeric/elementary.hpp"

namespace esmc::test {

enum class Op {
  constant,
  parameter,
  variable,
  add,
  subtract,
  multiply,
  negate,
  invert,
  sine,
  cosine,
  step,
  saturate,
  arc_tangent
};
[[nodiscard]] constexpr bool takes_two(Op op) {
  return (op >= Op::add && op <= Op::multiply) || op >= Op::saturate;
}

struct Node {
  Op op = Op::constant;
  int a = 0, b = 0;  ///< operands, as indices of the graph
  double value = 0;
  std::string name{};
  std::uint64_t key = 0;  ///< of the whole expression: the order of operands must not depend on the compiler
  auto operator<=>(const Node&) const = default;
};

class Expression {
 public:
  Expression() : Expression(0) {}
  // NOLINTNEXTLINE(google-explicit-constructor): Eigen and the templates write numbers
  Expression(double number) : id_(intern({.op = Op::constant, .value = number == 0 ? 0.0 : number})) {}
  /// Fixed for a mechanism: what depends on these alone is computed once.
  static Expression parameter(const std::string& name) { return make({.op = Op::parameter, .name = name}); }
  static Expression variable(const std::string& name) { return make({.op = Op::variable, .name = name}); }
  static const std::vector<Node>& graph() { return nodes(); }
  [[nodiscard]] int id() const { return id_; }

  friend Expression operator+(Expression x, Expression y) {
    if (x.is(0)) return y;
    if (y.is(0)) return x;
    if (x.node().op == Op::negate) return y - x.operand();
    if (y.node().op == Op::negate) return x - y.operand();
    if (x.fixed() && y.fixed()) return Expression(x.node().value + y.node().value);
    if (y.node().op == Op::subtract && y.node().b == x.id_) return y.operand();  // x + (z - x)
    if (x.node().op == Op::subtract && x.node().b == y.id_) return x.operand();
    return commutative(Op::add, x, y);
  }
  friend Expression operator-(Expression x, Expression y) {
    if (x.id_ == y.id_) return Expression(0);
    if (y.is(0)) return x;
    if (x.is(0)) return -y;
    if (y.node().op == Op::negate) return x + y.operand();
    if (x.node().op == Op::negate) return -(x.operand() + y);
    if (x.fixed() && y.fixed()) return Expression(x.node().value - y.node().value);
    return make({.op = Op::subtract, .a = x.id_, .b = y.id_});
  }
  friend Expression operator-(Expression x) {
    if (x.fixed()) return Expression(-x.node().value);
    if (x.node().op == Op::negate) return x.operand();
    if (x.node().op == Op::subtract) return make({.op = Op::subtract, .a = x.node().b, .b = x.node().a});
    return make({.op = Op::negate, .a = x.id_});
  }
  friend Expression operator*(Expression x, Expression y) {
    if (x.is(0) || y.is(0)) return Expression(0);
    if (x.is(1)) return y;
    if (y.is(1)) return x;
    if (x.is(-1)) return -y;
    if (y.is(-1)) return -x;
    if (x.node().op == Op::negate) return -(x.operand() * y);
    if (y.node().op == Op::negate) return -(x * y.operand());
    if (x.fixed() && y.fixed()) return Expression(x.node().value * y.node().value);
    return commutative(Op::multiply, x, y);
  }
  friend Expression operator/(Expression x, Expression y) {
    if (y.fixed()) return x * Expression(1 / y.node().value);
    return x * make({.op = Op::invert, .a = y.id_});
  }
  /// 1 or 0. Nothing that is generated may depend on it, but friction that is 0 is multiplied by it.
  friend Expression operator>(Expression x, Expression y) { return make({.op = Op::step, .a = (x - y).id_}); }
  friend Expression operator<(Expression x, Expression y) { return y > x; }
  Expression& operator+=(Expression y) { return *this = *this + y; }
  Expression& operator-=(Expression y) { return *this = *this - y; }
  Expression& operator*=(Expression y) { return *this = *this * y; }
  friend SinCos<Expression> sin_cos(Expression angle) {
    return {make({.op = Op::sine, .a = angle.id_}), make({.op = Op::cosine, .a = angle.id_})};
  }
  // What a law calls by these names and the program calls again.
  friend Expression angle_of_unit(Expression y, Expression x) {
    return make({.op = Op::arc_tangent, .a = y.id_, .b = x.id_});
  }
  friend Expression saturated(Expression s, Expression layer) {
    return make({.op = Op::saturate, .a = s.id_, .b = layer.id_});
  }
  // What the laws name but what is generated does not use.
  friend Expression sign_of(Expression s) { return s > Expression(0); }
  friend Expression hyperbolic_tangent(Expression s) { return s > Expression(0); }
  friend Expression wrap_to_pi(Expression angle) {
    return angle;
  }  // of joints, which have no mass: display only

 private:
  static std::vector<Node>& nodes() {
    static std::vector<Node> all;
    return all;
  }
  static std::uint64_t key(const Node& n) {  // FNV-1a
    std::uint64_t h = 0xcbf29ce484222325U;
    const auto mix = [&](std::uint64_t v) { h = (h ^ v) * 0x100000001b3U ^ (h >> 29U); };
    mix(static_cast<std::uint64_t>(n.op));
    mix(std::bit_cast<std::uint64_t>(n.value));
    for (const char c : n.name) mix(static_cast<unsigned char>(c));
    if (n.op >= Op::add) mix(nodes()[static_cast<std::size_t>(n.a)].key);
    if (takes_two(n.op)) mix(nodes()[static_cast<std::size_t>(n.b)].key);
    return h;
  }
  static int intern(Node n) {
    n.key = key(n);
    static std::map<Node, int> known;
    const auto [found, is_new] = known.try_emplace(n, static_cast<int>(nodes().size()));
    if (is_new) nodes().push_back(n);
    return found->second;
  }
  static Expression make(const Node& n) {
    Expression out;
    out.id_ = intern(n);
    return out;
  }
  static Expression commutative(Op op, Expression x, Expression y) {
    if (y.node().key < x.node().key) std::swap(x, y);
    return make({.op = op, .a = x.id_, .b = y.id_});
  }
  [[nodiscard]] const Node& node() const { return nodes()[static_cast<std::size_t>(id_)]; }
  [[nodiscard]] bool fixed() const { return node().op == Op::constant; }
  [[nodiscard]] bool is(double number) const { return fixed() && node().value == number; }
  [[nodiscard]] Expression operand() const {
    Expression out;
    out.id_ = node().a;
    return out;
  }

  int id_;
};

}  // namespace esmc::test

template <>
struct Eigen::NumTraits<esmc::test::Expression> : Eigen::GenericNumTraits<esmc::test::Expression> {
  using Real = esmc::test::Expression;
  using NonInteger = esmc::test::Expression;
  using Nested = esmc::test::Expression;
  using Literal = esmc::test::Expression;
  enum {
    IsComplex = 0,
    IsInteger = 0,
    IsSigned = 1,
    RequireInitialization = 1,
    ReadCost = 1,
    AddCost = 1,
    MulCost = 1
  };
};
