#pragma once
/// While a HeapGuard lives, every allocation in its thread ends the program. The hooks are in heap_guard.cpp,
/// which a test has to compile in; not under AddressSanitizer, which brings an allocator of its own.

namespace esmc::test {

class HeapGuard {
 public:
  HeapGuard();
  ~HeapGuard();
  HeapGuard(const HeapGuard&) = delete;
  HeapGuard& operator=(const HeapGuard&) = delete;
};

}  // namespace esmc::test
