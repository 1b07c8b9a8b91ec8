/// The serial port of Linux at the end of a socket pair and of a pseudo terminal; the other end is this
/// file's own.

#include "hal/linux/byte_port.hpp"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <pty.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <string>
#include <utility>

#include "host_sim/loop/waiting.hpp"

namespace esmc::host {
namespace {

using hal::CanFrame;
using hal::SendStatus;
using hal::SerialPort;
using namespace std::chrono_literals;

CanFrame frame(std::uint32_t id) {
  CanFrame f;
  f.id = id;
  f.size = 8;
  return f;
}

/// What waits at a descriptor that does not block.
std::string drained(int fd) {
  std::string out;
  std::array<char, 4096> part{};
  for (ssize_t n = 0; (n = ::read(fd, part.data(), part.size())) > 0;)
    out.append(part.data(), static_cast<std::size_t>(n));
  return out;
}
void say(int fd, const std::string& text) {
  ASSERT_EQ(::write(fd, text.data(), text.size()), static_cast<ssize_t>(text.size()));
}

/// Two ends of a stream; `there` is the test's.
struct Pair {
  Pair() {
    std::array<int, 2> fd{};
    EXPECT_EQ(::socketpair(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK, 0, fd.data()), 0);
    here = fd[0];
    there = fd[1];
  }
  ~Pair() { close_there(); }
  void close_there() {
    if (there >= 0) ::close(std::exchange(there, -1));
  }
  int here, there;
};

TEST(SerialPort, AnAdapterIsOpenedWithItsBitRateAndClosedAgain) {
  Pair pair;
  {
    hal::SlcanAdapter adapter(SerialPort(pair.here), hal::slcan_speed(500'000));
    EXPECT_EQ(drained(pair.there), "C\rS6\rO\r");
  }
  EXPECT_EQ(drained(pair.there), "C\r");
}

TEST(SerialPort, BitRatesAreThoseOfTheProtocol) {
  const std::array rates{10'000, 20'000, 50'000, 100'000, 125'000, 250'000, 500'000, 800'000, 1'000'000};
  for (std::size_t i = 0; i < rates.size(); ++i)
    EXPECT_EQ(hal::slcan_speed(rates.at(i)), static_cast<int>(i));
  for (const int r : {0, -1, 1, 83'333, 750'000, 1'000'001}) EXPECT_EQ(hal::slcan_speed(r), -1);
}

/// The line is not read until it is full, and then as slowly as can be: what was accepted is whole, and in
/// order.
TEST(SerialPort, AFullLineTakesWholeLinesOrNothing) {
  Pair pair;
  const int small = 1;  // the kernel makes of it the smallest that it has
  ASSERT_EQ(::setsockopt(pair.here, SOL_SOCKET, SO_SNDBUF, &small, sizeof small), 0);
  SerialPort port(pair.here);
  hal::SlcanBus bus(port);
  hal::SlcanDecoder decoder;
  std::uint32_t accepted = 0, heard = 0;
  bool was_full = false;
  CanFrame f;
  for (int n = 0; n < 20000; ++n) {
    const SendStatus s = bus.try_send(frame(accepted % 0x800U));
    ASSERT_TRUE(s == SendStatus::ok || s == SendStatus::bus_full);
    if (s == SendStatus::ok) ++accepted;
    was_full = was_full || s == SendStatus::bus_full;
    std::array<char, 7> part{};
    const ssize_t got = was_full ? ::read(pair.there, part.data(), part.size()) : 0;
    for (ssize_t i = 0; i < got; ++i) {
      if (!decoder.feed(part.at(static_cast<std::size_t>(i)), f)) continue;
      ASSERT_EQ(f.id, heard % 0x800U);
      ++heard;
    }
  }
  EXPECT_TRUE(was_full);
  for (int n = 0; n < 100; ++n) {
    for (const char c : drained(pair.there)) heard += decoder.feed(c, f) ? 1U : 0U;
    port.flush();
  }
  EXPECT_FALSE(port.has_output());
  EXPECT_EQ(heard, accepted);
}

TEST(SerialPort, APseudoTerminalPassesEveryByteUnchanged) {
  int master = -1, slave = -1;
  std::array<char, 256> name{};
  ASSERT_EQ(::openpty(&master, &slave, name.data(), nullptr, nullptr), 0);
  ASSERT_EQ(::fcntl(master, F_SETFL, O_NONBLOCK), 0);
  std::string why;
  {
    SerialPort port = SerialPort::open(name.data(), why);
    ASSERT_TRUE(port.is_open()) << why;
    ASSERT_TRUE(why.empty());
    EXPECT_FALSE(SerialPort::open(name.data(), why).is_open());
    EXPECT_NE(why.find("another program"), std::string::npos) << why;
    std::string all;
    for (int c = 0; c < 256; ++c) all.push_back(static_cast<char>(c));
    for (std::size_t i = 0; i < 256; i += 64)
      EXPECT_TRUE(port.try_write(std::span<const char>(all).subspan(i, 64)));
    EXPECT_EQ(drained(master), all);
    say(master, all);
    std::string got;
    char c = 0;
    while (port.try_read(c)) got.push_back(c);
    EXPECT_EQ(got, all);
    EXPECT_FALSE(port.gone());
    EXPECT_FALSE(port.try_write(std::string(65, 'x')));
  }
  ASSERT_TRUE(SerialPort::open(std::string(name.data()) + "@3000000", why).is_open()) << why;
  EXPECT_FALSE(SerialPort::open(std::string(name.data()) + "@123", why).is_open());
  EXPECT_NE(why.find("@123"), std::string::npos) << why;
  SerialPort port = SerialPort::open(name.data(), why);
  ::close(slave);
  ::close(master);
  char c = 0;
  EXPECT_FALSE(port.try_read(c));
  EXPECT_TRUE(port.gone());
}

class OnSlcan : public testing::Test {
 protected:
  OnSlcan() { (void)drained(pair_.there); }
  Pair pair_;
  HostBus bus_{"pair", std::make_unique<hal::SlcanAdapter>(SerialPort(pair_.here), 8)};
};

/// Two frames come in one piece: the system has nothing more to report, and the second one is there all the
/// same.
TEST_F(OnSlcan, WaitingKnowsOfFramesThatWereReadAlready) {
  CanFrame f;
  EXPECT_FALSE(wait_for_frame(bus_, 0));
  say(pair_.there, "t1000\rt2000\rt30");
  EXPECT_TRUE(wait_for_frame(bus_, 0));
  ASSERT_TRUE(bus_.try_receive(f));
  EXPECT_EQ(f.id, 0x100U);
  EXPECT_TRUE(wait_for_frame(bus_, 0));
  ASSERT_TRUE(bus_.try_receive(f));
  EXPECT_EQ(f.id, 0x200U);
  EXPECT_FALSE(bus_.try_receive(f));
  EXPECT_FALSE(wait_for_frame(bus_, 0));
  say(pair_.there, "00\r");
  EXPECT_TRUE(wait_for_frame(bus_, 0));
  ASSERT_TRUE(bus_.try_receive(f));
  EXPECT_EQ(f.id, 0x300U);
  EXPECT_EQ(bus_.frame_age_us(), 0U);
}

TEST_F(OnSlcan, AnEndThatIsGoneIsBusOffAndReadsToItsLastFrame) {
  EXPECT_EQ(bus_.try_send(frame(1)), SendStatus::ok);
  say(pair_.there, "t1000\r");
  pair_.close_there();
  CanFrame f;
  EXPECT_TRUE(bus_.try_receive(f));
  EXPECT_FALSE(bus_.try_receive(f));
  EXPECT_TRUE(bus_.gone());
  for (int n = 0; n < 3; ++n) EXPECT_EQ(bus_.try_send(frame(1)), SendStatus::bus_off);
  EXPECT_FALSE(wait_for_frame(bus_, 0));  // and not "readable" for ever
}

TEST_F(OnSlcan, AClosedEndIsSeenBySendingToo) {
  pair_.close_there();
  SendStatus s = SendStatus::ok;
  for (int n = 0; n < 3; ++n) s = bus_.try_send(frame(1));
  EXPECT_EQ(s, SendStatus::bus_off);
  EXPECT_TRUE(bus_.gone());
}

}  // namespace
}  // namespace esmc::host
