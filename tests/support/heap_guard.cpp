#include "tests/support/heap_guard.hpp"

#include <unistd.h>

#include <cerrno>
#include <cstddef>
#include <cstdlib>

namespace {

thread_local int guards = 0;

[[maybe_unused]] void refuse_when_guarded() {
  if (guards == 0) return;
  constexpr char what[] = "heap allocation under HeapGuard\n";
  [[maybe_unused]] const auto written = ::write(STDERR_FILENO, what, sizeof what - 1);
  std::abort();
}

}  // namespace

namespace esmc::test {
HeapGuard::HeapGuard() { ++guards; }
HeapGuard::~HeapGuard() { --guards; }
}  // namespace esmc::test

// glibc's own entries, under the names that a program may take over. operator new ends up in malloc, or in
// aligned_alloc for over-aligned types. free is left alone: it belongs to both.
extern "C" {
void* __libc_malloc(std::size_t size);
void* __libc_calloc(std::size_t count, std::size_t size);
void* __libc_realloc(void* old, std::size_t size);
void* __libc_memalign(std::size_t alignment, std::size_t size);

void* malloc(std::size_t size) {
  refuse_when_guarded();
  return __libc_malloc(size);
}
void* calloc(std::size_t count, std::size_t size) {
  refuse_when_guarded();
  return __libc_calloc(count, size);
}
void* realloc(void* old, std::size_t size) {
  refuse_when_guarded();
  return __libc_realloc(old, size);
}
void* memalign(std::size_t alignment, std::size_t size) {
  refuse_when_guarded();
  return __libc_memalign(alignment, size);
}
void* aligned_alloc(std::size_t alignment, std::size_t size) {
  refuse_when_guarded();
  return __libc_memalign(alignment, size);
}
int posix_memalign(void** out, std::size_t alignment, std::size_t size) {
  refuse_when_guarded();
  *out = __libc_memalign(alignment, size);
  return *out == nullptr ? ENOMEM : 0;
}
}
