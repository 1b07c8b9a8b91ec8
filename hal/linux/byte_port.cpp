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
#include <string_view>
#include <utility>

namespace esmc::hal {
namespace {

constexpr int patience_ms = 5000;

struct Speed {
  std::string_view name;
  speed_t value;
};
constexpr std::array<Speed, 14> speeds{{{"57600", B57600},
                                        {"115200", B115200},
                                        {"230400", B230400},
                                        {"460800", B460800},
                                        {"500000", B500000},
                                        {"576000", B576000},
                                        {"921600", B921600},
                                        {"1000000", B1000000},
                                        {"1152000", B1152000},
                                        {"1500000", B1500000},
                                        {"2000000", B2000000},
                                        {"2500000", B2500000},
                                        {"3000000", B3000000},
                                        {"4000000", B4000000}}};

std::string reason(int code) { return std::strerror(code); }

/// Connected, or `why` says why not. Takes the descriptor with it.
bool connect_in_time(int fd, const sockaddr* address, socklen_t size, std::string& why) {
  if (::connect(fd, address, size) == 0) return true;
  if (errno == EINPROGRESS) {
    pollfd p{fd, POLLOUT, 0};
    int code = ETIMEDOUT;
    socklen_t length = sizeof code;
    if (::poll(&p, 1, patience_ms) > 0) (void)::getsockopt(fd, SOL_SOCKET, SO_ERROR, &code, &length);
    if (code == 0) return true;
    why = reason(code);
  } else {
    // A stream socket of the same machine refuses at once; EAGAIN is its full queue.
    why = errno == EAGAIN ? "busy" : reason(errno);
  }
  return false;
}

int open_unix(const std::string& path, std::string& why) {
  sockaddr_un address{};
  if (path.empty() || path.size() >= sizeof address.sun_path) {
    why = path.empty() ? "a path is missing" : "the path is too long for a socket";
    return -1;
  }
  address.sun_family = AF_UNIX;
  path.copy(address.sun_path, path.size());
  const int fd = ::socket(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  if (fd < 0) {
    why = reason(errno);
    return -1;
  }
  if (connect_in_time(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address, why)) return fd;
  ::close(fd);
  return -1;
}

int open_tcp(const std::string& where, std::string& why) {
  const std::size_t colon = where.rfind(':');
  if (colon == std::string::npos || colon == 0 || colon + 1 == where.size()) {
    why = "tcp:HOST:PORT is needed";
    return -1;
  }
  std::string host = where.substr(0, colon);
  if (host.size() > 2 && host.front() == '[' && host.back() == ']') host = host.substr(1, host.size() - 2);
  addrinfo wanted{};
  wanted.ai_family = AF_UNSPEC;
  wanted.ai_socktype = SOCK_STREAM;
  addrinfo* list = nullptr;
  const int code = ::getaddrinfo(host.c_str(), where.substr(colon + 1).c_str(), &wanted, &list);
  if (code != 0) {
    why = code == EAI_SYSTEM ? reason(errno) : ::gai_strerror(code);
    return -1;
  }
  const std::unique_ptr<addrinfo, decltype(&::freeaddrinfo)> owner(list, &::freeaddrinfo);
  for (const addrinfo* a = list; a != nullptr; a = a->ai_next) {
    const int fd = ::socket(a->ai_family, a->ai_socktype | SOCK_NONBLOCK | SOCK_CLOEXEC, a->ai_protocol);
    if (fd < 0) {
      why = reason(errno);
      continue;
    }
    if (connect_in_time(fd, a->ai_addr, a->ai_addrlen, why)) {
      // A line is short, and nothing is gained by waiting for more of them.
      const int on = 1;
      (void)::setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
      why.clear();
      return fd;
    }
    ::close(fd);
  }
  return -1;
}

bool make_raw(int fd, speed_t speed) {
  termios t{};
  if (::tcgetattr(fd, &t) != 0) return false;
  ::cfmakeraw(&t);  // 8 bits, no parity, nothing translated
  t.c_cflag |= CLOCAL | CREAD;
  t.c_cflag &= ~static_cast<tcflag_t>(CSTOPB | CRTSCTS);
  t.c_iflag &= ~static_cast<tcflag_t>(IXOFF | IXANY);
  t.c_cc[VMIN] = 1;  // with 0 a read without data would look like a hang-up
  t.c_cc[VTIME] = 0;
  if (::cfsetispeed(&t, speed) != 0 || ::cfsetospeed(&t, speed) != 0) return false;
  if (::tcsetattr(fd, TCSANOW, &t) != 0) return false;
  // What came before this program asked for anything is not for it.
  return ::tcflush(fd, TCIOFLUSH) == 0;
}

int open_tty(const std::string& endpoint, std::string& why) {
  std::string path = endpoint;
  speed_t speed = B115200;
  struct stat there {};
  const std::size_t at = endpoint.rfind('@');
  // A device whose own name has an @ is meant by it.
  if (at != std::string::npos && ::stat(endpoint.c_str(), &there) != 0) {
    path = endpoint.substr(0, at);
    const std::string baud = endpoint.substr(at + 1);
    const auto* const known =
        std::find_if(speeds.begin(), speeds.end(), [&](const Speed& s) { return s.name == baud; });
    if (known == speeds.end()) {
      why = "@" + baud + ": allowed are";
      for (const Speed& s : speeds) why += (&s == speeds.data() ? " " : ", ") + std::string(s.name);
      return -1;
    }
    speed = known->value;
  }
  const int fd = ::open(path.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);  // NOLINT(*-vararg)
  if (fd < 0) {
    why = reason(errno);
    if (errno == EACCES) why += " (is the user in the device's group, dialout?)";
    if (errno == ENXIO || errno == EISDIR) why = "no serial line (a socket is unix:PATH)";
    return -1;
  }
  if (::isatty(fd) != 1) {
    why = "no serial line";
  } else if (::flock(fd, LOCK_EX | LOCK_NB) != 0) {
    // Two readers would each get some of the bytes. The lock is the one that pyserial and others know.
    why = errno == EWOULDBLOCK ? "another program uses it; every node needs an adapter of its own"
                               : reason(errno);
  } else if (!make_raw(fd, speed)) {
    why = "cannot be set up: " + reason(errno);
  } else {
    return fd;
  }
  ::close(fd);
  return -1;
}

}  // namespace

SerialPort::SerialPort(int fd) : fd_(fd) {
  struct stat kind {};
  socket_ = fd >= 0 && ::fstat(fd, &kind) == 0 && S_ISSOCK(kind.st_mode);
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

SerialPort& SerialPort::operator=(SerialPort&& other) noexcept {
  std::swap(fd_, other.fd_);
  socket_ = other.socket_;
  gone_ = other.gone_;
  rest_ = other.rest_;
  sent_ = other.sent_;
  unsent_ = other.unsent_;
  input_ = other.input_;
  next_ = other.next_;
  filled_ = other.filled_;
  return *this;
}

SerialPort::~SerialPort() {
  if (fd_ < 0) return;
  // A line that has stopped taking bytes must not hold the end of the program.
  if (!socket_ && has_output()) (void)::tcflush(fd_, TCOFLUSH);
  ::close(fd_);
}

std::size_t SerialPort::write_some(std::span<const char> out) {
  const ssize_t n = socket_ ? ::send(fd_, out.data(), out.size(), MSG_DONTWAIT | MSG_NOSIGNAL)
                            : ::write(fd_, out.data(), out.size());
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
  // Half a line on the wire would swallow the next one.
  sent_ = 0;
  unsent_ = out.size() - n;
  std::copy(out.begin() + static_cast<std::ptrdiff_t>(n), out.end(), rest_.begin());
  return true;
}

bool SerialPort::try_read(char& in) {
  if (!has_input()) {
    flush();
    if (gone_) return false;
    const ssize_t n = ::read(fd_, input_.data(), input_.size());
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
  command(std::array{'C', slcan_end});  // open from an earlier program: it would refuse the bit rate
  command(std::array{'S', static_cast<char>('0' + speed), slcan_end});
  command(std::array{'O', slcan_end});
}

SlcanAdapter::~SlcanAdapter() { command(std::array{'C', slcan_end}); }

void SlcanAdapter::command(std::span<const char> line) {
  // Of the few bytes at the beginning none is refused; at the end nobody could act on it.
  (void)port_.try_write(line);
}

}  // namespace esmc::hal
