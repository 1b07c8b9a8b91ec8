#pragma once
/// Cases of `esmc eval`: typed access to JSON with errors that name the case, and vectors and matrices as
/// JSON.

#include <Eigen/Core>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string>

#include "firmware/control/law.hpp"
#include "firmware/mechanism/params.hpp"
#include "host_sim/error.hpp"

namespace esmc::host {

using Json = nlohmann::ordered_json;

/// One value of the input, which must outlive it, with the place to name in errors ("FILE:LINE: case 'id'").
/// Reading functions throw InputError for an absent key, another type and a number that is not finite.
class Node {
 public:
  Node(const Json& value, std::string where, std::string path)
      : value_(&value), where_(std::move(where)), path_(std::move(path)) {}

  [[nodiscard]] bool has(const char* key) const { return value_->is_object() && value_->contains(key); }
  [[nodiscard]] Node at(const char* key) const {
    if (!has(key)) fail(std::string("missing key '") + name(key) + "'");
    return {(*value_)[key], where_, name(key)};
  }
  [[nodiscard]] Node at(std::size_t i) const {
    if (!value_->is_array() || i >= value_->size())
      fail("'" + path_ + "' must be an array with more entries");
    return {(*value_)[i], where_, path_ + "[" + std::to_string(i) + "]"};
  }
  [[nodiscard]] std::size_t size() const { return value_->is_array() ? value_->size() : 0; }  ///< 0: no array
  template <class S>
  [[nodiscard]] S number() const {
    if (!value_->is_number()) fail("'" + path_ + "' must be a number");
    const auto v = static_cast<S>(value_->get<double>());
    if (!std::isfinite(v)) fail("'" + path_ + "' must be finite");
    return v;
  }
  template <class S>
  [[nodiscard]] S number(const char* key) const {
    return at(key).number<S>();
  }
  template <class S, int N>
  [[nodiscard]] Eigen::Matrix<S, N, 1> vector(const char* key) const {
    const Node list = at(key);
    if (list.size() != N) list.fail("'" + list.path_ + "' must have " + std::to_string(N) + " entries");
    Eigen::Matrix<S, N, 1> out;
    for (int i = 0; i < N; ++i) out[i] = list.at(static_cast<std::size_t>(i)).template number<S>();
    return out;
  }
  [[nodiscard]] std::string text(const char* key) const {
    const Node v = at(key);
    if (!v.value_->is_string()) v.fail("'" + v.path_ + "' must be a string");
    return v.value_->get<std::string>();
  }
  /// Reads +1 or -1; throws InputError for another value.
  [[nodiscard]] int sign() const {
    const auto v = number<double>();
    if (v != 1.0 && v != -1.0) fail("'" + path_ + "' must be 1 or -1");
    return v > 0 ? 1 : -1;
  }
  [[noreturn]] void fail(const std::string& what) const { throw InputError(where_, what); }

 private:
  [[nodiscard]] std::string name(const char* key) const { return path_.empty() ? key : path_ + "." + key; }
  const Json* value_;
  std::string where_, path_;
};

/// A vector as an array of numbers, a matrix as an array of its rows.
template <class Derived>
Json list(const Eigen::MatrixBase<Derived>& m) {
  Json out = Json::array();
  for (Eigen::Index i = 0; i < m.rows(); ++i) {
    if constexpr (Derived::ColsAtCompileTime == 1) {
      out.push_back(m(i, 0));
    } else {
      out.push_back(list(m.row(i).transpose()));
    }
  }
  return out;
}

template <class S>
LegParams<S> read_leg(const Node& n) {
  return {n.number<S>("l1"), n.number<S>("l2"), n.number<S>("lg1"),    n.number<S>("lg2"),
          n.number<S>("m1"), n.number<S>("m2"), n.number<S>("J1"),     n.number<S>("J2"),
          n.number<S>("c1"), n.number<S>("c2"), n.number<S>("gamma1"), n.number<S>("gamma2")};
}

inline Reaching read_switch(const Node& n) {
  const std::string s = n.text("switch");
  if (s == "sign") return Reaching::sign;
  if (s == "sat") return Reaching::saturation;
  if (s == "tanh") return Reaching::tanh;
  if (s == "super_twisting" || s == "implicit" || s == "implicit_coupled") {
    n.at("switch").fail("'esmc.switch' must be sign, sat or tanh: " + s +
                        " depends on the sample time, and a case has none");
  }
  n.at("switch").fail("'esmc.switch' must be sign, sat or tanh");
}

/// Reads a list of N numbers, each >= 0 or, if `positive`, > 0. Throws InputError.
template <class S, int N>
Vec<S, N> read_bounded(const Node& n, const char* key, bool positive) {
  const Vec<S, N> v = n.vector<S, N>(key);
  if (!(positive ? (v.array() > S(0)).all() : (v.array() >= S(0)).all()))
    n.at(key).fail(std::string("'esmc.") + key + "' must be " + (positive ? "> 0" : ">= 0"));
  return v;
}

template <class M, class S = typename M::Scalar>
Gains<M> read_gains(const Node& n) {
  Gains<M> g;
  g.lambda = read_bounded<S, M::channels>(n, "lambda", false);
  g.k = read_bounded<S, M::channels>(n, "k", false);
  g.layer = n.has("eps") ? read_bounded<S, M::channels>(n, "eps", true) : M::Channels::Ones().eval();
  g.independent.lambda = g.lambda[0];
  g.independent.k = g.k[0];
  g.independent.layer = g.layer[0];
  return g;
}

inline void require_valid(ParamError e, const Node& n) {
  if (e != ParamError::none) {
    n.fail(
        "'params' is not a possible mechanism: lengths > 0, masses and inertias >= 0, gravity >= 0, and "
        "every bar must resist turning");
  }
}

/// The four joint angles and rates of a state must be those of its (x, y) and rates: two mechanisms in one
/// case have no result. In double, so that single precision reads the same cases.
inline void require_consistent(const Node& n, const FiveBarParams<double>& m, const List<int, 2>& working) {
  constexpr double tolerance = 1e-6;  // of the mechanism's size, and of its speed
  const Node state = n.at("state");
  if (!state.has("theta")) return;
  const Vec<double, 4> theta = state.vector<double, 4>("theta");
  const bool rates = state.has("thetad");
  const Vec<double, 4> w = rates ? state.vector<double, 4>("thetad") : Vec<double, 4>::Zero().eval();
  const Vec2<double> x(state.number<double>("x"), state.number<double>("y"));
  const Vec2<double> v(state.number<double>("xd"), state.number<double>("yd"));
  for (unsigned j = 0; j < 2; ++j) {
    const LegParams<double>& leg = m.legs[j];
    const double side = j == 0 ? 1.0 : -1.0;  // leg 2 lives in a mirrored frame
    const double a = theta[2 * j], b = a + theta[2 * j + 1], wa = w[2 * j], wb = wa + w[2 * j + 1];
    const Vec2<double> tip(side * (m.l0 + leg.l1 * std::cos(a) + leg.l2 * std::cos(b)),
                           leg.l1 * std::sin(a) + leg.l2 * std::sin(b));
    const Vec2<double> rate(-side * (leg.l1 * std::sin(a) * wa + leg.l2 * std::sin(b) * wb),
                            leg.l1 * std::cos(a) * wa + leg.l2 * std::cos(b) * wb);
    const double size = m.l0 + leg.l1 + leg.l2;
    const double speed = leg.l1 * std::abs(wa) + leg.l2 * std::abs(wb) + v.norm();
    const std::string which = " of leg " + std::to_string(j + 1);
    if (!((tip - x).norm() <= tolerance * size))
      state.at("theta").fail("'state.theta'" + which + " does not lead to ('state.x', 'state.y')");
    const double bend = std::sin(theta[2 * j + 1]);
    if (std::abs(bend) > tolerance && (bend > 0.0) != (working[static_cast<int>(j)] > 0))
      state.at("theta").fail("'state.theta'" + which + " does not bend as 'mode.sigma' says");
    if (rates && !((rate - v).norm() <= tolerance * (speed + size)))
      state.at("thetad").fail("'state.thetad'" + which + " does not lead to ('state.xd', 'state.yd')");
  }
}

}  // namespace esmc::host
