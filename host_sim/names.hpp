#pragma once
/// Names of enumerators: one table per enum, in the order of its enumerators. Readers, key tables, summaries,
/// the command line and the live bench take their names from it.

#include <array>
#include <cstddef>
#include <optional>
#include <string_view>
#include <type_traits>

namespace esmc::host {

/// An array of `const char*` for an enum that has names; specialised beside the enum.
template <class E>
inline constexpr auto names_of = nullptr;

template <class E>
concept Named = std::is_enum_v<E> && !std::is_null_pointer_v<std::remove_const_t<decltype(names_of<E>)>>;

/// Name of an enumerator. One beyond the table (ReferenceType::none) must not be passed: it is not checked.
template <Named E>
[[nodiscard]] constexpr const char* name(E e) {
  return names_of<E>[static_cast<std::size_t>(e)];
}

/// Returns the enumerator of this name, case-sensitive; nothing where none has it.
template <Named E>
[[nodiscard]] constexpr std::optional<E> from_name(std::string_view text) {
  for (std::size_t i = 0; i < names_of<E>.size(); ++i) {
    if (names_of<E>[i] == text) return static_cast<E>(i);
  }
  return std::nullopt;
}

/// "a | b | c" of an array of names, computed at compile time: the form of allowed values in key tables.
template <const auto& names>
struct Joined {
  static constexpr std::string_view between = " | ";
  static constexpr auto text = [] {
    constexpr std::size_t size = [] {
      std::size_t sum = 0;
      for (const std::string_view name : names) sum += name.size() + between.size();
      return sum;
    }();
    std::array<char, size> out{};
    std::size_t at = 0;
    for (const std::string_view name : names) {
      for (const char c : name) out[at++] = c;
      for (const char c : between) out[at++] = c;
    }
    return out;
  }();
  static constexpr std::string_view value{text.data(), text.size() - between.size()};
};
template <const auto& names>
inline constexpr std::string_view joined = Joined<names>::value;
template <Named E>
inline constexpr std::string_view choices = joined<names_of<E>>;

}  // namespace esmc::host
