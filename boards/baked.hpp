#pragma once
/// Helpers of the header that `esmc bake` writes.

#include <span>
#include <type_traits>

#include "firmware/cycle/instances.hpp"

namespace esmc::baked {

/// An enumerator by its number; converts to the enumeration of the field that it initialises.
struct Enum {
  int number;
  template <class E>
  requires std::is_enum_v<E>
  constexpr operator E() const { return static_cast<E>(number); }
};

/// Number of entries of column(first, rest...).
template <class... T>
inline constexpr int size = 1 + static_cast<int>(sizeof...(T));

/// A column vector of these entries.
template <class S, class... T>
[[nodiscard]] Vec<S, size<T...>> column(S first, T... rest) {
  Vec<S, size<T...>> v;
  int i = 0;
  v[i++] = first;
  ((v[i++] = rest), ...);
  return v;
}

}  // namespace esmc::baked
