#include "hal/linux/byte_port.hpp"

#include <fcntl.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/file.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <memory>
#include <utility>

namespace esmc::hal {
namespace {

constexpr int patience_ms = 5000;

constexpr std::array speeds{57'600,    115'200,   230'400,   460'800,   500'000,   576'000,   921'600,
                            1'000'000, 1'152'000, 1'500'000, 2'000'000, 2'500'000, 3'000'000, 4'000'000};

std::string reason(int code) { return std::strerror(code); }

Descriptor fail(std::string& why, const std::string& because) {
  why = because;
  return {};
}

/// False: not connected, for the reason `why`.
bool connect_in_time(const Descriptor& fd, const sockaddr* address, socklen_t size, std::string& why) {
  if (::connect(fd.get(), address, size) == 0) return true;
  if (errno == EINPROGRESS) {
    pollfd p{fd.get(), POLLOUT, 0};
    int code = ETIMEDOUT;
    socklen_t length = sizeof code;
    if (::poll(&p, 1, patience_ms) > 0) (void)::getsockopt(fd.get(), SOL_SOCKET, SO_ERROR, &code, &length);
    if (code == 0) return true;
    why = reason(code);
  } else {
    // EAGAIN: the queue of a local stream socket is full.
    why = errno == EAGAIN ? "busy" : reason(errno);
  }
  return false;
}

Descriptor open_unix(const std::string& path, std::string& why) {
  sockaddr_un address{};
  if (path.empty() || path.size() >= sizeof address.sun_path) {
    return fail(why, path.empty() ? "a path is missing" : "the path is too long for a socket");
  }
  address.sun_family = AF_UNIX;
  path.copy(address.sun_path, path.size());
  Descriptor fd(::socket(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  if (!fd.is_open()) return fail(why, reason(errno));
  if (connect_in_time(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address, why)) return fd;
  return {};
}

Descriptor open_tcp(const std::string& where, std::string& why) {
  const std::size_t colon = where.rfind(':');
  if (colon == std::string::npos || colon == 0 || colon + 1 == where.size()) {
    return fail(why, "tcp:HOST:PORT is needed");
  }
  std::string host = where.substr(0, colon);
  if (host.size() > 2 && host.front() == '[' && host.back() == ']') host = host.substr(1, host.size() - 2);
  addrinfo wanted{};
  wanted.ai_family = AF_UNSPEC;
  wanted.ai_socktype = SOCK_STREAM;
  addrinfo* list = nullptr;
  const int code = ::getaddrinfo(host.c_str(), where.substr(colon + 1).c_str(), &wanted, &list);
  if (code != 0) return fail(why, code == EAI_SYSTEM ? reason(errno) : ::gai_strerror(code));
  const std::unique_ptr<addrinfo, decltype(&::freeaddrinfo)> owner(list, &::freeaddrinfo);
  for (const addrinfo* a = list; a != nullptr; a = a->ai_next) {
    Descriptor fd(::socket(a->ai_family, a->ai_socktype | SOCK_NONBLOCK | SOCK_CLOEXEC, a->ai_protocol));
    if (!fd.is_open()) {
      why = reason(errno);
    } else if (connect_in_time(fd, a->ai_addr, a->ai_addrlen, why)) {
      // Lines are short and must not wait for more of them.
      const int on = 1;
      (void)::setsockopt(fd.get(), IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
      why.clear();
      return fd;
    }
  }
  return {};
}

bool make_raw(int fd, int speed) {
  termios t{};
  if (::tcgetattr(fd, &t) != 0) return false;
  ::cfmakeraw(&t);  // 8 bits, no parity, nothing translated
  t.c_cflag |= CLOCAL | CREAD;
  t.c_cflag &= ~static_cast<tcflag_t>(CSTOPB | CRTSCTS);
  t.c_iflag &= ~static_cast<tcflag_t>(IXOFF | IXANY);
  t.c_cc[VMIN] = 1;  // 0: a read without data would look like a hang-up
  t.c_cc[VTIME] = 0;
  if (::cfsetspeed(&t, static_cast<speed_t>(speed)) != 0) return false;  // glibc takes bit/s
  if (::tcsetattr(fd, TCSANOW, &t) != 0) return false;
  return ::tcflush(fd, TCIOFLUSH) == 0;  // older input is not for this program
}

Descriptor open_tty(const std::string& endpoint, std::string& why) {
  std::string path = endpoint;
  int speed = 115'200;
  struct stat there {};
  const std::size_t at = endpoint.rfind('@');
  // A device may have an @ in its own name.
  if (at != std::string::npos && ::stat(endpoint.c_str(), &there) != 0) {
    path = endpoint.substr(0, at);
    const std::string baud = endpoint.substr(at + 1);
    const auto* const known =
        std::find_if(speeds.begin(), speeds.end(), [&](int s) { return std::to_string(s) == baud; });
    if (known == speeds.end()) {
      why = "@" + baud + ": allowed are";
      for (const int& s : speeds) why += (&s == speeds.data() ? " " : ", ") + std::to_string(s);
      return {};
    }
    speed = *known;
  }
  Descriptor fd(::open(path.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC));  // NOLINT(*-vararg)
  if (!fd.is_open()) {
    why = reason(errno);
    if (errno == EACCES) why += " (is the user in the device's group, dialout?)";
    if (errno == ENXIO || errno == EISDIR) why = "no serial line (a socket is unix:PATH)";
  } else if (::isatty(fd.get()) != 1) {
    why = "no serial line";
  } else if (::flock(fd.get(), LOCK_EX | LOCK_NB) != 0) {
    // Two readers would each get some of the bytes. pyserial and others use the same lock.
    why = errno == EWOULDBLOCK ? "another program uses it; every node needs an adapter of its own"
                               : reason(errno);
  } else if (!make_raw(fd.get(), speed)) {
    why = "cannot be set up: " + reason(errno);
  } else {
    return fd;
  }
  return {};
}

}  // namespace

SerialPort::SerialPort(Descriptor fd) : fd_(std::move(fd)) {
  struct stat kind {};
  socket_ = is_open() && ::fstat(descriptor(), &kind) == 0 && S_ISSOCK(kind.st_mode);
}

SerialPort SerialPort::open(const std::string& endpoint, std::string& why) {
  why.clear();
  if (endpoint.empty()) {
    why = "an endpoint is missing";
    return SerialPort(-1);
  }
  if (endpoint.starts_with("unix:")) return SerialPort(open_unix(endpoint.substr(5), why));
  if (endpoint.starts_with("tcp:")) return SerialPort(open_tcp(endpoint.substr(4), why));
  return SerialPort(open_tty(endpoint, why));
}

SerialPort::~SerialPort() {
  // A line that takes no more bytes must not delay the end of the program.
  if (is_open() && !socket_ && has_output()) (void)::tcflush(descriptor(), TCOFLUSH);
}

std::size_t SerialPort::write_some(std::span<const char> out) {
  const ssize_t n = socket_ ? ::send(descriptor(), out.data(), out.size(), MSG_DONTWAIT | MSG_NOSIGNAL)
                            : ::write(descriptor(), out.data(), out.size());
  if (n >= 0) return static_cast<std::size_t>(n);
  if (errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR && errno != ENOBUFS) gone_ = true;
  return 0;
}

void SerialPort::flush() {
  if (!gone_ && has_output()) sent_ += write_some({rest_.data() + sent_, unsent_ - sent_});
}

bool SerialPort::try_write(std::span<const char> out) {
  flush();
  if (gone_ || has_output() || out.size() > rest_.size()) return false;
  const std::size_t n = write_some(out);
  if (n == 0) return out.empty();
  // The rest must follow before the next line.
  sent_ = 0;
  unsent_ = out.size() - n;
  std::copy(out.begin() + static_cast<std::ptrdiff_t>(n), out.end(), rest_.begin());
  return true;
}

bool SerialPort::try_read(char& in) {
  if (!has_input()) {
    flush();
    if (gone_) return false;
    const ssize_t n = ::read(descriptor(), input_.data(), input_.size());
    next_ = 0;
    filled_ = n > 0 ? static_cast<std::size_t>(n) : 0;
    if (n == 0 || (n < 0 && errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR)) gone_ = true;
    if (n <= 0) return false;
  }
  in = input_[next_++];
  return true;
}

int slcan_speed(int bits_per_second) {
  constexpr std::array rates{10'000, 20'000, 50'000, 100'000, 125'000, 250'000, 500'000, 800'000, 1'000'000};
  const auto* const found = std::find(rates.begin(), rates.end(), bits_per_second);
  return found == rates.end() ? -1 : static_cast<int>(found - rates.begin());
}

SlcanAdapter::SlcanAdapter(SerialPort port, int speed) : port_(std::move(port)) {
  command(std::array{'C', slcan_end});  // a channel left open would refuse the bit rate
  command(std::array{'S', static_cast<char>('0' + speed), slcan_end});
  command(std::array{'O', slcan_end});
}

SlcanAdapter::~SlcanAdapter() { command(std::array{'C', slcan_end}); }

void SlcanAdapter::command(std::span<const char> line) {
  (void)port_.try_write(line);  // cannot fail at the beginning; at the end a failure has no consequence
}

}  // namespace esmc::hal
