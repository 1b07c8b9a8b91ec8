/// Lines of a GPIO chip against a model of the kernel's interface.

#include "hal/linux/gpio_line.hpp"

#include <gtest/gtest.h>
#include <linux/gpio.h>

#include <cerrno>
#include <cstring>
#include <map>
#include <set>
#include <string>

#include "boards/linux/board.hpp"

namespace esmc {
namespace {

using hal::GpioLine;

/// /dev/gpiochip0 with 32 lines. Descriptors: 10 the chip, 100 + n line n.
struct Kernel {
  struct Line {
    bool requested = false, output = false, pulled_down = false, high = false;
    int writes = 0;
    std::string consumer;
  };
  std::map<int, Line> lines;
  std::set<int> open;
  int fails = 0;  ///< errno of every ioctl on a line; 0: none

  int request(gpio_v2_line_request& r) {
    if (r.num_lines != 1 || r.offsets[0] >= 32) return errno = EINVAL, -1;
    Line& l = lines[static_cast<int>(r.offsets[0])];
    if (l.requested) return errno = EBUSY, -1;
    l.requested = true;
    l.consumer = r.consumer;
    l.output = (r.config.flags & GPIO_V2_LINE_FLAG_OUTPUT) != 0;
    l.pulled_down = (r.config.flags & GPIO_V2_LINE_FLAG_BIAS_PULL_DOWN) != 0;
    if (l.output == ((r.config.flags & GPIO_V2_LINE_FLAG_INPUT) != 0)) return errno = EINVAL, -1;
    if (l.output) {
      if (r.config.num_attrs != 1 || r.config.attrs[0].attr.id != GPIO_V2_LINE_ATTR_ID_OUTPUT_VALUES)
        return errno = EINVAL, -1;
      l.high = (r.config.attrs[0].attr.values & r.config.attrs[0].mask & 1U) != 0;
    }
    r.fd = 100 + static_cast<int>(r.offsets[0]);
    open.insert(r.fd);
    return 0;
  }
  int values(int fd, unsigned long what, gpio_v2_line_values& v) {
    if (fails != 0) return errno = fails, -1;
    Line& l = lines[fd - 100];
    if (what == GPIO_V2_LINE_GET_VALUES_IOCTL) {
      v.bits = l.high ? v.mask : 0;
      return 0;
    }
    if (!l.output) return errno = EPERM, -1;
    l.high = (v.bits & v.mask & 1U) != 0;
    ++l.writes;
    return 0;
  }
};

Kernel* now = nullptr;
const hal::GpioKernel model{[](const char* path, int) {
                              return std::strcmp(path, "/dev/gpiochip0") == 0 ? (now->open.insert(10), 10)
                                                                              : (errno = ENOENT, -1);
                            },
                            [](int fd, unsigned long what, void* argument) {
                              if (!now->open.contains(fd)) return errno = EBADF, -1;
                              if (what == GPIO_V2_GET_LINE_IOCTL && fd == 10)
                                return now->request(*static_cast<gpio_v2_line_request*>(argument));
                              return now->values(fd, what, *static_cast<gpio_v2_line_values*>(argument));
                            },
                            [](int fd) {
                              if (fd >= 100) now->lines[fd - 100].requested = false;
                              return now->open.erase(fd) == 1 ? 0 : -1;
                            }};

class Gpio : public ::testing::Test {
 protected:
  Gpio() { now = &kernel; }
  Kernel kernel;
};

TEST_F(Gpio, AContactThatIsOpenOrCannotBeReadIsOpen) {
  GpioLine enable;
  EXPECT_TRUE(enable.closed()) << "not wired";
  ASSERT_FALSE(enable.request("gpiochip0:17", GpioLine::Use::contact, "enable", model));
  EXPECT_TRUE(kernel.lines[17].pulled_down);
  EXPECT_FALSE(kernel.lines[17].output);
  EXPECT_EQ(kernel.lines[17].consumer, "enable");
  EXPECT_FALSE(enable.closed());
  kernel.lines[17].high = true;
  EXPECT_TRUE(enable.closed());
  kernel.fails = EIO;
  EXPECT_FALSE(enable.closed());
}

TEST_F(Gpio, AnOutputIsLowFromTheRequestOnAndWrittenWhenItChanges) {
  kernel.lines[27].high = true;
  LinuxBoard::Output out;
  ASSERT_FALSE(out.line().request("gpiochip0:27", GpioLine::Use::output, "drive-enable", model));
  EXPECT_FALSE(kernel.lines[27].high);
  for (const bool high : {false, false, true, true, false, true}) {
    out.set(high);
    EXPECT_EQ(kernel.lines[27].high, high);
  }
  EXPECT_EQ(kernel.lines[27].writes, 4);
  kernel.fails = EIO;
  out.set(false);
  EXPECT_TRUE(kernel.lines[27].high) << "the kernel refused";
  kernel.fails = 0;
  out.set(false);
  EXPECT_FALSE(kernel.lines[27].high) << "asked again";
}

TEST_F(Gpio, TheLineIsGivenBackAndTheChipIsNotKept) {
  {
    GpioLine one, two;
    ASSERT_FALSE(one.request("gpiochip0:5", GpioLine::Use::output, "brake", model));
    EXPECT_EQ(kernel.open, std::set<int>{105});
    EXPECT_EQ(two.request("gpiochip0:5", GpioLine::Use::contact, "enable", model),
              std::errc::device_or_resource_busy);
    EXPECT_FALSE(two.is_open());
    EXPECT_EQ(one.request("gpiochip0:6", GpioLine::Use::output, "brake", model), std::errc::invalid_argument)
        << "once";
  }
  EXPECT_TRUE(kernel.open.empty());
}

TEST_F(Gpio, WhatIsNoPlaceIsRefused) {
  for (const char* place :
       {"", ":", "gpiochip0", "gpiochip0:", ":4", "gpiochip0:x", "gpiochip0:4x", "gpiochip0:-1", "../mem:1",
        "/dev/gpiochip0:4", "gpiochip0:4294967296", "watchdog:0"}) {
    GpioLine line;
    EXPECT_EQ(line.request(place, GpioLine::Use::output, "brake", model), std::errc::invalid_argument)
        << place;
  }
  GpioLine line;
  EXPECT_EQ(line.request("gpiochip9:1", GpioLine::Use::output, "brake", model),
            std::errc::no_such_file_or_directory);
  EXPECT_EQ(line.request("gpiochip0:32", GpioLine::Use::output, "brake", model), std::errc::invalid_argument);
  EXPECT_TRUE(kernel.open.empty());
}

}  // namespace
}  // namespace esmc
