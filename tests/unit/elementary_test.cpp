#include "firmware/numeric/elementary.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>
#include <type_traits>
#include <vector>

namespace {

using esmc::angle_of_unit;
using esmc::arc_tangent2;
using esmc::hyperbolic_tangent;
using esmc::sin_cos;
using esmc::square_root;
using esmc::wrap_to_pi;

/// The C library of the next wider type is the oracle; where there is none, only the digests are checked.
template <class S>
using Wide = std::conditional_t<std::is_same_v<S, float>, double, long double>;

template <class S>
using Limits = std::numeric_limits<S>;

template <class S>
constexpr S kLargestAngle = std::is_same_v<S, float> ? S(1e3) : S(1e4);

/// Error of `got` in units of the last place that the exact result has in S.
template <class S>
double ulp(S got, Wide<S> want) {
  int exponent = 0;
  (void)std::frexp(want, &exponent);
  exponent = std::max(exponent, Limits<S>::min_exponent);
  return static_cast<double>(std::fabs(static_cast<Wide<S>>(got) - want) /
                             std::ldexp(Wide<S>(1), exponent - Limits<S>::digits));
}

/// The worst error seen, and where.
template <class S>
struct Worst {
  double error = 0.0;
  S first = S(0);
  S second = S(0);

  void take(double seen, S at, S at_second = S(0)) {
    if (!(seen <= error)) {
      error = std::isnan(seen) ? Limits<double>::infinity() : seen;
      first = at;
      second = at_second;
    }
  }
  void check(const char* what, double bound) const {
    EXPECT_LE(error, bound) << what << " at " << std::hexfloat << first << ", " << second;
    testing::Test::RecordProperty(what, std::to_string(error));
  }
};

class Random {
 public:
  template <class S>
  S between(S low, S high) {
    state_ = state_ * 6364136223846793005U + 1442695040888963407U;
    const double unit = static_cast<double>(state_ >> 11U) * 0x1p-53;
    return static_cast<S>(static_cast<double>(low) +
                          (static_cast<double>(high) - static_cast<double>(low)) * unit);
  }

 private:
  std::uint64_t state_ = 20240229;
};

/// `value`, its neighbours, and their negatives.
template <class S>
void add_around(std::vector<S>& to, S value) {
  S below = value;
  S above = value;
  for (int i = 0; i < 4; ++i) {
    to.insert(to.end(), {below, above, -below, -above});
    below = std::nextafter(below, -Limits<S>::infinity());
    above = std::nextafter(above, Limits<S>::infinity());
  }
}

/// Every power of two, subnormal ones included, up to `last`.
template <class S>
void add_powers(std::vector<S>& to, S last) {
  for (S power = Limits<S>::denorm_min(); power <= last; power *= S(2)) {
    add_around(to, power);
  }
}

template <class S>
std::vector<S> angles(S largest, int count) {
  std::vector<S> result{S(0), -S(0)};
  add_powers(result, largest / S(2));
  for (int eighths = 1; eighths * 0.39269908169872415481 < static_cast<double>(largest); ++eighths) {
    add_around(result, static_cast<S>(static_cast<Wide<S>>(0.39269908169872415481L) * eighths));
  }
  Random random;
  for (int i = 0; i < count; ++i) {
    result.push_back(random.between(-largest, largest));
  }
  std::erase_if(result, [&](S angle) { return std::fabs(angle) > largest; });
  return result;
}

/// What float is allowed next to zeros of the result, see the header; in units of the last place.
template <class S>
double forgiven(S angle, Wide<S> want) {
  if (std::is_same_v<S, double> || want == Wide<S>(0)) {
    return 0.0;
  }
  return 0x1p-53 * 0x1p24 * std::fabs(static_cast<double>(angle) / static_cast<double>(want));
}

template <class S>
class Elementary : public testing::Test {
 protected:
  void SetUp() override {
    if (Limits<Wide<S>>::digits < Limits<S>::digits + 11) {
      GTEST_SKIP() << "no wider type to compare with";
    }
  }
};
using Scalars = testing::Types<float, double>;
TYPED_TEST_SUITE(Elementary, Scalars);

TYPED_TEST(Elementary, SineAndCosine) {
  using S = TypeParam;
  Worst<S> sine;
  Worst<S> cosine;
  for (const S largest : {S(0.8), S(10), S(100), kLargestAngle<S>}) {
    for (const S angle : angles<S>(largest, 200000)) {
      const auto got = sin_cos(angle);
      const Wide<S> sin = std::sin(static_cast<Wide<S>>(angle));
      const Wide<S> cos = std::cos(static_cast<Wide<S>>(angle));
      sine.take(ulp(got.sin, sin) - forgiven(angle, sin), angle);
      cosine.take(ulp(got.cos, cos) - forgiven(angle, cos), angle);
      const auto mirrored = sin_cos(-angle);
      ASSERT_EQ(mirrored.sin, -got.sin) << angle;
      ASSERT_EQ(mirrored.cos, got.cos) << angle;
      ASSERT_LE(std::fabs(got.sin), S(1)) << angle;
      ASSERT_LE(std::fabs(got.cos), S(1)) << angle;
    }
  }
  sine.check("sine", 0.9);
  cosine.check("cosine", 0.9);
}

TYPED_TEST(Elementary, SineAndCosineOfSpecialArguments) {
  using S = TypeParam;
  EXPECT_FALSE(std::signbit(sin_cos(S(0)).sin));
  EXPECT_TRUE(std::signbit(sin_cos(-S(0)).sin));
  EXPECT_EQ(sin_cos(-S(0)).cos, S(1));
  EXPECT_EQ(sin_cos(-Limits<S>::denorm_min()).sin, -Limits<S>::denorm_min());
  const S beyond = std::nextafter(kLargestAngle<S>, Limits<S>::max());
  for (const S angle : {beyond, Limits<S>::max(), Limits<S>::infinity(), Limits<S>::quiet_NaN()}) {
    for (const S signed_angle : {angle, -angle}) {
      EXPECT_TRUE(std::isnan(sin_cos(signed_angle).sin)) << signed_angle;
      EXPECT_TRUE(std::isnan(sin_cos(signed_angle).cos)) << signed_angle;
      EXPECT_TRUE(std::isnan(wrap_to_pi(signed_angle))) << signed_angle;
    }
  }
}

TYPED_TEST(Elementary, ArcTangent) {
  using S = TypeParam;
  const Wide<S> pi = std::acos(Wide<S>(-1));
  Worst<S> worst;
  const auto compare = [&](S y, S x) {
    const S got = arc_tangent2(y, x);
    worst.take(ulp(got, std::atan2(static_cast<Wide<S>>(y), static_cast<Wide<S>>(x))), y, x);
    ASSERT_LE(std::fabs(got), static_cast<S>(pi)) << y << ' ' << x;
    ASSERT_EQ(arc_tangent2(-y, x), -got) << y << ' ' << x;
  };
  Random random;
  for (int i = 0; i < 600000; ++i) {
    compare(random.between(S(-1), S(1)), random.between(S(-1), S(1)));
    const S x = random.between(S(1), S(2));  // where two reductions meet and where the result is smallest
    compare(x * random.between(S(0.24), S(0.27)), x);
  }
  std::vector<S> ratios;
  for (const S ratio : {S(0.2578125), S(0.71875), S(1), S(0.5), S(0.25)}) {
    add_around(ratios, ratio);
  }
  std::vector<S> sizes;
  add_powers(sizes, Limits<S>::max() / S(2));
  for (const S ratio : ratios) {
    for (const S size : sizes) {
      compare(size * ratio, size);
      compare(size, size * ratio);
    }
  }
  sizes.clear();
  for (S size = Limits<S>::denorm_min(); size < Limits<S>::max() / S(64); size *= S(61)) {
    sizes.insert(sizes.end(), {size, -size});
  }
  sizes.insert(sizes.end(), {Limits<S>::max(), Limits<S>::lowest(), Limits<S>::min()});
  for (const S y : sizes) {
    for (const S x : sizes) {
      compare(y, x);
    }
  }
  worst.check("arc_tangent2", 1.7);
}

TYPED_TEST(Elementary, AngleOfUnitVector) {
  using S = TypeParam;
  const Wide<S> pi = std::acos(Wide<S>(-1));
  Worst<S> worst;
  const auto compare = [&](Wide<S> angle) {
    const S y = static_cast<S>(std::sin(angle)), x = static_cast<S>(std::cos(angle));
    const S got = angle_of_unit(y, x);
    // Rounded, it is no unit vector any more, and the angle follows one component.
    const Wide<S> want = std::atan2(static_cast<Wide<S>>(y), static_cast<Wide<S>>(x));
    worst.take(ulp(got, want), y, x);
    ASSERT_LE(std::fabs(got), static_cast<S>(pi)) << y << ' ' << x;
    ASSERT_EQ(angle_of_unit(-y, x), -got) << y << ' ' << x;
  };
  Random random;
  for (int i = 0; i < 600000; ++i) {
    compare(random.between(-pi, pi));
    compare(random.between(Wide<S>(-0.3), Wide<S>(0.3)));
    compare(random.between(Wide<S>(-1), Wide<S>(1)) *
            std::pow(Wide<S>(10), -random.between(Wide<S>(0), Wide<S>(30))));
  }
  for (const Wide<S> where :
       {pi / 4, pi / 2, pi * 3 / 4, std::asin(Wide<S>(0.26)), std::asin(Wide<S>(0.7072))}) {
    for (int i = -2000; i <= 2000; ++i)
      compare(where + i * Wide<S>(1e-7));  // where one way takes over from another
  }
  compare(pi);
  worst.check("angle_of_unit", 2.4);
}

TYPED_TEST(Elementary, AngleOfUnitVectorOfSpecialArguments) {
  using S = TypeParam;
  const S zero(0), one(1), nan = Limits<S>::quiet_NaN(), infinity = Limits<S>::infinity();
  for (const S y : {zero, -zero}) {
    EXPECT_EQ(angle_of_unit(y, one), y);
    EXPECT_EQ(std::signbit(angle_of_unit(y, one)), std::signbit(y));
    EXPECT_EQ(angle_of_unit(y, -one), std::copysign(arc_tangent2(zero, -one), y));
    EXPECT_EQ(angle_of_unit(one, y), arc_tangent2(one, zero));
    EXPECT_EQ(angle_of_unit(-one, y), arc_tangent2(-one, zero));
  }
  for (const S other : {zero, -zero, one, -one, S(0.1), S(-0.1), S(0.7071), S(5), infinity, nan}) {
    EXPECT_TRUE(std::isnan(angle_of_unit(nan, other))) << other;
    EXPECT_TRUE(std::isnan(angle_of_unit(other, nan))) << other;
  }
}

TYPED_TEST(Elementary, ArcTangentOfSpecialArguments) {
  using S = TypeParam;
  const S infinity = Limits<S>::infinity();
  for (const S y : {S(0), S(1), Limits<S>::denorm_min(), Limits<S>::max(), infinity}) {
    for (const S x : {S(0), S(1), Limits<S>::denorm_min(), Limits<S>::max(), infinity}) {
      for (const S signed_y : {y, -y}) {
        for (const S signed_x : {x, -x}) {
          const S want =
              static_cast<S>(std::atan2(static_cast<Wide<S>>(signed_y), static_cast<Wide<S>>(signed_x)));
          const S got = arc_tangent2(signed_y, signed_x);
          EXPECT_EQ(got, want) << signed_y << ' ' << signed_x;
          EXPECT_EQ(std::signbit(got), std::signbit(want)) << signed_y << ' ' << signed_x;
        }
      }
    }
    EXPECT_TRUE(std::isnan(arc_tangent2(y, Limits<S>::quiet_NaN())));
    EXPECT_TRUE(std::isnan(arc_tangent2(Limits<S>::quiet_NaN(), y)));
  }
  EXPECT_TRUE(std::isnan(arc_tangent2(Limits<S>::quiet_NaN(), Limits<S>::quiet_NaN())));
}

TYPED_TEST(Elementary, HyperbolicTangent) {
  using S = TypeParam;
  std::vector<S> arguments{S(0)};
  add_powers(arguments, Limits<S>::max() / S(2));
  for (int k = 0; k < 60; ++k) {  // where the reduction changes
    add_around(arguments, static_cast<S>((k + 0.5) * 0.34657359027997265471));
  }
  Random random;
  for (int i = 0; i < 300000; ++i) {
    for (const S largest : {S(0.4), S(1), S(25)}) {
      arguments.push_back(random.between(S(0), largest));
    }
  }
  Worst<S> worst;
  for (const S x : arguments) {
    const S got = hyperbolic_tangent(x);
    worst.take(ulp(got, std::tanh(static_cast<Wide<S>>(x))), x);
    ASSERT_LE(std::fabs(got), S(1)) << x;
    ASSERT_EQ(hyperbolic_tangent(-x), -got) << x;
  }
  worst.check("hyperbolic_tangent", 1.8);

  const S one = std::is_same_v<S, float> ? S(9.1) : S(19.1);
  for (const S x : {one, S(100), Limits<S>::max(), Limits<S>::infinity()}) {
    EXPECT_EQ(hyperbolic_tangent(x), S(1)) << x;
    EXPECT_EQ(hyperbolic_tangent(-x), S(-1)) << x;
  }
  EXPECT_TRUE(std::signbit(hyperbolic_tangent(-S(0))));
  EXPECT_TRUE(std::isnan(hyperbolic_tangent(Limits<S>::quiet_NaN())));
}

TYPED_TEST(Elementary, WrapToPi) {
  using S = TypeParam;
  using W = Wide<S>;
  const S pi = static_cast<S>(0x1.921fb54442d18p+1);
  Worst<S> worst;
  Worst<S> at_cut;
  for (const S largest : {S(10), S(100), kLargestAngle<S>}) {
    for (const S angle : angles<S>(largest, 100000)) {
      const S got = wrap_to_pi(angle);
      ASSERT_GT(got, -pi) << angle;
      ASSERT_LE(got, pi) << angle;
      if (angle > -pi && angle <= pi) {
        ASSERT_EQ(got, angle);
        ASSERT_EQ(std::signbit(got), std::signbit(angle));
        continue;
      }
      W want = std::atan2(std::sin(static_cast<W>(angle)), std::cos(static_cast<W>(angle)));
      if (std::fabs(want - static_cast<W>(got)) > W(3)) {  // the other side of the cut
        want -= std::copysign(static_cast<W>(0x1.921fb54442d18469898cc517p+2L), want);
      }
      (got == pi ? at_cut : worst).take(ulp(got, want) - forgiven(angle, want), angle);
    }
  }
  worst.check("wrap_to_pi", 0.6);
  at_cut.check("wrap_to_pi_cut", 1.3);
  EXPECT_EQ(wrap_to_pi(-pi), pi);
  EXPECT_EQ(wrap_to_pi(pi), pi);
}

TYPED_TEST(Elementary, SquareRoot) {
  using S = TypeParam;
  EXPECT_EQ(square_root(S(2)), static_cast<S>(1.41421356237309504880L));
  EXPECT_EQ(square_root(S(0)), S(0));
  EXPECT_TRUE(std::isnan(square_root(S(-1))));
}

/// FNV-1a over the bits of results: any difference between compilers, options or processors shows.
class Digest {
 public:
  template <class S>
  void take(S value) {
    std::uint64_t rest = esmc::ieee::bits(value);
    for (std::size_t i = 0; i < sizeof(S); ++i, rest >>= 8U) {
      value_ = (value_ ^ (rest & 0xffU)) * 0x100000001b3U;
    }
  }
  [[nodiscard]] std::uint64_t value() const { return value_; }

 private:
  std::uint64_t value_ = 0xcbf29ce484222325U;
};

template <class S>
struct Digests {
  Digest sin_cos;
  Digest arc_tangent2;
  Digest angle_of_unit;
  Digest hyperbolic_tangent;
  Digest wrap_to_pi;

  Digests() {
    Random random;
    for (int i = 0; i < 100000; ++i) {
      const S largest = i % 2 == 0 ? S(8) : kLargestAngle<S>;
      const S a = random.between(-largest, largest);
      const S b = random.between(S(-8), S(8));
      const auto both = esmc::sin_cos(a);
      sin_cos.take(both.sin);
      sin_cos.take(both.cos);
      arc_tangent2.take(esmc::arc_tangent2(b, a));
      angle_of_unit.take(esmc::angle_of_unit(both.sin, both.cos));
      hyperbolic_tangent.take(esmc::hyperbolic_tangent(b));
      wrap_to_pi.take(esmc::wrap_to_pi(a));
    }
  }
};

TEST(ElementaryDigest, Float) {
  const Digests<float> digests;
  EXPECT_EQ(digests.sin_cos.value(), 0x260dc2c1d97abc43U);
  EXPECT_EQ(digests.arc_tangent2.value(), 0x8b5af90bfe18789fU);
  EXPECT_EQ(digests.angle_of_unit.value(), 0x1ac0b7c84b24da61U);
  EXPECT_EQ(digests.hyperbolic_tangent.value(), 0x1ad0b6cf57feb218U);
  EXPECT_EQ(digests.wrap_to_pi.value(), 0x86a7b28a01f4d1d3U);
}

TEST(ElementaryDigest, Double) {
  const Digests<double> digests;
  EXPECT_EQ(digests.sin_cos.value(), 0x508b8dc760a2ddb3U);
  EXPECT_EQ(digests.arc_tangent2.value(), 0xbaca6cd0237424c9U);
  EXPECT_EQ(digests.angle_of_unit.value(), 0xa1a6aef5896b834bU);
  EXPECT_EQ(digests.hyperbolic_tangent.value(), 0xf0e9f7f4ae39332dU);
  EXPECT_EQ(digests.wrap_to_pi.value(), 0x75cb452210f67b6dU);
}

template <class S>
concept HasSinCos = requires(S angle) {
  sin_cos(angle);
};

static_assert(HasSinCos<float> && HasSinCos<double>);
static_assert(!HasSinCos<int> && !HasSinCos<long double>, "no silent change of precision");

}  // namespace

/// A user's scalar type, with functions of its own.
namespace foreign {
struct Scalar {};
constexpr int sin_cos(Scalar) { return 42; }
}  // namespace foreign

namespace {

template <class S>
auto unqualified(S angle) {
  return sin_cos(angle);
}

TEST(ElementaryLookup, OtherScalarsBringTheirOwn) {
  EXPECT_EQ(unqualified(foreign::Scalar{}), 42);
  EXPECT_EQ(unqualified(0.0).cos, 1.0);
}

}  // namespace
