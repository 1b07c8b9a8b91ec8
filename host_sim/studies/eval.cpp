#include "host_sim/studies/studies.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string>

#include "firmware/control/allocation.hpp"
#include "firmware/control/law.hpp"
#include "firmware/mechanism/matrices.hpp"
#include "firmware/mechanism/params.hpp"
#include "host_sim/error.hpp"
#include "host_sim/json_text.hpp"
#include "host_sim/record/output.hpp"

namespace esmc::host {
namespace {

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
  const auto or_0 = [&](const char* key) { return n.has(key) ? n.number<S>(key) : S(0); };
  return {n.number<S>("l1"),  n.number<S>("l2"),  n.number<S>("lg1"),    n.number<S>("lg2"),
          n.number<S>("m1"),  n.number<S>("m2"),  n.number<S>("J1"),     n.number<S>("J2"),
          n.number<S>("c1"),  n.number<S>("c2"),  n.number<S>("gamma1"), n.number<S>("gamma2"),
          or_0("asymmetry1"), or_0("asymmetry2"), or_0("rotor2")};
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
  const bool angles = state.has("theta"), rates = state.has("thetad");
  if (!angles && !rates) return;
  const Vec2<double> x(state.number<double>("x"), state.number<double>("y"));
  const auto reached = FiveBar<double>(m).inverse(x, {working, 0});
  if (!angles && !reached) return;  // not in double
  const Vec<double, 4> theta = angles ? state.vector<double, 4>("theta") : FiveBar<double>::angles(*reached);
  const Vec<double, 4> w = rates ? state.vector<double, 4>("thetad") : Vec<double, 4>::Zero().eval();
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

/// (x, y) must be of the assembly mode of the case: its base angles lead elsewhere in the other one.
inline void require_assembly(const Node& n, const FiveBarParams<double>& params,
                             const List<int, 2>& working) {
  constexpr double tolerance = 1e-6;  // both modes meet at type 2
  const Node state = n.at("state");
  const Vec2<double> x(state.number<double>("x"), state.number<double>("y"));
  const auto pose = FiveBar<double>(params).inverse(x, {working, 0});
  if (pose && pose->sin_type2 * n.at("mode").at("assembly").sign() < -tolerance)
    state.at("x").fail("'state.x', 'state.y' is of the other assembly mode than 'mode.assembly'");
}

/// M v' + f + g with the rotors at the elbows.
template <class M>
typename M::Channels forces(const M& m, typename M::Channels acceleration, const typename M::Rates& r) {
  m.add_rotors(acceleration);
  return m.force(acceleration, r);
}

/// Forward dynamics in base joints (`base_form`) or chain coordinates, whichever are better conditioned.
template <class M, class S = typename M::Scalar>
typename M::Channels accelerations(const M& m, const typename M::Pose& p, const typename M::Rates& r,
                                   const Vec2<S>& force_chain, const Vec2<S>& force_base, bool base_form) {
  using Channels = typename M::Channels;
  if (base_form) {
    const Channels c = m.channel_accelerations(p, r, m.base_accelerations(p, r, Vec2<S>::Zero()));
    const Vec2<S> h = m.base_torque(p, forces<M>(m, c, r));
    const Vec2<S> a = solve_spd<S>(mass_matrix(m, matrix_C_base(m, p)), force_base - h);
    return m.channel_accelerations(p, r, m.base_accelerations(p, r, a));
  }
  const Mat<S, M::channels, 2> C = matrix_C(m, p);
  const Vec2<S> h = gather<M>(C, forces<M>(m, bias(m, p, r), r));
  const Vec2<S> a = solve_spd<S>(mass_matrix(m, C), force_chain - h);
  return m.channel_accelerations(p, r, m.chain_accelerations(p, r, a));
}

/// The blocks `model` that every mechanism has.
template <class M, class S = typename M::Scalar>
Json model_block(const M& m, const typename M::Pose& p, const typename M::Rates& r) {
  using Channels = typename M::Channels;
  const Mat<S, M::channels, 2> C = matrix_C(m, p);
  const Channels c = bias(m, p, r);
  const typename M::Rates still = m.chain_rates(p, Vec2<S>::Zero());
  const Channels g = m.force(Channels::Zero(), still);
  return {{"C", list(C)},
          {"A", list(matrix_A(m, p))},
          {"b", list(vector_b(m, p, r))},
          {"M_diag", list(m.mass())},
          {"g", list(g)},
          {"f", list(m.force(Channels::Zero(), r) - g)},
          {"H", list(mass_matrix(m, C))},
          {"h", list(gather<M>(C, forces<M>(m, c, r)))},
          {"bias", list(c)}};
}

/// e, e', s, v' of the full law, and the channels they come from.
template <class M>
Json law_block(const M& m, const Tracking<M>& t, const Gains<M>& gain, Reaching reaching,
               const typename M::Channels& q, const typename M::Channels& q_d, const Demand<M>& d) {
  using Channels = typename M::Channels;
  const Channels rate = m.channel_rates(t.pose, t.rates);
  const Channels rate_d = m.channel_rates(t.desired_pose, t.desired_rates);
  return {{"q", list(q)},
          {"q_d", list(q_d)},
          {"qd", list(rate)},
          {"qd_d", list(rate_d)},
          {"qdd_d", list(m.channel_accelerations(t.desired_pose, t.desired_rates, t.desired_acceleration))},
          {"e", list(channel_errors(m, t).e)},
          {"edot", list(rate_d - rate)},
          {"s", list(d.sliding)},
          {"vprime", list(demand(LawKind::esmc, m, gain, reaching, t).acceleration)}};
}

/// [theta1, theta2, phi1, phi2, Xg1, Yg1, Xg2, Yg2], angles as given (not wrapped).
template <class S>
Vec<S, 8> leg_coordinates(const Dyad<S>& leg, const typename Dyad<S>::Pose& p, const Vec2<S>& theta) {
  const auto g = leg.centres(p);
  Vec<S, 8> q;
  q << theta, theta[0], theta[0] + theta[1], g[0], g[1];
  return q;
}

template <class S>
Json evaluate_rr(const Node& n) {
  using M = Rr<S>;
  const Node pn = n.at("params");
  const RrParams<S> params{read_leg<S>(pn), pn.number<S>("g")};
  require_valid(check(params), n);
  const M m(params);
  const Node state = n.at("state");
  const Vec2<S> theta = state.vector<S, 2>("theta"), rate = state.vector<S, 2>("thetad");
  const typename M::Pose p = m.pose(theta);
  Json out;
  Mat<S, 2, 2> J;
  for (int k = 0; k < 2; ++k) J.col(k) = m.tip_rate(p, Vec2<S>::Unit(k));
  out["effector"] = {{"pos", list(p.effector)}, {"vel", list(m.tip_rate(p, rate))}, {"J", list(J)}};
  out["model"] = model_block(m, p, rate);
  if (n.has("forward")) {
    const Vec2<S> tau = n.at("forward").vector<S, 2>("tau");
    const auto pdot = accelerations<M>(m, p, rate, tau, tau, false);
    out["forward"] = {{"thetadd", list(pdot.template head<2>())}, {"pdot", list(pdot)}};
  }
  if (n.has("inverse")) {
    const Vec2<S> a = n.at("inverse").vector<S, 2>("thetadd");
    const Vec2<S> tau = m.base_torque(p, forces<M>(m, m.channel_accelerations(p, rate, a), rate));
    out["inverse"] = {{"tau", list(tau)}};
  }
  if (n.has("esmc")) {
    const Node e = n.at("esmc");
    const Vec2<S> theta_d = e.vector<S, 2>("theta_d");
    const Tracking<M> t{p, m.pose(theta_d), rate, e.vector<S, 2>("thetad_d"), e.vector<S, 2>("thetadd_d")};
    const Gains<M> gain = read_gains<M>(e);
    const Demand<M> d = demand(LawKind::esmc, m, gain, read_switch(e), t);
    Json block = law_block(m, t, gain, read_switch(e), leg_coordinates(m.arm(), p.arm, theta),
                           leg_coordinates(m.arm(), t.desired_pose.arm, theta_d), d);
    const Vec2<S> u = m.base_torque(p, forces<M>(m, d.acceleration, rate));
    block["u"] = list(u);
    block["v_projected"] = list(accelerations<M>(m, p, rate, u, u, false));
    out["esmc"] = std::move(block);
  }
  return out;
}

template <class S>
Vec<S, 18> coordinates(const FiveBar<S>& m, const typename FiveBar<S>::Pose& p, const Vec<S, 4>& theta) {
  Vec<S, 18> q;
  q << p.effector, leg_coordinates<S>(m.leg(0), p.leg[0], theta.template head<2>()),
      leg_coordinates<S>(m.leg(1), p.leg[1], theta.template tail<2>());
  return q;
}

/// A 5R case: mechanism and state once, then one function per block.
template <class S>
class FiveBarCase {
 public:
  using M = FiveBar<S>;
  explicit FiveBarCase(const Node& n) : n_(n) {
    const Node pn = n.at("params");
    if (pn.at("legs").size() != 2) pn.at("legs").fail("'params.legs' must have 2 entries");
    const auto params = read_params<S>(pn);
    require_valid(check(params), n);
    m_ = M(params);
    for (int j = 0; j < 2; ++j)
      sigma_.working[j] = n.at("mode").at("sigma").at(static_cast<std::size_t>(j)).sign();
    const Node state = n.at("state");
    const Vec2<S> x(state.number<S>("x"), state.number<S>("y"));
    const Vec2<S> v(state.number<S>("xd"), state.number<S>("yd"));
    const auto closed = m_.inverse(x, sigma_);
    if (!closed) n.fail("'state.x', 'state.y' cannot be reached by both legs");
    require_consistent(n, read_params<double>(pn), sigma_.working);
    require_assembly(n, read_params<double>(pn), sigma_.working);
    inverse_ = *closed;
    theta_ = state.has("theta") ? state.vector<S, 4>("theta") : M::angles(inverse_);
    p_ = state.has("theta") ? m_.pose(theta_) : inverse_;
    p_.effector = x;
    r_ = m_.chain_rates(p_, v);
    if (state.has("thetad")) {
      const Vec<S, 4> rates = state.vector<S, 4>("thetad");
      r_.leg = {{rates.template head<2>(), rates.template tail<2>()}};
    }
    // Each form has a pole at the other's singularity; take the one that is further from its own.
    base_form_ = M::min_abs_sin_type1(p_) < M::abs_sin_type2(p_);
  }

  Json evaluate() const {
    Json model{{"Chat", list(matrix_Chat(m_, p_))}};
    model.update(model_block(m_, p_, r_));
    Json out{{"state", state()}, {"singularity", singularity()}, {"model", std::move(model)}};
    if (n_.has("forward")) out["forward"] = forward();
    if (n_.has("inverse")) out["inverse"] = inverse();
    if (n_.has("esmc")) laws(out);
    return out;
  }

 private:
  template <class T>
  static FiveBarParams<T> read_params(const Node& pn) {
    FiveBarParams<T> params{pn.number<T>("l0"), pn.number<T>("m0"), pn.number<T>("g"), {}};
    for (unsigned j = 0; j < 2; ++j) params.legs[j] = read_leg<T>(pn.at("legs").at(j));
    return params;
  }
  Json state() const {
    const auto closed = m_.forward(Vec2<S>(theta_[0], theta_[2]), n_.at("mode").at("assembly").sign());
    const auto r = m_.chain_rates(p_, r_.platform);
    Vec<S, 4> rates;
    rates << r.leg[0], r.leg[1];
    return {{"x", closed ? Json(closed->effector.x()) : Json(nullptr)},
            {"y", closed ? Json(closed->effector.y()) : Json(nullptr)},
            {"theta", list(unwrapped_like(M::angles(inverse_), theta_))},
            {"thetad", list(rates)}};
  }
  static Vec<S, 4> unwrapped_like(Vec<S, 4> angle, const Vec<S, 4>& reference) {
    const S turn = S(6.283185307179586476925286766559L);
    for (int i = 0; i < 4; ++i) angle[i] += turn * std::round((reference[i] - angle[i]) / turn);
    return angle;
  }
  Json singularity() const {
    const Mat<S, 6, 2> chat = matrix_Chat(m_, p_);
    const Mat<S, 2, 2> H = mass_matrix(m_, matrix_C(m_, p_));
    const S mean = (H(0, 0) + H(1, 1)) / S(2), half = (H(0, 0) - H(1, 1)) / S(2);
    const S radius = std::sqrt(half * half + H(0, 1) * H(0, 1)), large = mean + radius;
    const S det = H(0, 0) * H(1, 1) - H(0, 1) * H(0, 1);
    return {{"sin_theta12", M::sin_type1(p_, 0)},
            {"sin_theta22", M::sin_type1(p_, 1)},
            {"D2", p_.sin_type2},
            {"det_Chat_base", chat(2, 0) * chat(4, 1) - chat(2, 1) * chat(4, 0)},
            {"cond_H", large * large / det}};
  }
  typename M::Channels forward_from(const Vec<S, 4>& tau) const {
    const List<Vec2<S>, 2> legs{{tau.template head<2>(), tau.template tail<2>()}};
    return accelerations<M>(m_, p_, r_, m_.gather(p_, Vec2<S>::Zero(), legs),
                            m_.gather_on_base(p_, Vec2<S>::Zero(), legs), base_form_);
  }
  Json forward() const {
    const Node f = n_.at("forward");
    Json out;
    if (f.has("tau4")) {
      const auto pdot = forward_from(f.vector<S, 4>("tau4"));
      out["xdd"] = list(pdot.template head<2>());
      out["pdot"] = list(pdot);
    }
    if (f.has("tau2")) {
      const Vec2<S> base = f.vector<S, 2>("tau2");
      const auto pdot = forward_from(Vec<S, 4>(base[0], S(0), base[1], S(0)));
      out["xdd_from_tau2"] = list(pdot.template head<2>());
    }
    return out;
  }
  Json inverse() const {
    const Node in = n_.at("inverse");
    typename M::Rates acceleration;
    if (in.has("pdot")) {  // joint accelerations as given: near type 1 they cannot be had from xdd
      const auto pdot = in.vector<S, 18>("pdot");
      acceleration.platform = pdot.template head<2>();
      for (int j = 0; j < 2; ++j) acceleration.leg[j] = pdot.template segment<2>(M::row_leg(j));
    } else {
      acceleration = m_.chain_accelerations(p_, r_, in.vector<S, 2>("xdd"));
    }
    const auto pdot = m_.channel_accelerations(p_, r_, acceleration);
    const auto w = forces<M>(m_, pdot, r_);
    Json out{{"pdot", list(pdot)},
             {"F", list(m_.platform_force(p_, w))},
             {"tau2", list(m_.base_torque(p_, w))},
             {"tau4_minnorm", list(allocate_all(m_, p_, w, Vec<S, 4>::Ones().eval()))}};
    if (in.has("W_diag")) {
      const Vec<S, 4> weight = in.vector<S, 4>("W_diag");
      if (!(weight.array() > S(0)).all()) in.at("W_diag").fail("'inverse.W_diag' must be > 0");
      out["tau4_weighted"] = list(allocate_all(m_, p_, w, weight));
    }
    return out;
  }
  void laws(Json& out) const {
    const Node e = n_.at("esmc"), ref = e.at("ref");
    const auto desired = m_.inverse(Vec2<S>(ref.number<S>("x"), ref.number<S>("y")), sigma_);
    if (!desired) ref.fail("'esmc.ref' cannot be reached by both legs");
    Tracking<M> t{p_, *desired, r_, m_.chain_rates(*desired, ref.vector<S, 2>("xd")), {}};
    t.desired_acceleration = m_.chain_accelerations(*desired, t.desired_rates, ref.vector<S, 2>("xdd"));
    const Gains<M> gain = read_gains<M>(e);
    const Reaching reaching = read_switch(e);
    const Demand<M> d = demand(LawKind::esmc, m_, gain, reaching, t);
    const Vec<S, 4> theta_d = ref.has("theta")
                                  ? unwrapped_like(M::angles(*desired), ref.vector<S, 4>("theta"))
                                  : M::angles(*desired);
    Json block =
        law_block(m_, t, gain, reaching, coordinates(m_, p_, theta_), coordinates(m_, *desired, theta_d), d);
    const auto w = forces<M>(m_, d.acceleration, r_);
    const Vec2<S> F = m_.platform_force(p_, w), base = m_.base_torque(p_, w);
    block["F"] = list(F);
    block["tau2"] = list(base);
    block["tau4_minnorm"] = list(allocate_all(m_, p_, w, Vec<S, 4>::Ones().eval()));
    block["v_projected"] = list(accelerations<M>(m_, p_, r_, F, base, base_form_));
    out["esmc"] = std::move(block);
    out["smc_xy"] = smc(t, gain, reaching);
  }
  Json smc(const Tracking<M>& t, const Gains<M>& gain, Reaching reaching) const {
    // The golden block lets x and y have their own gains, so the channels' first two rows are evaluated
    // apart.
    Vec2<S> v;
    for (int i = 0; i < 2; ++i) {
      Gains<M> own = gain;
      own.independent.lambda = gain.lambda[i];
      own.independent.k = gain.k[i];
      own.independent.layer = gain.layer[i];
      v[i] = demand(LawKind::smc, m_, own, reaching, t).acceleration[i];
    }
    const auto w = forces<M>(m_, independent_acceleration(m_, t, v), r_);
    return {{"v", list(v)}, {"F", list(m_.platform_force(p_, w))}, {"tau2", list(m_.base_torque(p_, w))}};
  }

  Node n_;
  M m_;
  typename M::Mode sigma_{};
  typename M::Pose inverse_, p_;
  typename M::Rates r_;
  Vec<S, 4> theta_;
  bool base_form_{};
};

std::size_t line_of(const std::string& text, std::size_t position) {
  return 1 + static_cast<std::size_t>(std::ranges::count(text.substr(0, position), '\n'));
}

template <class S>
Json evaluate_case(const Node& n) {
  return n.at("params").has("legs") ? FiveBarCase<S>(n).evaluate() : evaluate_rr<S>(n);
}

}  // namespace

std::string evaluate(const std::string& text, const std::string& file, bool single_precision) {
  Json input;
  try {
    input = parse_json(text, true);
  } catch (const Json::parse_error& e) {
    throw InputError(file + ":" + std::to_string(line_of(text, e.byte)), "not valid JSON");
  } catch (const Json::exception& e) {  // valid, but not for a double
    const std::string what = e.what();
    const std::size_t mark = what.find("] ");  // after the number of the library's error
    throw InputError(file, "not usable JSON: " + what.substr(mark == std::string::npos ? 0 : mark + 2));
  }
  if (!input.is_object() || !input.contains("cases") || !input["cases"].is_array()) {
    throw InputError(file + ":1", "an object with an array \"cases\" is needed");
  }
  Json out;
  out["cases"] = Json::array();
  std::size_t position = 0;
  for (const Json& c : input["cases"]) {
    if (!c.is_object() || !c.contains("id") || !c["id"].is_string()) {
      throw InputError(file + ":" + std::to_string(line_of(text, position)),
                       "every case needs a string \"id\"");
    }
    const auto id = c["id"].get<std::string>();
    position = std::min(text.find("\"" + id + "\"", position), text.size());
    const Node n(c, file + ":" + std::to_string(line_of(text, position)) + ": case '" + id + "'", "");
    Json& block = out["cases"].emplace_back(Json{{"id", id}});
    block.update(single_precision ? evaluate_case<float>(n) : evaluate_case<double>(n));
  }
  return document_text(out, 1);
}

}  // namespace esmc::host
