#pragma once
/// Chooses a mutant at run time: the number in the environment variable MUTANT. All of a header are compiled
/// at once.

#include <cstdlib>
#include <type_traits>

namespace mutant {

inline const int chosen = std::getenv("MUTANT") != nullptr ? std::atoi(std::getenv("MUTANT")) : -1;

/// No constant expression: where the compiler evaluates this, it says so, and cannot choose the original
/// unnoticed.
constexpr bool is(int number) { return chosen == number; }

/// In a function that the compiler has to evaluate somewhere: there, it takes the original. Such a mutant has
/// to be compiled by itself as well.
struct Folded {
  int number;
};
constexpr bool is(Folded m) { return !std::is_constant_evaluated() && chosen == m.number; }

template <class T>
struct Plain {
  using type = std::remove_cvref_t<T>;
};
template <class T>
requires requires { typename std::remove_cvref_t<T>::PlainObject; }
struct Plain<T> {  // an expression of matrices has another type when its operator changes
  using type = typename std::remove_cvref_t<T>::PlainObject;
};

/// Exit status of a mutant that does not exist: these operands do not have the other operator.
inline constexpr int does_not_exist = 77;

#define MUTANT_BINARY(name, op, other)                                                                  \
  template <class Number, class A, class B>                                                             \
  constexpr typename Plain<decltype(std::declval<A>() op std::declval<B>())>::type name(Number number,  \
                                                                                        A&& a, B&& b) { \
    if (is(number)) {                                                                                   \
      if constexpr (requires { a other b; }) return a other b;                                          \
      std::_Exit(does_not_exist);                                                                       \
    }                                                                                                   \
    return a op b;                                                                                      \
  }
MUTANT_BINARY(add, +, -)
MUTANT_BINARY(subtract, -, +)
MUTANT_BINARY(multiply, *, /)
MUTANT_BINARY(divide, /, *)
#undef MUTANT_BINARY

}  // namespace mutant
