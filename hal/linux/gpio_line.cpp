#include "hal/linux/gpio_line.hpp"

#include <fcntl.h>
#include <linux/gpio.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <cstdint>
#include <cstring>

namespace esmc::hal {
namespace {

struct Place {
  std::string path;
  std::uint32_t offset;
};

/// Empty path: not valid.
Place parse(const std::string& text) {
  Place p{{}, 0};
  const std::size_t colon = text.rfind(':');
  // No other devices: opening one may have an effect.
  if (colon == std::string::npos || !text.starts_with("gpiochip") || text.find('/') != std::string::npos)
    return p;
  const char* const end = text.data() + text.size();
  const auto [stop, wrong] = std::from_chars(text.data() + colon + 1, end, p.offset);
  if (wrong == std::errc{} && stop == end) p.path = "/dev/" + text.substr(0, colon);
  return p;
}

std::error_code last_error() { return {errno, std::generic_category()}; }

}  // namespace

const GpioKernel gpio_kernel{
    [](const char* path, int flags) { return ::open(path, flags); },
    [](int fd, unsigned long request, void* argument) { return ::ioctl(fd, request, argument); },
    [](int fd) { return ::close(fd); }};

GpioLine::~GpioLine() {
  if (line_ >= 0) kernel_->close(line_);
}

std::error_code GpioLine::request(const std::string& place, Use use, const char* consumer,
                                  const GpioKernel& kernel) {
  const Place p = parse(place);
  if (p.path.empty() || line_ >= 0) return std::make_error_code(std::errc::invalid_argument);
  const int chip = kernel.open(p.path.c_str(), O_RDONLY | O_CLOEXEC);
  if (chip < 0) return last_error();
  gpio_v2_line_request r{};
  r.offsets[0] = p.offset;
  r.num_lines = 1;
  std::strncpy(r.consumer, consumer, sizeof r.consumer - 1);
  if (use == Use::contact) {
    r.config.flags = GPIO_V2_LINE_FLAG_INPUT | GPIO_V2_LINE_FLAG_BIAS_PULL_DOWN;
  } else {
    r.config.flags = GPIO_V2_LINE_FLAG_OUTPUT;
    r.config.num_attrs = 1;
    r.config.attrs[0].mask = 1;
    r.config.attrs[0].attr.id = GPIO_V2_LINE_ATTR_ID_OUTPUT_VALUES;
    r.config.attrs[0].attr.values = 0;
  }
  const std::error_code wrong =
      kernel.ioctl(chip, GPIO_V2_GET_LINE_IOCTL, &r) < 0 ? last_error() : std::error_code{};
  kernel.close(chip);
  if (wrong) return wrong;
  kernel_ = &kernel;
  line_ = r.fd;
  return {};
}

bool GpioLine::closed() const {
  if (line_ < 0) return true;
  gpio_v2_line_values v{.bits = 0, .mask = 1};
  return kernel_->ioctl(line_, GPIO_V2_LINE_GET_VALUES_IOCTL, &v) == 0 && (v.bits & 1U) != 0;
}

bool GpioLine::set(bool high) const {
  if (line_ < 0) return true;
  gpio_v2_line_values v{.bits = high ? 1U : 0U, .mask = 1};
  return kernel_->ioctl(line_, GPIO_V2_LINE_SET_VALUES_IOCTL, &v) == 0;
}

}  // namespace esmc::hal
