#pragma once
/// While a HeapGuard lives, every allocation in its thread ends the program. The hooks are in heap_guard.cpp,
/// which a test has to compile in; without effect under AddressSanitizer, which brings an allocator of its own.

namespace esmc::test {

#if defined(__SANITIZE_ADDRESS__)
inline constexpr bool heap_is_guarded = false;
#elif defined(__has_feature)
#if __has_feature(address_sanitizer)
inline constexpr bool heap_is_guarded = false;
#else
inline constexpr bool heap_is_guarded = true;
#endif
#else
inline constexpr bool heap_is_guarded = true;
#endif

class HeapGuard {
 public:
  HeapGuard();
  ~HeapGuard();
  HeapGuard(const HeapGuard&) = delete;
  HeapGuard& operator=(const HeapGuard&) = delete;
};

}  // namespace esmc::test
