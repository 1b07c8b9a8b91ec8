#pragma once
/// Sums of products of named symbols with integer exponents, as a scalar for the templates of
/// firmware/mechanism: what they compute then comes out as a formula. Sums are kept in normal form, so equal
/// formulas are equal objects. Division is by single products only, which is all that C, A, b of RR and 5R
/// need.

#include <Eigen/Core>
#include <map>
#include <stdexcept>
#include <string>
#include <vector>

#include "firmware/numeric/elementary.hpp"

namespace esmc::test {

class Laurent {
 public:
  using Exponents = std::map<int, int>;  ///< of symbols, by index; none is 0

  Laurent() = default;
  // NOLINTNEXTLINE(google-explicit-constructor): Eigen and the templates write numbers
  Laurent(double number) {
    if (number != 0) terms_[{}] = number;
  }
  static Laurent symbol(const std::string& name) {
    Laurent out;
    out.terms_[{{index(name), 1}}] = 1;
    return out;
  }

  friend Laurent operator+(Laurent a, const Laurent& b) {
    for (const auto& [product, factor] : b.terms_) a.add(product, factor);
    return a;
  }
  friend Laurent operator-(const Laurent& a) { return Laurent(-1) * a; }
  friend Laurent operator-(const Laurent& a, const Laurent& b) { return a + -b; }
  friend Laurent operator*(const Laurent& a, const Laurent& b) {
    Laurent out;
    for (const auto& [p, f] : a.terms_) {
      for (const auto& [q, g] : b.terms_) out.add(product(p, q, 1), f * g);
    }
    return out;
  }
  friend Laurent operator/(const Laurent& a, const Laurent& b) {
    if (b.terms_.size() != 1) throw std::domain_error("division by the sum " + b.text());
    Laurent out;
    const auto& [q, g] = *b.terms_.begin();
    for (const auto& [p, f] : a.terms_) out.add(product(p, q, -1), f / g);
    return out;
  }
  Laurent& operator+=(const Laurent& b) { return *this = *this + b; }
  Laurent& operator-=(const Laurent& b) { return *this = *this - b; }
  Laurent& operator*=(const Laurent& b) { return *this = *this * b; }
  friend bool operator==(const Laurent& a, const Laurent& b) { return a.terms_ == b.terms_; }

  /// As `-s1 s12 (l2 - lg2) / (l2 s2)`: common factors and the common denominator taken out.
  [[nodiscard]] std::string text() const {
    if (terms_.empty()) return "0";
    // Least exponent of every symbol over all terms: positive is a common factor, negative the denominator.
    Exponents common;
    for (int s = 0; s < static_cast<int>(names().size()); ++s) {
      int least = exponent(terms_.begin()->first, s);
      for (const auto& [p, f] : terms_) least = std::min(least, exponent(p, s));
      if (least != 0) common[s] = least;
    }
    std::string above, below;
    int divisors = 0;
    for (const auto& [s, e] : common) {
      if (e > 0) append(above, power(s, e));
      if (e < 0) {
        append(below, power(s, -e));
        ++divisors;
      }
    }
    std::map<Exponents, double> rest;  // in the order of the symbols
    for (const auto& [p, f] : terms_) rest[product(p, common, -1)] = f;
    const bool negative = rest.begin()->second < 0;
    std::string sum;
    for (const auto& [p, f] : rest) {
      std::string one;
      for (const auto& [s, e] : p) append(one, power(s, e));
      const double size = f < 0 ? -f : f;
      if (size != 1 || (one.empty() && (rest.size() > 1 || above.empty()))) {
        std::string counted = number(size);
        append(counted, one);
        one = counted;
      }
      const bool minus = (f < 0) != negative;
      sum += sum.empty() ? one : (minus ? " - " : " + ") + one;
    }
    std::string out = negative ? "-" : "";
    const bool brackets = terms_.size() > 1 && (negative || !above.empty() || divisors > 0);
    if (brackets) sum = "(" + sum + ")";
    append(above, sum);
    out += above;
    if (divisors > 0) out += " / " + (divisors > 1 ? "(" + below + ")" : below);
    return out;
  }

 private:
  static std::vector<std::string>& names() {
    static std::vector<std::string> all;
    return all;
  }
  static int index(const std::string& name) {
    auto& all = names();
    for (std::size_t i = 0; i < all.size(); ++i) {
      if (all[i] == name) return static_cast<int>(i);
    }
    all.push_back(name);
    return static_cast<int>(all.size()) - 1;
  }
  static int exponent(const Exponents& p, int symbol) {
    const auto found = p.find(symbol);
    return found == p.end() ? 0 : found->second;
  }
  static Exponents product(Exponents p, const Exponents& q, int sign) {
    for (const auto& [s, e] : q) {
      if ((p[s] += sign * e) == 0) p.erase(s);
    }
    return p;
  }
  static void append(std::string& text, const std::string& factor) {
    if (!text.empty() && !factor.empty()) text += " ";
    text += factor;
  }
  static std::string power(int symbol, int exponent) {
    const std::string& name = names()[static_cast<std::size_t>(symbol)];
    return exponent == 1 ? name : name + "^" + std::to_string(exponent);
  }
  static std::string number(double value) {
    if (value != static_cast<int>(value)) throw std::domain_error("a number that is not whole");
    return std::to_string(static_cast<int>(value));
  }
  void add(const Exponents& product, double factor) {
    if ((terms_[product] += factor) == 0) terms_.erase(product);
  }

  std::map<Exponents, double> terms_;  // factor of each product; none is 0
};

/// Sine and cosine become symbols; `trigonometry` says of which angle.
inline std::vector<std::pair<Laurent, std::string>>& trigonometry() {
  static std::vector<std::pair<Laurent, std::string>> names;
  return names;
}
inline SinCos<Laurent> sin_cos(const Laurent& angle) {
  for (const auto& [known, name] : trigonometry()) {
    if (known == angle) return {Laurent::symbol("s" + name), Laurent::symbol("c" + name)};
  }
  throw std::domain_error("an angle without a name: " + angle.text());
}

}  // namespace esmc::test

template <>
struct Eigen::NumTraits<esmc::test::Laurent> : Eigen::GenericNumTraits<esmc::test::Laurent> {
  using Real = esmc::test::Laurent;
  using NonInteger = esmc::test::Laurent;
  using Nested = esmc::test::Laurent;
  using Literal = esmc::test::Laurent;
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
