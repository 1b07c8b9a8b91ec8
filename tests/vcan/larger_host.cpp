// Preloaded behind whole_xstate: plays a host that has 8 KB more of a process's extended registers than this
// one, as AMX brings. Like Linux it cuts what is read to the caller's length and refuses to write less than
// all. The end of what it adds must come back as it was read.
#include <dlfcn.h>
#include <elf.h>
#include <linux/ptrace.h>
#include <sys/types.h>
#include <sys/uio.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

namespace {

constexpr std::size_t kAdded = 8192;
constexpr std::size_t kMarked = 4096;  // of them; the others may lie within the user-mode kernel's own area

const auto next = reinterpret_cast<long (*)(int, pid_t, void*, void*)>(dlsym(RTLD_NEXT, "ptrace"));
char area[1 << 16];

long refuse(int why) {
  errno = why;
  return -1;
}

}  // namespace

extern "C" long ptrace(int request, pid_t pid, void* address, void* data) {
  const bool writes = request == PTRACE_SETREGSET;
  if ((!writes && request != PTRACE_GETREGSET) || address != reinterpret_cast<void*>(NT_X86_XSTATE)) {
    return next(request, pid, address, data);
  }
  iovec real{area, sizeof(area) - kAdded};
  if (next(PTRACE_GETREGSET, pid, address, &real) != 0) return -1;
  const std::size_t whole = real.iov_len + kAdded;
  char* const marked = area + whole - kMarked;
  std::memset(area + real.iov_len, 0, kAdded - kMarked);
  std::memset(marked, 0xA5, kMarked);

  auto& caller = *static_cast<iovec*>(data);
  const std::size_t length = std::min(caller.iov_len, whole);
  if (!writes) {
    std::memcpy(caller.iov_base, area, length);
  } else {
    if (length != whole) return refuse(EFAULT);
    if (std::memcmp(static_cast<char*>(caller.iov_base) + whole - kMarked, marked, kMarked) != 0)
      return refuse(EINVAL);
    real.iov_base = caller.iov_base;
    if (next(request, pid, address, &real) != 0) return -1;
  }
  caller.iov_len = length;
  return 0;
}

// For use without whole_xstate in front of it.
extern "C" long larger_host(int, pid_t, void*, void*) __attribute__((alias("ptrace")));
