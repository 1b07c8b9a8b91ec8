/// The guards against sets of allowed values written again.

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <set>
#include <string>
#include <type_traits>
#include <vector>

#include "firmware/safety/guards.hpp"

namespace {

using esmc::Fault;
using esmc::limit_torque;
using esmc::TorqueCheck;

// ---- guards

template <class S>
using Numbers = std::numeric_limits<S>;

/// Crowded around every limit, plus the ones nobody sends on purpose.
template <class S>
std::vector<S> around(std::initializer_list<S> limits) {
  std::vector<S> v{S(0),
                   -S(0),
                   Numbers<S>::denorm_min(),
                   -Numbers<S>::denorm_min(),
                   Numbers<S>::min(),
                   Numbers<S>::max(),
                   Numbers<S>::lowest(),
                   Numbers<S>::infinity(),
                   -Numbers<S>::infinity(),
                   Numbers<S>::quiet_NaN(),
                   -Numbers<S>::quiet_NaN()};
  for (const S limit : limits) {
    for (const S x : {limit, -limit}) {
      v.insert(v.end(), {x, std::nextafter(x, Numbers<S>::infinity()),
                         std::nextafter(x, -Numbers<S>::infinity()), x * S(0.5), x * S(2)});
    }
  }
  return v;
}

template <class S>
class Guards : public testing::Test {
 protected:
  static constexpr S type1 = S(0.02), type2 = S(0.05), speed = S(50), closure = S(1e-3);
  static constexpr S x0 = S(-0.3), x1 = S(0.25), y0 = S(0.05), y1 = S(0.5);
  static constexpr S a0 = S(-1.5), a1 = S(2.5), b0 = S(0.5), b1 = S(3);

  static esmc::Limits<S> limits() {
    return {type1, type2, speed, closure, {x0, x1}, {y0, y1}, {{{a0, a1}, {b0, b1}}}, 2, S(0.125)};
  }
  static esmc::Measured<S> good() {
    return {S(0.5), S(0.6), S(0), S(0), S(0.2), true, {S(1), S(1)}, {S(3), S(-3)}};
  }

  /// One quantity the guard looks at: where it is, the values to try, which are allowed and what the fault
  /// is.
  struct Quantity {
    S& (*of)(esmc::Measured<S>&);
    std::vector<S> values;
    bool (*allowed)(S);
    Fault fault;
  };
  static std::vector<Quantity> quantities() {
    using M = esmc::Measured<S>;
    return {
        {[](M& m) -> S& { return m.abs_sin_type1; }, around({type1}),
         [](S v) { return !std::isnan(v) && !std::isless(v, type1); }, Fault::type1_singularity},
        {[](M& m) -> S& { return m.sin_type2; }, around({type2}),
         [](S v) { return !std::isnan(v) && !std::isless(v, type2); }, Fault::type2_singularity},
        {[](M& m) -> S& { return m.closure; }, around({closure}),
         [](S v) { return !std::isnan(v) && !std::isgreater(v, closure); }, Fault::loop_not_closed},
        {[](M& m) -> S& { return m.x; }, around({x0, x1}),
         [](S v) { return std::isfinite(v) && !std::isless(v, x0) && !std::isgreater(v, x1); },
         Fault::workspace},
        {[](M& m) -> S& { return m.y; }, around({y0, y1}),
         [](S v) { return std::isfinite(v) && !std::isless(v, y0) && !std::isgreater(v, y1); },
         Fault::workspace},
        {[](M& m) -> S& { return m.joint_angle[0]; }, around({a0, a1}),
         [](S v) { return std::isfinite(v) && !std::isless(v, a0) && !std::isgreater(v, a1); },
         Fault::joint_angle},
        {[](M& m) -> S& { return m.joint_angle[1]; }, around({b0, b1}),
         [](S v) { return std::isfinite(v) && !std::isless(v, b0) && !std::isgreater(v, b1); },
         Fault::joint_angle},
        {[](M& m) -> S& { return m.joint_rate[0]; }, around({speed}),
         [](S v) { return std::isfinite(v) && !std::isgreater(std::abs(v), speed); }, Fault::joint_speed},
        {[](M& m) -> S& { return m.joint_rate[1]; }, around({speed}),
         [](S v) { return std::isfinite(v) && !std::isgreater(std::abs(v), speed); }, Fault::joint_speed},
    };
  }
};
using Scalars = testing::Types<float, double>;
TYPED_TEST_SUITE(Guards, Scalars);

TYPED_TEST(Guards, EachQuantityIsAllowedExactlyInItsRange) {
  using S = TypeParam;
  ASSERT_EQ(guard(this->limits(), this->good()), Fault::none);
  for (const auto& q : this->quantities()) {
    for (const S v : q.values) {
      esmc::Measured<S> m = this->good();
      q.of(m) = v;
      EXPECT_EQ(guard(this->limits(), m), q.allowed(v) ? Fault::none : q.fault) << name(q.fault) << ' ' << v;
      m.working_mode_kept = false;
      EXPECT_NE(guard(this->limits(), m), Fault::none) << name(q.fault) << ' ' << v;
    }
  }
}

TYPED_TEST(Guards, NoQuantityHidesAnother) {
  using S = TypeParam;
  const auto all = this->quantities();
  for (std::size_t i = 0; i < all.size(); ++i) {
    for (std::size_t j = i + 1; j < all.size(); ++j) {
      for (const S a : all[i].values) {
        for (const S b : all[j].values) {
          esmc::Measured<S> m = this->good();
          all[i].of(m) = a;
          all[j].of(m) = b;
          ASSERT_EQ(guard(this->limits(), m) == Fault::none, all[i].allowed(a) && all[j].allowed(b))
              << i << ' ' << a << ", " << j << ' ' << b;
        }
      }
    }
  }
}

TYPED_TEST(Guards, TheWorkingModeIsAFaultOfItsOwn) {
  auto m = this->good();
  m.working_mode_kept = false;
  EXPECT_EQ(guard(this->limits(), m), Fault::working_mode);
}

/// A limit that is not a number lets nothing pass.
TYPED_TEST(Guards, LimitsThatAreNoNumbersRefuseEverything) {
  using S = TypeParam;
  const S nan = Numbers<S>::quiet_NaN();
  const auto refuses = [&](auto&& change) {
    esmc::Limits<S> l = this->limits();
    change(l);
    return guard(l, this->good()) != Fault::none;
  };
  EXPECT_TRUE(refuses([&](auto& l) { l.min_abs_sin_type1 = nan; }));
  EXPECT_TRUE(refuses([&](auto& l) { l.min_abs_sin_type2 = nan; }));
  EXPECT_TRUE(refuses([&](auto& l) { l.joint_speed = nan; }));
  EXPECT_TRUE(refuses([&](auto& l) { l.closure = nan; }));
  for (int i = 0; i < 8; ++i) {
    EXPECT_TRUE(refuses([&](auto& l) {
      esmc::Range<S>* ranges[] = {&l.workspace_x, &l.workspace_y, &l.joint_angle[0], &l.joint_angle[1]};
      (i % 2 == 0 ? ranges[i / 2]->lower : ranges[i / 2]->upper) = nan;
    })) << i;
  }
}

TYPED_TEST(Guards, WithoutGivenRangesEveryFiniteValueIsInsideAndNothingElse) {
  using S = TypeParam;
  const esmc::Range<S> open{};
  for (const S v : around<S>({S(1)})) EXPECT_EQ(open.contains(v), std::isfinite(v)) << v;
}

/// Both mechanisms have two base joints; no mode is confirmed, and no sample may be missed, unless
/// told.
TYPED_TEST(Guards, DefaultsAllowNothing) {
  using S = TypeParam;
  EXPECT_EQ(esmc::Measured<S>{}.joint_angle.size(), 2U);
  EXPECT_EQ(esmc::Limits<S>{}.max_age_ticks, 0U);
  EXPECT_EQ(guard(esmc::Limits<S>{}, esmc::Measured<S>{}), Fault::working_mode);
}

TYPED_TEST(Guards, DefaultLimitsOfSpeedAllowOnlyRest) {
  using S = TypeParam;
  auto m = this->good();
  EXPECT_NE(guard(esmc::Limits<S>{}, m), Fault::none);
}

/// On the way to rest a mechanism may be where it may not go; all else is guarded as before.
TYPED_TEST(Guards, WhileHaltingOnlyBoxAndJointRangesAreOpen) {
  using S = TypeParam;
  const esmc::Limits<S> l = this->limits().while_halting();
  EXPECT_EQ(l.max_age_ticks, this->limits().max_age_ticks);
  EXPECT_EQ(l.feedback_jump, this->limits().feedback_jump);
  for (const auto& q : this->quantities()) {
    for (const S v : q.values) {
      esmc::Measured<S> m = this->good();
      q.of(m) = v;
      const bool open = q.fault == Fault::workspace || q.fault == Fault::joint_angle;
      EXPECT_EQ(guard(l, m), (open ? std::isfinite(v) : q.allowed(v)) ? Fault::none : q.fault)
          << name(q.fault) << ' ' << v;
    }
  }
}

TYPED_TEST(Guards, FiniteMeansFinite) {
  using S = TypeParam;
  for (const S v : around<S>({S(1), Numbers<S>::max(), Numbers<S>::min(), Numbers<S>::epsilon()})) {
    EXPECT_EQ(esmc::finite(v), std::isfinite(v)) << v;
  }
}

// ---- torque

TYPED_TEST(Guards, TorqueIsPassedClampedOrZero) {
  using S = TypeParam;
  for (const S limit : {S(0), Numbers<S>::denorm_min(), S(1e-3), S(2), Numbers<S>::max()}) {
    for (const S asked : around<S>({limit, S(2)})) {
      S torque = asked;
      const TorqueCheck check = limit_torque(torque, limit);
      if (!std::isfinite(asked)) {
        EXPECT_EQ(check, TorqueCheck::not_finite) << asked;
        EXPECT_EQ(torque, S(0)) << asked;
      } else if (std::isgreater(std::abs(asked), limit)) {
        EXPECT_EQ(check, TorqueCheck::limited) << asked << " limit " << limit;
        EXPECT_EQ(torque, std::copysign(limit, asked)) << asked << " limit " << limit;
      } else {
        EXPECT_EQ(check, TorqueCheck::passed) << asked << " limit " << limit;
        EXPECT_EQ(torque, asked);
      }
    }
  }
}

/// A limit that is NaN or negative bounds nothing: no torque may pass it, and none may come out of it.
TYPED_TEST(Guards, ALimitThatIsNoneLetsNoTorquePass) {
  using S = TypeParam;
  for (const S limit : {Numbers<S>::quiet_NaN(), S(-1), -Numbers<S>::denorm_min(), -Numbers<S>::infinity()}) {
    for (const S asked : around<S>({S(1), S(2)})) {
      S torque = asked;
      (void)limit_torque(torque, limit);
      EXPECT_EQ(torque, S(0)) << asked << " limit " << limit;
    }
  }
}

}  // namespace
