// tests/vcan/whole_xstate.cpp on a host that has more of a process's extended registers than a user-mode
// kernel keeps, tests/vcan/larger_host.cpp; it calls the real one.
#include <elf.h>
#include <gtest/gtest.h>
#include <sys/ptrace.h>
#include <sys/uio.h>
#include <sys/user.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstddef>
#include <vector>

extern "C" long larger_host(int, pid_t, void*, void*);

namespace {

void* const kXstate = reinterpret_cast<void*>(NT_X86_XSTATE);
constexpr std::size_t kGuests = 2696;  // bytes that Linux 6.1 keeps as a user-mode kernel

class WholeXstate : public testing::Test {
 protected:
  WholeXstate() : child_(fork()) {
    if (child_ == 0) {
      ptrace(PTRACE_TRACEME, 0, nullptr, nullptr);
      raise(SIGSTOP);
      _exit(1);
    }
    waitpid(child_, nullptr, 0);
  }
  ~WholeXstate() override {
    kill(child_, SIGKILL);
    waitpid(child_, nullptr, 0);
  }

  // At most `length` bytes of the child's area.
  std::vector<char> read(std::size_t length) const {
    std::vector<char> bytes(length);
    iovec part{bytes.data(), bytes.size()};
    EXPECT_EQ(ptrace(PTRACE_GETREGSET, child_, kXstate, &part), 0);
    bytes.resize(part.iov_len);
    return bytes;
  }

  pid_t child_;
};

TEST_F(WholeXstate, APartIsWrittenOverTheBeginningOfTheWhole) {
  const std::vector<char> before = read(1 << 16);
  std::vector<char> guests = read(kGuests);
  ASSERT_EQ(guests.size(), kGuests);
  ASSERT_GT(before.size(), kGuests);
  for (std::size_t i = 160; i < 176; ++i) guests[i] = static_cast<char>(i);  // xmm0
  guests[512] |= 2;                                                          // which is in use

  iovec part{guests.data(), guests.size()};
  EXPECT_EQ(larger_host(PTRACE_SETREGSET, child_, kXstate, &part), -1);  // what the user-mode kernel dies of
  EXPECT_EQ(errno, EFAULT);
  EXPECT_EQ(read(1 << 16), before);

  EXPECT_EQ(ptrace(PTRACE_SETREGSET, child_, kXstate, &part), 0);
  EXPECT_EQ(part.iov_base, guests.data());
  EXPECT_EQ(part.iov_len, kGuests);
  std::vector<char> after = before;  // the host refuses another end
  std::copy(guests.begin(), guests.end(), after.begin());
  EXPECT_EQ(read(1 << 16), after);
}

TEST_F(WholeXstate, TheWholeIsWrittenAsItIs) {
  std::vector<char> bytes = read(1 << 16);
  iovec whole{bytes.data(), bytes.size()};
  EXPECT_EQ(ptrace(PTRACE_SETREGSET, child_, kXstate, &whole), 0);
  bytes.back() = static_cast<char>(~bytes.back());
  EXPECT_EQ(ptrace(PTRACE_SETREGSET, child_, kXstate, &whole), -1);
  EXPECT_EQ(errno, EINVAL);
}

TEST_F(WholeXstate, OtherRequestsAreHandedOn) {
  user_regs_struct registers{};
  ASSERT_EQ(ptrace(PTRACE_GETREGS, child_, nullptr, &registers), 0);
  errno = 0;
  EXPECT_EQ(ptrace(PTRACE_PEEKUSER, child_, offsetof(user_regs_struct, rsp), nullptr),
            static_cast<long>(registers.rsp));
  EXPECT_EQ(errno, 0);
  registers.r15 = 15;
  iovec first{&registers, sizeof(registers.r15)};  // of general registers Linux takes a part
  EXPECT_EQ(ptrace(PTRACE_SETREGSET, child_, NT_PRSTATUS, &first), 0);
  EXPECT_EQ(ptrace(PTRACE_PEEKUSER, child_, offsetof(user_regs_struct, r15), nullptr), 15);
}

TEST_F(WholeXstate, ReasonsOfRefusalsAreKept) {
  EXPECT_EQ(ptrace(PTRACE_PEEKUSER, child_, 1, nullptr), -1);
  EXPECT_EQ(errno, EIO);
  std::vector<char> guests(kGuests);
  iovec part{guests.data(), guests.size()};
  guests[512] = 2;
  guests[520] = 1;  // a form of area that Linux does not take
  EXPECT_EQ(ptrace(PTRACE_SETREGSET, child_, kXstate, &part), -1);
  EXPECT_EQ(errno, EINVAL);
  EXPECT_EQ(ptrace(PTRACE_SETREGSET, getpid(), kXstate, &part), -1);
  EXPECT_EQ(errno, ESRCH);
}

}  // namespace
