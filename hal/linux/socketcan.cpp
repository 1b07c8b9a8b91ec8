#include "hal/linux/socketcan.hpp"

#include <linux/can.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/uio.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <limits>

namespace esmc::hal {
namespace {

/// By the kernel's stamp, on the wall clock: a step forwards makes frames look older, which is the safe side.
std::uint32_t age_of(msghdr& message) {
  for (cmsghdr* c = CMSG_FIRSTHDR(&message); c != nullptr; c = CMSG_NXTHDR(&message, c)) {
    if (c->cmsg_level != SOL_SOCKET || c->cmsg_type != SCM_TIMESTAMP) continue;
    timeval then{}, now{};
    std::memcpy(&then, CMSG_DATA(c), sizeof then);
    if (::gettimeofday(&now, nullptr) != 0) return 0;
    const std::int64_t us =
        (static_cast<std::int64_t>(now.tv_sec) - then.tv_sec) * 1'000'000 + (now.tv_usec - then.tv_usec);
    return static_cast<std::uint32_t>(
        std::clamp<std::int64_t>(us, 0, std::numeric_limits<std::uint32_t>::max()));
  }
  return 0;
}

}  // namespace

SocketCan SocketCan::open(const std::string& interface, std::error_code& error, bool fd) {
  const auto fail = [&](int code) {
    error = std::error_code(code, std::generic_category());
    return SocketCan(-1);
  };
  error.clear();
  if (interface.empty() || interface.size() >= IFNAMSIZ) return fail(ENODEV);
  SocketCan s(::socket(PF_CAN, SOCK_RAW | SOCK_NONBLOCK | SOCK_CLOEXEC, CAN_RAW));
  if (!s.is_open()) return fail(errno);
  // Optional: an interface without FD refuses FD frames when they are sent.
  const int on = 1;
  const can_err_mask_t errors = CAN_ERR_BUSOFF | CAN_ERR_RESTARTED;
  (void)::setsockopt(s.descriptor(), SOL_CAN_RAW, CAN_RAW_FD_FRAMES, &on, sizeof on);
  (void)::setsockopt(s.descriptor(), SOL_CAN_RAW, CAN_RAW_ERR_FILTER, &errors, sizeof errors);
  (void)::setsockopt(s.descriptor(), SOL_SOCKET, SO_TIMESTAMP, &on, sizeof on);

  ifreq request{};
  interface.copy(request.ifr_name, IFNAMSIZ - 1);
  if (::ioctl(s.descriptor(), SIOCGIFINDEX, &request) < 0) return fail(errno);
  const int index = request.ifr_ifindex;
  if (::ioctl(s.descriptor(), SIOCGIFFLAGS, &request) < 0) return fail(errno);
  if ((request.ifr_flags & IFF_UP) == 0) return fail(ENETDOWN);
  if (::ioctl(s.descriptor(), SIOCGIFMTU, &request) < 0) return fail(errno);
  if (fd && request.ifr_mtu < static_cast<int>(CANFD_MTU)) return fail(EMSGSIZE);
  sockaddr_can address{};
  address.can_family = AF_CAN;
  address.can_ifindex = index;
  if (::bind(s.descriptor(), reinterpret_cast<const sockaddr*>(&address), sizeof address) < 0)
    return fail(errno);
  return s;
}

bool SocketCan::set_filters(const IdFilters& filters) {
  std::array<can_filter, IdFilters::capacity> list{};
  std::size_t size = 0;
  for (const IdFilter& f : filters.list())  // frames of the other length of identifier do not match
    list[size++] = {f.id | (f.extended ? CAN_EFF_FLAG : 0U), f.mask | CAN_EFF_FLAG};
  if (size == 0) size = 1;  // {0, 0} matches every frame
  return ::setsockopt(descriptor(), SOL_CAN_RAW, CAN_RAW_FILTER, list.data(),
                      static_cast<socklen_t>(size * sizeof list[0])) == 0;
}

SendStatus SocketCan::try_send(const CanFrame& f) {
  if (!well_formed(f)) return SendStatus::refused;
  if (bus_off_) return SendStatus::bus_off;
  canfd_frame raw{};  // a classic frame is the beginning of it
  raw.can_id = f.id | (f.extended ? CAN_EFF_FLAG : 0U) | (f.remote ? CAN_RTR_FLAG : 0U);
  raw.len = f.size;
  raw.flags = f.fd && f.bit_rate_switch ? CANFD_BRS : 0;
  std::copy_n(f.data.begin(), f.size, raw.data);
  const std::size_t size = f.fd ? CANFD_MTU : CAN_MTU;
  const ssize_t written = ::send(descriptor(), &raw, size, MSG_DONTWAIT | MSG_NOSIGNAL);
  if (written == static_cast<ssize_t>(size)) return SendStatus::ok;
  if (errno == EAGAIN || errno == EWOULDBLOCK || errno == ENOBUFS || errno == EINTR)
    return SendStatus::bus_full;
  if (errno == EINVAL || errno == EMSGSIZE) return SendStatus::refused;  // FD on a classic interface
  return SendStatus::bus_off;                                            // interface down or gone
}

bool SocketCan::try_receive(CanFrame& f) {
  for (int skipped = 0; skipped < 64; ++skipped) {  // bounded, against a flood of error frames
    canfd_frame raw{};
    iovec buffer{&raw, sizeof raw};
    alignas(cmsghdr) std::array<char, CMSG_SPACE(sizeof(timeval))> control{};
    msghdr message{};
    message.msg_iov = &buffer;
    message.msg_iovlen = 1;
    message.msg_control = control.data();
    message.msg_controllen = control.size();
    const ssize_t n = ::recvmsg(descriptor(), &message, MSG_DONTWAIT);
    const bool fd = n == static_cast<ssize_t>(CANFD_MTU);
    if (!fd && n != static_cast<ssize_t>(CAN_MTU)) return false;
    if ((raw.can_id & CAN_ERR_FLAG) != 0U) {
      if ((raw.can_id & CAN_ERR_BUSOFF) != 0U) bus_off_ = true;
      continue;
    }
    CanFrame out;
    out.extended = (raw.can_id & CAN_EFF_FLAG) != 0U;
    out.remote = (raw.can_id & CAN_RTR_FLAG) != 0U;
    out.id = raw.can_id & (out.extended ? CAN_EFF_MASK : CAN_SFF_MASK);
    out.fd = fd;
    out.bit_rate_switch = fd && (raw.flags & CANFD_BRS) != 0;
    out.size = raw.len;
    if (!well_formed(out)) continue;
    std::copy_n(raw.data, out.size, out.data.begin());
    f = out;
    frame_age_us_ = age_of(message);
    return true;
  }
  return false;
}

}  // namespace esmc::hal
