// Preloaded into the user-mode kernel, which keeps 2696 bytes of a process's extended registers. A host takes
// its whole area of them back or refuses with EFAULT, and with AMX it has 11008 bytes: the first process of
// the guest died. So what the guest leaves out is completed with what the process has there.
#include <dlfcn.h>
#include <elf.h>
#include <linux/ptrace.h>
#include <sys/types.h>
#include <sys/uio.h>

#include <cstring>

namespace {

// Looked up before the guest runs, because its stacks are small. The area is no local variable for the same
// reason; one thread of that kernel traces.
const auto next = reinterpret_cast<long (*)(int, pid_t, void*, void*)>(dlsym(RTLD_NEXT, "ptrace"));
char area[1 << 16];

}  // namespace

// The C library declares it with `...`, which comes in the same registers.
extern "C" long ptrace(int request, pid_t pid, void* address, void* data) {
  iovec whole{area, sizeof(area)};
  if (request == PTRACE_SETREGSET && address == reinterpret_cast<void*>(NT_X86_XSTATE) &&
      next(PTRACE_GETREGSET, pid, address, &whole) == 0) {
    const auto& guest = *static_cast<const iovec*>(data);
    if (guest.iov_len < whole.iov_len) {
      std::memcpy(area, guest.iov_base, guest.iov_len);
      data = &whole;
    }
  }
  return next(request, pid, address, data);
}
